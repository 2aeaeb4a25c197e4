"""What environments of tensors are given: settings and actions, checked or refused by name."""

from __future__ import annotations

from typing import Any, Protocol

import torch
from torch import Tensor

from npend_gym import _checks
from npend_gym.envs.config import EnvConfig
from npend_gym.envs.settings import COUNTED, HARDWARE
from npend_gym.torch.steps import check_tensor


class Receiver(Protocol):
    """What is known of an environment that is given actions."""

    config: EnvConfig
    num_envs: int
    dtype: torch.dtype
    device: torch.device


def check_config(config: EnvConfig) -> EnvConfig:
    """Return the settings, refused where they ask for what has no gradient here."""
    if config.has_cart:
        raise ValueError('base must be "pivot" in an environment of tensors, got "cart"')
    if config.goal_env:
        raise ValueError("goal_env must be False in an environment of tensors, got True")
    for name in HARDWARE:
        if name not in COUNTED and config.largest[name] > 0.0:
            raise ValueError(
                f"{name} must be left out in an environment of tensors, whose motors and sensors "
                f"are ideal; got {config.largest[name]:g}"
            )
    return config


def check_place(name: str, given: Tensor, device: torch.device) -> None:
    """Refuse a tensor that is not where the environment is."""
    if given.device.type != device.type:
        raise TypeError(
            f"{name} must be on the environment's device {device}, got {given.device}: make the "
            "environment with device=..., or convert with .to(...)"
        )


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
