"""Pseudo-periods of releases: integrated by DOP853 until every bob or rod has turned twice.

Each step is cut into subintervals at whose ends signals and slopes (see `turning_points`) are taken
from the dense output; those that may hold a turning point are followed, rod by rod.
"""

# ruff: noqa: ARG001  rods of all kinds share the parameters of a kernel
from __future__ import annotations

import math
from typing import Any, NamedTuple

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import NumbersOf, lane
from npend_gym.compiled.jit import chosen_by_type, inlined_kernel, inner_kernel
from npend_gym.compiled.packs import any_of, where
from npend_gym.compiled.sincos import sincos
from npend_gym.physics.kernels.link_terms import (
    AnyArrays,
    ChainArrays,
    LinkArrays,
    MachineArrays,
    SliderArrays,
    SpringArrays,
)
from npend_gym.physics.kernels.methods import Method, prepare_dense
from npend_gym.physics.kernels.solver import DONE, STATUS, Problem, Solver, state_at
from npend_gym.physics.kernels.turning_points import (
    AROUND,
    COM,
    COM_AROUND,
    HEIGHT,
    LINK,
    Interval,
    Record,
    TurningRule,
    follow_interval,
    latest_sign,
    may_turn,
)

# Rows of the work space: signals and slopes, those at the left and the right end of the
# subinterval, and 1 for rods that may turn in it
_SIGNAL, _SLOPE, _LEFT, _SLOPE_LEFT, _RIGHT, _SLOPE_RIGHT, _MARKED = range(7)
RELEASE_ROWS = 7
_SUBINTERVALS = 4  # of a step; at these tolerances a step is about a radian of the fastest mode
_ROOT_TOLERANCE = 1e-11  # s


class Releases(NamedTuple):
    """Releases, each of which ends when all its rods have completed their pseudo-period."""

    definition: int
    threshold: FloatArray  # above which the sign of a signal counts, (lanes,)
    record: Record
    scratch: FloatArray  # RELEASE_ROWS for the rods, zeros at first


class Stretching(NamedTuple):
    """Rods that stretch, where their lengths stand in the state too."""

    length: FloatArray  # without load


Rods = FloatArray | Stretching  # the lengths of rigid rods, or those


@inlined_kernel
def _rigid_rods(chain: Any) -> FloatArray:
    return chain.length


@inlined_kernel
def _springs(chain: Any) -> Stretching:
    return Stretching(chain.length)


@chosen_by_type(
    "chain",
    {
        ChainArrays: _rigid_rods,
        LinkArrays: _rigid_rods,
        MachineArrays: _rigid_rods,
        SpringArrays: _springs,
        SliderArrays: _springs,
    },
)
def _rods_of(chain: AnyArrays) -> Rods:
    """Quantities of the rods that definitions need."""
    raise NotImplementedError


class _Dense(NamedTuple):
    """The signal of rod `i` during the last step of a solver."""

    i: int
    solver: Solver
    release: Releases
    rods: Rods


@inlined_kernel
def _moving(solver: Solver, x: float, j: int) -> tuple[float, float]:
    """Return component `j` of the state at fraction `x` of the step, and its time derivative."""
    value, slope = state_at(solver, x, j)
    return value, slope / (solver.clock[1] - solver.clock[0])


@inlined_kernel
def _rigid_length(solver: Solver, x: float, i: int, rods: FloatArray) -> tuple[float, float, float]:
    return rods[i], 0.0, 0.0


@inlined_kernel
def _spring_length(
    solver: Solver, x: float, i: int, rods: Stretching
) -> tuple[float, float, float]:
    size = solver.y.size // 2
    first = size - rods.length.size
    stretch, _ = _moving(solver, x, first + i)
    growth, change = _moving(solver, x, size + first + i)
    return rods.length[i] + stretch, growth, change


@chosen_by_type("rods", {0: _rigid_length, Stretching: _spring_length})
def _length(solver: Solver, x: float, i: int, rods: Rods) -> tuple[float, float, float]:
    """Return the length of rod `i` at fraction `x` of the step, and its two time derivatives."""
    raise NotImplementedError


