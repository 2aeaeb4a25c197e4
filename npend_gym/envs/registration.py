"""Registration of the environments with Gymnasium, by strings: nothing heavy is imported."""

from __future__ import annotations

from gymnasium.envs import registration

ENV_ID = "NPendulum-v0"
MAX_EPISODE_STEPS = 1000


def register_envs() -> None:
    """Make the environments known to `gym.make` and `gym.make_vec`; may be called again."""
    if ENV_ID not in registration.registry:
        registration.register(
            id=ENV_ID,
            entry_point="npend_gym:NPendulumEnv",
            vector_entry_point="npend_gym:NPendulumVectorEnv",
            max_episode_steps=MAX_EPISODE_STEPS,
        )
