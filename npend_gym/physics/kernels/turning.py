"""Pseudo-periods while integrating: the instants at which each bob or rod turns.

A *signal* is a quantity of one rod whose zeros are the turning points of a reading:

=======  ============================================  =========================
reading  signal                                        slope
=======  ============================================  =========================
BOB      horizontal velocity of the bob                its horizontal acceleration
LINK     angular velocity of the rod                   its angular acceleration
HEIGHT   height of the bob above its start             its vertical velocity
=======  ============================================  =========================

Each step is cut into pieces at whose ends the signals and slopes are taken from the dense output.
Where the slope changes sign within a piece, the extremum is located and the piece is cut there, so
that an excursion shorter than a piece is seen too: between cuts a signal is monotone.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.compiled.jit import inlined_kernel, inner_kernel, kernel, spliced_kernel
from npend_gym.compiled.packs import WIDTH, NumbersOf, any_of, bare, packs, where
from npend_gym.compiled.sincos import sincos
from npend_gym.physics.kernels.dop853 import Solver, attempt, prepare_dense, start
from npend_gym.physics.kernels.dynamics import Rods

BOB, LINK, HEIGHT = 0, 1, 2
T_END, THRESHOLD, STATUS = range(3)  # rows of what belongs to a release
RUNNING, DONE, STUCK = 0.0, 1.0, -1.0  # stuck: no step is small enough
SCRATCH_ROWS = 7
_PIECES = 4  # of a step; at these tolerances a step is about a radian of the fastest mode
_ROOT_TOLERANCE = 1e-11  # s
_MAX_ITERATIONS = 100


class Turns(NamedTuple):
    """What is known of each rod's turning points so far; all of shape (n,)."""

    period: FloatArray  # s; NaN until complete
    orientation: FloatArray  # +1 where the rod was released from positive angles, else -1
    sign: FloatArray  # of the signal, once it counted; 0 before
    risen: FloatArray  # 1 where the signal has crossed from - to +
    zero: FloatArray  # s; latest zero of the signal
    start: FloatArray  # starting angle; its cosine gives the starting height


def new_turns(theta: FloatArray, orientation: FloatArray) -> Turns:
    """Return the record of a release from `theta`, nothing seen yet."""
    n = theta.size
    nan = np.full(n, np.nan)
    return Turns(nan, orientation, np.zeros(n), np.zeros(n), nan.copy(), theta.copy())


@inlined_kernel
def _at(solver: Solver, x: float, j: int) -> tuple[float, float]:
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


@inner_kernel
def _signals(
    reading: int, solver: Solver, x: float, first: int, last: int, turns: Turns, rods: Rods,
    signal: FloatArray, slope: FloatArray,
) -> None:  # fmt: skip
    """Write signal and slope of rods first..last at fraction `x` of the step.

    A bob's motion is the sum over the rods above it: but for LINK, `first` must be 0.
    """
    n = turns.start.size
    value = rate = 0.0
    for i in range(first, last + 1):
        omega, alpha = _at(solver, x, n + i)
        if reading == LINK:
            value, rate = omega, alpha
        else:
            theta, _ = _at(solver, x, i)
            s, c = sincos(theta)
            l = rods.length[i]
            if reading == BOB:
                value = value + l * (omega * c)
                rate = rate + l * (alpha * c - (omega * omega) * s)
            else:
                _, c0 = sincos(turns.start[i])
                value = value + l * (c0 - c)
                rate = rate + l * (omega * s)
        signal[i] = turns.orientation[i] * value
        slope[i] = turns.orientation[i] * rate


@inner_kernel
def _root(
    of_slope: bool, reading: int, i: int, solver: Solver, a: float, fa: float, b: float, fb: float,
    turns: Turns, rods: Rods, scratch: FloatArray,
) -> tuple[float, float]:  # fmt: skip
    """Return where rod i's signal (or its slope) is zero between `a` and `b`, and the signal there.

    Illinois variant of regula falsi: keeps the bracket, no derivative needed.
    """
    first = i if reading == LINK else 0
    tolerance = _ROOT_TOLERANCE / (solver.clock[1] - solver.clock[0])
    x = b
    for _ in range(_MAX_ITERATIONS):
        x = b if fb == 0.0 else b - fb * ((b - a) / (fb - fa))
        _signals(reading, solver, x, first, i, turns, rods, scratch[0], scratch[1])
        f = scratch[1, i] if of_slope else scratch[0, i]
        if f == 0.0 or abs(x - b) <= tolerance:
            break
        if (f > 0.0) == (fb > 0.0):
            fa *= 0.5
        else:
            a, fa = b, fb
        b, fb = x, f
    return x, scratch[0, i]