@inlined_kernel
def _rigid_height(length: float, c: float, start: float, rods: FloatArray) -> float:
    _, c_start = sincos(start)
    return length * (c_start - c)


@inlined_kernel
def _spring_height(length: float, c: float, start: float, rods: Stretching) -> float:
    return start - length * c


@chosen_by_type("rods", {0: _rigid_height, Stretching: _spring_height})
def _height(length: float, c: float, start: float, rods: Rods) -> float:
    """Return how far the lower end of a rod has risen against its upper one, from its `start`."""
    raise NotImplementedError


@inlined_kernel
def _along_rod(
    definition: int, solver: Solver, x: float, i: int, omega: float, alpha: float, record: Record,
    rods: Rods,
) -> tuple[float, float]:  # fmt: skip
    """Return terms of rod `i` in the signal of its bob and of those below, and in the slope."""
    theta, _ = _moving(solver, x, i)
    r, growth, change = _length(solver, x, i, rods)
    s, c = sincos(theta)
    if definition == HEIGHT:
        return _height(r, c, record.per_rod[i], rods), r * (omega * s) - growth * c
    turned = r * (alpha * c - (omega * omega) * s) + 2.0 * (growth * (omega * c))
    return r * (omega * c) + growth * s, turned + change * s


@inlined_kernel
def _signals_around(solver: Solver, x: float, last: int, release: Releases, rods: Rods) -> None:
    """Write signal and slope of rods 0 to `last` around the pivot at fraction `x` of the step."""
    record, signal, slope = release.record, release.scratch[_SIGNAL], release.scratch[_SLOPE]
    of_com, velocities = release.definition == COM_AROUND, solver.y.size // 2
    px = py = vx = vy = ax = ay = 0.0
    for i in range(record.per_rod.size if of_com else last + 1):
        theta, _ = _moving(solver, x, i)
        omega, alpha = _moving(solver, x, velocities + i)
        r, growth, change = _length(solver, x, i, rods)
        s, c = sincos(theta)
        k, speed = record.per_rod[i], r * omega
        along, across = change - speed * omega, r * alpha + 2.0 * (growth * omega)
        px, py = px + k * (r * s), py - k * (r * c)
        vx, vy = vx + k * (speed * c + growth * s), vy + k * (speed * s - growth * c)
        ax, ay = ax + k * (across * c + along * s), ay + k * (across * s - along * c)
        own = 0 if of_com else i
        signal[own] = record.orientation[own] * (px * vy - py * vx)
        slope[own] = record.orientation[own] * (px * ay - py * ax)


@inlined_kernel
def _signal_of_com(solver: Solver, x: float, release: Releases, rods: Rods) -> None:
    """Write signal and slope of the centre of mass at fraction `x` of the step.

    Each rod moves what its end carries, and its own mass as far as its centre is out.
    """
    record, scratch = release.record, release.scratch
    velocities, value, rate = solver.y.size // 2, 0.0, 0.0
    for i in range(record.per_rod.size):
        omega, alpha = _moving(solver, x, velocities + i)
        f, slope = _along_rod(COM, solver, x, i, omega, alpha, record, rods)
        value, rate = value + record.per_rod[i] * f, rate + record.per_rod[i] * slope
    scratch[_SIGNAL][0] = record.orientation[0] * value
    scratch[_SLOPE][0] = record.orientation[0] * rate


@inner_kernel
def _signals(
    solver: Solver, x: float, first: int, last: int, release: Releases, rods: Rods
) -> None:
    """Write signal and slope of rods `first` to `last` at fraction `x` of the step.

    A bob's motion is the sum over the rods above it: except for LINK, `first` must be 0.
    """
    definition, record = release.definition, release.record
    if definition == COM:
        _signal_of_com(solver, x, release, rods)
        return
    if definition >= AROUND:
        _signals_around(solver, x, last, release, rods)
        return
    velocities = solver.y.size // 2
    signal, slope = release.scratch[_SIGNAL], release.scratch[_SLOPE]
    value = rate = 0.0
    for i in range(first, last + 1):
        omega, alpha = _moving(solver, x, velocities + i)
        if definition == LINK:
            value, rate = omega, alpha
        else:
            f, slope_here = _along_rod(definition, solver, x, i, omega, alpha, record, rods)
            value, rate = value + f, rate + slope_here
        signal[i] = record.orientation[i] * value
        slope[i] = record.orientation[i] * rate


