"""Units of the first layer that begin as the feedback along plans."""

import dataclasses

import numpy as np
import pytest

from npend_gym.envs import EnvConfig
from npend_gym.rl import observation_of
from npend_gym.rl.controllers.tracking import track
from npend_gym.rl.controllers.transcription import NominalTrajectory

pytestmark = pytest.mark.long

torch = pytest.importorskip("torch")

from npend_gym.rl.training import imitation  # noqa: E402
from npend_gym.rl.training.chain_plans import PlanTracker  # noqa: E402

STEPS, COUNT = 12, 10
ENVS = {
    "pivot": {"n": 2, "actuated": (0, 1), "max_torque": 7.0},
    "cart": {"n": 2, "base": "cart", "max_force": 15.0},
}


def expert_of(env, ends, mode="swingup"):
    """Return plans that are motions of no chain, but have feedback all the same."""
    config = EnvConfig(**{"observation": "sincos", "mode": mode} | env)
    rng, plans = np.random.default_rng(0), []
    for start, goal in ends:
        c, blend = config.state_size // 2, np.linspace(0.0, 1.0, STEPS + 1)[:, None]
        states = np.zeros((STEPS + 1, 2 * c))
        states[:, : config.n] = np.pi * ((1.0 - blend) * start + blend * np.asarray(goal))
        states[1:-1] += 0.3 * rng.normal(size=(STEPS - 1, 2 * c))
        actions = np.zeros((STEPS, config.joints.size))
        plans.append(track(config, NominalTrajectory(states, actions), 0.0))
    return config, plans


def dagger_of(env, ends=(((0, 0), (1, 1)),), **changes):
    mode = "transition" if len(ends) > 1 else "swingup"
    config, plans = expert_of(env, ends, mode)
    own = {"observation": "sincos", "mode": mode} | env
    small = {"num_envs": 4, "hidden": 16, "feedback_units": COUNT, "rounds": 2}
    settings = imitation.Settings(env=own, **small | changes)
    pairs = ends if mode == "transition" else ()
    torch.manual_seed(0)
    return config, plans, imitation.DAgger(settings, PlanTracker(config, plans, pairs=pairs))


def units(network, inputs):
    """Return what the units of the first layer are given, (B, units)."""
    with torch.no_grad():
        return network[0](inputs).numpy()


def observed(config, states, **given):
    n = config.n
    if config.has_cart:
        given |= {"cart_position": states[:, n], "cart_velocity": states[:, -1]}
    c = config.state_size // 2
    return observation_of(config, states[:, :n], states[:, c : c + n], **given)


@pytest.mark.parametrize("length", [1, 3])
@pytest.mark.parametrize("env", ENVS)
def test_units_tell_what_the_feedback_of_a_step_of_the_plan_would_do(env, length):
    config, (plan,), dagger = dagger_of(ENVS[env], length=length)
    gains = np.array([*plan.gains, plan.hold_goal.gain]).reshape(-1, config.state_size)
    at = np.repeat(plan.nominal.states, config.joints.size, axis=0)
    chosen = np.rint(np.linspace(0, len(gains) - 1, COUNT)).astype(int)
    away = 1e-3 * np.random.default_rng(1).normal(size=(COUNT, config.state_size))
    frames = np.zeros((COUNT, *dagger.history.frames.shape[1:]), np.float32)
    frames[:, 0, : config.observed] = observed(config, at[chosen] + away)
    rows = torch.from_numpy(frames.reshape(COUNT, -1))[:, : len(dagger.to_inputs)]
    given = units(dagger.student, rows @ dagger.to_inputs)
    expected = -(gains[chosen] * away).sum(axis=1) * np.resize([1.0, 4.0], COUNT)
    scale = np.abs(expected).max()
    np.testing.assert_allclose(np.diagonal(given) / scale, expected / scale, atol=2e-3)
    assert given.shape == (COUNT, 16)  # other units are as they were
    plain = dagger_of(ENVS[env], length=length, feedback_units=0)[-1]
    assert torch.equal(dagger.student[0].weight[COUNT:], plain.student[0].weight[COUNT:])
    assert torch.equal(dagger.student[2].weight, plain.student[2].weight)


def test_each_goal_has_units_along_the_plans_that_lead_to_it():
    hangs, up, folded = (0, 0), (1, 1), (1, 0)
    ends = (hangs, up), (folded, up), (hangs, folded)
    config, plans, dagger = dagger_of({"n": 2}, ends, by_goal=True, feedback_units=16)
    networks = dagger.learner.networks
    for goal, of_goal in ((up, plans[:2]), (folded, plans[2:])):
        number = goal[0] + 2 * goal[1]
        last = of_goal[-1]  # whose feedback about the goal is the last unit
        end = last.nominal.states[-1:]
        away = np.array([[1e-3, -2e-3, 0.01, 0.02]])
        goals = {"goal": np.pi * np.array([goal])}
        inputs = torch.from_numpy(observed(config, end + away, **goals)) @ dagger.to_inputs
        expected = -4.0 * (last.hold_goal.gain @ away[0])
        assert units(networks[number], inputs)[0, 15] == pytest.approx(expected[0], rel=1e-3)


def test_units_that_cannot_be_are_refused_before_anything_is_planned():
    settings = imitation.settings_of("swingup-1", feedback_units=200)
    with pytest.raises(ValueError, match="feedback_units must be between 0 and 32, got 200"):
        imitation.train(settings)
    with pytest.raises(ValueError, match="layers must be at least 1, got 0"):
        imitation.train(dataclasses.replace(settings, layers=0))
    with pytest.raises(ValueError, match=r"by_goal must be False .* layers=1"):
        imitation.train(imitation.settings_of("transition-1", by_goal=True, layers=1))
    own = dataclasses.replace(settings, feedback_units=8)
    own.env["observe_velocities"] = False
    with pytest.raises(ValueError, match="feedback_units must be 0 with observe_velocities=False"):
        imitation.train(own)


def test_a_student_with_such_units_learns_to_balance_what_others_do_not_yet():
    quick = {"rounds": 2, "num_envs": 64, "updates": 100, "first_updates": 200, "averaging": 0.9}
    success = {}
    for count in (0, 32):
        settings = imitation.settings_of("balance-4-cart", **quick, feedback_units=count)
        settings = dataclasses.replace(settings, obs_scale=(0.3, 0.3, 1.5))
        success[count] = imitation.train(settings)[1][-1]["success"]
    assert success[0] == 0.0
    assert success[32] > 0.9
