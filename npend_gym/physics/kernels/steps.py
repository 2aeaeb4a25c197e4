"""A step of many chains as a function of arrays, with its derivatives forward and backward.

The chains are in `members`, `rods` and `model` as in `layout`, one for each state, or one group for
all. No kernel writes to them. A step is `given` as coordinates and rates (B, m), loads (B, k), and
the places in a chain of coordinates (m,) and loads (k,). The states after it are left in `reached`
(2, B, m). `lost` (B,) becomes one where a number is out of bounds, before or after.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import LARGEST, FloatArray
from npend_gym.compiled.arrays import bare, packs
from npend_gym.compiled.jit import inlined_kernel, inner_kernel, kernel
from npend_gym.compiled.packs import WIDTH
from npend_gym.compiled.sincos import MAX_ANGLE
from npend_gym.physics.kernels.layout import MAX_SPEED, Group, Model, Timing, group_of
from npend_gym.physics.kernels.rk4 import RK4_ROWS
from npend_gym.physics.kernels.rk4_derivatives import (
    adjoint_of_group,
    step_of_group,
    tangents_of_group,
)

# Rows of the work space of one group: its state and loads; derivatives by them; then changes, or
# derivatives by parameters, and what the step itself needs
_Q, _U, _LOAD, _BY_Q, _BY_U, _BY_LOAD, OWN_ROWS = range(7)
STEP_ROWS = OWN_ROWS + RK4_ROWS

Places = NDArray[np.int64]
Given = tuple[FloatArray, FloatArray, FloatArray, Places, Places]


@inner_kernel
def _put(values: FloatArray, g: int, at: Places, row: FloatArray) -> None:
    """Write the values (B, k) of group `g` into its row; lanes to spare repeat the last state."""
    for lane in range(WIDTH):
        k = min(g * WIDTH + lane, values.shape[0] - 1)
        for i in range(values.shape[1]):
            row[at[i] * WIDTH + lane] = values[k, i]


@inner_kernel
def _take(row: FloatArray, g: int, at: Places, values: FloatArray) -> None:
    """Write a row of group `g` into its values (B, k)."""
    first = g * WIDTH
    for k in range(first, min(first + WIDTH, values.shape[0])):
        for i in range(values.shape[1]):
            values[k, i] = row[at[i] * WIDTH + k - first]


@inner_kernel
def _check(values: FloatArray, g: int, n: int, limit: float, lost: FloatArray) -> None:
    """Mark states of group `g` whose first `n` values leave the limit, or others are not finite."""
    for k in range(g * WIDTH, min(g * WIDTH + WIDTH, values.shape[0])):
        for i in range(values.shape[1]):
            x = values[k, i]
            if not (abs(x) <= limit if i < n else x - x == 0.0):
                lost[k] = 1.0


@inlined_kernel
def _clear(rows: FloatArray) -> None:
    for r in range(rows.shape[0]):
        for i in range(rows.shape[1]):
            rows[r, i] = 0.0


@inlined_kernel
def _begin(
    members: FloatArray, rods: FloatArray, model: Model, g: int, given: Given, lost: FloatArray,
    work: FloatArray,
) -> Group:  # fmt: skip
    """Write state and loads of group `g` into the work space, and return them with its chains."""
    chains = min(g, rods.shape[0] - 1)
    own = group_of(packs(members), packs(rods), packs(model), None, chains)
    q, u, loads, places, inputs = given
    n, rows, size = own.velocity.size, packs(work), own.theta.size
    _clear(work[:OWN_ROWS])
    _put(q, g, places, work[_Q])
    _put(u, g, places, work[_U])
    _put(loads, g, inputs, work[_LOAD])
    _check(q, g, n, MAX_ANGLE, lost)
    _check(u, g, n, MAX_SPEED, lost)
    _check(loads, g, loads.shape[1], LARGEST, lost)
    state = rows[_Q][:size], rows[_U][:size], rows[_LOAD][:size]
    return Group(*state, own.velocity, own.mass, own.carried, own.chain, own.record)


@inlined_kernel
def _end(
    work: FloatArray, g: int, n: int, places: Places, reached: FloatArray, lost: FloatArray
) -> None:
    """Write the states of group `g` from the work space into `reached`."""
    _take(work[_Q], g, places, reached[0])
    _take(work[_U], g, places, reached[1])
    _check(reached[0], g, n, MAX_ANGLE, lost)
    _check(reached[1], g, n, MAX_SPEED, lost)


@kernel
def step_states(
    members: FloatArray, rods: FloatArray, model: Model, given: Given, reached: FloatArray,
    lost: FloatArray, timing: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Take a step."""
    members, rods, given, work = bare(members), bare(rods), bare(given), bare(scratch)
    reached, lost = bare(reached), bare(lost)
    for g in range(int(timing[Timing.FIRST_GROUP]), int(timing[Timing.LAST_GROUP])):
        group = _begin(members, rods, model, g, given, lost, work)
        step_of_group(group, timing, packs(work)[OWN_ROWS:])
        _end(work, g, group.velocity.size, given[3], reached, lost)


