"""One step of many chains in one pass: substeps, turning points, work, and what is seen of it.

The turning points are those of the "bob" reading, found on the cubic through the velocities and
accelerations of each bob at the ends of a substep.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import FloatArray
from npend_gym.physics.kernels.dynamics import Rods, accelerations, copy
from npend_gym.physics.kernels.jit import inlined_kernel, kernel
from npend_gym.physics.kernels.lanes import (
    ALPHA,
    COS,
    DAMPING,
    EFFORT,
    MAX_SPEED,
    OMEGA,
    OMEGA_0,
    ROWS,
    SIN,
    SLOPE_0,
    SLOPE_1,
    STAGES,
    THETA,
    THETA_0,
    TILE,
    TORQUE,
    VALUE_0,
    VALUE_1,
    WORK,
    Lanes,
    bob_velocities,
    describe_tile,
    lanes_of,
    load,
    observe_tile,
    seen_of,
    unload,
)  # fmt: skip
from npend_gym.physics.kernels.rk4 import rk4_step, rk4_step_of_one
from npend_gym.physics.kernels.sincos import MAX_ANGLE, sincos
from npend_gym.physics.kernels.turning import BOB, Turns, count_sign

_ROOT_TOLERANCE = 1e-13  # of a substep


@kernel
def _tile_rods(rods: Rods, n: int, first: int, last: int) -> Rods:
    """Return the parameters of the tile of lanes first..last-1."""
    return Rods(
        rods.inverse_mass[first * (n + 1) : last * (n + 1)],
        rods.length[first * n : last * n],
        rods.inverse_length[first * n : last * n],
        rods.damping[first * n : last * n],
        rods.gravity[first:last],
    )


@kernel
def _bob_accelerations(
    theta: FloatArray, omega: FloatArray, alpha: FloatArray, length: FloatArray, lanes: int,
    slope: FloatArray,
) -> None:  # fmt: skip
    """Write the horizontal acceleration of every bob."""
    for j in range(theta.size):
        s, c = sincos(theta[j])
        slope[j] = length[j] * (alpha[j] * c - (omega[j] * omega[j]) * s)
    below = slope[lanes:]
    for j in range(below.size):
        below[j] += slope[j]


@kernel
def _hermite(f: float, df: float, g: float, dg: float, x: float) -> tuple[float, float]:
    """Return the cubic through (0, f) and (1, g) with slopes df and dg at `x`, and its slope."""
    a = df - (g - f)
    b = (g - f) - dg
    u = 1.0 - x
    bend = a * u + b * x
    value = (u * f + x * g) + (x * u) * bend
    return value, (g - f) + (u - x) * bend + (x * u) * (b - a)


@kernel
def _hermite_root(
    of_slope: bool, f: float, df: float, g: float, dg: float, a: float, b: float
) -> float:
    """Return where the cubic (or its slope) is zero in [a, b], at whose ends it differs in sign."""
    value, slope = _hermite(f, df, g, dg, a)
    fa = slope if of_slope else value
    value, slope = _hermite(f, df, g, dg, b)
    fb = slope if of_slope else value
    x = b
    for _ in range(100):
        x = b if fb == 0.0 else b - fb * ((b - a) / (fb - fa))
        value, slope = _hermite(f, df, g, dg, x)
        fx = slope if of_slope else value
        if fx == 0.0 or abs(x - b) <= _ROOT_TOLERANCE:
            break
        if (fx > 0.0) == (fb > 0.0):
            fa *= 0.5
        else:
            a, fa = b, fb
        b, fb = x, fx
    return x


@kernel
def _follow(
    turns: Turns, r: int, t: float, h: float, f: float, df: float, g: float, dg: float,
    threshold: float,
) -> None:  # fmt: skip
    """Take note of the turning points of bob `r` from `t` to `t + h`, cubic in between."""
    left, value = 0.0, f
    for last in (False, True):
        right, end = 1.0, g
        if not last:
            if not df * dg < 0.0:
                continue
            right = _hermite_root(True, f, h * df, g, h * dg, 0.0, 1.0)
            end, _ = _hermite(f, h * df, g, h * dg, right)
        crosses = (value <= 0.0 and end > 0.0) or (value >= 0.0 and end < 0.0)
        if crosses and turns.sign[r] != 0:
            x = _hermite_root(False, f, h * df, g, h * dg, left, right)
            turns.zero[r] = t + h * x
        count_sign(BOB, r, t + h * right, end, not last, threshold, turns)
        if not math.isnan(turns.period[r]):
            return
        left, value = right, end


@inlined_kernel
def _eventful(all_lanes: Lanes, first: int, lanes: int, scratch: FloatArray, turning: bool) -> bool:
    """Return whether a bob of the tile may have turned, or, if `turning`, has had an extremum."""
    n = all_lanes.theta.shape[1]
    turns = all_lanes.turns
    before, now = scratch[VALUE_0], scratch[VALUE_1]
    slope, slope_now = scratch[SLOPE_0], scratch[SLOPE_1]
    events = 0
    for k in range(lanes):
        for i in range(n):
            r, j = (first + k) * n + i, i * lanes + k
            counted = turns.sign[r] * turns.orientation[r]
            steady = (before[j] * now[j] > 0.0) & (counted * now[j] > 0.0)
            if turning:
                steady = steady & (slope[j] * slope_now[j] >= 0.0)
            events += 0 if steady | (turns.period[r] > 0.0) else 1
    return events > 0


@kernel
def _follow_tile(
    all_lanes: Lanes, first: int, lanes: int, since: float, h: float,
    scratch: FloatArray,
) -> bool:  # fmt: skip
    """Follow the bobs of a tile through a substep that began `since` the step did.

    Return whether any of them is yet to complete.
    """
    n = all_lanes.theta.shape[1]
    turns = all_lanes.turns
    pending = False
    for k in range(lanes):
        lane = first + k
        if all_lanes.active[lane] == 0 or all_lanes.completed[lane] == n:
            continue
        complete = 0
        for i in range(n):
            r, j = lane * n + i, i * lanes + k
            side = turns.orientation[r]
            f, df = side * scratch[VALUE_0, j], side * scratch[SLOPE_0, j]
            g, dg = side * scratch[VALUE_1, j], side * scratch[SLOPE_1, j]
            if math.isnan(turns.period[r]) and math.isfinite(g):
                t = all_lanes.time[lane] + since
                _follow(turns, r, t, h, f, df, g, dg, all_lanes.threshold[lane])
            if not math.isnan(turns.period[r]):
                complete += 1
        all_lanes.completed[lane] = complete
        pending = pending or complete < n
    return pending


@kernel
def _add_damping_work(
    omega: FloatArray, damping: FloatArray, weight: float, lanes: int, work_done: FloatArray
) -> None:
    """Add weight times the power of the dampers, -damping (omega_i - omega_{i-1})^2."""
    for k in range(lanes):
        work_done[k] -= weight * (damping[k] * (omega[k] * omega[k]))
    for j in range(lanes, omega.size):
        relative = omega[j] - omega[j - lanes]
        work_done[j % lanes] -= weight * (damping[j] * (relative * relative))


@kernel
def _restore_unsound(all_lanes: Lanes, first: int, lanes: int, scratch: FloatArray) -> None:
    """Give lanes that have diverged, or are not active, their last state back."""
    n = all_lanes.theta.shape[1]
    theta, omega = scratch[THETA], scratch[OMEGA]
    for k in range(lanes):
        lane = first + k
        sound = True
        for i in range(n):
            j = i * lanes + k
            sound = sound and abs(theta[j]) <= MAX_ANGLE and abs(omega[j]) <= MAX_SPEED
        if sound and all_lanes.active[lane] == 1:
            continue
        if all_lanes.active[lane] == 1:
            all_lanes.diverged[lane] = 1
        for i in range(n):
            j = i * lanes + k
            theta[j], omega[j] = all_lanes.theta[lane, i], all_lanes.omega[lane, i]
    end = n * lanes
    bob_velocities(
        theta[:end], omega[:end], all_lanes.rods.length[first * n :], lanes, scratch[SIN],
        scratch[COS], scratch[VALUE_1][:end],
    )  # fmt: skip


@inlined_kernel
def _store_tile(
    all_lanes: Lanes, dt: float, first: int, lanes: int, scratch: FloatArray,
    damping_work: FloatArray,
) -> None:  # fmt: skip
    """Take the tile's new state over into its lanes; a diverged lane keeps its last state."""
    n = all_lanes.theta.shape[1]
    theta, omega, velocity = scratch[THETA], scratch[OMEGA], scratch[VALUE_1]
    torque = scratch[TORQUE]
    unsound = 0
    for j in range(n * lanes):
        sound = (abs(theta[j]) <= MAX_ANGLE) & (abs(omega[j]) <= MAX_SPEED)
        unsound += 0 if sound else 1
    for k in range(lanes):
        unsound += 1 - all_lanes.active[first + k]
    if unsound > 0:
        _restore_unsound(all_lanes, first, lanes, scratch)
    for k in range(lanes):
        lane = first + k
        if all_lanes.active[lane] == 1 and all_lanes.diverged[lane] == 0:
            work = damping_work[k]
            for m in range(all_lanes.joints.size):
                i = all_lanes.joints[m]
                turned = theta[i * lanes + k] - all_lanes.theta[lane, i]
                if i > 0:
                    turned -= theta[(i - 1) * lanes + k] - all_lanes.theta[lane, i - 1]
                work += torque[i * lanes + k] * turned
            all_lanes.work_done[lane] += work
            all_lanes.time[lane] += dt
    unload(theta, first, lanes, all_lanes.theta)
    unload(omega, first, lanes, all_lanes.omega)
    unload(velocity, first, lanes, all_lanes.velocity)


