"""The laws of motors, sensors and observations for tensors: as in kernels, with gradients."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import torch
from torch import Tensor

from npend_gym.envs import episodes  # noqa: F401  # pyright: ignore[reportUnusedImport]
from npend_gym.envs.laws import LAWS, of_kind
from npend_gym.torch.autograd import SinCos, applied

ALL = slice(None)  # sub-environments, of the numbers that laws read


def exact_sincos(angles: Tensor) -> tuple[Tensor, Tensor]:
    """Return sines and cosines with the bits of the kernels, of float64."""
    return applied(SinCos, angles)


def _where(condition: Tensor, a: Any, b: Any) -> Tensor:
    chosen = torch.where(condition, a, b)
    return chosen if isinstance(a, Tensor) or isinstance(b, Tensor) else chosen.double()


def _wrapped(theta: Tensor) -> Tensor:
    turns = torch.floor((theta.detach() + math.pi) / (2.0 * math.pi))
    return theta - 2.0 * math.pi * turns


def _rounded(x: Tensor, resolution: Tensor) -> Tensor:
    """Return the nearest multiple of the resolution, with the gradient of x."""
    step: Any = torch.where(resolution > 0.0, resolution, 1.0)
    change = ((x / step).round() * step - x).detach()
    return x + torch.where(resolution > 0.0, change, 0.0)


def _within(x: Tensor, limit: float) -> Tensor:
    return x.clamp(-limit, limit)


def _one_minus_exp(x: Tensor) -> Tensor:
    return -torch.expm1(-x)


_TENSORS: dict[str, Callable[..., Any]] = {
    "where": _where,
    "wrapped": _wrapped,
    "rounded": _rounded,
    "sincos": exact_sincos,
    "within": _within,
    "any_of": torch.any,
    "one_minus_exp": _one_minus_exp,
}

# All laws by their names; `episodes` imports the modules that have them
laws = SimpleNamespace(**{name: of_kind(each, _TENSORS) for name, each in LAWS.items()})
