"""What environments of tensors are given: settings and actions, checked or refused by name."""

from __future__ import annotations

from typing import Any, Protocol

import torch
from torch import Tensor

from npend_gym import _checks
from npend_gym.envs.config import EnvConfig
from npend_gym.torch.steps import check_tensor


class Receiver(Protocol):
    """What is known of an environment that is given actions."""

    config: EnvConfig
    num_envs: int
    dtype: torch.dtype
    device: torch.device


def check_config(config: EnvConfig, device: torch.device, *, errors: bool) -> None:
    """Refuse settings that these environments cannot take.

    `errors` says whether motors or sensors have any.
    """
    for name in ("cart_mass", "rail_damping"):
        if name in config.randomization.names:
            raise ValueError(
                f"randomize must leave {name} out in an environment of tensors, whose carts are "
                "all alike"
            )
    if device.type != "cpu" and (config.has_cart or errors):
        raise ValueError(
            'device must be "cpu" for a cart, or for motors and sensors that are not ideal; got '
            f'"{device}"'
        )


def check_place(name: str, given: Tensor, device: torch.device) -> None:
    """Refuse a tensor that is not where the environment is."""
    if given.device.type != device.type:
        raise TypeError(
            f"{name} must be on the environment's device {device}, got {given.device}: make the "
            "environment with device=..., or convert with .to(...)"
        )


def checked_coordinates(
    name: str, given: Tensor, shape: tuple[int, ...], device: torch.device
) -> Tensor:
    """Return coordinates or rates as float64, or say what is wrong with them."""
    tensor = check_tensor(name, given).to(torch.float64)
    check_place(name, tensor, device)
    if tensor.shape != shape:
        raise ValueError(f"{name} must have the shape {shape}, got {tuple(tensor.shape)}")
    return tensor


def clipped_action(action: Any, env: Receiver) -> Tensor:
    """Return the actions, (B, joints) float64 within +-1, or say what is wrong with them."""
    joints = env.config.joints.size
    if joints == 0 or len(env.config.action_table) > 0:
        return _chosen(action, env)
    given = check_tensor("action", action)
    if given.dtype != env.dtype:
        raise TypeError(
            f"action must be of the environment's dtype {env.dtype}, got {given.dtype}: make the "
            "environment with dtype=..., or convert with .to(...)"
        )
    check_place("action", given, env.device)
    if given.shape != (env.num_envs, joints):
        wanted = (env.num_envs, joints)
        raise ValueError(f"action must have the shape {wanted}, got {tuple(given.shape)}")
    if not torch.isfinite(given).all():
        raise ValueError(f"action must be finite, got {_checks.show(given)}")
    return given.to(torch.float64).clamp(-1.0, 1.0)


def _chosen(action: Any, env: Receiver) -> Tensor:
    """Return what discrete actions, integers (B,), stand for."""
    table = torch.from_numpy(env.config.action_table).to(env.device)
    if not isinstance(action, Tensor) or action.is_floating_point():
        raise TypeError(f"action must be a tensor of integers, got {_checks.show(action)}")
    check_place("action", action, env.device)
    most = max(1, len(table))
    if action.shape != (env.num_envs,) or ((action < 0) | (action >= most)).any():
        raise ValueError(
            f"action must have the shape ({env.num_envs},) and lie between 0 and {most - 1}, got "
            f"{_checks.show(action)}"
        )
    if len(table) == 0:
        return table.new_zeros(env.num_envs, 0)
    return table[action.long()]
