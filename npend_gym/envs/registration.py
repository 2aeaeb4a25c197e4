"""Registration of the environments with Gymnasium, by strings: nothing heavy is imported."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from gymnasium.envs import registration

ENV_ID = "NPendulum-v0"
MAX_EPISODE_STEPS = 1000


class Task(NamedTuple):
    """A task under a name of its own: keywords of the environment, and when it is solved."""

    keywords: dict[str, Any]
    reward_threshold: float | None = None
    """Mean return of an episode for which the task counts as solved, with the default keywords.

    The `spec` of an environment has None where others make another task of it.

    Over 100 episodes each, the best policy or controller of the package lies above it, by less than
    a tenth. The mean return of random actions lies below a quarter of it.
    """


# On the cart of the chain, or on one of the mass of a chain that has none
_ON_CART = {"mode": "balance", "observation": "scaled", "base": "cart", "max_force": 10.0}
_OF_DM_CONTROL = _ON_CART | {"rail": 1.8, "max_tilt": math.radians(36)}
_OF_GYMNASIUM = _ON_CART | {"rail": 2.4, "max_tilt": math.radians(12)}

# Each page docs/tasks/*.md describes one of them
TASKS = {
    "npend/SwingUp-v1": Task({"mode": "swingup", "observation": "scaled"}, 900.0),
    "npend/Balance-v1": Task({"mode": "balance", "observation": "scaled"}, 990.0),
    "npend/Calm-v1": Task({"mode": "calm", "observation": "scaled"}, 900.0),
    "npend/Release-v1": Task({"mode": "passive", "observation": "scaled"}),  # has no reward
    "npend/Transition-v1": Task({"mode": "transition", "observation": "scaled"}, 900.0),
    "npend/CartPole-v1": Task(_OF_GYMNASIUM | {"chain": "cartpole"}, 990.0),
    "npend/CartDoublePole-v1": Task(_OF_DM_CONTROL | {"chain": "dm_control cartpole 2"}, 990.0),
    "npend/CartTriplePole-v1": Task(_OF_DM_CONTROL | {"chain": "dm_control cartpole 3"}, 950.0),
}


def register_envs() -> None:
    """Make the environments known to `gym.make` and `gym.make_vec`; may be called again."""
    for env_id, task in ({ENV_ID: Task({})} | TASKS).items():
        if env_id not in registration.registry:
            registration.register(
                id=env_id,
                entry_point="npend_gym:NPendulumEnv",
                vector_entry_point="npend_gym:NPendulumVectorEnv",
                max_episode_steps=MAX_EPISODE_STEPS,
                reward_threshold=task.reward_threshold,
                kwargs=dict(task.keywords),
            )