@inlined_kernel
def _load_torque(
    all_lanes: Lanes, limit: float, first: int, lanes: int, torque: FloatArray, effort: FloatArray
) -> None:
    """Write the torques of clipped actions, and the mean squares of these into `effort`."""
    action, joints = all_lanes.action, all_lanes.joints
    for j in range(torque.size):
        torque[j] = 0.0
    for k in range(lanes):
        squares = 0.0
        for m in range(joints.size):
            share = min(max(action[first + k, m], -1.0), 1.0)
            torque[joints[m] * lanes + k] = limit * share
            squares += share * share
        effort[first + k] = squares / joints.size if joints.size > 0 else 0.0


@inlined_kernel
def _turn_tile(
    all_lanes: Lanes, first: int, lanes: int, since: float, h: float,
    careful: bool, rods: Rods, scratch: FloatArray,
) -> bool:  # fmt: skip
    """Look for turning points in the substep just taken; return whether any are yet to come.

    Slopes take an evaluation of the dynamics: where not `careful`, they are left out of tiles in
    which no velocity has changed its sign.
    """
    end = rods.length.size
    theta, omega = scratch[THETA][:end], scratch[OMEGA][:end]
    first_alpha, alpha = scratch[STAGES][:end], scratch[ALPHA][:end]
    if not careful and not _eventful(all_lanes, first, lanes, scratch, False):
        return True
    accelerations(theta, omega, scratch[TORQUE], rods, scratch[WORK:], alpha, lanes)
    _bob_accelerations(
        scratch[THETA_0][:end], scratch[OMEGA_0][:end], first_alpha, rods.length, lanes,
        scratch[SLOPE_0][:end],
    )  # fmt: skip
    _bob_accelerations(theta, omega, alpha, rods.length, lanes, scratch[SLOPE_1][:end])
    if careful and not _eventful(all_lanes, first, lanes, scratch, True):
        return True
    return _follow_tile(all_lanes, first, lanes, since, h, scratch)


