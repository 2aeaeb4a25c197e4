"""Small changes carried through the steps of `gauss`: they solve the same equations, linearised."""

from __future__ import annotations

import math

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import aligned_zeros, bare
from npend_gym.compiled.jit import inner_kernel, kernel
from npend_gym.physics.kernels.canonical import Change, change_canonical
from npend_gym.physics.kernels.driven import Listed
from npend_gym.physics.kernels.dynamics import accelerations_kept, copy, respond
from npend_gym.physics.kernels.gauss import (
    ANSWER,
    GAIN,
    LEAST,
    MOST,
    RIGHT,
    ROUNDING,
    STAGES,
    SWEEP,
    Gauss,
    P,
    X,
    fit,
    gauss_step,
    improve,
    weighted,
)
from npend_gym.physics.kernels.stages import (
    ALPHA,
    OMEGA,
    SHARED_ROWS,
    STAGE_ROWS,
    change_stage,
    stage_of,
    take_poses,
)
from npend_gym.physics.kernels.tangent import POSE_ROWS
from npend_gym.physics.kernels.tape import Rods, Steps

# Rows of the work space of `carry_gauss`: those of `stages`; changes of the accelerations at both
# ends, of the state at the end and at a stage; its polynomial; stages kept at both ends; poses;
# then the work space of the step, and that of its changes
_ALPHA_0, _ALPHA_1, _STATE, _AT, _POLY = range(SHARED_ROWS, SHARED_ROWS + 5)
_TAPE = _POLY + 5
_POSES = _TAPE + 2 * STAGE_ROWS
_STEP = _POSES + 2 * POSE_ROWS


def new_gauss_scratch(stages: int, m: int) -> FloatArray:
    """Return the work space of `carry_gauss`, where loads are given at `stages` instants."""
    rows = STAGES + 3 * (stages - 2)
    return aligned_zeros(_STEP + 2 * rows, 2 * m + 4)


@inner_kernel
def _take_step(
    steps: Steps, step: int, rods: Rods, method: Gauss, alpha: FloatArray, scratch: FloatArray
) -> None:
    """Take a step again, and keep what the accelerations at its ends depend on."""
    state, m = bare(steps.states)[step], steps.states.shape[1] // 2
    torque = Listed(bare(rods.loads)[min(step, rods.loads.shape[0] - 1)])
    work, reached, gained = scratch[_STEP:], scratch[_STATE][: 2 * m], scratch[_AT][:m]
    q, u, h = state[:m], state[m:], steps.lengths[step]
    for end in range(2):
        stage = stage_of(scratch[_TAPE:], end)
        if end == 1:
            accelerations_kept(q, u, torque.rows[0], rods.chain, work, alpha)
            for s in range(method.ends.size):
                for i in range(m):
                    work[STAGES + 3 * s, i] = u[i] + (h * method.instants[s + 1]) * alpha[i]
            gauss_step(0.0, h, q, u, torque, rods.chain, method, reached, gained, work)
            q, u = reached[:m], reached[m : 2 * m]
        loads = torque.rows[min(end * (method.ends.size + 1), torque.rows.shape[0] - 1)]
        copy(u, stage[OMEGA])
        accelerations_kept(q, u, loads, rods.chain, stage, stage[ALPHA][:m])
    take_poses(2, m, rods.chain, rods.mass, scratch[_TAPE:], scratch[_POSES:])


