"""Steps of one chain from many states, with their derivatives, and what follows for motions."""

from __future__ import annotations

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import bare, packs
from npend_gym.compiled.jit import inlined_kernel, kernel
from npend_gym.compiled.packs import WIDTH
from npend_gym.physics.kernels.layout import Model, Rod, group_of
from npend_gym.physics.kernels.member_rows import Indices
from npend_gym.physics.kernels.rk4_derivatives import tangents_of_group


@inlined_kernel
def _load(states: FloatArray, torques: FloatArray, first: int, rows: FloatArray) -> None:
    """Put states from the `first` on, and their torques, into the lanes of a group."""
    last, n = states.shape[0] - 1, torques.shape[1]
    for lane in range(WIDTH):
        k = min(first + lane, last)
        for i in range(n):
            rows[Rod.THETA, i * WIDTH + lane] = states[k, 0, i]
            rows[Rod.OMEGA, i * WIDTH + lane] = states[k, 1, i]
            rows[Rod.TORQUE, i * WIDTH + lane] = torques[k, i]


@inlined_kernel
def _unit_changes(changes: FloatArray, n: int) -> None:
    """Write unit changes of theta and omega, and none for the directions of parameters."""
    for d in range(changes.shape[0]):
        for row in range(2):
            for i in range(n):
                for lane in range(WIDTH):
                    changes[d, row, i * WIDTH + lane] = 1.0 if d == row * n + i else 0.0


@inlined_kernel
def _store(lanes: FloatArray, n: int, first: int, states: FloatArray) -> None:
    """Write the states, or changes of them, that stand in the lanes: the reverse of `_load`."""
    for lane in range(min(WIDTH, states.shape[0] - first)):
        for row in range(2):
            for i in range(n):
                states[first + lane, row, i] = lanes[row, i * WIDTH + lane]


@kernel
def steps_of_chain(
    members: FloatArray, rods: FloatArray, model: Model, before: FloatArray, torques: FloatArray,
    after: FloatArray, changes: FloatArray, changed: FloatArray, columns: FloatArray,
    timing: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Take a step of `timing` from each of the states `before` (T, S, 2, n); write those `after`.

    One row of S follows the other, so that `after` may be `before` one row later: a motion of T
    steps. The chain is that of the one group of the ensemble; `torques` (T, S, n) act on its
    joints. `columns` (T, S, D, 2, n) are the derivatives by theta, omega, and the parameters in
    the directions `changed`, as in `tangents_many`; D may be 0. `changes` (D, 2, row) and a row
    more is for work.
    """
    members, rods, before, torques = bare(members), bare(rods), bare(before), bare(torques)
    after, changes, changed, columns = bare(after), bare(changes), bare(changed), bare(columns)
    n, count = torques.shape[2], columns.shape[2]
    rest, own, reached = packs(bare(scratch)), changes[:count], changes[count]
    pushed = np.zeros((count, n + 1))
    group = group_of(packs(members), packs(rods), packs(model), 0)
    for t in range(before.shape[0]):
        for first in range(0, before.shape[1], WIDTH):
            _load(before[t], torques[t], first, rods[0])
            _unit_changes(own, n)
            tangents_of_group(group, timing, packs(own), pushed, changed, packs(reached), rest)
            _store(reached, n, first, after[t])
            for d in range(count):
                _store(own[d], n, first, columns[t, :, d])


@kernel
def carry_changes(columns: FloatArray, changes: FloatArray) -> None:
    """Carry changes through motions: the chain rule.

    Parameters
    ----------
    columns : ndarray, shape (T, S, D, 2n)
        Derivatives of each step by the 2n numbers of the state before, then in D - 2n directions.
    changes : ndarray, shape (T + 1, S, D, 2n)
        Written: the changes of the states by those at the start, and in the directions.
    """
    columns, changes = bare(columns), bare(changes)
    steps, size, directions, numbers = columns.shape
    for s in range(size):
        for d in range(directions):
            for j in range(numbers):
                changes[0, s, d, j] = 1.0 if d == j else 0.0
    for t in range(steps):
        for s in range(size):
            for d in range(directions):
                for j in range(numbers):
                    changes[t + 1, s, d, j] = 0.0 if d < numbers else columns[t, s, d, j]
                for k in range(numbers):
                    share = changes[t, s, d, k]
                    for j in range(numbers):
                        changes[t + 1, s, d, j] += share * columns[t, s, k, j]


@kernel
def angles_between(
    states: FloatArray, node: Indices, weights: FloatArray, angles: FloatArray
) -> None:
    """Write angles between the nodes of a grid by the cubic with both states there.

    Parameters
    ----------
    states : ndarray, shape (T + 1, S, D, 2, n)
        Angles and angular velocities at the nodes, or D changes of them.
    node : ndarray of int, shape (S, M)
        The node before each instant.
    weights : ndarray, shape (S, M, 4)
        Of theta and omega there, and of theta and omega at the next node.
    angles : ndarray, shape (S, M, n, D)
    """
    states, node, weights, angles = bare(states), bare(node), bare(weights), bare(angles)
    size, rows, n, count = angles.shape
    for s in range(size):
        for m in range(rows):
            k, w = node[s, m], weights[s, m]
            for d in range(count):
                a, b = states[k, s, d], states[k + 1, s, d]
                for i in range(n):
                    start, end = w[0] * a[0, i] + w[1] * a[1, i], w[2] * b[0, i] + w[3] * b[1, i]
                    angles[s, m, i, d] = start + end
