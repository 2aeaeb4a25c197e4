"""Every ability of the environments and of learning with every kind of environment.

`python tests/env_composition.py` runs all cells and writes the table of
docs/reference/env_composition.md.
"""

from __future__ import annotations

import warnings
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from matrices import Matrix

import npend_gym  # noqa: F401 - registers the environments
from npend_gym import Cart, Chain, rl
from npend_gym.envs import EnvConfig
from npend_gym.rl.controllers.planning import planned_swing_up
from npend_gym.rl.training import experts
from npend_gym.rl.training.chain_plans import wrong_chains
from npend_gym.rl.training.error_lanes import KINDS

Keywords = dict[str, Any]
LANES, STEPS = 3, 5

_LINKS = Chain([1.0, 0.6], [0.8, 0.5], centres=[0.4, 0.3], inertias=[0.05, 0.02], friction=0.01)
_ERRORS = {
    "torque_noise": 0.01, "motor_lag": 0.01, "angle_noise": 1e-3, "velocity_noise": 1e-2,
    "angle_resolution": 1e-3, "action_delay": 0.5, "observation_delay": 0.5,
    "torque_ripple": 0.01, "push_rate": 1.0, "push_force": 0.1,
}  # fmt: skip
_SWING = {"mode": "swingup", "observation": "sincos"}
COLUMNS: dict[str, Keywords] = {
    "pivot": _SWING | {"n": 2},
    "links": _SWING | {"chain": _LINKS},
    "elbow motor": _SWING | {"n": 2, "actuated": (1,)},
    "RealAIGym robot": _SWING
    | {"chain": "realaigym C.1", "actuated": (0,), "max_torque": 6.0, "dt": 0.02},
    "cart, 1 rod": _SWING | {"n": 1, "base": "cart"},
    "cart, 2 rods": _SWING | {"n": 2, "base": "cart"},
    "cart, 3 rods": _SWING | {"n": 3, "base": "cart"},
    "links on a cart": _SWING
    | {"chain": Chain([1.0], [0.8], centres=0.4, inertias=0.05, base=Cart(1.5))},
    "noise and delay": _SWING | {"n": 1} | _ERRORS,
    "randomised": _SWING | {"n": 1, "randomize": {"masses": (0.9, 1.1), "lengths": (0.95, 1.05)}},
    "discrete actions": _SWING | {"n": 1, "torque_levels": 7},
    "balance on a cart": {"mode": "balance", "observation": "sincos", "n": 1, "base": "cart"},
    "calm on a cart": {"mode": "calm", "observation": "sincos", "n": 1, "base": "cart"},
    "transition": {"mode": "transition", "observation": "sincos", "n": 1},
}


def _vector(keywords: Keywords, lanes: int = LANES, **more: Any) -> Any:
    return gym.make_vec("NPendulum-v0", num_envs=lanes, **keywords | more)


def _single(keywords: Keywords) -> None:
    """A single environment is lane 0 of many, and Gymnasium's checker has nothing to say."""
    env = gym.make("NPendulum-v0", **keywords)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        observation, info = env.reset(seed=3)
        envs = _vector(keywords)
        observations, infos = envs.reset(seed=3)
        envs.action_space.seed(0)
        for _ in range(STEPS):
            np.testing.assert_array_equal(observation, observations[0])
            np.testing.assert_array_equal(info["theta"], infos["theta"][0])
            actions = envs.action_space.sample()
            observation, _, _, _, info = env.step(actions[0])
            observations, _, _, _, infos = envs.step(actions)


def _many(keywords: Keywords) -> None:
    """Other lanes change nothing, and every seed has its own start."""
    envs, fewer = _vector(keywords, 5), _vector(keywords, 2)
    shown, _ = envs.reset(seed=3)
    few, _ = fewer.reset(seed=[6, 7])
    np.testing.assert_array_equal(shown[3:], few)
    assert (shown[0] != shown[1]).any()
    envs.action_space.seed(0)
    actions = envs.action_space.sample()
    np.testing.assert_array_equal(envs.step(actions)[0][3:], fewer.step(actions[3:])[0])


