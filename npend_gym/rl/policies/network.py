"""The network of a policy: its numbers, what they must be, and what they compute."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.rl.policies.files import Float32Array

if TYPE_CHECKING:
    from npend_gym.rl.policies.policy import Policy

_MAX_OBSERVED = 1e7  # larger than any entry of an observation
_MAX_SIGNAL = 1e38  # float32 holds up to 3.4e38

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


def _as_float32(name: str, given: Any) -> Float32Array:
    """Return numbers as an array of float32, as a file holds them, that nothing else changes."""
    try:
        raw = np.asarray(given)
    except ValueError:  # lists of different lengths
        raw = np.asarray(None)
    if raw.dtype.kind not in "iuf":
        raise TypeError(f"{name} must be an array of numbers, got {_checks.show(given)}")
    array = np.array(raw, np.float32)
    array.setflags(write=False)
    return array


def arrays_of(policy: Policy) -> dict[str, Float32Array]:
    """Return the numbers of the network by their names in a file."""
    arrays = {"scale": policy.scale} | ({} if policy.offset is None else {"offset": policy.offset})
    for k, (weight, bias) in enumerate(zip(policy.weights, policy.biases, strict=True)):
        arrays |= {f"weight{k}": weight, f"bias{k}": bias}
    return arrays


def numbers_of(policy: Policy) -> dict[str, Any]:
    """Return scale, offset, weights and biases, by name, as arrays of float32 where they are given.

    Raises
    ------
    TypeError
        If one of them has something else than numbers.
    """
    numbers: dict[str, Any] = {"scale": _as_float32("scale", policy.scale)}
    if policy.offset is not None:
        numbers["offset"] = _as_float32("offset", policy.offset)
    for name in ("weights", "biases"):
        layers = _checks.listed(name, getattr(policy, name), "[first, second]")
        numbers[name] = [_as_float32(f"{name}[{k}]", each) for k, each in enumerate(layers)]
    return numbers


def layers_of(policy: Policy) -> list[tuple[FloatArray, FloatArray]]:
    """Return the weights, (inputs, outputs), and biases of each layer in float64."""
    pairs = zip(policy.weights, policy.biases, strict=True)
    return [(weight.T.astype(np.float64), bias.astype(np.float64)) for weight, bias in pairs]


def forward(
    policy: Policy, layers: list[tuple[FloatArray, FloatArray]], observed: Float32Array
) -> Float32Array:
    """Return the actions, (..., joints), for observations, (..., k), or frames of a memory.

    Sums in float64 are rounded to float32. So it hardly ever shows in which order a processor
    sums, which depends on its kind, the number of threads and of environments. `layers` are those
    of `layers_of`.
    """
    signal = observed.astype(np.float64)
    signal = (signal if policy.offset is None else signal - policy.offset) / policy.scale
    if policy.limit != math.inf:
        signal = np.clip(signal, -policy.limit, policy.limit)
    if policy.has_memory:
        signal = signal.reshape(len(signal), -1)
    *hidden, last = layers
    for weight, bias in hidden:
        signal = signal @ weight + bias
        signal = np.tanh(signal) if policy.activation == "tanh" else np.maximum(signal, 0.0)
    mean = signal @ last[0] + last[1]
    action = np.tanh(mean) if policy.output == "tanh" else np.clip(mean, -1.0, 1.0)
    return action.astype(np.float32)
