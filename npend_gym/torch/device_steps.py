"""Steps of chains and their gradients on a GPU, in the memory of torch's tensors."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from functools import cache, lru_cache
from typing import Any, cast

import numpy as np
import torch
from torch import Tensor

from npend_gym import _checks
from npend_gym.chain import Chain, ChainParameters
from npend_gym.compiled.gpu import DeviceKernel, simulated
from npend_gym.physics import DifferentiableDeviceChains
from npend_gym.physics.directions import by_names, check_names
from npend_gym.physics.kernels import threads
from npend_gym.physics.step import Chains
from npend_gym.torch.checks import DivergedError, check_bars
from npend_gym.torch.compiled_steps import StepCall


def forward(call: StepCall, chains: Chains, state: Sequence[Tensor]) -> tuple[Tensor, Tensor]:
    """Return theta and omega, (B, n), after a step from `state`: theta, omega and torque."""
    (theta, omega), torque = map(_copy, state[:2]), _torques(call, state)
    flags = torch.zeros_like(theta[:, 0])
    with _current(theta):
        device, options = _device_chains(call, chains, theta), _options(call, chains, theta)
        q, u, tau, lost = map(_shared, (theta, omega, torque, flags))
        device.advance(q, u, tau, lost, call.dt, **options)
    _check_lost(flags)
    return theta, omega


def backward(
    call: StepCall, chains: Chains, state: Sequence[Tensor], bars: Sequence[Tensor],
    names: Sequence[str],
) -> tuple[list[Tensor], dict[str, Tensor]]:  # fmt: skip
    """Return the gradient by theta, omega and torque, and by the parameters that are named."""
    check_names(names, chains.kind)
    if not all(bool((bar.abs() <= _checks.LARGEST).all()) for bar in bars):
        check_bars([bar.cpu().numpy() for bar in bars])
    theta, omega, torque = state[0].contiguous(), state[1].contiguous(), _torques(call, state)
    back, flags = [*map(_copy, bars), torch.zeros_like(torque)], torch.zeros_like(theta[:, 0])
    if names:
        back.append(theta.new_zeros(len(theta), len(ChainParameters._fields), chains.n))
    with _current(theta):
        device, options = _device_chains(call, chains, theta), _options(call, chains, theta)
        q, u, tau, lost = map(_shared, (theta, omega, torque, flags))
        device.step_vjp(q, u, tau, [*map(_shared, back)], lost, call.dt, **options)
    _check_lost(flags)
    by_name: dict[str, Tensor] = {}
    if names:
        ends = torch.from_numpy(chains.centres_at_ends).to(theta.device)
        by_name = by_names(back[3], names, ends)
    return [back[0], back[1], back[2][:, call.joints]], by_name


def _torques(call: StepCall, state: Sequence[Tensor]) -> Tensor:
    """Return the torques on all joints, (B, n)."""
    torque = torch.zeros_like(state[0], memory_format=torch.contiguous_format)
    torque[:, call.joints] = state[2]
    return torque


def _options(call: StepCall, chains: Chains, like: Tensor) -> dict[str, Any]:
    cut = call.cut(chains)
    return {
        "substeps": cut.substeps,
        "max_rotation": cut.max_rotation if np.isfinite(cut.max_rotation) else None,
        "parameters": _shared(_stacked(chains, like.device)),
        "stream": 0 if simulated() else torch.cuda.current_stream(like.device).cuda_stream,
    }


@lru_cache(maxsize=8)
def _stacked(chains: Chains, device: torch.device) -> Tensor:
    """Return the parameters of chains on a GPU, (B or 1, 12, n)."""
    return torch.from_numpy(chains.rows.stacked()).to(device)


def _device_chains(call: StepCall, chains: Chains, like: Tensor) -> DifferentiableDeviceChains:
    drag = chains.rows.has_drag
    return _kept_chains(call.chain, len(like), drag, like.device, threading.get_ident())


@lru_cache(maxsize=16)
def _kept_chains(
    chain: Chain, size: int, drag: bool, device: torch.device, thread: int
) -> DifferentiableDeviceChains:
    """Kernels and work space of a thread on a GPU, for batches of this size."""
    del device, thread
    return DifferentiableDeviceChains(chain, size, drag=drag)


def on_gpu(tensor: Tensor) -> bool:
    """Return whether a tensor is on a GPU."""
    return tensor.is_cuda


def write_sincos(x: Tensor, s: Tensor, c: Tensor) -> None:
    """Write sine and cosine of every entry, (m,), with the bits of the processor."""
    stream = 0 if simulated() else torch.cuda.current_stream(x.device).cuda_stream
    with _current(x):
        _sines().launch(x.numel(), *(_shared(each) for each in (x, s, c)), stream=stream)


@cache
def _sines() -> DeviceKernel:
    return DeviceKernel(threads.sines(), ())


def _current(tensor: Tensor) -> AbstractContextManager[Any]:
    """Make the GPU of a tensor the one that calls go to."""
    return nullcontext() if simulated() else torch.cuda.device(tensor.device)


def _copy(tensor: Tensor) -> Tensor:
    """Return a copy whose strides are those for which kernels are compiled."""
    return tensor.clone(memory_format=torch.contiguous_format)


def _shared(tensor: Tensor) -> Any:
    """A tensor as an argument of Numba: itself, or in the simulator an array of its memory."""
    return tensor.numpy() if simulated() else tensor


def _check_lost(flags: Tensor) -> None:
    """Raise an error where chains have left all bounds."""
    lost = cast("list[int]", flags.nonzero().flatten().tolist())
    if lost:
        raise DivergedError(lost)
