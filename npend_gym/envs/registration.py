"""Registration of the environments with Gymnasium, by strings: nothing heavy is imported."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from gymnasium.envs import registration

ENV_ID = "NPendulum-v0"
MAX_EPISODE_STEPS = 1000


class EnvTask(NamedTuple):
    """A task under a name of its own: keywords of the environment, and when it is solved."""

    keywords: dict[str, Any]
    reward_threshold: float | None = None
    """Mean return of an episode for which the task counts as solved, with the default keywords.

    The `spec` of an environment has None where others make another task of it.

    Over 100 episodes each, the best policy or controller of the package lies above it, by less than
    a tenth. The mean return of random actions lies below a quarter of it.
    """
    max_episode_steps: int = MAX_EPISODE_STEPS


# On the cart of the chain, or on one of the mass of a chain that has none
_ON_CART = {"mode": "balance", "observation": "scaled", "base": "cart", "max_force": 10.0}
_OF_DM_CONTROL = _ON_CART | {"rail": 1.8, "max_tilt": math.radians(36)}
_OF_GYMNASIUM = _ON_CART | {"rail": 2.4, "max_tilt": math.radians(12)}
# Those of other packages; see `envs/benchmarks.py`
_DM_ACROBOT = {
    "mode": "npend_gym.envs.benchmarks:DMAcrobot", "chain": "dm_control acrobot",
    "actuated": [1], "max_torque": 2.0, "substeps": 1, "observation": "sincos",
}  # fmt: skip
_OF_PUFFERLIB = {
    "mode": "npend_gym.envs.benchmarks:PufferDoublePendulum",
    "chain": {"masses": [0.1, 0.1], "lengths": [0.5, 0.5], "gravity": 9.8},
    "base": "cart", "cart_mass": 1.0, "rail": 5.0, "max_force": 10.0, "torque_levels": 3,
    "observation": "scaled",
}  # fmt: skip

# Each page docs/tasks/*.md describes one of them
TASKS = {
    "npend/SwingUp-v1": EnvTask({"mode": "swingup", "observation": "scaled"}, 900.0),
    "npend/Balance-v1": EnvTask({"mode": "balance", "observation": "scaled"}, 990.0),
    "npend/Calm-v1": EnvTask({"mode": "calm", "observation": "scaled"}, 900.0),
    "npend/Release-v1": EnvTask({"mode": "passive", "observation": "scaled"}),  # has no reward
    "npend/Transition-v1": EnvTask({"mode": "transition", "observation": "scaled"}, 900.0),
    "npend/CartPole-v1": EnvTask(_OF_GYMNASIUM | {"chain": "cartpole"}, 990.0),
    "npend/CartDoublePole-v1": EnvTask(_OF_DM_CONTROL | {"chain": "dm_control cartpole 2"}, 990.0),
    "npend/CartTriplePole-v1": EnvTask(_OF_DM_CONTROL | {"chain": "dm_control cartpole 3"}, 950.0),
    "npend/DMAcrobot-v1": EnvTask(_DM_ACROBOT),
    "npend/PufferDoublePendulum-v1": EnvTask(_OF_PUFFERLIB, max_episode_steps=600),
}


def register_envs() -> None:
    """Make the environments known to `gym.make` and `gym.make_vec`; may be called again."""
    for env_id, task in ({ENV_ID: EnvTask({})} | TASKS).items():
        if env_id not in registration.registry:
            registration.register(
                id=env_id,
                entry_point="npend_gym:NPendulumEnv",
                vector_entry_point="npend_gym:NPendulumVectorEnv",
                max_episode_steps=task.max_episode_steps,
                reward_threshold=task.reward_threshold,
                kwargs=dict(task.keywords),
            )