@inner_kernel
def _change_step(
    steps: Steps, step: int, rods: Rods, method: Gauss, change: FloatArray, pushed: FloatArray,
    changed: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Carry a change through the step that `_take_step` took, and leave its polynomial."""
    m, h, ends, chain = change.size // 2, steps.lengths[step], method.ends, rods.chain
    state, work = bare(steps.states)[step], scratch[_STEP:]
    stages = work[STAGES:]
    own = scratch[_STEP + STAGES + 3 * ends.size :]
    rows, p, x = own[STAGES:], own[P][:m], own[X][:m]
    tape, poses, sweep = scratch[_TAPE:], scratch[_POSES:], own[SWEEP:]
    at, loads = scratch[_AT][:m], rods.loads[0, 0]
    dq, du, gained = change[:m], change[m:], scratch[_ALPHA_0][:m]
    change_canonical(
        state[:m], state[m:], loads, chain, Change(dq, du, pushed, changed), sweep, p, rows[2]
    )
    change_stage(0, chain, rods.mass, tape, poses, dq, du, pushed, changed, gained, scratch)
    for s in range(ends.size):
        for i in range(m):
            rows[3 * s, i] = du[i] + (h * method.instants[s + 1]) * gained[i]
    last, factors = 1e300, stage_of(tape, 0)
    for _ in range(MOST):
        for s in range(ends.size):
            weighted(method.tableau[s], h, stages, 0, state[:m], at)
            weighted(method.tableau[s], h, rows, 0, dq, x)
            by = Change(x, rows[3 * s][:m], pushed, changed)
            change_canonical(
                at, stages[3 * s][:m], loads, chain, by, sweep, rows[3 * s + 1], rows[3 * s + 2]
            )
        size, largest = improve(h, p, 1.0, factors, chain, method, own, m)
        if size <= LEAST * largest or not size < math.inf:
            break
        if size >= last and size <= ROUNDING * largest:
            break
        last = size
    reached, end = scratch[_STATE], stage_of(tape, 1)
    moved = scratch[_AT][: 2 * m]
    q_end, u_end, right, gain = moved[:m], moved[m:], own[RIGHT][:m], own[GAIN][:m]
    weighted(ends, h, rows, 0, dq, q_end)
    weighted(ends, h, rows, 2, p, right)
    weighted(method.last, 1.0, rows, 0, p, u_end)
    for i in range(m):
        u_end[i] = u_end[i] - p[i]
    by = Change(q_end, u_end, pushed, changed)
    change_canonical(reached[:m], reached[m : 2 * m], loads, chain, by, sweep, x, rows[2])
    for i in range(m):
        right[i] = right[i] - x[i]
    respond(right, chain, end, own[ANSWER:], gain)
    for i in range(m):
        u_end[i] = u_end[i] + gain[i]
    again = scratch[_ALPHA_1][:m]
    change_stage(1, chain, rods.mass, tape, poses, q_end, u_end, pushed, changed, again, scratch)
    fit(h, dq, du, gained, moved, again, method, scratch[_POLY:])
    copy(moved, change)


@kernel
def carry_gauss(
    steps: Steps, rods: Rods, changes: FloatArray, pushed: FloatArray, changed: FloatArray,
    frames: FloatArray, method: Gauss, scratch: FloatArray,
) -> None:  # fmt: skip
    """Carry changes of the state, loads and parameters through `steps`; see `carry_changes`."""
    steps, scratch, method = bare(steps), bare(scratch), bare(method)
    rods = Rods(bare(rods.chain), bare(rods.mass), bare(rods.loads))
    changes, pushed, changed, frames = bare(changes), bare(pushed), bare(changed), bare(frames)
    m, at, first = steps.states.shape[1] // 2, steps.at, 0
    poly = scratch[_POLY:]
    for step in range(steps.lengths.size):
        last = first
        while last < at.size and at[last] == step:
            last += 1
        _take_step(steps, step, rods, method, scratch[_ALPHA_0][:m], scratch)
        for d in range(len(changes)):
            for f in range(first, last):
                copy(changes[d], frames[f, d])
            _change_step(steps, step, rods, method, changes[d], pushed[d], changed[d], scratch)
            for f in range(first, last):
                fraction, to = steps.weights[f, 0], frames[f, d]
                for i in range(2 * m):
                    value = poly[4, i] * fraction
                    for row in range(3, 0, -1):
                        by = 1.0 - fraction if row % 2 == 1 else fraction
                        value = (value + poly[row, i]) * by
                    to[i] += (value + poly[0, i]) * fraction
        first = last
