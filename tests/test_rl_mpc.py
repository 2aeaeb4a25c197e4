"""Model predictive control: its plans are motions of the chain, optimal, and it swings up."""

import gymnasium as gym
import numpy as np
import pytest
from scipy.optimize import minimize

from npend_gym import Chain
from npend_gym.envs import EnvConfig
from npend_gym.rl import MPC, evaluate, lqr
from npend_gym.rl.controllers.ilqr import ILQR, Cost, _bounded_minimum
from npend_gym.rl.controllers.step_model import StepModel


def info_of(states, time=0.0):
    theta, omega = np.split(np.atleast_2d(states), 2, axis=1)
    return {"theta": theta, "omega": omega, "time": np.full(len(theta), time)}


@pytest.mark.long
def test_about_upright_the_gains_are_those_of_the_linear_quadratic_regulator():
    config = EnvConfig(n=2, mode="balance", damping=0.1)
    upright = np.array([[np.pi, np.pi, 0.0, 0.0]])
    method = ILQR(Cost(config, upright[0], action_weight=2.0, last=10.0))
    begun = method.begin(upright, np.zeros((400, 1)), upright, np.zeros((1, 4)))
    # the guess must stay upright for 8 s, so that rounding errors are held by feedback
    held = method.begin(upright, np.zeros((400, 1)), upright, lqr(config).gain)
    gains = method.improve(held._replace(damping=0.0 * begun.damping)).gains
    expected = lqr(config, action_weight=2.0).gain
    np.testing.assert_allclose(gains[0, 0], expected, rtol=1e-4)


def test_the_bounded_minimum_is_that_of_a_general_method():
    rng = np.random.default_rng(1)
    root = rng.normal(size=(40, 2, 2))
    hessian = root @ np.swapaxes(root, 1, 2) + 0.1 * np.eye(2)
    gradient, low = rng.normal(size=(40, 2)), rng.uniform(-0.8, 0.0, (40, 2))
    both = rng.normal(size=(40, 2, 4))
    change, gains = _bounded_minimum(hessian, gradient, both, low, low + 0.8)
    held = (change == low) | (change == low + 0.8)
    assert 10 < held.sum() < 70
    for k in range(40):

        def value(x, k=k):
            return gradient[k] @ x + 0.5 * x @ hessian[k] @ x

        bounds = list(zip(low[k], low[k] + 0.8, strict=True))
        best = minimize(value, np.clip(0.0, *np.transpose(bounds)), bounds=bounds, tol=1e-12)
        assert value(change[k]) <= best.fun + 1e-7
        assert (gains[k][held[k]] == 0.0).all()


def test_a_plan_is_the_motion_of_the_environment_bit_for_bit():
    envs = gym.make_vec("NPendulum-v0", num_envs=3, n=2, mode="swingup")
    controller = MPC(envs.unwrapped.config, first_iterations=5)
    observation, info = envs.reset(seed=0)
    for _ in range(3):
        action = controller(observation, info)
        assert action.shape == (3, 1)
        assert (np.abs(action) <= 1.0).all()
        planned = controller.plans.states[1]
        observation, _, _, _, info = envs.step(action)
        np.testing.assert_array_equal(np.hstack([info["theta"], info["omega"]]), planned)


@pytest.mark.long  # derivatives of steps on a cart take long to compile
@pytest.mark.parametrize(
    ("settled", "keywords"),
    [
        (3.0, {"n": 1}),
        (4.0, {"n": 2}),
        (2.0, {"n": 2, "actuated": (0, 1)}),
        (4.5, {"n": 1, "base": "cart"}),
        (8.0, {"n": 2, "base": "cart"}),
        (3.0, {"n": 2, "base": "cart", "actuated": (0, 1)}),
    ],
)
def test_it_swings_up_in_held_out_episodes(settled, keywords):
    keywords = {"mode": "swingup"} | keywords
    controller = MPC(EnvConfig(**keywords))
    steps = round((settled + 5.5) / 0.05)
    evaluation = evaluate(controller, keywords | {"max_episode_steps": steps}, episodes=4)
    assert evaluation.success_rate == 1.0
    assert (evaluation.settling_time - 5.0).max() < settled  # success is 5 s upright


@pytest.mark.long
@pytest.mark.nightly
@pytest.mark.parametrize("noise", [0.0, 0.05])  # N m, of 2
def test_it_swings_up_a_chain_with_dry_friction_under_noise_of_the_torque(noise):
    keywords = {
        "chain": Chain.rods([0.3, 0.3], [0.3, 0.3], friction=[0.029, 0.0058]),
        "mode": "swingup", "max_torque": 2.0, "dt": 0.02,
    }  # fmt: skip
    controller = MPC(EnvConfig(**keywords))
    noisy = keywords | {"torque_noise": noise, "max_episode_steps": 500}
    assert evaluate(controller, noisy, episodes=8).success_rate == 1.0


@pytest.mark.long
def test_it_recovers_from_kicks_after_which_the_regulator_stays_down():
    kicks = np.linspace(0.8, 3.0, 8)[:, None] * np.ones(2)  # rad/s
    start = {"theta": np.full((8, 2), np.pi), "omega": kicks}
    envs = gym.make_vec("NPendulum-v0", num_envs=8, n=2, mode="swingup")
    config, success = envs.unwrapped.config, []
    for controller in (lqr(config), MPC(config)):
        observation, info = envs.reset(seed=0, options=start)
        for _ in range(220):
            action = np.clip(controller(observation, info), -1.0, 1.0)
            observation, _, _, _, info = envs.step(action)
        success.append(info["success"].sum())
    assert success == [0, 8]


