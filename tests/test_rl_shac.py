"""SHAC: its gradients are those of the environment, and it learns from them."""

from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest

from npend_gym import Cart, Chain
from npend_gym.envs import EnvConfig, Mode
from npend_gym.envs.modes import SwingUp
from npend_gym.rl import evaluate, recovery

torch = pytest.importorskip("torch")

from npend_gym.rl.training import shac  # noqa: E402
from npend_gym.rl.training.keywords import with_wider_ranges  # noqa: E402
from npend_gym.rl.training.knock_downs import knocked_down  # noqa: E402
from npend_gym.rl.training.shac import Learner, Settings, settings_of, train  # noqa: E402
from npend_gym.rl.training.short_horizons import (  # noqa: E402
    Collector,
    TensorTask,
)
from npend_gym.rl.training.tasks import env_of_task  # noqa: E402
from npend_gym.torch import DifferentiableVectorEnv  # noqa: E402


def made(**changes):
    """Return settings, configuration, task, collector and learner of a small run."""
    small = {"num_envs": 4, "horizon": 6, "batch_size": 8, "total_timesteps": 48}
    settings = settings_of("swingup-2", **(small | changes))
    torch.manual_seed(settings.seed)
    config = EnvConfig(**settings.env)
    task = TensorTask(config, settings.gamma, settings.obs_scale)
    collector = Collector(config, task, settings)
    return settings, config, task, collector, Learner(task, 1, settings)


@pytest.mark.long  # the kernels of gradients take long to compile
def test_the_gradient_along_the_jacobians_is_that_through_the_environment():
    """Taken again by the actor that took it, a horizon and its gradient are the simulated ones."""
    settings, _, task, collector, learner = made()
    horizons = collector.collect(learner.actor, exploration=0.0)
    states, outputs, near = learner.replay(horizons)
    np.testing.assert_allclose(torch.stack(states, 1).detach(), horizons.states, atol=1e-5)
    assert near.all()
    parameters = [*learner.actor.parameters()]
    rewards = task.reward(torch.stack(states[1:], 1), outputs.tanh(), horizons.context)
    along = torch.autograd.grad(rewards.sum() / (1.0 - settings.gamma), parameters)
    envs = DifferentiableVectorEnv(4, **settings.env)
    theta, omega = horizons.states[:, 0].double().numpy().reshape(4, 2, 2).swapaxes(0, 1)
    observation, _ = envs.reset(options={"theta": theta, "omega": omega})
    total = torch.zeros(())
    for _ in range(settings.horizon):
        action = learner.actor((observation / task.obs_scale).float()).tanh()
        observation, reward, _, _, _ = envs.step(action.double())
        total = total + reward.sum()
    through = torch.autograd.grad(total, parameters)
    for one, other in zip(along, through, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-3, atol=1e-3 * float(other.abs().max()))


def test_a_horizon_ends_where_its_jacobians_no_longer_hold():
    _, _, _, collector, learner = made(trust=0.05)
    horizons = collector.collect(learner.actor, exploration=0.5)
    states, _, near = learner.replay(horizons)
    away = (torch.stack(states, 1) - horizons.states).abs() / learner.task.state_scale
    within = away.amax(-1) < 0.05
    assert 0.0 < near.mean() < 1.0
    np.testing.assert_array_equal(near > 0, within.cummin(1).values)


def test_a_share_of_the_reward_is_for_a_tip_where_recovery_counts_it_as_up():
    config = EnvConfig(n=2, mode="swingup", observation="sincos")
    usual, other = (TensorTask(config, 0.9, (1.0, 1.0, 5.0), share) for share in (0.0, 0.7))
    angles = np.arccos(-np.array([-1.0, 0.7, 0.9, 1.0]))  # of both rods: the tip in lengths
    states = torch.tensor(np.stack([angles, angles, 0.0 * angles, 0.0 * angles], 1)).float()
    none = torch.zeros(4, 1), torch.zeros(4, 0)
    counted = (other.reward(states, *none) - 0.3 * usual.reward(states, *none)) / 0.1
    expected = 0.7 / (1.0 + np.exp(-np.array([-1.9, -0.2, 0.0, 0.1]) / 0.04))
    np.testing.assert_allclose(counted, expected, atol=1e-5)


def test_joints_cost_reward_beyond_their_largest_speed_alone():
    config = EnvConfig(n=2, mode="swingup", observation="sincos")
    usual, other = (TensorTask(config, 0.9, (1.0, 1.0, 5.0), 0.0, most) for most in (0.0, 8.0))
    speeds = np.array([[1.0, -5.0], [8.0, 0.0], [-12.0, -10.0], [2.0, -10.0]])  # of the rods
    states = torch.tensor(np.hstack([np.full((4, 2), 0.3), speeds])).float()
    none = torch.zeros(4, 1), torch.zeros(4, 0)
    cost = (usual.reward(states, *none) - other.reward(states, *none)) / 0.1
    # joints turn at 1 and -6, 8 and -8, -12 and 2, 2 and -12 rad/s
    np.testing.assert_allclose(cost, [0.0, 0.0, 10.0, 10.0], atol=1e-4)


