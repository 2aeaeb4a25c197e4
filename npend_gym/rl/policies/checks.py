"""What the environment of a policy must be, whoever made the policy."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from npend_gym import _checks
from npend_gym.chain import PRESETS
from npend_gym.envs.registration import TASKS
from npend_gym.rl.policies.files import CHECKSUM

_RESERVED = {"env", "network", CHECKSUM}  # beside the provenance in a file
_MAX_STEPS = 1_000_000  # of an episode
_MIN_DT, _MAX_DT = 1e-4, 100.0  # s, of a step
_MAX_WORK = 1_000_000  # rods times substeps in a step: some tenths of a second
_MAX_ENTRIES = 64  # of a list that is not one number for each rod


def check_about(env: Any, provenance: Any) -> None:
    """Raise an error where what a policy tells about itself cannot stand in its file."""
    for name, given in (("env", env), ("provenance", provenance)):
        if not isinstance(given, Mapping):
            raise TypeError(f"{name} must be a dict, got {_checks.show(given)}")
    for name in _RESERVED & provenance.keys():
        raise ValueError(f"provenance[{name!r}] must be left out: a file has its own")


def names_code(mode: Any) -> bool:
    """Return whether a mode "package.module:Class" is from outside the package."""
    own = {task.keywords["mode"] for task in TASKS.values()}  # "npend/DMAcrobot-v1" has such a mode
    return isinstance(mode, str) and ":" in mode and mode not in own


def check_trust(env: dict[str, Any], *, trust: bool) -> None:
    """Raise an error where keywords in a file name code or other files.

    With `trust` a mode "package.module:Class" of others may be imported.
    """
    mode = env.get("mode", "swingup")
    if names_code(mode) and not trust:
        raise ValueError(
            f"its mode {_checks.show(mode)} would be imported, which runs code: give trust=True "
            "(--trust) if you trust whoever wrote the file"
        )
    chain = env.get("chain")
    if isinstance(chain, str) and chain not in PRESETS:
        raise ValueError(
            f"its chain must be a preset's name or parameters, got {_checks.show(chain)}: a policy "
            "reads no other file"
        )


def check_env(env: dict[str, Any], observed: int, actions: int) -> None:
    """Raise an error for plain keywords that describe no environment for a policy of this size.

    They may be from a file that nobody trusts, after `check_trust`.
    """
    from npend_gym.envs.config import EnvConfig  # heavy

    if "n" in env:  # each rod is observed by one number at least
        _checks.count("n", env["n"], high=max(1, observed))
    if env.get("max_episode_steps") is not None:
        _checks.count("max_episode_steps", env["max_episode_steps"], high=_MAX_STEPS)
    _check_lists(env, max(observed, _MAX_ENTRIES))
    if env.get("dt") is not None:
        dt = _checks.positive_number("dt", env["dt"])
        if not _MIN_DT <= dt <= _MAX_DT:
            rule = f"least {_MIN_DT:g}" if dt < _MIN_DT else f"most {_MAX_DT:g}"
            raise ValueError(f"dt must be at {rule}, got {dt:g}")
    for name in ("torque_levels", "goal_env"):
        if env.get(name):
            raise ValueError(f"{name} must be left out: a policy maps one array to torques")
    config = EnvConfig(**env)
    if (config.observed, config.joints.size) != (observed, actions):
        raise ValueError(
            f"the environment observes {config.observed} numbers and has {config.joints.size} "
            f"motors, the policy is for {observed} and {actions}"
        )
    if config.min_substeps * config.n > _MAX_WORK:
        raise ValueError(
            f"substeps must be at most {_MAX_WORK // config.n}, got {config.min_substeps} of "
            f"{config.n} rods in a step"
        )


def _check_lists(value: Any, most: int) -> None:
    """Refuse lists and dicts with more entries than a policy for so few numbers can need."""
    if isinstance(value, (list, dict)):
        entries: list[Any] = list(value.values()) if isinstance(value, dict) else value  # pyright: ignore[reportUnknownVariableType, reportUnknownArgumentType]
        if len(entries) > most:
            raise ValueError(f"a list must have at most {most} entries, got {len(entries)}")
        for entry in entries:
            _check_lists(entry, most)