@kernel
def advance(
    floats: FloatArray, integers: NDArray[np.int64], limit: float, dt: float, substeps: int,
    count: int, n: int, first_lane: int, last_lane: int, observation: NDArray[np.float32],
    out: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Advance the active lanes of first_lane..last_lane-1 by `dt` seconds in equal substeps.

    The action, clipped to [-1, 1] and times `limit` [N m], acts at the joints all the while.
    What is seen of every lane is written. `first_lane` is a multiple of TILE.
    """
    all_lanes, seen = lanes_of(floats, integers, count, n), seen_of(observation, out, count, n)
    stages, work = scratch[STAGES:], scratch[WORK:]
    h = dt / substeps
    careful = all_lanes.joints.size == 0
    for first in range(first_lane, last_lane, TILE):
        lanes = min(TILE, last_lane - first)
        end = n * lanes
        theta, omega, torque = scratch[THETA][:end], scratch[OMEGA][:end], scratch[TORQUE][:end]
        s, c, velocity = scratch[SIN][:end], scratch[COS][:end], scratch[VALUE_1][:end]
        rods = _tile_rods(all_lanes.rods, n, first, first + lanes)
        if count > TILE and count % TILE != 0:  # tiles of two sizes: the guard rods move
            for row in range(WORK, ROWS):
                for j in range(scratch.shape[1]):
                    scratch[row, j] = 0.0
        load(all_lanes.theta, first, lanes, theta)
        load(all_lanes.omega, first, lanes, omega)
        load(all_lanes.velocity, first, lanes, velocity)
        _load_torque(all_lanes, limit, first, lanes, torque, seen.scalars[EFFORT])
        damped = False
        for j in range(end):
            damped = damped or rods.damping[j] > 0.0
        damping_work = scratch[DAMPING]
        for k in range(lanes):
            damping_work[k] = 0.0
        pending = False
        for lane in range(first, first + lanes):
            pending = pending or all_lanes.completed[lane] < n
        for substep in range(substeps):
            if pending:
                copy(velocity, scratch[VALUE_0])
                copy(theta, scratch[THETA_0])
                copy(omega, scratch[OMEGA_0])
            if damped:
                _add_damping_work(omega, rods.damping, h / 6.0, lanes, damping_work)
            if lanes == 1:
                rk4_step_of_one(theta, omega, h, torque, rods, work, stages)
            else:
                accelerations(theta, omega, torque, rods, work, stages[0][:end], lanes)
                rk4_step(theta, omega, h, torque, rods, work, stages, lanes)
            if damped:
                _add_damping_work(stages[4][:end], rods.damping, h / 3.0, lanes, damping_work)
                _add_damping_work(stages[5][:end], rods.damping, h / 3.0, lanes, damping_work)
                _add_damping_work(stages[6][:end], rods.damping, h / 6.0, lanes, damping_work)
            if pending or substep == substeps - 1:
                bob_velocities(theta, omega, rods.length, lanes, s, c, velocity)
            if pending:
                pending = _turn_tile(
                    all_lanes, first, lanes, substep * h, h, careful, rods, scratch
                )
        _store_tile(all_lanes, dt, first, lanes, scratch, damping_work)
        describe_tile(all_lanes, all_lanes.active, False, first, lanes, scratch, seen)
        observe_tile(first, lanes, n, scratch, observation)