@pytest.mark.long
def test_without_gravity_rods_come_to_rest_too():
    config = EnvConfig(n=1, mode="swingup", gravity=0.0, max_torque=1.0)
    controller, step, states = MPC(config, horizon=3.0), StepModel(config), np.array([[0.0, 1.0]])
    for k in range(160):
        states = step(states, controller(None, info_of(states, k * config.dt)))
    np.testing.assert_allclose(states, [[np.pi, 0.0]], atol=1e-3)


@pytest.mark.long
def test_rods_come_to_rest_at_the_angles_that_are_asked_for():
    goal = [0.0, np.pi]  # the second rod stands on the first, which hangs
    config = EnvConfig(n=2, mode="swingup", actuated=(0, 1))
    controller, step = MPC(config, goal), StepModel(config)
    states = np.array([[0.1, 0.2, 0.0, 0.0]])
    for k in range(120):
        states = step(states, controller(None, info_of(states, k * config.dt)))
    np.testing.assert_allclose(np.cos(states[0, :2]), np.cos(goal), atol=1e-4)
    np.testing.assert_allclose(states[0, 2:], 0.0, atol=1e-2)


@pytest.mark.long
def test_environments_are_independent_of_each_other_and_a_new_episode_is_planned_anew():
    config = EnvConfig(n=2, mode="swingup")
    states = np.random.default_rng(0).normal(2.5, 1.0, (3, 4))
    together, step = MPC(config, horizon=1.0, first_iterations=3), StepModel(config)
    begun = together(None, info_of(states))
    alone = MPC(config, horizon=1.0, first_iterations=3)
    np.testing.assert_allclose(alone(None, info_of(states[1])), begun[1:2], atol=1e-9)
    info = info_of(step(states, begun), config.dt)
    info["time"][1], info["theta"][1], info["omega"][1] = 0.0, *np.split(states[1], 2)
    after = together(None, info)
    np.testing.assert_allclose(after[1], begun[1], atol=1e-9)
    second = info_of(step(states[1:2], begun[1:2]), config.dt)
    fresh = MPC(config, horizon=1.0, first_iterations=3)
    alone(None, second), fresh(None, second)
    assert abs(alone.plans.actions - fresh.plans.actions).max() > 1e-3
    together.reset()
    np.testing.assert_allclose(together(None, info_of(states)), begun, atol=1e-9)


def test_plans_belong_to_the_environments_that_are_named():
    config = EnvConfig(n=2, mode="swingup")
    states, step = np.random.default_rng(1).normal(2.5, 1.0, (4, 4)), StepModel(config)
    every, some = (MPC(config, horizon=0.5, first_iterations=3) for _ in range(2))
    begun_at_first = [0, 2], [0, 2], [2], [2]  # and named in every step since
    for k, lanes in enumerate(map(np.array, ([0, 2], [0, 1, 2], [1, 2, 3], [0, 2]))):
        time = np.full(4, k * config.dt)
        actions = every.plan(states, time)
        found = some.plan(states[lanes], time[lanes], lanes)
        same = np.isin(lanes, begun_at_first[k])
        difference = np.abs(found - actions[lanes]).max(axis=1)
        assert (difference[same] < 1e-9).all()
        assert (difference[~same] > 1e-6).all()
        states = step(states, actions)


@pytest.mark.parametrize(
    ("env", "arguments", "message"),
    [
        ({"mode": "passive"}, {}, 'the environment must have motors, got mode "passive"'),
        ({"gravity": 0.0}, {}, "horizon must be given for a chain without a period"),
        ({}, {"horizon": -1.0}, "horizon must be greater than zero, got -1.0"),
        ({}, {"horizon": 1e25}, r"horizon must be at most 50000 s, .* got 1e\+25"),
        ({}, {"iterations": 0}, "iterations must be at least 1, got 0"),
        ({}, {"first_iterations": 0}, "first_iterations must be at least 1, got 0"),
        ({}, {"angle": np.nan}, "angle must be finite"),
        ({}, {"angle": [0.0, 1.0, 2.0]}, r"angle must be one number or an array of shape \(2,\)"),
        ({}, {"action_weight": 0.0}, "action_weight must be greater than zero"),
        ({}, {"last_weight": 0.0}, "last_weight must be greater than zero"),
        ({}, {"seed": -1}, "seed must be at least 0"),
    ],
)
def test_bad_arguments_are_named(env, arguments, message):
    config = EnvConfig(**({"n": 2, "mode": "swingup"} | env))
    with pytest.raises(ValueError, match=message):
        MPC(config, **arguments)


def test_a_state_of_another_chain_is_refused():
    controller = MPC(EnvConfig(n=2, mode="swingup"), horizon=0.5)
    with pytest.raises(ValueError, match=r'info\["theta"\] must have the shape \(B, 2\)'):
        controller(None, info_of(np.zeros((4, 6))))
    cart = {"cart_position": np.zeros(1), "cart_velocity": np.zeros(1)}
    with pytest.raises(ValueError, match='info must not have "cart_position" and "cart_velocity"'):
        controller(None, info_of(np.zeros(4)) | cart)
    with pytest.raises(ValueError, match="theta must be finite"):
        controller(None, info_of(np.full((1, 4), np.nan)))


def test_a_horizon_that_diverges_is_an_error_that_names_the_step():
    controller = MPC(EnvConfig(n=3, mode="swingup", dt=1.0, substeps=1), horizon=5.0)
    with pytest.raises(FloatingPointError, match=r"in step [1-4] of the horizon"):
        controller(None, info_of(np.full((2, 6), 0.1)))