@inner_kernel
def count_sign(
    reading: int, i: int, t: float, f: float, at_extremum: bool, threshold: float, turns: Turns
) -> None:
    """Take note that rod i's signal has come to `f` at time `t`, its latest zero being known."""
    sign = turns.sign[i]
    if reading == HEIGHT and sign != 0.0 and at_extremum and abs(f) <= threshold:
        turns.period[i] = t  # touches the starting height without crossing it
        return
    if abs(f) <= threshold:
        return
    new = 1.0 if f > 0.0 else -1.0
    if sign == -new:
        if reading == HEIGHT or (new < 0.0 and turns.risen[i] == 1.0):
            turns.period[i] = turns.zero[i]
        elif new > 0.0:
            turns.risen[i] = 1.0
    turns.sign[i] = new


@inner_kernel
def _follow_piece(
    reading: int, solver: Solver, a: float, b: float, threshold: float, turns: Turns, rods: Rods,
    scratch: FloatArray,
) -> None:  # fmt: skip
    """Follow the marked signals of one chain from fraction `a` of the step to `b`."""
    t_old, ends, marked = solver.clock[0], scratch[2:6], scratch[6]
    h = solver.clock[1] - t_old
    for i in range(turns.start.size):
        left, f = a, ends[0, i]
        turning = ends[1, i] * ends[3, i] < 0.0
        for last in (False, True):
            if marked[i] == 0.0 or not (math.isnan(turns.period[i]) and (last or turning)):
                continue
            right, g = b, ends[2, i]
            if not last:
                right, g = _root(
                    True, reading, i, solver, a, ends[1, i], b, ends[3, i], turns, rods, scratch
                )
            crosses = (f <= 0.0 and g > 0.0) or (f >= 0.0 and g < 0.0)
            if crosses and turns.sign[i] != 0.0:
                x, _ = _root(False, reading, i, solver, left, f, right, g, turns, rods, scratch)
                turns.zero[i] = t_old + h * x
            count_sign(reading, i, t_old + h * right, g, not last, threshold, turns)
            left, f = right, g


@inlined_kernel
def _mark_piece(
    reading: int, solver: Solver, b: float, taken: bool, threshold: float, turns: Turns,
    rods: Rods, scratch: FloatArray,
) -> bool:  # fmt: skip
    """Take signals and slopes at fraction `b` of the steps that were `taken`; mark what happened.

    Marked are signals that have turned, crossed zero or come to a sign that counts. Return whether
    there are any.
    """
    n = turns.start.size
    found = False
    _signals(reading, solver, b, 0, n - 1, turns, rods, scratch[0], scratch[1])
    for i in range(n):
        f, slope = scratch[4, i], scratch[5, i]  # until now the right end
        g, slope_now = scratch[0, i], scratch[1, i]
        scratch[2, i], scratch[3, i] = f, slope
        scratch[4, i], scratch[5, i] = where(taken, g, f), where(taken, slope_now, slope)
        sign = turns.sign[i]
        new = where(g > threshold, 1.0, where(g < -threshold, -1.0, sign))
        event = (slope * slope_now < 0.0) | (new != sign)
        event = event | ((f <= 0.0) & (g > 0.0)) | ((f >= 0.0) & (g < 0.0))
        event = event & taken & (turns.period[i] != turns.period[i])  # not known: no number
        scratch[6, i] = where(event, 1.0, 0.0)
        found = found | any_of(event)
    return found


@inlined_kernel
def _solver_of(solver: Solver, lane: int, width: int) -> Solver:
    """Return the part of one lane; likewise below."""
    return Solver(
        solver.clock[lane::width], solver.y_old[lane::width], solver.y[lane::width],
        solver.k[:, lane::width], solver.poly[:, lane::width], solver.work[:, lane::width],
    )  # fmt: skip


@inlined_kernel
def _rods_of(rods: Rods, lane: int, width: int) -> Rods:
    return Rods(
        rods.inverse_mass[lane::width], rods.length[lane::width],
        rods.inverse_length[lane::width], rods.damping[lane::width], rods.gravity[lane::width],
        rods.drag[lane::width], rods.pivot[lane::width],
    )  # fmt: skip