@pytest.mark.parametrize(("changes", "message"), [
    ({"memory": 100}, "memory must be at least 320"),
    ({"updates": 0}, "updates must be"),
    ({"horizon": 0}, "horizon must be"),
    ({"gamma": 1.0}, "gamma must lie from 0 to below 1"),
    ({"uptime": 1.0}, "uptime must lie from 0 to below 1"),
    ({"gamma": 0.0}, "gamma to the power of horizon must be greater than zero"),
    ({"gamma": 1e-5}, "gamma to the power of horizon must be at least 1e-30"),
    ({"trust": 0.0}, "trust must be greater than zero"),
    ({"knocked": 2.0}, "knocked must lie from 0 to 1, got 2.0"),
    ({"rule": "robot"}, "rule must be one of"),
    ({"tau": 3.0}, "tau must lie from 0 to 1, got 3.0"),
])  # fmt: skip
def test_settings_that_cannot_teach_are_refused_by_name(changes, message):
    with pytest.raises(ValueError, match=message):
        train(settings_of("swingup-1", **changes))


CARTS = {
    "balance": {"n": 2, "mode": "balance", "base": "cart", "observation": "sincos"},
    "calm": {"n": 1, "mode": "calm", "base": "cart", "observation": "sincos"},
    "links, elbow": {
        "chain": Chain([1.0, 0.6], [0.8, 0.5], centres=0.3, inertias=0.02, base=Cart(2.0)),
        "mode": "swingup", "actuated": (1,), "observation": "sincos",
    },
}  # fmt: skip


@pytest.mark.parametrize("task", CARTS)
def test_rewards_and_ends_on_carts_are_those_of_the_environment(task):
    env = CARTS[task] | {"spread": 0.0}
    config, rng, gamma = EnvConfig(**env), np.random.default_rng(1), 0.9
    in_torch = TensorTask(config, gamma, (1.0, 1.0, 5.0))
    envs = gym.make_vec("NPendulum-v0", num_envs=8, **env)
    near = 0.0 if task == "calm" else np.pi
    envs.reset(
        options={
            "theta": near + rng.normal(0.0, 0.6, (8, config.n)),
            "omega": rng.normal(0.0, 2.0, (8, config.n)),
            "cart_position": 0.99 * config.rail * np.resize([1.0, -1.0], 8),
            "cart_velocity": np.repeat([-4.0, 4.0], 4),  # some leave the rail
        }
    )
    action = rng.uniform(-1.0, 1.0, (8, config.joints.size)).astype(np.float32)
    observation, reward, terminated, _, info = envs.step(action)
    cart = [info[name][:, None] for name in ("cart_position", "cart_velocity")]
    state = np.hstack([info["theta"], cart[0], info["omega"], cart[1]])
    states = torch.from_numpy(state).float()
    if task != "calm":  # whose reward is of the energy at the start, another one in training
        found = in_torch.reward(states, torch.from_numpy(action), torch.zeros(8, 0))
        np.testing.assert_allclose(found / (1.0 - gamma), reward, rtol=1e-4, atol=1e-6)
    np.testing.assert_array_equal(in_torch.ended(states, torch.zeros(8, 0)), terminated)
    assert terminated.any()
    assert not terminated.all()
    shown = in_torch.observe(states, torch.zeros(8, 0)) * in_torch.obs_scale
    np.testing.assert_allclose(shown, observation, atol=1e-5)


@pytest.mark.parametrize("energyless", [{"gravity": 0.0}, {"amplitude": 0.0}])
def test_a_chain_that_is_calmed_from_no_energy_has_the_rewards_of_the_environment(energyless):
    env = {"n": 2, "mode": "calm", "observation": "sincos", "spread": 0.0} | energyless
    envs = gym.make_vec("NPendulum-v0", num_envs=2, **env)
    envs.reset(seed=0)
    in_torch = TensorTask(EnvConfig(**env), 0.9, (1.0, 1.0, 5.0))
    actions = torch.tensor([[1.0], [-0.5]])
    for _ in range(3):
        expected = envs.step(actions.numpy())[1]
        states = torch.from_numpy(envs.unwrapped.state).float()
        found = in_torch.reward(states, actions, torch.zeros(2, 0)) / 0.1
        np.testing.assert_allclose(found, expected, rtol=1e-5)


