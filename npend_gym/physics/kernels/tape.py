"""Small changes carried forward, and gradients backward, through the steps of one chain's motion.

Steps are those of any explicit Runge-Kutta method: its a_sj and weights are arguments, see `stages`
for their meaning. What lies within a step by dense output is linear in the same k_s, with weights
of its own.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import aligned_zeros, bare
from npend_gym.compiled.jit import inlined_kernel, inner_kernel, kernel
from npend_gym.physics.kernels.driven import ACROSS, AFTER_TORQUES, UP, accelerate_base
from npend_gym.physics.kernels.dynamics import AnyArrays, accelerations_kept, copy
from npend_gym.physics.kernels.rk4 import ALPHA, OMEGA, STAGE_ROWS
from npend_gym.physics.kernels.stages import (
    SHARED_ROWS,
    change_stage,
    return_stage,
    stage_of,
    take_poses,
)
from npend_gym.physics.kernels.tangent import POSE_ROWS

# Rows of the work space: those of `stages`; coordinates of a stage, their change or derivatives by
# them; then for each stage two rows of `_slopes`, the pose and the tape
_X, _SLOPES = SHARED_ROWS, SHARED_ROWS + 1


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
    return aligned_zeros(_SLOPES + stages * (2 + POSE_ROWS + STAGE_ROWS), m + 2)


class _Parts(NamedTuple):
    """Parts of the work space."""

    rows: FloatArray  # of `stages`
    x: FloatArray  # (m,)
    slopes: FloatArray  # changes of q' and u' at each stage, or the derivatives by them
    poses: FloatArray
    tape: FloatArray


@inlined_kernel
def _parts_of(scratch: FloatArray, stages: int, m: int) -> _Parts:
    poses = _SLOPES + 2 * stages
    tape = poses + stages * POSE_ROWS
    return _Parts(scratch, scratch[_X, :m], scratch[_SLOPES:poses], scratch[poses:], scratch[tape:])


@inlined_kernel
def _add(
    weights: FloatArray, h: float, slopes: FloatArray, q: FloatArray, u: FloatArray, count: int
) -> None:
    """Add h sum_s weights_s k_s to `q` and `u`, from two rows of `slopes` for each stage."""
    for s in range(count):
        weight = h * weights[s]
        if weight != 0.0:
            faster, gained = slopes[2 * s], slopes[2 * s + 1]
            for i in range(q.size):
                q[i] += weight * faster[i]
                u[i] += weight * gained[i]


@inlined_kernel
def _row(table: FloatArray, step: int, s: int) -> FloatArray:
    """Return the row of a table of loads for a stage of a step."""
    return table[min(step, table.shape[0] - 1), min(s, table.shape[1] - 1)]


@inner_kernel
def _take_stages(steps: Steps, step: int, rods: Rods, parts: _Parts) -> None:
    """Evaluate the stages of a step, and keep what their derivatives need."""
    parts = bare(parts)  # views of it would count references in each stage
    x, m, h, n = parts.x, parts.x.size, steps.lengths[step], rods.mass.size
    state, a = bare(steps.states)[step], bare(steps.tableau)
    for s in range(steps.stages[step]):
        stage = stage_of(parts.tape, s)
        w = stage[OMEGA][:m]
        copy(state[:m], x)
        copy(state[m:], w)
        for j in range(s):
            weight = h * a[s, j]
            if weight != 0.0:
                before = stage_of(parts.tape, j)
                for i in range(m):
                    x[i] += weight * before[OMEGA][i]
                    w[i] += weight * before[ALPHA][i]
        loads = _row(rods.loads, step, s)
        if loads.size == n + AFTER_TORQUES:
            accelerate_base(rods.chain, loads[n + ACROSS], loads[n + UP])
        accelerations_kept(x, w, loads, rods.chain, stage, stage[ALPHA][:m])


@inner_kernel
def _change_stages(
    steps: Steps, step: int, rods: Rods, change: FloatArray, pushed: FloatArray,
    changed: FloatArray, parts: _Parts,
) -> None:  # fmt: skip
    """Write how k changes at each stage of a step, from that of the state at its beginning."""
    parts, chain, mass = bare(parts), bare(rods.chain), bare(rods.mass)
    m, h, a, slopes = change.size // 2, steps.lengths[step], bare(steps.tableau), parts.slopes
    for s in range(steps.stages[step]):
        sped = slopes[2 * s][:m]  # the change of q'
        copy(change[:m], parts.x)
        copy(change[m:], sped)
        _add(a[s], h, slopes, parts.x, sped, s)
        change_stage(
            s, chain, mass, parts.tape, parts.poses, parts.x, sped, pushed, changed,
            slopes[2 * s + 1][:m], parts.rows,
        )  # fmt: skip


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
    m, at, first = steps.states.shape[1] // 2, steps.at, 0
    parts = _parts_of(scratch, len(steps.tableau), m)
    for step in range(steps.lengths.size):
        h, count, last = steps.lengths[step], steps.stages[step], first
        while last < at.size and at[last] == step:
            last += 1
        _take_stages(steps, step, rods, parts)
        take_poses(count, m, rods.chain, rods.mass, parts.tape, parts.poses)
        for d in range(len(changes)):
            change = changes[d]
            _change_stages(steps, step, rods, change, pushed[d], changed[d], parts)
            for f in range(first, last + 1):  # the last of them is the end of the step
                to = frames[f, d] if f < last else change
                weights = steps.weights[f] if f < last else steps.end
                if f < last:
                    copy(change, to)
                _add(weights, h, parts.slopes, to[:m], to[m:], count)
        first = last


@inner_kernel
def _return_stages(
    steps: Steps, step: int, rods: Rods, bar: FloatArray, load_bars: FloatArray,
    chain_bar: FloatArray, parts: _Parts,
) -> None:  # fmt: skip
    """Take derivatives by k at each stage of a step back, and add them to `bar` and the others."""
    parts, chain, mass = bare(parts), bare(rods.chain), bare(rods.mass)
    m, h, a, x = bar.size // 2, steps.lengths[step], bare(steps.tableau), parts.x
    for back in range(steps.stages[step]):
        s = steps.stages[step] - 1 - back
        w, of_rates = parts.slopes[2 * s][:m], parts.slopes[2 * s + 1][:m]
        return_stage(
            s, chain, mass, parts.tape, of_rates, x, w, _row(load_bars, step, s), chain_bar,
            parts.rows,
        )  # fmt: skip
        for i in range(m):
            bar[i] += x[i]
            bar[m + i] += w[i]
        for j in range(s):
            weight = h * a[s, j]
            if weight != 0.0:
                faster, gained = parts.slopes[2 * j], parts.slopes[2 * j + 1]
                for i in range(m):
                    faster[i] += weight * x[i]
                    gained[i] += weight * w[i]


@kernel
def carry_back(
    steps: Steps, rods: Rods, bar: FloatArray, load_bars: FloatArray, chain_bar: FloatArray,
    frames: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Take derivatives by the states at the end of `steps` and at the instants back to the start.

    `bar` (2m,) is that by the state, after and before; `frames` (F, 2m) are those by the states at
    the instants. Derivatives by torques and force are added to `load_bars`, a table as for the
    loads or one row for their sum. Derivatives by the parameters are added to `chain_bar`
    (len(Parameter) or 0, n).
    """
    steps, scratch, frames = bare(steps), bare(scratch), bare(frames)
    rods = Rods(bare(rods.chain), bare(rods.mass), bare(rods.loads))
    m, last = bar.size // 2, steps.at.size
    parts = _parts_of(scratch, len(steps.tableau), m)
    for back in range(steps.lengths.size):
        step, first = steps.lengths.size - 1 - back, last
        while first > 0 and steps.at[first - 1] == step:
            first -= 1
        _take_stages(steps, step, rods, parts)
        for s in range(steps.stages[step]):
            faster, gained = parts.slopes[2 * s], parts.slopes[2 * s + 1]
            weight = steps.lengths[step] * steps.end[s]
            for i in range(m):
                faster[i], gained[i] = weight * bar[i], weight * bar[m + i]
            for f in range(first, last):
                weight = steps.lengths[step] * steps.weights[f, s]
                for i in range(m):
                    faster[i] += weight * frames[f, i]
                    gained[i] += weight * frames[f, m + i]
        for f in range(first, last):
            for i in range(2 * m):
                bar[i] += frames[f, i]
        _return_stages(steps, step, rods, bar, load_bars, chain_bar, parts)
        last = first