@inner_kernel
def _dense_at(motion: _Dense, x: float) -> tuple[float, float]:
    """Return the signal of one rod at fraction `x` of the step, and its slope."""
    release, i = motion.release, motion.i
    first = i if release.definition == LINK else 0
    _signals(motion.solver, x, first, i, release, motion.rods)
    return release.scratch[_SIGNAL, i], release.scratch[_SLOPE, i]


@inner_kernel
def _follow_marked(
    solver: Solver, left: float, right: float, release: Releases, rods: Rods
) -> None:
    """Follow the marked rods of one chain from fraction `left` of the step to `right`."""
    t, h = solver.clock[0], solver.clock[1] - solver.clock[0]
    record, scratch = release.record, release.scratch
    rule = TurningRule(release.definition, release.threshold[0], _ROOT_TOLERANCE / h)
    for i in range(record.period.size):
        if scratch[_MARKED, i] != 0.0:
            interval = Interval(
                t, h, left, right, scratch[_LEFT, i], scratch[_SLOPE_LEFT, i], scratch[_RIGHT, i],
                scratch[_SLOPE_RIGHT, i],
            )  # fmt: skip
            motion = _Dense(i, solver, release, rods)
            follow_interval(_dense_at, motion, rule, interval, record, i)


@inlined_kernel
def _mark(solver: Solver, right: float, taken: bool, release: Releases, rods: Rods) -> bool:
    """Take signals and slopes at fraction `right` of the steps that were `taken`.

    Mark the rods that may turn between the fraction looked at before and this one; return whether
    there are any.
    """
    record, scratch, threshold = release.record, release.scratch, release.threshold[0]
    n = record.period.size
    found = False
    _signals(solver, right, 0, n - 1, release, rods)
    for i in range(n):
        f, slope = scratch[_RIGHT, i], scratch[_SLOPE_RIGHT, i]  # the right end until now
        g, slope_now = scratch[_SIGNAL, i], scratch[_SLOPE, i]
        scratch[_LEFT, i], scratch[_SLOPE_LEFT, i] = f, slope
        scratch[_RIGHT, i] = where(taken, g, f)
        scratch[_SLOPE_RIGHT, i] = where(taken, slope_now, slope)
        marked = may_turn(record, i, threshold, f, slope, g, slope_now) & taken
        scratch[_MARKED, i] = where(marked, 1.0, 0.0)
        found = found | any_of(marked)
    return found


@inlined_kernel
def observe_release(
    view: NumbersOf, width: int, solver: Solver, problem: Problem, method: Method, taken: bool,
    observer: Releases, status: FloatArray,
) -> None:  # fmt: skip
    """Look for turning points in a step that the lanes in `taken` have taken."""
    release, rods, state = view(observer), _rods_of(problem.chain), view(status)
    prepare_dense(solver, problem, method)
    first = any_of(taken & (solver.clock[0] == 0.0))
    for part in range(0 if first else 1, _SUBINTERVALS + 1):  # 0: the start itself
        begun = taken & (solver.clock[0] <= (0.0 if part == 0 else math.inf))
        right = part / _SUBINTERVALS
        found = _mark(solver, right, begun, release, rods)
        if part == 0:
            for i in range(release.record.period.size):
                sign = latest_sign(release.scratch[_RIGHT, i], release.threshold[0], 0.0)
                release.record.sign[i] = where(begun, sign, release.record.sign[i])
        elif found:
            left = (part - 1) / _SUBINTERVALS
            for k in range(width):
                own = lane(release, k)
                _follow_marked(lane(solver, k), left, right, own, lane(rods, k))
    missing = 0.0
    for i in range(release.record.period.size):
        period = release.record.period[i]
        missing = missing + where(period != period, 1.0, 0.0)  # noqa: PLR0124 - it is NaN
    state[STATUS] = where(taken & (missing == 0.0), DONE, state[STATUS])