def _threads(keywords: Keywords) -> None:
    shown = []
    for threads in (1, 2):
        envs = _vector(keywords, 40, threads=threads)
        envs.reset(seed=0)
        envs.action_space.seed(0)
        shown.append([envs.step(envs.action_space.sample())[:2] for _ in range(STEPS)])
    for one, two in zip(*shown, strict=True):
        np.testing.assert_array_equal(one[0], two[0])
        np.testing.assert_array_equal(one[1], two[1])


def _pictures(keywords: Keywords) -> None:
    env = gym.make("NPendulum-v0", render_mode="rgb_array", render_size=64, **keywords)
    env.reset(seed=0)
    picture = env.render()
    assert picture.shape == (64, 64, 3)
    assert len(np.unique(picture)) > 3


def _states(keywords: Keywords) -> None:
    """An environment continues from the state of another, to the last bit."""
    one, other = _vector(keywords), _vector(keywords)
    one.reset(seed=1)
    one.action_space.seed(1)
    one.step(one.action_space.sample())
    other.set_state(one.get_state())
    for _ in range(STEPS):
        actions = one.action_space.sample()
        for mine, theirs in zip(one.step(actions)[:4], other.step(actions)[:4], strict=True):
            np.testing.assert_array_equal(mine, theirs)


def _sb3(keywords: Keywords) -> Any:
    from stable_baselines3 import PPO

    more = {"autoreset_mode": "SAME_STEP", "max_episode_steps": 20}
    model = PPO(
        "MlpPolicy", rl.SB3VecEnv(_vector(keywords, 4, **more)), n_steps=8, batch_size=16,
        n_epochs=1, seed=0, device="cpu", policy_kwargs={"net_arch": [8]},
    )  # fmt: skip
    return model.learn(32)


def _sb3_learns(keywords: Keywords) -> None:
    model = _sb3(keywords)
    assert all(bool(each.isfinite().all()) for each in model.policy.parameters())


def _tensors(keywords: Keywords) -> None:
    """The tensor environment is the vector environment, to rounding."""
    import torch

    from npend_gym.torch import DifferentiableVectorEnv

    envs, tensors = _vector(keywords), DifferentiableVectorEnv(LANES, **keywords)
    envs.action_space.seed(2)
    expected, _ = envs.reset(seed=2)
    observed, _ = tensors.reset(seed=2)
    for _ in range(STEPS):
        np.testing.assert_allclose(observed.numpy(), expected, rtol=1e-6, atol=1e-6)
        actions = envs.action_space.sample()
        expected, reward, *_ = envs.step(actions)
        given = torch.as_tensor(actions)
        given = given.double() if given.is_floating_point() else given
        observed, rewards, *_ = tensors.step(given)
        np.testing.assert_allclose(rewards.numpy(), reward, rtol=1e-9, atol=1e-9)


def _gradient(keywords: Keywords) -> None:
    """The gradient of the rewards by the first action is that of finite differences."""
    import torch

    from npend_gym.torch import DifferentiableVectorEnv

    env = DifferentiableVectorEnv(1, **keywords)

    def total(first: Any) -> Any:
        env.reset(seed=4)
        rewards = 0.0
        for k in range(4):
            rewards = rewards + env.step(first if k == 0 else torch.zeros_like(first))[1].sum()
        return rewards

    action = torch.full((1, env.action_size), 0.3, dtype=torch.float64, requires_grad=True)
    total(action).backward()
    assert action.grad is not None
    step = 1e-5
    for k in range(env.action_size):
        moved = torch.zeros_like(action)
        moved[0, k] = step
        with torch.no_grad():
            slope = (total(action + moved) - total(action - moved)) / (2.0 * step)
        assert abs(float(slope - action.grad[0, k])) < 1e-6


def _torchrl(keywords: Keywords) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # TorchRL warns of itself
        from torchrl.envs.utils import check_env_specs

        from npend_gym.torch.torchrl import TorchRLEnv

        check_env_specs(TorchRLEnv(2, **keywords))


def _goal(keywords: Keywords) -> float:
    """Return the angle at which a controller holds the chain."""
    return 0.0 if keywords["mode"] == "calm" else np.pi


