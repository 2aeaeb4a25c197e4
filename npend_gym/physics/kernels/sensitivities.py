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

    states: FloatArray  # (theta, omega) at the beginning of each, (S, 2n)
    lengths: FloatArray  # s, (S,)
    tableau: FloatArray  # a, (stages, stages)
    stages: NDArray[np.int64]  # how many of them each step needs, (S,)
    end: FloatArray  # b, (stages,)
    at: NDArray[np.int64]  # the step of each instant, (F,)
    weights: FloatArray  # of the stages at each instant, (F, stages)


class Rods(NamedTuple):
    """A chain, and the torques on it."""

    chain: AnyArrays
    mass: FloatArray  # kg, (n,)
    torque: FloatArray  # N m at joints 0..n-1, (n,)


def new_scratch(stages: int, n: int) -> FloatArray:
    """Return the work space of the kernels here."""
    return aligned_zeros(_SHARED + stages * (_STAGE + 4), n + 2)


@inlined_kernel
def _stage_of(scratch: FloatArray, s: int) -> FloatArray:
    return scratch[_SHARED + s * _STAGE : _SHARED + (s + 1) * _STAGE]


@inlined_kernel
def _slopes(scratch: FloatArray, stages: int) -> FloatArray:
    """Return rows for changes of theta and omega at each stage per second, or derivatives by k."""
    return scratch[_SHARED + stages * _STAGE :]


@inner_kernel
def _take_stages(steps: Steps, step: int, rods: Rods, scratch: FloatArray) -> None:
    """Evaluate the stages of a step, and keep what their derivatives need."""
    n, h, x = rods.mass.size, steps.lengths[step], scratch[_X]
    state, a = bare(steps.states)[step], bare(steps.tableau)
    for s in range(steps.stages[step]):
        stage = _stage_of(scratch, s)
        w = stage[_OMEGA][:n]
        for i in range(n):
            x[i] = w[i] = 0.0
        for j in range(s):
            weight = a[s, j]
            if weight != 0.0:
                before = _stage_of(scratch, j)
                for i in range(n):
                    x[i] += weight * before[_OMEGA][i]
                    w[i] += weight * before[_ALPHA][i]
        for i in range(n):
            x[i] = state[i] + h * x[i]
            w[i] = state[n + i] + h * w[i]
        accelerations_kept(x[:n], w, rods.torque, rods.chain, stage, stage[_ALPHA][:n])


@inlined_kernel
def _add(weights: FloatArray, h: Any, slopes: FloatArray, rows: FloatArray, n: int) -> None:
    """Add h sum_s weights_s k_s, from two rows of `slopes` each, to the two of `rows`."""
    for s in range(weights.size):
        weight = h * weights[s]
        if weight != 0.0:
            faster, gained = slopes[2 * s], slopes[2 * s + 1]
            for i in range(n):
                rows[0][i] += weight * faster[i]
                rows[1][i] += weight * gained[i]


