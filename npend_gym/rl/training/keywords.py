"""Which keywords of the environment a trainer uses; it refuses the others.

A policy's record holds the keywords that it was trained with. A keyword that the trainer ignored
would make the record wrong, and the user believe that the policy knows noise it has never seen.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import fields
from typing import Any

from npend_gym import _checks
from npend_gym.envs import EnvConfig, EnvKeywords, NPendulumVectorEnv
from npend_gym.envs.keywords import CHAIN_KEYWORDS, DEFAULTS, check_names
from npend_gym.envs.starts import Draw
from npend_gym.envs.values import CartOnRail, unfolded
from npend_gym.rl.evaluation.settings import keywords_of

# Those of a chain that is simulated without an environment, and of the start of its episodes
OF_CHAIN = (
    "n", "mode", "chain", *CHAIN_KEYWORDS, "actuated", "max_torque", "difficulty", "dt", "substeps",
    "observation", "amplitude", "spread",
)  # fmt: skip
# Those of a cart, for trainers that take one
OF_CARTS = ("base", *(each.name for each in fields(CartOnRail)))
# Those of an environment whose observations are one array, and whose actions are continuous
OF_ENV = {*EnvKeywords.__annotations__} - {"torque_levels", "goal_env"}
OF_IMITATION = OF_ENV | {"torque_levels"}  # whose student takes the nearest action
# Of vector environments, beside those of `EnvConfig`
_OF_VECTOR_ENV = {"max_episode_steps": None, "threads": 1, "autoreset_mode": None,
                  "render_mode": None}  # fmt: skip


def used_config(algorithm: str, env: Mapping[str, Any], uses: Collection[str]) -> EnvConfig:
    """Return the settings of an algorithm's training environment with the keywords `env`.

    Keywords that are not in `uses` must have their default values.
    """
    rest = {name: value for name, value in env.items() if name not in _OF_VECTOR_ENV}
    check_names(NPendulumVectorEnv, rest)
    config = EnvConfig(**rest)
    defaults = DEFAULTS | _OF_VECTOR_ENV
    for name, value in unfolded(env).items():
        if name not in uses and value != defaults[name]:
            other = ", or train by imitation, which uses it" if name in OF_IMITATION else ""
            raise ValueError(
                f"{algorithm} does not use {name}: leave it out{other}; got {_checks.show(value)}"
            )
    if config.observation != "sincos":
        raise ValueError(
            f'observation must be "sincos" for {algorithm}, got {_checks.show(config.observation)}'
        )
    return config


def with_wider_ranges(config: EnvConfig, margin: float) -> EnvConfig:
    """Return settings whose ranges of random numbers are wider.

    Each end moves out by `margin` times half the width. No end that is positive becomes negative.
    """
    if _checks.nonnegative_number("margin", margin) == 0.0:
        return config
    ranges: dict[str, dict[str, list[float]]] = {}
    drawn = config.randomization
    for name, low, high in zip(drawn.names, *drawn.draws[:, [Draw.LOW, Draw.HIGH]].T, strict=True):
        away = 0.5 * margin * (high - low)
        ends = ranges.setdefault(name.partition("[")[0], {"low": [], "high": []})
        ends["low"].append(float(low - away if low < 0.0 else max(0.0, low - away)))
        ends["high"].append(float(high + away))
    keywords: dict[str, Any] = keywords_of(config) | {"randomize": ranges or None}
    try:
        return EnvConfig(**keywords)
    except ValueError as error:
        raise ValueError(
            f"margin must be smaller for these ranges, got {margin:g}: {error}"
        ) from error