def _released(keywords: Keywords, theta: Any) -> tuple[tuple[Any, Any, Any], ...]:
    """Return a single environment and two lanes, with what each shows at the same start."""
    starts = [(gym.make("NPendulum-v0", **keywords), theta)]
    starts += [(_vector(keywords, 2), np.tile(theta, (2, 1)))]
    return tuple(
        (env, *env.reset(seed=0, options={"theta": angles, "omega": 0.0})) for env, angles in starts
    )


def _holds(keywords: Keywords, controller: Any, seconds: float = 1.0) -> None:
    """A single environment and many hold the chain near its goal, with the same actions."""
    goal, config = _goal(keywords), EnvConfig(**keywords)
    (_, *shown), (envs, observation, info) = _released(keywords, np.full(config.n, goal + 0.01))
    alone = np.asarray(controller(*shown))
    if hasattr(controller, "reset"):
        controller.reset(2)
    np.testing.assert_allclose(np.asarray(controller(observation, info))[0], alone, atol=1e-9)
    if hasattr(controller, "reset"):
        controller.reset(2)
    for _ in range(round(seconds / config.dt)):
        action = controller(observation, info)
        if len(config.action_table) == 0:
            action = np.clip(action, -1.0, 1.0)
        observation, _, terminated, _, info = envs.step(action)
        assert not terminated.any()
    assert np.abs(info["theta"] - goal).max() < 0.3


def _lqr(keywords: Keywords) -> None:
    _holds(keywords, rl.lqr(EnvConfig(**keywords), _goal(keywords)))


def _mpc(keywords: Keywords) -> None:
    _holds(keywords, rl.MPC(EnvConfig(**keywords), _goal(keywords), horizon=0.8), 0.5)


def _plan(config: EnvConfig) -> Any:
    if config.mode.name == "calm":
        stands = np.full(config.n, np.pi)
        return rl.planned_transition(config, stands, stands - np.pi, 15.0, guess="waves")
    if config.n == 3:
        return rl.planned_swing_up(config, 8.0, guess="mpc", tries=2)
    if config.mode.name == "balance":
        return rl.planned_transition(config, 0.0, np.pi, guess="waves")
    return rl.planned_swing_up(config)


def _planner(keywords: Keywords) -> None:
    """A plan leads to its goal in the environment's own steps, and a start near it is held."""
    config = EnvConfig(**keywords)
    plan = _plan(config)
    angles = plan.nominal.states[:, : config.n]
    assert np.abs(np.cos(angles[-1]) - np.cos(_goal(keywords))).max() < 0.01
    (env, observation, info), (envs, observations, infos) = _released(keywords, angles[0])
    for _ in range(3):  # of the plan's actions, which both take alike
        action, actions = plan(observation, info), plan(observations, infos)
        np.testing.assert_allclose(actions[0], action, atol=1e-9)
        if len(config.action_table) == 0:
            action, actions = (np.clip(each, -1.0, 1.0) for each in (action, actions))
        observation, _, terminated, _, info = env.step(action)
        observations, _, _, _, infos = envs.step(actions)
        if terminated:  # a plan begins where "balance" ends
            return
    assert np.abs(info["theta"] - angles[3]).max() < 0.3


def _evaluate(keywords: Keywords) -> None:
    """A model and a controller are judged, each as its own rewards say."""
    short = keywords | {"max_episode_steps": 10}
    found = rl.evaluate(_sb3(keywords), short, episodes=3)
    assert found.returns.shape == (3,)
    assert np.isfinite(found.returns).all()
    held = rl.evaluate(rl.lqr(EnvConfig(**keywords), _goal(keywords)), short, episodes=3)
    assert np.isfinite(held.returns).all()


def _robustness(keywords: Keywords) -> None:
    model = _sb3(keywords)
    found = rl.robustness(model, keywords, values=2, repetitions=1, seconds=0.3)
    assert found.outcomes
    assert 0.0 <= found.score <= 1.0
    controller = rl.lqr(EnvConfig(**keywords), _goal(keywords))
    held = rl.robustness(controller, keywords, values=2, repetitions=1, seconds=0.3)
    assert set(held.outcomes) == set(found.outcomes)