VARIED = {
    "chains": {"n": 2, "mode": "swingup", "randomize": {"masses": (0.7, 1.3), "gravity": (0.8, 1.2),
               "max_torque": (0.5, 1.5), "damping": {"low": 0.0, "high": 0.1}}},
    "chains, observed": {"n": 2, "mode": "balance", "observe_context": True,
                         "randomize": {"lengths": (0.7, 1.3)}},
    "goals": {"n": 2, "mode": "transition"},
    "links on a cart, goals": {
        "chain": Chain([1.0, 0.6], [0.8, 0.5], centres=0.3, inertias=0.02, base=Cart(2.0)),
        "mode": "transition", "randomize": {"inertias": (0.5, 2.0)},
    },
}  # fmt: skip


@pytest.mark.long  # the kernels of tensor environments take long to compile
@pytest.mark.parametrize("kind", VARIED)
def test_what_differs_between_episodes_is_known_to_rewards_observations_and_steps(kind):
    """Steps of the trainer's own lanes, and those of the tensor environment with the same draws."""
    env = VARIED[kind] | {"observation": "sincos"}
    settings, config = Settings(env=env, num_envs=6, horizon=3), EnvConfig(**env)
    torch.manual_seed(0)
    task = TensorTask(config, settings.gamma, settings.obs_scale)
    collector = Collector(config, task, settings)
    envs = DifferentiableVectorEnv(6, **env)
    envs.reset(seed=0)  # the first seed of the training episodes of seed 0
    began, c = torch.from_numpy(collector.states), config.state_size // 2
    envs.state = began[:, :c], began[:, c:]
    net = torch.nn.Linear(task.inputs, config.joints.size)
    context = collector.context
    horizon = collector.collect(net, exploration=0.5)
    assert (horizon.context == context).all()
    for t in range(3):
        observation, reward, terminated, _, _ = envs.step(horizon.actions[:, t].double())
        states = horizon.states[:, t + 1]
        found = torch.cat(envs.state, dim=1)
        np.testing.assert_allclose(states, found, rtol=1e-4, atol=1e-4)
        shown = task.observe(states, context) * task.obs_scale
        np.testing.assert_allclose(shown, observation, rtol=1e-4, atol=2e-4)
        own = task.reward(states, horizon.actions[:, t], context) / (1.0 - settings.gamma)
        np.testing.assert_allclose(own, reward, rtol=1e-3, atol=1e-4)
        np.testing.assert_array_equal(task.ended(states, context), terminated)


@pytest.mark.long
@pytest.mark.parametrize(
    "task", ["swingup-1", pytest.param("swingup-1-cart", marks=pytest.mark.nightly)]
)
def test_shac_learns_to_swing_up_one_rod_in_twenty_thousand_steps(task):
    policy, curve = train(settings_of(task))
    assert curve[-1]["steps"] <= 20_000
    assert evaluate(policy, policy.env).success_rate == 1.0


def test_ranges_are_wider_in_training_than_in_the_record():
    ranges = {"masses": (0.8, 1.2), "gravity": (0.5, 1.0), "damping": {"low": 0.0, "high": 0.1}}
    config = EnvConfig(n=2, mode="swingup", randomize=ranges)
    wider = with_wider_ranges(config, 0.5)
    ends = {name: [*wider.randomize[name].values()] for name in ranges}
    np.testing.assert_allclose(ends["masses"], [[0.7, 0.7], [1.3, 1.3]])
    np.testing.assert_allclose(ends["gravity"], [[9.81 * 0.375], [9.81 * 1.125]])
    np.testing.assert_allclose(ends["damping"], [[0.0, 0.0], [0.125, 0.125]])
    assert with_wider_ranges(config, 0.0) is config
    with pytest.raises(ValueError, match=r"margin must be smaller .* got 5: randomize\['masses'\]"):
        with_wider_ranges(config, 5.0)
    few = {"total_timesteps": 320, "num_envs": 8, "updates": 1, "margin": 0.5}
    policy, _ = train(settings_of("swingup-1-robust", **few))
    assert policy.env["randomize"]["masses"] == [0.8, 1.2]


@pytest.mark.nightly
@pytest.mark.long
def test_shac_learns_from_links_that_start_as_a_knock_leaves_them():
    settings = settings_of("swingup-2-pendubot", total_timesteps=32_000)
    policy, curve = train(settings)
    assert curve[-1]["success"] == 1.0
    assert policy.env["chain"]["inertias"] != [0.0, 0.0]
    assert recovery(policy, policy.env, episodes=5).score > 0.6