@kernel
def step_tangents(
    members: FloatArray, rods: FloatArray, model: Model, given: Given, reached: FloatArray,
    lost: FloatArray, pushed: FloatArray, changed: FloatArray, columns: FloatArray,
    timing: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Take a step, and write its derivatives by state, loads and parameters.

    They become the `columns` (B, 2m, D), the first 2m by the state. `pushed` (D, n + 1) are changes
    of the loads; `changed` (K, len(Parameter) or 0, n) those of the parameters, in the last K of D.
    """
    members, rods, given, work = bare(members), bare(rods), bare(given), bare(scratch)
    reached, lost, columns = bare(reached), bare(lost), bare(columns)
    pushed, changed, places = bare(pushed), bare(changed), given[3]
    m, count = places.size, columns.shape[2]
    changes, rest = work[OWN_ROWS : OWN_ROWS + 2 * count], work[OWN_ROWS + 2 * count :]
    for g in range(int(timing[Timing.FIRST_GROUP]), int(timing[Timing.LAST_GROUP])):
        group = _begin(members, rods, model, g, given, lost, work)
        _clear(changes)
        for d in range(2 * m):
            for lane in range(WIDTH):
                changes[2 * d + d // m, (d % m) * WIDTH + lane] = 1.0
        end = packs(work)[_Q:]
        tangents_of_group(group, timing, packs(changes), pushed, changed, end, packs(rest))
        _end(work, g, group.velocity.size, places, reached, lost)
        for d in range(count):
            _take(changes[2 * d], g, places, columns[:, :m, d])
            _take(changes[2 * d + 1], g, places, columns[:, m:, d])


@kernel
def step_adjoint(
    members: FloatArray, rods: FloatArray, model: Model, given: Given, reached: FloatArray,
    lost: FloatArray, bars: tuple[FloatArray, FloatArray], by_state: FloatArray,
    by_loads: FloatArray, by_parameters: FloatArray, slots: int, kept: FloatArray,
    timing: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Take a step, and derivatives by the coordinates and rates after it, `bars`, back.

    Those by the state before are written into `by_state` (2, B, m); by the loads into `by_loads`
    (B, k); by the parameters into `by_parameters` (B, len(Parameter) or 0, n). The tapes of `slots`
    substeps are kept, those of others made once more; `kept` (groups, substeps) is written.
    """
    members, rods, given, work = bare(members), bare(rods), bare(given), bare(scratch)
    reached, lost, bars, by_state = bare(reached), bare(lost), bare(bars), bare(by_state)
    by_loads, by_parameters, places = bare(by_loads), bare(by_parameters), given[3]
    count = by_parameters.shape[1]
    of_chains, rest = work[OWN_ROWS : OWN_ROWS + count], work[OWN_ROWS + count :]
    for g in range(int(timing[Timing.FIRST_GROUP]), int(timing[Timing.LAST_GROUP])):
        group, end = _begin(members, rods, model, g, given, lost, work), packs(work)[_Q:]
        for part in range(2):
            _put(bars[part], g, places, work[_BY_Q + part])
            _check(bars[part], g, places.size, LARGEST, lost)
        _clear(of_chains)
        back = packs(work)[_BY_Q:]
        adjoint_of_group(
            group, timing, back, packs(of_chains), end, slots, kept[g], packs(rest)
        )  # fmt: skip
        _end(work, g, group.velocity.size, places, reached, lost)
        for part in range(2):
            _take(work[_BY_Q + part], g, places, by_state[part])
        _take(work[_BY_LOAD], g, given[4], by_loads)
        for row in range(count):
            _take(of_chains[row], g, places, by_parameters[:, row])
