"""Which tensors steps take, and what is raised where steps or their gradients leave all bounds."""

from __future__ import annotations

import math
import numbers
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np
import torch
from torch import Tensor

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.compiled.gpu import require_device
from npend_gym.envs.config import EnvConfig
from npend_gym.envs.episodes import Episodes
from npend_gym.envs.inputs import checked_action
from npend_gym.envs.keywords import DEFAULTS
from npend_gym.envs.laws import names_in_laws
from npend_gym.envs.settings import EnvSettings

_DTYPES = (torch.float64, torch.float32)
_DEVICES = ("cpu", "cuda")


class DivergedError(FloatingPointError):
    """Raised where chains leave all bounds in a step, so that there is no gradient.

    Attributes
    ----------
    chains : list of int
        Which chains, or sub-environments.
    step : int or None
        The step of a rollout or an environment, from 1; None of a step alone.
    """

    def __init__(self, chains: Sequence[int], step: int | None = None) -> None:
        self.chains: list[int] = list(chains)
        self.step: int | None = step
        which = "the step" if step is None else f"step {step}"
        super().__init__(
            f"chains {_checks.show(self.chains)} leave all bounds in {which}, where nothing can "
            "be differentiated: take smaller torques, shorter steps or more substeps"
        )


def check_bars(bars: Sequence[FloatArray]) -> None:
    """Refuse gradients that a step cannot take back."""
    for bar in bars:
        if not np.all(np.abs(bar) <= _checks.LARGEST):
            lanes = np.flatnonzero(~np.all(np.abs(bar) <= _checks.LARGEST, axis=-1)).tolist()
            largest = float(np.nanmax(np.abs(bar), initial=0.0))
            what = "NaN" if math.isnan(float(bar.sum())) else f"as large as {largest:g}"
            raise FloatingPointError(
                f"the gradient that arrives at a step from behind is {what} in chains "
                f"{_checks.show(lanes)}: shorten the horizon, or look for what made it so in the "
                "function that is differentiated"
            )


def check_tensor(
    name: str, value: Any, shape: tuple[int, ...] | None = None, device: torch.device | None = None
) -> Tensor:
    """Return a tensor of floating numbers, refused if it is something else, or elsewhere."""
    if not isinstance(value, Tensor):
        raise TypeError(f"{name} must be a tensor of torch, got {_checks.show(value)}")
    if value.device.type not in _DEVICES:
        raise ValueError(
            f"{name} must be on the processor or an NVIDIA GPU, got {value.device}: convert it "
            "with .cpu() or .cuda()"
        )
    if value.dtype not in _DTYPES:
        raise TypeError(
            f"{name} must be of float64 or float32, got {value.dtype}, which has no gradients "
            "here: convert it with .double()"
        )
    if device is not None and value.device.type != device.type:
        raise TypeError(
            f"{name} must be on the environment's device {device}, got {value.device}: make the "
            "environment with device=..., or convert with .to(...)"
        )
    if shape is not None and value.shape != shape:
        raise ValueError(f"{name} must have the shape {shape}, got {tuple(value.shape)}")
    return value


def as_tensors(values: Mapping[str, Any]) -> list[Tensor]:
    """Return tensors of one dtype and device; plain numbers become that of the first."""
    first = next(iter(values.items()))
    tensors: list[Tensor] = []
    for name, given in values.items():
        value = given
        if tensors and not isinstance(given, Tensor):
            if isinstance(given, bool) or not isinstance(given, numbers.Real):
                raise TypeError(
                    f"{name} must be a tensor of torch or a number, got {_checks.show(given)}"
                )
            value = tensors[0].new_tensor(_checks.number(name, given))
        tensors.append(check_tensor(name, value))
        if value.dtype != first[1].dtype or value.device != first[1].device:
            raise TypeError(
                f"{name} must have the dtype and device of {first[0]}, {first[1].dtype} on "
                f"{first[1].device}, got {value.dtype} on {value.device}: convert it with .to(...)"
            )
    return tensors


def check_device(device: str | torch.device) -> torch.device:
    """Return the device, refused where steps cannot be taken there."""
    if isinstance(device, str):
        _checks.choice("device", device.partition(":")[0], _DEVICES)
    chosen = torch.device(device)
    _checks.choice("device", chosen.type, _DEVICES)
    if chosen.type == "cuda":
        require_device()
        if not torch.cuda.is_available():
            raise RuntimeError(
                'device "cuda" needs a torch with CUDA, this one is '
                f'{torch.__version__}: install one as pytorch.org says, or use device="cpu"'
            )
    return chosen


def clipped_action(
    action: Any, config: EnvConfig, count: int, dtype: torch.dtype, device: torch.device
) -> Tensor:
    """Return actions, (count, joints) float64 within +-1, or say what is wrong with them."""
    shape, table = (count, config.joints.size), config.action_table
    if config.action_space.shape == ():  # discrete
        if not isinstance(action, Tensor) or action.is_floating_point():
            raise TypeError(f"action must be a tensor of integers, got {_checks.show(action)}")
        chosen = checked_action(action.cpu().numpy(), shape, table)
        return torch.from_numpy(np.zeros(shape) if chosen is None else chosen).to(device)
    given = check_tensor("action", action, shape, device)
    if given.dtype != dtype:
        raise TypeError(
            f"action must be of the environment's dtype {dtype}, got {given.dtype}: make the "
            "environment with dtype=..., or convert with .to(...)"
        )
    if not torch.isfinite(given).all():
        raise ValueError(f"action must be finite, got {_checks.show(given)}")
    return given.to(torch.float64).clamp(-1.0, 1.0)


# What this environment does as `NPendulumVectorEnv`, beside the settings that laws read
_KNOWN = frozenset({
    "actuated", "max_torque", "difficulty", "torque_levels", "base", "max_force", "cart_mass",
    "rail", "rail_damping", "observation", "observe_velocities", "observe_context", "mode", "chain",
    "dt", "substeps", "reward_type", "goal_env", "max_tilt", "measure_periods", "amplitude",
    "spread", "randomize",
})  # fmt: skip


def check_known(config: EnvConfig) -> None:
    """Raise a ValueError that names a keyword which an environment of tensors does not know."""
    known, where = _KNOWN.union(names_in_laws()), "in an environment of tensors"
    for name in [each.name for each in fields(EnvSettings)]:
        is_default = np.array_equal(getattr(config, name), DEFAULTS[name])
        is_drawn = any(drawn.split("[")[0] == name for drawn in config.context_names)
        if name not in known and (is_drawn or not is_default):
            raise ValueError(
                f"{name} must be left out {where}, which does not know it as NPendulumVectorEnv "
                f"does; got {_checks.show(getattr(config, name))}"
            )
        if name in ("cart_mass", "rail_damping") and is_drawn:
            raise ValueError(f"randomize must leave {name} out {where}, whose carts are all alike")
    if config.measure_periods and not config.mode.measures_periods:
        raise ValueError(f"measure_periods must be left out {where}, which measures none; got True")


def check_ideal(episodes: Episodes, device: torch.device) -> None:
    """Raise a ValueError for motors, sensors or a cart that a device does not have."""
    ideal = episodes.motors is None and episodes.sensors is None
    if device.type != "cpu" and (episodes.config.has_cart or not ideal):
        raise ValueError(
            'device must be "cpu" for a cart, or for motors and sensors that are not ideal; '
            f'got "{device}"'
        )
