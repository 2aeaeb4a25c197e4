"""What a policy must be, whoever made it: a network, and an environment that fits it."""

from __future__ import annotations

import math
from typing import Any, cast

import numpy as np

from npend_gym import _checks
from npend_gym.chain import PRESETS
from npend_gym.envs.registration import TASKS
from npend_gym.rl.policies.files import Float32Array

_MAX_OBSERVED = 1e7  # larger than any entry of an observation
_MAX_SIGNAL = 1e38  # float32 holds up to 3.4e38
_MAX_STEPS = 1_000_000  # of an episode
_MIN_DT, _MAX_DT = 1e-4, 100.0  # s, of a step
_MAX_WORK = 1_000_000  # rods times substeps in a step: some tenths of a second
_MAX_ENTRIES = 64  # of a list that is not one number for each rod

Layers = tuple[Float32Array, list[Float32Array], list[Float32Array]]


# How a network acts, if its file does not say otherwise
USUAL: dict[str, Any] = {"limit": math.inf, "activation": "tanh", "output": "clip"}


def check_functions(given: Any) -> dict[str, Any]:
    """Return how a network acts, by the names of `USUAL`."""
    shown = _checks.show(given)
    read = cast("dict[str, Any]", given) if isinstance(given, dict) else {"": given}
    if not read.keys() <= USUAL.keys():
        raise ValueError(f"its network must have {', '.join(USUAL)}, got {shown}")
    functions = USUAL | read
    _checks.choice("activation", functions["activation"], ("tanh", "relu"))
    _checks.choice("output", functions["output"], ("clip", "tanh"))
    if "limit" in read:
        functions["limit"] = _checks.positive_number("limit", functions["limit"])
    return functions


def dense_layers(arrays: dict[str, Float32Array]) -> Layers:
    """Return the scale, the weights and the biases among the arrays of a file."""
    depth = (len(arrays) - 1) // 2
    names = ["scale"] + [f"{kind}{k}" for k in range(depth) for kind in ("weight", "bias")]
    if sorted(arrays) != sorted(names):
        raise ValueError(f"it holds {_checks.show(sorted(arrays))}")
    weights, biases = ([arrays[f"{kind}{k}"] for k in range(depth)] for kind in ("weight", "bias"))
    return arrays["scale"], weights, biases


def check_network(layers: Layers, offset: Float32Array | None, functions: dict[str, Any]) -> None:
    """Raise an error for layers that form no network, or in which signals may overflow.

    `functions` are those of `check_functions`.
    """
    scale, weights, biases = layers
    if not len(weights) == len(biases) > 0:
        raise ValueError(
            f"weights and biases must have one entry for each layer, got {len(weights)} and "
            f"{len(biases)}"
        )
    if scale.ndim not in (1, 2) or scale.size == 0:
        raise ValueError(
            f"scale must have the shape (k,) or (length, k + joints), got {scale.shape}"
        )
    if scale.ndim == 2 and scale.shape[1] <= biases[-1].size:
        raise ValueError(
            f"scale of shape {scale.shape} has no room for observations and "
            f"{biases[-1].size} actions"
        )
    inputs = scale.size
    for k, (weight, bias) in enumerate(zip(weights, biases, strict=True)):
        if bias.ndim != 1 or bias.size == 0 or weight.shape != (bias.size, inputs):
            raise ValueError(
                f"weights[{k}] and biases[{k}] must have the shapes (m, {inputs}) and (m,), got "
                f"{weight.shape} and {bias.shape}"
            )
        inputs = bias.size
    if offset is not None and offset.shape != scale.shape:
        raise ValueError(f"offset must have the shape of scale, {scale.shape}, got {offset.shape}")
    if not all(np.isfinite(array).all() for array in (scale, *weights, *biases)):
        raise ValueError("scale, weights and biases must be finite")
    _check_signals(layers, offset, functions)


def _check_signals(layers: Layers, offset: Float32Array | None, functions: dict[str, Any]) -> None:
    """Refuse a network in which a sum of products may leave float32, in whatever order it is added.

    The bound is the sum of magnitudes, for the largest observations and tanh layers at their ends.
    A tanh of the output overflows nothing.
    """
    scale, weights, biases = layers
    with np.errstate(all="ignore"):
        away = 0.0 if offset is None else np.abs(offset.ravel().astype(np.float64))
        bound = (_MAX_OBSERVED + away) / np.abs(scale.ravel().astype(np.float64))
        largest = bound.max()
        bound = np.minimum(bound, functions["limit"])
        for weight, bias in zip(weights, biases, strict=True):
            signal = np.abs(weight.astype(np.float64)) @ bound + np.abs(bias)
            largest = np.maximum(largest, signal.max())
            bound = np.ones(bias.size) if functions["activation"] == "tanh" else signal
    if not largest <= _MAX_SIGNAL:
        raise ValueError(
            f"scale, weights and biases overflow: with observations of up to {_MAX_OBSERVED:g} a "
            f"signal may reach {largest:.3g}"
        )


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