@inlined_kernel
def _turns_of(turns: Turns, lane: int, width: int) -> Turns:
    return Turns(
        turns.period[lane::width], turns.orientation[lane::width], turns.sign[lane::width],
        turns.risen[lane::width], turns.zero[lane::width], turns.start[lane::width],
    )  # fmt: skip


@inlined_kernel
def _as_numbers(
    view: NumbersOf, solver: Solver, rods: Rods, turns: Turns
) -> tuple[Solver, Rods, Turns]:
    return (
        Solver(
            view(solver.clock), view(solver.y_old), view(solver.y), view(solver.k),
            view(solver.poly), view(solver.work),
        ),
        Rods(
            view(rods.inverse_mass), view(rods.length), view(rods.inverse_length),
            view(rods.damping), view(rods.gravity), view(rods.drag), view(rods.pivot),
        ),
        Turns(
            view(turns.period), view(turns.orientation), view(turns.sign), view(turns.risen),
            view(turns.zero), view(turns.start),
        ),
    )  # fmt: skip


@spliced_kernel
def _measure(
    view: NumbersOf, width: int, reading: int, starting: bool, max_steps: int, lanes: Solver,
    lane_rods: Rods, lane_turns: Turns, torque: FloatArray, rtol: float, atol: float,
    release: FloatArray, lane_scratch: FloatArray,
) -> None:  # fmt: skip
    solver, rods, turns = _as_numbers(view, lanes, lane_rods, lane_turns)
    torque, scratch, state = view(torque), view(lane_scratch), view(release)
    n, clock, threshold = turns.start.size, solver.clock, state[THRESHOLD]
    if starting:
        start(solver, rods, torque, rtol, atol)
    for _ in range(max_steps):
        going = state[STATUS] == RUNNING
        if not any_of(going):
            return
        t_end = where(going, state[T_END], clock[1])
        outcome = attempt(solver, t_end, rods, torque, rtol, atol)
        state[STATUS] = where(going & (outcome < 0.0), STUCK, state[STATUS])
        taken = going & (outcome > 0.0)
        if not any_of(taken):
            continue
        prepare_dense(solver, rods, torque)
        first = taken & (clock[0] == 0.0)
        if any_of(first):
            _mark_piece(reading, solver, 0.0, first, threshold, turns, rods, scratch)
        for piece in range(_PIECES):
            a, b = piece / _PIECES, (piece + 1) / _PIECES
            if not _mark_piece(reading, solver, b, taken, threshold, turns, rods, scratch):
                continue
            for lane in range(width):
                _follow_piece(
                    reading, _solver_of(lanes, lane, width), a, b,
                    release[THRESHOLD * width + lane], _turns_of(lane_turns, lane, width),
                    _rods_of(lane_rods, lane, width), lane_scratch[:, lane::width],
                )  # fmt: skip
        missing = 0.0
        for i in range(n):
            missing = missing + where(turns.period[i] != turns.period[i], 1.0, 0.0)
        finished = taken & ((missing == 0.0) | (clock[1] >= t_end))
        state[STATUS] = where(finished, DONE, state[STATUS])


@kernel
def measure_one(
    reading: int, starting: bool, max_steps: int, solver: Solver, rods: Rods, turns: Turns,
    torque: FloatArray, rtol: float, atol: float, release: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Follow the release of one chain; see `measure_many`."""
    _measure(
        bare, 1, reading, starting, max_steps, solver, rods, turns, torque, rtol, atol, release,
        scratch,
    )  # fmt: skip


@kernel
def measure_many(
    reading: int, starting: bool, max_steps: int, solver: Solver, rods: Rods, turns: Turns,
    torque: FloatArray, rtol: float, atol: float, release: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Integrate WIDTH releases, each with its own steps, until all their rods are complete.

    Arrays are flat with the lane innermost. Each release ends at its own T_END too; `release` has
    a row each for T_END, THRESHOLD and STATUS. `scratch` has SCRATCH_ROWS rows for the rods and
    belongs to the releases from the first call, which is `starting`, to the last. After
    `max_steps` attempts the call returns, and another goes on. `turns.period` holds what was found.
    """
    _measure(
        packs, WIDTH, reading, starting, max_steps, solver, rods, turns, torque, rtol, atol,
        release, scratch,
    )  # fmt: skip
