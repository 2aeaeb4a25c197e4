"""Torques that change within a step: by a law of one's own, or along a ramp."""

# ruff: noqa: ARG001  what stands for another function has its parameters
from __future__ import annotations

import math
from typing import NamedTuple

from npend_gym._checks import FloatArray
from npend_gym.compiled.callbacks import call_law
from npend_gym.compiled.jit import chosen_by_type, inlined_kernel, inner_kernel
from npend_gym.physics.kernels.dynamics import AnyArrays, derivative
from npend_gym.physics.kernels.link_terms import Base, LinkArrays, MachineArrays
from npend_gym.physics.kernels.springs import SpringArrays
from npend_gym.physics.kernels.tensions import ChainArrays

FORCE, ACROSS, UP = range(3)  # what a law writes after the torques on n joints
LAW_ENTRIES = 3


class Driven(NamedTuple):
    """Torques, a force on the cart and accelerations of the pivot, by a law."""

    law: int  # address of a function: see `npend_gym.compiled.callbacks`
    values: FloatArray  # what the law has written last, (n + LAW_ENTRIES,)
    forces: FloatArray  # on all coordinates, as `accelerations` takes them
    broken: FloatArray  # instant at which it wrote what is not finite, (1,); else NaN


class Sampled(NamedTuple):
    """The same on straight lines from an instant on."""

    begin: float  # s
    line: FloatArray  # values there and their slopes, (2, n + LAW_ENTRIES)
    forces: FloatArray


Torque = FloatArray | Driven | Sampled


@inlined_kernel
def _base_at_rest(chain: AnyArrays, across: float, up: float) -> None:
    pass


@inlined_kernel
def _base_that_moves(chain: MachineArrays | SpringArrays, across: float, up: float) -> None:
    if chain.base.shape[0] > 0 and chain.base[Base.INVERSE_MASS, 0] == 0.0:
        chain.base[Base.ACROSS, 0], chain.base[Base.UP, 0] = across, up


@chosen_by_type(
    "chain",
    {
        ChainArrays: _base_at_rest,
        LinkArrays: _base_at_rest,
        SpringArrays: _base_that_moves,
        MachineArrays: _base_that_moves,
    },
)
def accelerate_base(chain: AnyArrays, across: float, up: float) -> None:
    """Give the pivot the acceleration that is prescribed for this instant."""
    raise NotImplementedError


@inlined_kernel
def _steady(
    t: float, y: FloatArray, torque: FloatArray, chain: AnyArrays, work: FloatArray,
    dydt: FloatArray,
) -> None:  # fmt: skip
    derivative(y, torque, chain, work, dydt)


@inner_kernel
def _by_law(
    t: float, y: FloatArray, torque: Driven, chain: AnyArrays, work: FloatArray,
    dydt: FloatArray,
) -> None:  # fmt: skip
    n, half = torque.values.size - LAW_ENTRIES, y.size // 2
    call_law(torque.law, t, y, y[half:], torque.values, n)
    total = 0.0
    for i in range(torque.values.size):
        total += torque.values[i]
    if not math.isfinite(total) and math.isfinite(t):
        torque.broken[0] = t
    for i in range(n):
        torque.forces[i] = torque.values[i]
    if half > n:
        torque.forces[n] = torque.values[n + FORCE]
        accelerate_base(chain, torque.values[n + ACROSS], torque.values[n + UP])
    derivative(y, torque.forces, chain, work, dydt)


@inner_kernel
def _along_line(
    t: float, y: FloatArray, torque: Sampled, chain: AnyArrays, work: FloatArray,
    dydt: FloatArray,
) -> None:  # fmt: skip
    n, half = torque.line.shape[1] - LAW_ENTRIES, y.size // 2
    since, line = t - torque.begin, torque.line
    for i in range(n):
        torque.forces[i] = line[0, i] + since * line[1, i]
    if half > n:
        torque.forces[n] = line[0, n + FORCE] + since * line[1, n + FORCE]
        across, up = line[0, n + ACROSS], line[0, n + UP]
        accelerate_base(chain, across + since * line[1, n + ACROSS], up + since * line[1, n + UP])
    derivative(y, torque.forces, chain, work, dydt)


@chosen_by_type("torque", {0: _steady, Driven: _by_law, Sampled: _along_line})
def slope(
    t: float, y: FloatArray, torque: Torque, chain: AnyArrays, work: FloatArray, dydt: FloatArray
) -> None:
    """Write the time derivative of the state y = (q, u) at the instant `t` into `dydt`."""
    raise NotImplementedError