@inner_kernel
def _change_stages(
    steps: Steps, step: int, rods: Rods, change: FloatArray, pushed: FloatArray,
    changed: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Write how k changes at each stage of a step, from that of the state at its beginning."""
    n, h, a = rods.mass.size, steps.lengths[step], bare(steps.tableau)
    slopes, both = _slopes(scratch, len(steps.tableau)), scratch[_TURNED : _SPED + 1]
    for s in range(steps.stages[step]):
        stage = _stage_of(scratch, s)
        for i in range(n):
            both[0][i], both[1][i] = change[i], change[n + i]
        _add(a[s, :s], h, slopes, both, n)
        copy(both[1][:n], slopes[2 * s])
        tangent(
            stage[_OMEGA][:n], stage[_ALPHA][:n], both[0][:n], both[1][:n], pushed, changed,
            rods.chain, rods.mass, stage[_POSE:], scratch[_OUT:], scratch[_FORCE][:n],
        )  # fmt: skip
        respond(scratch[_FORCE][:n], rods.chain, stage, scratch, slopes[2 * s + 1][:n])


@kernel
def carry_changes(
    steps: Steps, rods: Rods, changes: FloatArray, pushed: FloatArray, changed: FloatArray,
    frames: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Carry changes of the state, torques and parameters through `steps`.

    `changes` (D, 2n) are those of the state before and after; `pushed` (D, n) those of the torques,
    `changed` (D, len(Parameter) or 0, n) of the parameters. Those at each instant are written into
    `frames` (F, D, 2n).
    """
    steps, scratch = bare(steps), bare(scratch)
    rods = Rods(bare(rods.chain), bare(rods.mass), bare(rods.torque))
    changes, pushed, changed, frames = bare(changes), bare(pushed), bare(changed), bare(frames)
    n, slopes, first = rods.mass.size, _slopes(scratch, len(steps.tableau)), 0
    at, total = steps.at, scratch[_TURNED : _SPED + 1]
    for step in range(steps.lengths.size):
        h, last = steps.lengths[step], first
        while last < at.size and at[last] == step:
            last += 1
        _take_stages(steps, step, rods, scratch)
        for s in range(steps.stages[step]):
            stage = _stage_of(scratch, s)
            u, alpha = stage[_OMEGA][:n], stage[_ALPHA][:n]
            pose(u, alpha, rods.chain, rods.mass, stage, stage[_POSE:])
        for d in range(len(changes)):
            change = changes[d]
            _change_stages(steps, step, rods, change, pushed[d], changed[d], scratch)
            for f in range(first, last + 1):  # the last of them is the end of the step
                for i in range(n):
                    total[0][i], total[1][i] = change[i], change[n + i]
                _add(steps.weights[f] if f < last else steps.end, h, slopes, total, n)
                to = frames[f, d] if f < last else change
                for i in range(n):
                    to[i], to[n + i] = total[0][i], total[1][i]
        first = last


@inner_kernel
def _return_stages(
    steps: Steps, step: int, rods: Rods, bar: FloatArray, torque_bar: FloatArray,
    chain_bar: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Take derivatives by k at each stage of a step back, and add them to `bar` and the others."""
    n, h, a = rods.mass.size, steps.lengths[step], bare(steps.tableau)
    slopes = _slopes(scratch, len(steps.tableau))
    x, w, lam = scratch[_X_BAR][:n], scratch[_W_BAR][:n], scratch[_LAM][:n]
    for back in range(steps.stages[step]):
        s = steps.stages[step] - 1 - back
        stage = _stage_of(scratch, s)
        copy(slopes[2 * s][:n], w)
        respond(slopes[2 * s + 1][:n], rods.chain, stage, scratch, lam)
        adjoint(
            stage[_OMEGA][:n], stage[_ALPHA][:n], lam, rods.chain, rods.mass, stage,
            scratch, scratch[_ROWS:], x, w, torque_bar, chain_bar,
        )  # fmt: skip
        for i in range(n):
            bar[i] += x[i]
            bar[n + i] += w[i]
        for j in range(s):
            weight = h * a[s, j]
            if weight != 0.0:
                faster, gained = slopes[2 * j], slopes[2 * j + 1]
                for i in range(n):
                    faster[i] += weight * x[i]
                    gained[i] += weight * w[i]


@kernel
def carry_back(
    steps: Steps, rods: Rods, bar: FloatArray, torque_bar: FloatArray, chain_bar: FloatArray,
    frames: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Take derivatives by the states at the end of `steps` and at the instants back to the start.

    `bar` (2n,) is that by the state, after and before; `frames` (F, 2n) are those by the states at
    the instants. Those by the torques are added to `torque_bar` (n,), by the parameters to
    `chain_bar` (len(Parameter) or 0, n).
    """
    steps, scratch, frames = bare(steps), bare(scratch), bare(frames)
    rods = Rods(bare(rods.chain), bare(rods.mass), bare(rods.torque))
    n, slopes, last = rods.mass.size, _slopes(scratch, len(steps.tableau)), steps.at.size
    for back in range(steps.lengths.size):
        step, first = steps.lengths.size - 1 - back, last
        while first > 0 and steps.at[first - 1] == step:
            first -= 1
        _take_stages(steps, step, rods, scratch)
        for s in range(steps.stages[step]):
            weight = steps.lengths[step] * steps.end[s]
            for i in range(n):
                slopes[2 * s][i], slopes[2 * s + 1][i] = weight * bar[i], weight * bar[n + i]
            for f in range(first, last):
                weight = steps.lengths[step] * steps.weights[f, s]
                for i in range(n):
                    slopes[2 * s][i] += weight * frames[f, i]
                    slopes[2 * s + 1][i] += weight * frames[f, n + i]
        for f in range(first, last):
            for i in range(2 * n):
                bar[i] += frames[f, i]
        _return_stages(steps, step, rods, bar, torque_bar, chain_bar, scratch)
        last = first
