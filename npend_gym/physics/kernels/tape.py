"""Small changes carried forward, and gradients backward, through the steps of one chain's motion.

A step of an explicit Runge-Kutta method begins at y and has the stages and the end

    y_s = y + h sum_j a_sj k_j,   k_s = f(y_s),   y' = y + h sum_s b_s k_s,

and what lies within the step by dense output is linear in the same k_s, with weights of its own.
Lengths of steps are held fixed. A change dy then goes the same way, with d k_s = (df/dy) d y_s from
`tangent.tangent`; the gradient goes the way back, by `adjoint.adjoint`. Both serve any
such method: its a_sj and weights are arguments.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import aligned_zeros, bare
from npend_gym.compiled.jit import inlined_kernel, inner_kernel, kernel
from npend_gym.physics.kernels.adjoint import ADJOINT_ROWS, adjoint
from npend_gym.physics.kernels.driven import ACROSS, AFTER_TORQUES, UP, accelerate_base
from npend_gym.physics.kernels.dynamics import (
    ANSWER_ROWS,
    WORK_ROWS,
    AnyArrays,
    accelerations_kept,
    copy,
    respond,
)
from npend_gym.physics.kernels.tangent import POSE_ROWS, pose, tangent

# Rows that a stage keeps: those of `accelerations_kept`, its accelerations and velocities, its pose
_ALPHA, _OMEGA, _POSE = WORK_ROWS + 1, WORK_ROWS + 2, WORK_ROWS + 3
_STAGE = _POSE + POSE_ROWS
# Before the stages: what `respond` leaves; angles of a stage; its changes, or derivatives by it
_X, _TURNED, _SPED, _FORCE, _OUT = range(ANSWER_ROWS, ANSWER_ROWS + 5)
_X_BAR, _W_BAR, _LAM, _ROWS = _TURNED, _SPED, _FORCE, _OUT
_SHARED = _OUT + max(4, ADJOINT_ROWS)


class Steps(NamedTuple):
    """Steps of a motion, one after another, and the instants that lie in them."""

    states: FloatArray  # (q, u) at the beginning of each, (S, 2m)
    lengths: FloatArray  # s, (S,)
    tableau: FloatArray  # a, (stages, stages)
    stages: NDArray[np.int64]  # how many of them each step needs, (S,)
    end: FloatArray  # b, (stages,)
    at: NDArray[np.int64]  # the step of each instant, (F,)
    weights: FloatArray  # of the stages at each instant, (F, stages)


class Rods(NamedTuple):
    """A chain, and the loads on it: torques at joints 0..n-1 [N m], then a force on a base [N].

    Where the acceleration of the base is prescribed and changes in time, it follows behind the
    force: n + `driven.AFTER_TORQUES` loads. The same loads at all times are a table of one row.
    """

    chain: AnyArrays
    mass: FloatArray  # kg, (n,)
    loads: FloatArray  # (S or 1, stages or 1, n or more)


def new_scratch(stages: int, m: int) -> FloatArray:
    """Return the work space of the kernels here, for `m` coordinates."""
    return aligned_zeros(_SHARED + stages * (_STAGE + 4), m + 2)


@inlined_kernel
def _stage_of(scratch: FloatArray, s: int) -> FloatArray:
    return scratch[_SHARED + s * _STAGE : _SHARED + (s + 1) * _STAGE]


@inlined_kernel
def _at(table: FloatArray, step: int, s: int) -> FloatArray:
    """Return the row of a table of loads for a stage of a step."""
    return table[min(step, table.shape[0] - 1), min(s, table.shape[1] - 1)]


@inlined_kernel
def _slopes(scratch: FloatArray, stages: int) -> FloatArray:
    """Return rows for changes of theta and omega at each stage per second, or derivatives by k."""
    return scratch[_SHARED + stages * _STAGE :]


@inner_kernel
def _take_stages(steps: Steps, step: int, rods: Rods, scratch: FloatArray) -> None:
    """Evaluate the stages of a step, and keep what their derivatives need."""
    m, h, x = steps.states.shape[1] // 2, steps.lengths[step], scratch[_X]
    n = rods.mass.size
    state, a = bare(steps.states)[step], bare(steps.tableau)
    for s in range(steps.stages[step]):
        stage = _stage_of(scratch, s)
        w = stage[_OMEGA][:m]
        for i in range(m):
            x[i] = w[i] = 0.0
        for j in range(s):
            weight = a[s, j]
            if weight != 0.0:
                before = _stage_of(scratch, j)
                for i in range(m):
                    x[i] += weight * before[_OMEGA][i]
                    w[i] += weight * before[_ALPHA][i]
        for i in range(m):
            x[i] = state[i] + h * x[i]
            w[i] = state[m + i] + h * w[i]
        loads = _at(rods.loads, step, s)
        if loads.size == n + AFTER_TORQUES:
            accelerate_base(rods.chain, loads[n + ACROSS], loads[n + UP])
        accelerations_kept(x[:m], w, loads, rods.chain, stage, stage[_ALPHA][:m])


@inlined_kernel
def _add(weights: FloatArray, h: Any, slopes: FloatArray, rows: FloatArray, m: int) -> None:
    """Add h sum_s weights_s k_s, from two rows of `slopes` each, to the two of `rows`."""
    for s in range(weights.size):
        weight = h * weights[s]
        if weight != 0.0:
            faster, gained = slopes[2 * s], slopes[2 * s + 1]
            for i in range(m):
                rows[0][i] += weight * faster[i]
                rows[1][i] += weight * gained[i]


@inner_kernel
def _change_stages(
    steps: Steps, step: int, rods: Rods, change: FloatArray, pushed: FloatArray,
    changed: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Write how k changes at each stage of a step, from that of the state at its beginning."""
    m, h, a = change.size // 2, steps.lengths[step], bare(steps.tableau)
    slopes, both = _slopes(scratch, len(steps.tableau)), scratch[_TURNED : _SPED + 1]
    for s in range(steps.stages[step]):
        stage = _stage_of(scratch, s)
        for i in range(m):
            both[0][i], both[1][i] = change[i], change[m + i]
        _add(a[s, :s], h, slopes, both, m)
        copy(both[1][:m], slopes[2 * s])
        tangent(
            stage[_OMEGA][:m], stage[_ALPHA][:m], both[0][:m], both[1][:m], pushed, changed,
            rods.chain, rods.mass, stage[_POSE:], scratch[_OUT:], scratch[_FORCE][:m],
        )  # fmt: skip
        respond(scratch[_FORCE][:m], rods.chain, stage, scratch, slopes[2 * s + 1][:m])


