"""Stable-Baselines3 over Gymnasium's vector environments (extra "rl")."""

from __future__ import annotations

from npend_gym import _extras

try:
    from npend_gym.rl.gymnasium_vec_env import SB3VecEnv
except ImportError as _error:
    purpose = "vector environments for Stable-Baselines3"
    raise _extras.missing("stable_baselines3", "rl", purpose, _error) from _error

__all__ = ["SB3VecEnv"]