@pytest.mark.long
@pytest.mark.parametrize("turns", [0.0, 1.0])
@pytest.mark.parametrize(
    ("rule", "steps", "stiffness", "most", "damping"),
    [("simulation", 10, 10.0, np.inf, 1.0), ("hardware", 50, 2.0, 3.0, 0.6)],
)
def test_starts_are_states_in_which_the_motors_of_recovery_leave_an_upright_chain(
    rule, steps, stiffness, most, damping, turns
):
    keywords = env_of_task("swingup-2-pendubot")
    config = EnvConfig(**keywords)
    found = knocked_down(config, np.random.default_rng(0), count=4, rule=rule, turns=turns)
    rng = np.random.default_rng(0)
    goal = rng.uniform(-np.pi, np.pi, (4, 2))
    theta, omega = rng.normal(np.pi, 0.05, (4, 2)), rng.normal(0.0, 0.2, (4, 2))
    upright = np.diff(theta, prepend=0.0)
    goal = upright + np.angle(np.exp(1j * (goal - upright)))
    if turns > 0.0:
        whole = np.rint(rng.normal(0.0, turns, (4, 2)))
        assert whole.any()
        goal += 2.0 * np.pi * whole
    env = gym.make("NPendulum-v0", **keywords, actuated=(0, 1))
    for k in range(4):
        _, info = env.reset(options={"theta": theta[k], "omega": omega[k]})
        for _ in range(steps):  # of 0.02 s
            joints, speeds = (np.diff(info[key], prepend=0.0) for key in ("theta", "omega"))
            weights = 9.81 * config.chain.lift * np.sin(info["theta"])
            pull = np.clip(stiffness * (goal[k] - joints), -most, most)
            torque = pull - damping * speeds + [weights.sum(), weights[1]]  # N m
            info = env.step(np.clip(torque / 6.0, -1.0, 1.0))[-1]
        reached = np.concatenate([info["theta"], info["omega"]])
        np.testing.assert_allclose(found[k], reached, rtol=1e-5, atol=1e-5)
    env.close()


@pytest.mark.parametrize(("successes", "chosen"), [([0.5, 1.0, 0.2], 1), ([0.5, 1.0, 0.95], 2)])
def test_a_run_that_forgets_what_it_had_learned_returns_its_best_policy(
    monkeypatch, successes, chosen
):
    played = []

    def trial(policy, *_, **__):
        played.append(policy)
        return SimpleNamespace(returns=np.ones(2), success_rate=successes[len(played) - 1])

    monkeypatch.setattr(shac, "evaluate", trial)
    few = {"total_timesteps": 240, "num_envs": 8, "updates": 1}
    settings = settings_of("swingup-1", **few)
    policy, curve = train(settings)
    assert [row["success"] for row in curve] == successes
    for mine, theirs in zip(policy.weights, played[chosen].weights, strict=True):
        np.testing.assert_array_equal(mine, theirs)
    assert policy.provenance["training"]["success"] == successes[chosen]
    assert policy.provenance["training"]["steps"] == 80 * (chosen + 1)


def test_a_task_that_draws_its_start_in_python_can_be_learned():
    class Anywhere(SwingUp):
        def start(self, rng, n, *_):
            return rng.uniform(1.0, 2.0, n), np.zeros(n)

    env = {"n": 2, "mode": Anywhere(), "observation": "sincos"}
    settings, config = Settings(env=env, num_envs=64), EnvConfig(**env)
    collector = Collector(config, TensorTask(config, settings.gamma, settings.obs_scale), settings)
    theta, omega = np.split(collector.states, 2, axis=1)
    as_the_task = ((theta >= 1.0) & (theta < 2.0) & (omega == 0.0)).all(axis=1)
    assert 0.1 < as_the_task.mean() < 0.5  # a quarter


class Turn(Mode):
    """Turn in one direction."""

    dt, torque_share = 0.05, 1.5

    def start(self, rng, n, *_):
        return rng.uniform(-0.1, 0.1, n), np.zeros(n)

    def reward(self, quantities):
        speed = quantities.omega[..., 0] / 10.0
        return 0.5 + 0.5 * speed / (1.0 + abs(speed))


class Exponential(Turn):
    name = "exponential"

    def reward(self, quantities):
        return np.exp(-quantities.energy)


class Constant(Turn):
    name = "constant"

    def reward(self, quantities):
        return 1.0 * (quantities.tip > 0.0)


@pytest.mark.long
def test_a_mode_of_the_users_own_is_learned():
    env = {"n": 1, "mode": Turn(), "observation": "sincos"}
    policy, _ = train(Settings(env=env, total_timesteps=8000))
    found, least = (
        evaluate(each, env, episodes=5).returns.mean()
        for each in (policy, lambda observation, _: np.zeros((len(observation), 1), np.float32))
    )
    assert found > 1.2 * least


@pytest.mark.parametrize("mode", [Exponential(), Constant()], ids=str)
def test_a_reward_without_a_gradient_is_refused(mode):
    with pytest.raises(ValueError, match=f"reward of mode '{mode.name}' must have a gradient"):
        train(Settings(env={"n": 1, "mode": mode, "observation": "sincos"}))