def _performance(keywords: Keywords) -> None:
    found = rl.performance(_sb3(keywords), keywords, episodes=2, seconds=0.4)
    assert 0.0 <= found.score.mean() <= 1.0


def _recovery(keywords: Keywords) -> None:
    found = rl.recovery(_sb3(keywords), keywords, episodes=1, seconds=2.0, resets=1)
    assert 0.0 <= found.score <= 1.0


def _train(trainer: str, keywords: Keywords, **settings: Any) -> None:
    """A short training gives a policy that acts in the environment."""
    from npend_gym.rl import training

    module = getattr(training, trainer)
    policy, curve = module.train(module.Settings(env=keywords, **settings))
    assert curve
    found = rl.evaluate(policy, keywords | {"max_episode_steps": 5}, episodes=2)
    assert np.isfinite(found.returns).all()


_PLANS: dict[int, Any] = {}  # of experts, by column


def _planned_once(column: int) -> Any:
    """Return a planner whose first plan for a column serves all rows: it is of the same chain."""

    def planned(*given: Any, **more: Any) -> Any:
        if column not in _PLANS:
            _PLANS[column] = planned_swing_up(*given, **more)
        return _PLANS[column]

    return planned


def _imitation(keywords: Keywords, changed: Keywords | None = None, **settings: Any) -> None:
    """Imitate, perhaps with some keywords `changed` of a column's."""
    column = list(COLUMNS.values()).index(keywords)
    small = {"guesses": 1, "rounds": 2, "num_envs": 8, "standing": 10, "first_updates": 20}
    seconds = 8.0 if keywords.get("n") == 3 else 6.0
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(experts, "planned_swing_up", _planned_once(column))
        env = keywords | (changed or {})
        _train("imitation", env, **small | {"seconds": seconds, "updates": 20} | settings)


def _shac(keywords: Keywords) -> None:
    small = {"total_timesteps": 640, "num_envs": 8, "updates": 2, "batch_size": 8}
    _train("shac", keywords, **small)


def _drawn(keywords: Keywords) -> None:
    """Every episode has a chain and sensors of its own."""
    drawn = {"masses": (0.95, 1.05), "velocity_noise": {"low": 0.0, "high": 0.1}}
    _imitation(keywords, {"randomize": drawn | keywords.get("randomize", {})})


def _robust(keywords: Keywords) -> None:
    """A student with a memory, which something is wrong with in every lane."""
    errors = dict.fromkeys(KINDS, 1.0)
    with pytest.MonkeyPatch.context() as patch:  # plans for all of them take a minute
        patch.setattr(experts, "wrong_chains", lambda *given: wrong_chains(*given)[3:4])
        _imitation(keywords, errors=errors, num_envs=len(errors), length=3, averaging=0.9)


ROWS = {
    "single": _single,
    "vector": _many,
    "threads": _threads,
    "rgb_array": _pictures,
    "get_state, set_state": _states,
    "Stable-Baselines3": _sb3_learns,
    "tensor environment": _tensors,
    "gradient": _gradient,
    "TorchRL": _torchrl,
    "LQR, single and vector": _lqr,
    "MPC, single and vector": _mpc,
    "planner, single and vector": _planner,
    "evaluate": _evaluate,
    "robustness": _robustness,
    "performance": _performance,
    "recovery": _recovery,
    "imitation": _imitation,
    "SHAC": _shac,
    "imitation with drawn chains": _drawn,
    "imitation with errors": _robust,
}

# Why a cell is refused, by what the error says
REASONS = {
    "The number of a discrete action has no gradient.": (
        "must be a tensor of integers",
        "shac does not use torque_levels",
    ),
    "SHAC learns with motors and sensors that are ideal.": (
        "shac does not use torque_noise",
        "shac does not use randomize",
    ),
}

MATRIX = Matrix(
    "env_composition.md",
    "What works in which environment",
    "Every ability of the environments and of learning was run with every kind of environment. "
    "{works} of {cells} combinations work. In the table a number says why one raises an error. "
    "`python tests/env_composition.py` runs all of them and writes this page.",
    ROWS,
    COLUMNS,
    REASONS,
)

if __name__ == "__main__":
    MATRIX.write()
