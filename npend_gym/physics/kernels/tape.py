"""Small changes carried forward, and gradients backward, through the steps of one chain's motion.

Steps are those of any explicit Runge-Kutta method, whose derivatives `stages` has.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import aligned_zeros, bare
from npend_gym.compiled.jit import inlined_kernel, inner_kernel, kernel
from npend_gym.physics.kernels.driven import Listed
from npend_gym.physics.kernels.dynamics import AnyArrays, copy
from npend_gym.physics.kernels.stages import (
    SHARED_ROWS,
    STAGE_ROWS,
    change_stages,
    gather,
    return_stages,
    spread,
    take_poses,
    take_stages,
)
from npend_gym.physics.kernels.tangent import POSE_ROWS

# Rows of the work space: those of `stages`; a change at the start of a step, and coordinates of a
# stage, their change or derivatives by them; then slopes, and for each stage its pose and its tape
_BEGIN, _SLOPES = SHARED_ROWS, SHARED_ROWS + 3


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
    return aligned_zeros(_SLOPES + 2 + stages * (2 + POSE_ROWS + STAGE_ROWS), m + 2)


class _Parts(NamedTuple):
    """Parts of the work space."""

    rows: FloatArray  # of `stages`
    begin: FloatArray  # as `change_stages` has it
    x: FloatArray  # (m,)
    slopes: FloatArray
    poses: FloatArray
    tape: FloatArray


@inlined_kernel
def _parts_of(scratch: FloatArray, stages: int, m: int) -> _Parts:
    poses = _SLOPES + 2 * stages + 2
    tape, begin = poses + stages * POSE_ROWS, scratch[_BEGIN:_SLOPES]
    slopes = scratch[_SLOPES:poses]
    return _Parts(scratch, begin, begin[2][:m], slopes, scratch[poses:], scratch[tape:])


@inner_kernel
def _take_stages(steps: Steps, step: int, rods: Rods, parts: _Parts) -> None:
    """Evaluate the stages of a step, and keep what their derivatives need."""
    parts = bare(parts)  # views of it would count references in each stage
    state, m, loads = bare(steps.states)[step], parts.x.size, bare(rods.loads)
    torque = Listed(loads[min(step, loads.shape[0] - 1)])
    take_stages(
        steps.lengths[step], bare(steps.tableau), steps.stages[step], state[:m], state[m:], torque,
        rods.chain, parts.x, parts.tape,
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
            change_stages(
                h, steps.tableau, steps.end, count, count + 1, rods.chain, rods.mass, parts.tape,
                parts.poses, change[:m], change[m:], pushed[d], changed[d], parts.begin,
                parts.slopes, parts.rows,
            )  # fmt: skip
            for f in range(first, last):
                to = frames[f, d]
                copy(parts.begin[0][:m], to[:m])
                copy(parts.begin[1][:m], to[m:])
                gather(steps.weights[f], h, parts.slopes, count, to[:m], to[m:])
        first = last


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
        h, count = steps.lengths[step], steps.stages[step]
        while first > 0 and steps.at[first - 1] == step:
            first -= 1
        _take_stages(steps, step, rods, parts)
        spread(steps.end, h, bar[:m], bar[m:], parts.slopes, count, True)
        for f in range(first, last):
            by = frames[f]
            spread(steps.weights[f], h, by[:m], by[m:], parts.slopes, count, False)
            for i in range(2 * m):
                bar[i] += by[i]
        return_stages(
            h, steps.tableau, count, rods.chain, rods.mass, parts.tape, bar[:m], bar[m:],
            load_bars[min(step, load_bars.shape[0] - 1)], chain_bar, parts.x, parts.slopes,
            parts.rows,
        )  # fmt: skip
        last = first
