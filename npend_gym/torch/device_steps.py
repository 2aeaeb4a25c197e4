"""Steps of chains and their gradients on a GPU, in the memory of torch's tensors."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from functools import cache
from typing import Any, cast

import numpy as np
import torch
from torch import Tensor

from npend_gym import _checks
from npend_gym.chain import Chain, ChainParameters
from npend_gym.compiled.gpu import DeviceKernel, simulated
from npend_gym.physics import DifferentiableDeviceChains
from npend_gym.physics.directions import KINDS, check_names
from npend_gym.physics.kernels import threads
from npend_gym.physics.kernels.laws import Parameter
from npend_gym.physics.kernels.link_terms import check_terms, count_terms
from npend_gym.physics.substeps import MAX_ROTATION, substeps_of
from npend_gym.torch.checks import DivergedError, check_bars

_MAX_KEPT = 16  # sizes of batches for which what a GPU needs is kept


class DeviceSteps:
    """What `CompiledSteps` is, for tensors on a GPU."""

    def __init__(
        self, chain: Chain, joints: Sequence[int], timing: tuple[int, float] | None
    ) -> None:
        self.chain: Chain = chain
        self.joints: list[int] = list(joints)
        self.timing: tuple[int, float] | None = timing
        self._kept: dict[Any, DifferentiableDeviceChains] = {}
        self._rows: tuple[ChainParameters, Tensor] | None = None  # those of the last call
        self._needed: tuple[ChainParameters, float, int] | None = None  # with dt and substeps

    def forward(
        self, rows: ChainParameters, state: Sequence[Tensor], dt: float, substeps: int | None
    ) -> tuple[Tensor, Tensor]:
        """Return theta and omega, (B, n), after a step from `state`: theta, omega and torque."""
        (theta, omega), torque = map(_copy, state[:2]), self._torque(state)
        flags = torch.zeros_like(theta[:, 0])
        with _current(theta):
            q, u, tau, lost = (_shared(x) for x in (theta, omega, torque, flags))
            chains, options = self._chains(rows, theta), self._options(rows, theta, dt, substeps)
            chains.advance(q, u, tau, lost, dt, **options)
        _check_lost(flags)
        return theta, omega

    def backward(
        self, rows: ChainParameters, state: Sequence[Tensor], bars: Sequence[Tensor], dt: float,
        substeps: int | None, names: Sequence[str],
    ) -> tuple[list[Tensor], dict[str, Tensor]]:  # fmt: skip
        """Return the gradient by theta, omega and torque, and by the parameters that are named."""
        check_names(names, KINDS[count_terms(self.chain.repeated(1))])
        if not all(bool((bar.abs() <= _checks.LARGEST).all()) for bar in bars):
            check_bars([bar.cpu().numpy() for bar in bars])
        theta, omega, torque = state[0].contiguous(), state[1].contiguous(), self._torque(state)
        back = [*map(_copy, bars), torch.zeros_like(torque)]
        flags, of_chains = torch.zeros_like(theta[:, 0]), None
        if names:
            shape = (len(theta), len(ChainParameters._fields), self.chain.n)
            of_chains = torch.zeros(shape, dtype=theta.dtype, device=theta.device)
        with _current(theta):
            q, u, tau, lost = (_shared(x) for x in (theta, omega, torque, flags))
            bars = [_shared(x) for x in back]
            bars += [] if of_chains is None else [_shared(of_chains)]
            chains, options = self._chains(rows, theta), self._options(rows, theta, dt, substeps)
            chains.step_vjp(q, u, tau, bars, lost, dt, **options)
        _check_lost(flags)
        by_name: dict[str, Tensor] = {}
        if of_chains is not None:
            by_name = {name: of_chains[:, _row(name)] for name in names}
        if of_chains is not None and "lengths" in names and "centres" not in names:
            stacked = self._stacked(rows, theta)  # centres at the ends of rods stay there
            ends = stacked[:, _row("centres")] == stacked[:, _row("lengths")]
            by_centres = of_chains[:, _row("centres")]
            by_name["lengths"] = by_name["lengths"] + torch.where(ends, by_centres, 0.0)
        if "gravity" in by_name:
            by_name["gravity"] = by_name["gravity"][:, 0]
        return [back[0], back[1], back[2][:, self.joints]], by_name

    def _torque(self, state: Sequence[Tensor]) -> Tensor:
        """Return the torques on all joints, (B, n)."""
        torque = torch.zeros_like(state[0], memory_format=torch.contiguous_format)
        torque[:, self.joints] = state[2]
        return torque

    def _options(
        self, rows: ChainParameters, like: Tensor, dt: float, substeps: int | None
    ) -> dict[str, Any]:
        given = (substeps, None) if self.timing is None else self.timing
        if given[0] is None:
            given = self._default_substeps(rows, dt), MAX_ROTATION
        rotation = given[1] if given[1] is None or np.isfinite(given[1]) else None
        stream = 0 if simulated() else torch.cuda.current_stream(like.device).cuda_stream
        parameters = _shared(self._stacked(rows, like))
        named = {"substeps": given[0], "max_rotation": rotation, "parameters": parameters}
        return named | {"stream": stream}

    def _default_substeps(self, rows: ChainParameters, dt: float) -> int:
        """Return the substeps that the fastest chain needs, computed once for the last rows."""
        if self._needed is None or self._needed[0] is not rows or self._needed[1] != dt:
            step = _checks.positive_number("dt", dt)
            self._needed = rows, step, substeps_of(rows, step)
        return self._needed[2]

    def _stacked(self, rows: ChainParameters, like: Tensor) -> Tensor:
        """Return the parameters of the chains on the GPU, (B or 1, 12, n)."""
        if self._rows is None or self._rows[0] is not rows or self._rows[1].device != like.device:
            lanes = len(rows.masses)
            if lanes != 1 and len(like) % lanes > 0:
                raise ValueError(f"there are parameters of {lanes} chains for {len(like)} states")
            check_terms(rows, count_terms(self.chain.repeated(1)))
            self._rows = rows, torch.from_numpy(rows.stacked()).to(like.device)
        stacked = self._rows[1]
        if len(stacked) in (1, len(like)):
            return stacked
        return stacked.repeat(len(like) // len(stacked), 1, 1)

    def _chains(self, rows: ChainParameters, like: Tensor) -> DifferentiableDeviceChains:
        key = len(like), like.device, rows.has_drag
        if key not in self._kept:
            if len(self._kept) == _MAX_KEPT:
                self._kept.pop(next(iter(self._kept)))
            self._kept[key] = DifferentiableDeviceChains(self.chain, len(like), drag=rows.has_drag)
        return self._kept[key]

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_kept": {}, "_rows": None, "_needed": None}


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


def _row(name: str) -> int:
    return Parameter._asdict()[name]
