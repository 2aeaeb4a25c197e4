"""A step of chains as a function of arrays that owns nothing, and its derivatives.

Its arguments are the chains, their coordinates and rates (B, m), loads (B, k) at the coordinates
`inputs` (k,), and how the time is cut. Nothing is kept between calls but work space, which each
thread has for itself, and what follows from chains alone.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from npend_gym import _checks
from npend_gym._checks import BoolArray, FloatArray
from npend_gym._threads import Crew
from npend_gym.chain import ChainParameters
from npend_gym.compiled.arrays import aligned_zeros
from npend_gym.compiled.packs import WIDTH
from npend_gym.physics.calls import Cut, plan_of, run
from npend_gym.physics.directions import (
    KINDS,
    Kind,
    by_names,
    check_directions,
    check_names,
    with_features,
)
from npend_gym.physics.kernels.link_terms import Base, check_terms
from npend_gym.physics.kernels.member_rows import Arrays, new_arrays
from npend_gym.physics.kernels.rk4_derivatives import TAPE_ROWS, adjoint_rows, tangent_rows
from npend_gym.physics.kernels.steps import (
    OWN_ROWS,
    STEP_ROWS,
    step_adjoint,
    step_states,
    step_tangents,
)
from npend_gym.physics.substeps import (
    MAX_ROTATION,
    MAX_SUBSTEPS,
    check_default,
    substeps_of,
    substeps_on_cart,
)

_TAPE = 2**22  # bytes of the tapes that are kept for the way back: more would leave the cache
_KEPT, _LARGEST = 8, 2**25  # work spaces that a thread keeps, and their bytes
_IN_THREAD = threading.local()
_ALONE = Crew()


class Chains:
    """The parameters of chains: one for each state, or one for all. They do not change.

    They are of the kind with these `terms` (`count_terms`), on a `base` (len(Base), B or 1). What
    follows from them is computed where it is needed, and kept.

    Raises
    ------
    ValueError
        If they need a larger kind.
    """

    def __init__(self, rows: ChainParameters, terms: int, base: FloatArray | None = None) -> None:
        check_terms(rows, terms)
        self.size: int
        self.n: int
        self.size, self.n = rows.masses.shape
        self.rows, self.terms, self.base = rows, terms, base
        self.coordinates: int = self.n + (base is not None)
        self.kind: Kind = KINDS[terms]
        self._packs: dict[tuple[str, ...], Arrays] = {}
        self._needed = 0.0, 0  # the last dt, and its substeps

    def packs(self, names: Sequence[str] = ()) -> Arrays:
        """Return the chains as kernels have them that differentiate by the named parameters."""
        key = tuple(names)
        if key not in self._packs:
            rows = with_features(self.rows, key)
            if key and rows is self.rows:
                return self.packs()
            groups = -(-self.size // WIDTH)
            self._packs[key] = new_arrays(rows, self.terms, groups, WIDTH, self.base)
        return self._packs[key]

    @property
    def centres_at_ends(self) -> BoolArray:
        """Whether the centre of mass of each link is at its end, and stays there, (B or 1, n)."""
        return self.rows.centres == self.rows.lengths

    def cut(self, dt: float, substeps: int | None) -> Cut:
        """Return how a step of `dt` is cut: into `substeps`, or the default number."""
        dt = _checks.positive_number("dt", dt)
        if substeps is None:
            return Cut(dt, self._default_substeps(dt), MAX_ROTATION)
        return Cut(dt, _checks.count("substeps", substeps, high=MAX_SUBSTEPS), math.inf)

    def _default_substeps(self, dt: float) -> int:
        """Return the substeps that the chain with the fastest mode needs; kept for the last dt."""
        last, needed = self._needed
        if dt != last:
            needed = substeps_of(self.rows, dt)
            if self.base is not None:
                on_cart = self.base[Base.INVERSE_MASS], self.base[Base.DAMPING]
                needed = substeps_on_cart(needed, self.rows, dt, *on_cart)
            self._needed = dt, check_default(needed, dt)
        return needed


class State(NamedTuple):
    """What a step begins with."""

    q: FloatArray  # (B, m)
    u: FloatArray  # (B, m)
    loads: FloatArray  # (B, k)
    inputs: NDArray[np.int64]  # coordinates at which the loads act, (k,)


class Reached(NamedTuple):
    """Where steps lead."""

    states: FloatArray  # q and u, (2, B, m)
    lost: FloatArray  # one where a number is out of bounds before or after the step, (B,)


def take(chains: Chains, state: State, cut: Cut, crew: Crew = _ALONE) -> Reached:
    """Take a step; states have the bits of `Ensemble.advance`."""
    return _run(step_states, chains, state, cut, (), STEP_ROWS, crew)


def tangents(
    chains: Chains, state: State, cut: Cut, parameters: Mapping[str, ArrayLike] | None = None,
    crew: Crew = _ALONE,
) -> tuple[Reached, FloatArray]:  # fmt: skip
    """Take a step; return also its derivatives as columns, (B, 2m, D).

    They are by q and u, then by the loads, then along K directions of the parameters.
    """
    m, changed = chains.coordinates, np.zeros((0, 0, chains.n))
    if parameters:
        ends = chains.centres_at_ends
        changed = check_directions(parameters, chains.n, chains.kind, ends)
    inputs, last = state.inputs, 2 * m + state.inputs.size
    pushed = np.zeros((last + len(changed), chains.n + 1))
    pushed[range(2 * m, last), inputs] = 1.0
    columns = np.empty((len(state.q), 2 * m, len(pushed)))
    more = pushed, changed if len(changed) else np.zeros((1, 0, chains.n)), columns
    rows, names = OWN_ROWS + 2 * len(pushed) + tangent_rows(), tuple(parameters or ())
    return _run(step_tangents, chains, state, cut, more, rows, crew, names), columns


def vjp(
    chains: Chains, state: State, cut: Cut, bars: Sequence[FloatArray], names: Sequence[str] = (),
    crew: Crew = _ALONE,
) -> tuple[Reached, FloatArray, FloatArray, dict[str, FloatArray]]:  # fmt: skip
    """Take a step; return also what a gradient by q and u after it, `bars`, is before it.

    By q and u, (2, B, m); by the loads, (B, k); and by the parameters that are named.
    """
    names, size = check_names(names, chains.kind), len(state.q)
    by_state, by_loads = np.empty((2, *state.q.shape)), np.empty(state.loads.shape)
    by_rows = np.empty((size, len(ChainParameters._fields) if names else 0, chains.n))
    slots = max(1, min(cut.substeps, _TAPE // (8 * TAPE_ROWS * (chains.n + 2) * WIDTH)))
    kept = np.empty((-(-size // WIDTH), cut.substeps))
    back = tuple(np.ascontiguousarray(bar) for bar in bars)
    more = back, by_state, by_loads, by_rows, slots, kept
    rows = OWN_ROWS + by_rows.shape[1] + adjoint_rows(cut.substeps, slots)
    reached = _run(step_adjoint, chains, state, cut, more, rows, crew, names)
    gradients: dict[str, FloatArray] = {}
    if names:  # each as a whole in memory: the bits of sums over states depend on that
        each = np.ascontiguousarray(by_rows.swapaxes(0, 1)).swapaxes(0, 1)
        gradients = by_names(each, names, chains.centres_at_ends)
    return reached, by_state, by_loads, gradients


def _run(
    kernel: Callable[..., None], chains: Chains, state: State, cut: Cut, more: tuple[Any, ...],
    rows: int, crew: Crew, names: Sequence[str] = (),
) -> Reached:  # fmt: skip
    """Call a kernel for all states, with `more` arguments and work space of `rows` rows."""
    (size, m), n = state.q.shape, chains.n
    reached = Reached(np.empty((2, size, m)), np.zeros(size))
    begin = (np.ascontiguousarray(x) for x in state[:3])
    given: Any = (*begin, np.arange(m), state.inputs)
    plan = plan_of(cut, n * WIDTH, -(-size // WIDTH), crew.threads, at_once=True)
    kept = _IN_THREAD.__dict__.setdefault("work", {})
    # Entries at the ends of rows are zero and stay so. After an interrupt it is not used again
    key = kernel, rows, n, m, chains.terms, crew.threads
    work: list[FloatArray] | None = kept.pop(key, None)
    if work is None:
        work = [aligned_zeros(rows, (n + 2) * WIDTH) for _ in range(crew.threads)]
    run(kernel, (*chains.packs(names), given, *reached, *more), plan, crew, work)
    if work[0].nbytes <= _LARGEST:
        kept[key] = work
        if len(kept) > _KEPT:
            kept.pop(next(iter(kept)))
    return reached
