"""Pseudo-periods of releases: integrated by DOP853 until every bob or rod has turned twice.

Each step is cut into subintervals at whose ends signals and slopes (see `turning_points`) are taken
from the dense output; those that may hold a turning point are followed, rod by rod.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import NumbersOf, bare, packs
from npend_gym.compiled.jit import (
    chosen_by_type,
    inlined_kernel,
    inner_kernel,
    kernel,
    spliced_kernel,
)
from npend_gym.compiled.packs import WIDTH, any_of, where
from npend_gym.compiled.sincos import sincos
from npend_gym.physics.kernels.dop853 import (
    Problem,
    Solver,
    attempt,
    lane_of_solver,
    prepare_dense,
    solver_as,
    start,
)
from npend_gym.physics.kernels.dynamics import AnyArrays
from npend_gym.physics.kernels.link_terms import LinkArrays, MachineArrays
from npend_gym.physics.kernels.springs import SpringArrays
from npend_gym.physics.kernels.tensions import ChainArrays
from npend_gym.physics.kernels.turning_points import (
    COM,
    HEIGHT,
    LINK,
    Interval,
    Record,
    Rule,
    follow_interval,
    may_turn,
)

T_END, THRESHOLD, STATUS = range(3)  # rows of `release`
RUNNING, DONE, STUCK = 0.0, 1.0, -1.0  # stuck: no step is small enough
# Rows of the work space: signals and slopes, those at the left and the right end of the
# subinterval, and 1 for rods that may turn in it
_SIGNAL, _SLOPE, _LEFT, _SLOPE_LEFT, _RIGHT, _SLOPE_RIGHT, _MARKED = range(7)
RELEASE_ROWS = 7
_SUBINTERVALS = 4  # of a step; at these tolerances a step is about a radian of the fastest mode
_ROOT_TOLERANCE = 1e-11  # s


class Stretching(NamedTuple):
    """Rods that stretch, where their lengths stand in the state too."""

    length: FloatArray  # without load


Rods = FloatArray | Stretching  # the lengths of rigid rods, or those


@inlined_kernel
def _rigid_rods(chain: Any, lane: int, width: int) -> FloatArray:
    return chain.length[lane::width]


@inlined_kernel
def _springs(chain: SpringArrays, lane: int, width: int) -> Stretching:
    return Stretching(chain.length[lane::width])


@chosen_by_type(
    "chain",
    {
        ChainArrays: _rigid_rods,
        LinkArrays: _rigid_rods,
        MachineArrays: _rigid_rods,
        SpringArrays: _springs,
    },
)
def _rods_of(chain: AnyArrays, lane: int, width: int) -> Rods:
    """Return what readings need to know of the rods of one lane."""
    raise NotImplementedError


class _Dense(NamedTuple):
    """The signal of rod `i` during the last step of a solver."""

    reading: int
    i: int
    solver: Solver
    record: Record
    rods: Rods
    scratch: FloatArray


@inlined_kernel
def _state_at(solver: Solver, x: float, j: int) -> tuple[float, float]:
    """Return component `j` of the state at fraction `x` of the step, and its time derivative."""
    poly = solver.poly
    u = 1.0 - x
    p = poly[6, j]
    d = 0.0 * p
    for row in range(5, -1, -1):
        # multiplied by x and by 1 - x in turn, as in `interpolate`
        if row % 2 == 1:
            d = d * x + p
            p = p * x + poly[row, j]
        else:
            d = d * u - p
            p = p * u + poly[row, j]
    return solver.y_old[j] + p * x, (d * x + p) / (solver.clock[1] - solver.clock[0])


@inlined_kernel
def _along_rigid_rod(
    reading: int, solver: Solver, x: float, i: int, omega: float, alpha: float, record: Record,
    rods: FloatArray,
) -> tuple[float, float]:  # fmt: skip
    theta, _ = _state_at(solver, x, i)
    s, c = sincos(theta)
    l = rods[i]
    if reading != HEIGHT:
        return l * (omega * c), l * (alpha * c - (omega * omega) * s)
    _, c0 = sincos(record.per_rod[i])
    return l * (c0 - c), l * (omega * s)


@inlined_kernel
def _along_spring(
    reading: int, solver: Solver, x: float, i: int, omega: float, alpha: float, record: Record,
    rods: Stretching,
) -> tuple[float, float]:  # fmt: skip
    size = solver.y.size // 2
    first = size - rods.length.size  # of the stretches, behind a base that moves
    theta, _ = _state_at(solver, x, i)
    stretch, _ = _state_at(solver, x, first + i)
    growth, change = _state_at(solver, x, size + first + i)
    s, c = sincos(theta)
    r = rods.length[i] + stretch
    if reading != HEIGHT:
        turned = r * (alpha * c - (omega * omega) * s) + 2.0 * (growth * (omega * c))
        return r * (omega * c) + growth * s, turned + change * s
    return record.per_rod[i] - r * c, r * (omega * s) - growth * c


@chosen_by_type("rods", {0: _along_rigid_rod, Stretching: _along_spring})
def _along_rod(
    reading: int, solver: Solver, x: float, i: int, omega: float, alpha: float, record: Record,
    rods: Rods,
) -> tuple[float, float]:  # fmt: skip
    """Return what rod `i` adds to the signal of its bob and of those below, and to the slope."""
    raise NotImplementedError


@inner_kernel
def _signal_of_com(
    solver: Solver, x: float, record: Record, rods: Rods, scratch: FloatArray
) -> None:  # fmt: skip
    """Write signal and slope of the centre of mass at fraction `x` of the step.

    Each rod moves what its end carries, and its own mass as far as its centre is out.
    """
    n = record.per_rod.size
    velocities, value, rate = solver.y.size // 2, 0.0, 0.0
    for i in range(n):
        omega, alpha = _state_at(solver, x, velocities + i)
        f, slope = _along_rod(COM, solver, x, i, omega, alpha, record, rods)
        value, rate = value + record.per_rod[i] * f, rate + record.per_rod[i] * slope
    scratch[_SIGNAL][0] = record.orientation[0] * value
    scratch[_SLOPE][0] = record.orientation[0] * rate


@inner_kernel
def _signals(
    reading: int, solver: Solver, x: float, first: int, last: int, record: Record,
    rods: Rods, scratch: FloatArray,
) -> None:  # fmt: skip
    """Write signal and slope of rods `first` to `last` at fraction `x` of the step.

    A bob's motion is the sum over the rods above it: except for LINK, `first` must be 0.
    """
    if reading == COM:
        _signal_of_com(solver, x, record, rods, scratch)
        return
    velocities, signal, slope = solver.y.size // 2, scratch[_SIGNAL], scratch[_SLOPE]
    value = rate = 0.0
    for i in range(first, last + 1):
        omega, alpha = _state_at(solver, x, velocities + i)
        if reading == LINK:
            value, rate = omega, alpha
        else:
            f, slope_here = _along_rod(reading, solver, x, i, omega, alpha, record, rods)
            value, rate = value + f, rate + slope_here
        signal[i] = record.orientation[i] * value
        slope[i] = record.orientation[i] * rate


@inner_kernel
def _dense_at(motion: _Dense, x: float) -> tuple[float, float]:
    """Return the signal of one rod at fraction `x` of the step, and its slope."""
    first = motion.i if motion.reading == LINK else 0
    _signals(
        motion.reading, motion.solver, x, first, motion.i, motion.record, motion.rods,
        motion.scratch,
    )  # fmt: skip
    return motion.scratch[_SIGNAL, motion.i], motion.scratch[_SLOPE, motion.i]


@inner_kernel
def _follow_marked(
    reading: int, solver: Solver, left: float, right: float, threshold: float, record: Record,
    rods: Rods, scratch: FloatArray,
) -> None:  # fmt: skip
    """Follow the marked rods of one chain from fraction `left` of the step to `right`."""
    t, h = solver.clock[0], solver.clock[1] - solver.clock[0]
    rule = Rule(reading, threshold, _ROOT_TOLERANCE / h)
    for i in range(record.period.size):
        if scratch[_MARKED, i] != 0.0:
            interval = Interval(
                t, h, left, right, scratch[_LEFT, i], scratch[_SLOPE_LEFT, i], scratch[_RIGHT, i],
                scratch[_SLOPE_RIGHT, i],
            )  # fmt: skip
            motion = _Dense(reading, i, solver, record, rods, scratch)
            follow_interval(_dense_at, motion, rule, interval, record, i)


@inlined_kernel
def _mark(
    reading: int, solver: Solver, right: float, taken: bool, threshold: float, record: Record,
    rods: Rods, scratch: FloatArray,
) -> bool:  # fmt: skip
    """Take signals and slopes at fraction `right` of the steps that were `taken`.

    Mark the rods that may turn between the fraction looked at before and this one; return whether
    there are any.
    """
    n = record.period.size
    found = False
    _signals(reading, solver, right, 0, n - 1, record, rods, scratch)
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
def _lane_of_record(record: Record, lane: int, width: int) -> Record:
    """Return the turning points of one lane."""
    return Record(
        record.period[lane::width], record.orientation[lane::width], record.sign[lane::width],
        record.risen[lane::width], record.zero[lane::width], record.per_rod[lane::width],
    )  # fmt: skip


@inlined_kernel
def _as_numbers(
    view: NumbersOf, solver: Solver, problem: Problem, record: Record
) -> tuple[Solver, Problem, Record]:
    """Return views of all arrays as packs, or as bare floats."""
    return (
        solver_as(view, solver),
        Problem(
            view(problem.chain),
            view(problem.torque), problem.rtol, problem.atol,
        ),
        Record(
            view(record.period), view(record.orientation), view(record.sign), view(record.risen),
            view(record.zero), view(record.per_rod),
        ),
    )  # fmt: skip


@spliced_kernel
def _measure(
    view: NumbersOf, width: int, reading: int, starting: bool, max_steps: int,
    lanes: tuple[Solver, Problem, Record], release: FloatArray, lane_scratch: FloatArray,
) -> None:  # fmt: skip
    solver, problem, record = _as_numbers(view, *lanes)
    scratch, state = view(lane_scratch), view(release)
    # the loop makes views of these
    lane_solver, lane_problem, lane_record = _as_numbers(bare, *lanes)
    lane_scratch = bare(lane_scratch)
    n, clock, threshold = record.period.size, solver.clock, state[THRESHOLD]
    rods = _rods_of(problem.chain, 0, 1)
    if starting:
        start(solver, problem)
    for _ in range(max_steps):
        running = state[STATUS] == RUNNING
        if not any_of(running):
            return
        t_end = where(running, state[T_END], clock[1])
        outcome = attempt(solver, t_end, problem)
        state[STATUS] = where(running & (outcome < 0.0), STUCK, state[STATUS])
        taken = running & (outcome > 0.0)
        if not any_of(taken):
            continue
        prepare_dense(solver, problem)
        first = taken & (clock[0] == 0.0)
        if any_of(first):
            _mark(reading, solver, 0.0, first, threshold, record, rods, scratch)
        for part in range(_SUBINTERVALS):
            left, right = part / _SUBINTERVALS, (part + 1) / _SUBINTERVALS
            if not _mark(reading, solver, right, taken, threshold, record, rods, scratch):
                continue
            for lane in range(width):
                _follow_marked(
                    reading, lane_of_solver(lane_solver, lane, width), left, right,
                    release[THRESHOLD * width + lane], _lane_of_record(lane_record, lane, width),
                    _rods_of(lane_problem.chain, lane, width), lane_scratch[:, lane::width],
                )  # fmt: skip
        missing = 0.0
        for i in range(n):
            missing = missing + where(record.period[i] != record.period[i], 1.0, 0.0)
        finished = taken & ((missing == 0.0) | (clock[1] >= t_end))
        state[STATUS] = where(finished, DONE, state[STATUS])


@kernel
def measure_one(
    reading: int, starting: bool, max_steps: int, lanes: tuple[Solver, Problem, Record],
    release: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Follow the release of one chain; see `measure_many`."""
    _measure(bare, 1, reading, starting, max_steps, lanes, release, scratch)


@kernel
def measure_many(
    reading: int, starting: bool, max_steps: int, lanes: tuple[Solver, Problem, Record],
    release: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Integrate WIDTH releases, each with its own steps, until all their rods are complete.

    Arrays are flat with the lane innermost. Each release ends at its own T_END too; `release` has
    a row each for T_END, THRESHOLD and STATUS. `scratch` has RELEASE_ROWS rows for the rods and
    belongs to the releases from the first call, which is `starting`, to the last. After
    `max_steps` attempts the call returns, and another continues. The record's `period` holds what
    was found.
    """
    _measure(packs, WIDTH, reading, starting, max_steps, lanes, release, scratch)
