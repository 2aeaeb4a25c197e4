"""Forces that change within a step: by a function of the user's, or along straight lines."""

# ruff: noqa: ARG001  what stands for another function has its parameters
from __future__ import annotations

import math
from typing import Any, NamedTuple

from npend_gym._checks import FloatArray
from npend_gym.compiled.callbacks import call_function
from npend_gym.compiled.jit import chosen_by_type, inlined_kernel, inner_kernel
from npend_gym.physics.kernels.dynamics import FEATURES, AnyArrays, accelerations
from npend_gym.physics.kernels.link_terms import Base, ChainArrays

FORCE, ACROSS, UP = range(3)  # what stands after the torques on n joints
AFTER_TORQUES = 3


class Driven(NamedTuple):
    """Torques, a force on the cart and accelerations of the pivot, by a function."""

    function: int  # its address: see `npend_gym.compiled.callbacks`
    values: FloatArray  # what it has written last, (n + AFTER_TORQUES,)
    loads: FloatArray  # as `accelerations` takes them
    broken: FloatArray  # instant at which it wrote NaN or infinity for a finite state, (1,)


class Sampled(NamedTuple):
    """The same on straight lines from an instant on."""

    begin: float  # s
    line: FloatArray  # values there and their slopes, (2, n + AFTER_TORQUES)
    loads: FloatArray


class Listed(NamedTuple):
    """What acts at each stage of a step, or at all of them; see `tape.Rods`."""

    rows: FloatArray  # (stages or 1, n or more)


Torque = FloatArray | Driven | Sampled | Listed


@inlined_kernel
def _base_at_rest(chain: AnyArrays, across: float, up: float) -> None:
    pass


@inlined_kernel
def _base_that_moves(chain: Any, across: float, up: float) -> None:
    if chain.base.shape[0] > 0 and chain.base[Base.INVERSE_MASS, 0] == 0.0:
        chain.base[Base.ACROSS, 0], chain.base[Base.UP, 0] = across, up


@chosen_by_type("chain", {ChainArrays: _base_at_rest, **dict.fromkeys(FEATURES, _base_that_moves)})
def accelerate_base(chain: AnyArrays, across: float, up: float) -> None:
    """Give the pivot the acceleration that is prescribed for this instant."""
    raise NotImplementedError


@inlined_kernel
def _loads_by_function(
    t: float, q: FloatArray, u: FloatArray, torque: Driven, chain: AnyArrays, s: int
) -> FloatArray:
    values, loads = torque.values, torque.loads
    n = values.size - AFTER_TORQUES
    call_function(torque.function, t, q, u, values, q.size, n)
    total = 0.0
    for i in range(values.size):
        total += values[i]
    if not math.isfinite(total) and math.isfinite(t):
        diverged = 0.0  # NaN, where the state is not finite either
        for i in range(q.size):
            diverged += (q[i] - q[i]) + (u[i] - u[i])
        if diverged == 0.0:
            torque.broken[0] = t
    for i in range(loads.size):
        loads[i] = values[i]
    accelerate_base(chain, values[n + ACROSS], values[n + UP])
    return loads


@inlined_kernel
def _loads_along_line(
    t: float, q: FloatArray, u: FloatArray, torque: Sampled, chain: AnyArrays, s: int
) -> FloatArray:
    line, loads = torque.line, torque.loads
    n, since = line.shape[1] - AFTER_TORQUES, t - torque.begin
    for i in range(loads.size):
        loads[i] = line[0, i] + since * line[1, i]
    across, up = line[0, n + ACROSS], line[0, n + UP]
    accelerate_base(chain, across + since * line[1, n + ACROSS], up + since * line[1, n + UP])
    return loads


@inlined_kernel
def _steady_loads(
    t: float, q: FloatArray, u: FloatArray, torque: FloatArray, chain: AnyArrays, s: int
) -> FloatArray:
    return torque


@inlined_kernel
def _listed_loads(
    t: float, q: FloatArray, u: FloatArray, torque: Listed, chain: AnyArrays, s: int
) -> FloatArray:
    loads, n = torque.rows[min(s, torque.rows.shape[0] - 1)], chain.length.size
    if loads.size == n + AFTER_TORQUES:
        accelerate_base(chain, loads[n + ACROSS], loads[n + UP])
    return loads


@chosen_by_type(
    "torque",
    {
        0: _steady_loads,
        Driven: _loads_by_function,
        Sampled: _loads_along_line,
        Listed: _listed_loads,
    },
)
def loads_at(
    t: float, q: FloatArray, u: FloatArray, torque: Torque, chain: AnyArrays, s: int
) -> FloatArray:
    """Loads at the instant `t` of stage `s` of a step."""
    raise NotImplementedError


@inlined_kernel
def driven_accelerations(
    t: float, q: FloatArray, u: FloatArray, torque: Torque, chain: AnyArrays, work: FloatArray,
    alpha: FloatArray,
) -> Any:  # fmt: skip
    """Do as `accelerations` at the instant `t`, with the torques and forces of that instant."""
    return accelerations(q, u, loads_at(t, q, u, torque, chain, 0), chain, work, alpha)


@inner_kernel
def slope(
    t: Any, y: FloatArray, torque: Torque, chain: AnyArrays, work: FloatArray, dydt: FloatArray
) -> None:
    """Write the time derivative of the state y = (q, u) at the instant `t` into `dydt`."""
    size = y.size // 2
    for i in range(size):
        dydt[i] = y[size + i]
    driven_accelerations(t, y[:size], y[size:], torque, chain, work, dydt[size:])