@kernel
def carry_changes(
    steps: Steps, rods: Rods, changes: FloatArray, pushed: FloatArray, changed: FloatArray,
    frames: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Carry changes of the state, torques and parameters through `steps`.

    `changes` (D, 2m) are those of the state before and after; `pushed` (D, n or more) those of the
    loads at all times, `changed` (D, len(Parameter) or 0, n) of the parameters. Those at each
    instant are written into `frames` (F, D, 2m).
    """
    steps, scratch = bare(steps), bare(scratch)
    rods = Rods(bare(rods.chain), bare(rods.mass), bare(rods.loads))
    changes, pushed, changed, frames = bare(changes), bare(pushed), bare(changed), bare(frames)
    m, slopes, first = steps.states.shape[1] // 2, _slopes(scratch, len(steps.tableau)), 0
    at, total = steps.at, scratch[_TURNED : _SPED + 1]
    for step in range(steps.lengths.size):
        h, last = steps.lengths[step], first
        while last < at.size and at[last] == step:
            last += 1
        _take_stages(steps, step, rods, scratch)
        for s in range(steps.stages[step]):
            stage = _stage_of(scratch, s)
            u, alpha = stage[_OMEGA][:m], stage[_ALPHA][:m]
            pose(u, alpha, rods.chain, rods.mass, stage, stage[_POSE:])
        for d in range(len(changes)):
            change = changes[d]
            _change_stages(steps, step, rods, change, pushed[d], changed[d], scratch)
            for f in range(first, last + 1):  # the last of them is the end of the step
                for i in range(m):
                    total[0][i], total[1][i] = change[i], change[m + i]
                _add(steps.weights[f] if f < last else steps.end, h, slopes, total, m)
                to = frames[f, d] if f < last else change
                for i in range(m):
                    to[i], to[m + i] = total[0][i], total[1][i]
        first = last


@inner_kernel
def _return_stages(
    steps: Steps, step: int, rods: Rods, bar: FloatArray, torque_bar: FloatArray,
    chain_bar: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Take derivatives by k at each stage of a step back, and add them to `bar` and the others."""
    m, h, a = bar.size // 2, steps.lengths[step], bare(steps.tableau)
    slopes = _slopes(scratch, len(steps.tableau))
    x, w, lam = scratch[_X_BAR][:m], scratch[_W_BAR][:m], scratch[_LAM][:m]
    for back in range(steps.stages[step]):
        s = steps.stages[step] - 1 - back
        stage = _stage_of(scratch, s)
        copy(slopes[2 * s][:m], w)
        respond(slopes[2 * s + 1][:m], rods.chain, stage, scratch, lam)
        adjoint(
            stage[_OMEGA][:m], stage[_ALPHA][:m], lam, rods.chain, rods.mass, stage,
            scratch, scratch[_ROWS:], x, w, _at(torque_bar, step, s), chain_bar,
        )  # fmt: skip
        for i in range(m):
            bar[i] += x[i]
            bar[m + i] += w[i]
        for j in range(s):
            weight = h * a[s, j]
            if weight != 0.0:
                faster, gained = slopes[2 * j], slopes[2 * j + 1]
                for i in range(m):
                    faster[i] += weight * x[i]
                    gained[i] += weight * w[i]


@kernel
def carry_back(
    steps: Steps, rods: Rods, bar: FloatArray, torque_bar: FloatArray, chain_bar: FloatArray,
    frames: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Take derivatives by the states at the end of `steps` and at the instants back to the start.

    `bar` (2m,) is that by the state, after and before; `frames` (F, 2m) are those by the states at
    the instants. Those by torques and force are added to `torque_bar`, a table like that of the
    loads or one of a row for their sum, by the parameters to `chain_bar` (len(Parameter) or 0, n).
    """
    steps, scratch, frames = bare(steps), bare(scratch), bare(frames)
    rods = Rods(bare(rods.chain), bare(rods.mass), bare(rods.loads))
    m, slopes, last = bar.size // 2, _slopes(scratch, len(steps.tableau)), steps.at.size
    for back in range(steps.lengths.size):
        step, first = steps.lengths.size - 1 - back, last
        while first > 0 and steps.at[first - 1] == step:
            first -= 1
        _take_stages(steps, step, rods, scratch)
        for s in range(steps.stages[step]):
            weight = steps.lengths[step] * steps.end[s]
            for i in range(m):
                slopes[2 * s][i], slopes[2 * s + 1][i] = weight * bar[i], weight * bar[m + i]
            for f in range(first, last):
                weight = steps.lengths[step] * steps.weights[f, s]
                for i in range(m):
                    slopes[2 * s][i] += weight * frames[f, i]
                    slopes[2 * s + 1][i] += weight * frames[f, m + i]
        for f in range(first, last):
            for i in range(2 * m):
                bar[i] += frames[f, i]
        _return_stages(steps, step, rods, bar, torque_bar, chain_bar, scratch)
        last = first
