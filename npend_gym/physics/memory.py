"""The memory of many chains, and the compiled calls that work on it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym._threads import Crew
from npend_gym.chain import SIMPLE_FIELDS, Cart, Chain, ChainParameters
from npend_gym.compiled.arrays import aligned_zeros
from npend_gym.physics.calls import CallPlan, Cut, plan_of, run
from npend_gym.physics.kernels.laws import Friction
from npend_gym.physics.kernels.layout import (
    Member,
    Rod,
    Turn,
    Turns,
    group_width,
    new_scratch,
)
from npend_gym.physics.kernels.link_terms import (
    BASE_AT,
    Base,
    Link,
    Rotor,
    check_terms,
    count_terms,
)
from npend_gym.physics.kernels.member_rows import (
    Arrays,
    Indices,
    begin_all_to_measure,
    new_arrays,
    write_chains,
)
from npend_gym.physics.substeps import chain_of, check_default

_ALIASED = 256  # numbers, of 2 kB
# Where parameters stand, by their names in `Chain`
_OF_RODS = {
    "masses": Rod.MASS, "lengths": Rod.LENGTH, "damping": Rod.DAMPING, "drag": Rod.DRAG,
    "quadratic_drag": Rod.QUADRATIC_DRAG,
}  # fmt: skip
# and those in the arrays of the model
_OF_MODEL: tuple[dict[str, int], ...] = (
    {"centres": Link.CENTRE, "inertias": Link.INERTIA},
    {name: row for name, row in zip(map(str.lower, Friction._fields), Friction, strict=True)
     if name in ChainParameters._fields},
    {},
    {"armature": Rotor.ARMATURE, "gear": Rotor.GEAR},
)  # fmt: skip


class Memory:
    """The arrays of B chains of n rods, whose fields `kernels.layout` names.

    Parameters
    ----------
    chains : ChainParameters
        The parameters of all members, or of one chain for all.
    size : int
        Number of members B.
    threads : int
        Threads that share the members. No result depends on it.
    spare_rows : int
        Rows after those of `Member` in `members`, for the use of the caller.
    base : ndarray, shape (len(Base), B or 1), optional
        The rows of `link_terms.Base` where the pivots are carts.
    spare_rod_rows : int
        Rows after those of `Rod` in `rods`, for the use of the caller.
    measured : bool
        Whether turning points are measured.

    Attributes
    ----------
    arrays : tuple
        `members`, shape (rows, columns), `rods`, shape (groups, len(Rod), (n + 1) * width), and the
        model: what the kind of chain needs beside these. The last group is filled up with chains
        that hang at rest.
    record : tuple of one ndarray, shape (groups, len(Turn), (n + 1) * width), or None
        What is measured of turning points.
    groups, width : int
        Number of groups, and of members in each.
    lanes, columns : int
        Number of members with those that fill up the last group; columns of `members`, which are
        not all of use.
    """

    def __init__(
        self,
        chains: ChainParameters,
        size: int,
        threads: int = 1,
        spare_rows: int = 0,
        base: FloatArray | None = None,
        spare_rod_rows: int = 0,
        measured: bool = True,
    ) -> None:
        self.n: int = chains.masses.shape[1]
        self.size: int = size
        self.crew: Crew = Crew(threads)
        self.threads: int = threads
        self.width: int = group_width(size)
        self.groups: int = -(-size // self.width)
        lanes = self.groups * self.width
        self.lanes: int = lanes
        # rows that all begin at the same places of the cache would push each other out of it
        self.columns: int = lanes + (self.width if lanes % _ALIASED == 0 else 0)
        self.arrays: Arrays = new_arrays(
            chains, count_terms(chains, base), self.groups, self.width, base,
            columns=self.columns, spare=(spare_rows, spare_rod_rows),
        )  # fmt: skip
        rows = aligned_zeros(self.groups, len(Turn), (self.n + 1) * self.width)
        self.record: Turns = (rows,) if measured else None
        self._scratch = [new_scratch(self.n, self.width) for _ in range(threads)]
        self.arrays[0][Member.ACTIVE] = 1.0
        self.restart(np.arange(lanes))

    @property
    def members(self) -> FloatArray:
        """The rows of `Member` and the spare ones, a view of shape (rows, B)."""
        return self.arrays[0][:, : self.size]

    def per_rod(self, field: int) -> FloatArray:
        """Return a view of a field of all rods, shape (groups, width, n): see `place`."""
        return self._rods[:, field, : self.n].swapaxes(1, 2)

    def of_base(self, field: int) -> FloatArray:
        """Return a view, (groups, width), of THETA, OMEGA or TORQUE of a base that moves."""
        return self._rods[:, field, self.n]

    @property
    def _rods(self) -> FloatArray:
        """A view of the rods, shape (groups, rows, n + 1, width)."""
        return self.arrays[1].reshape(self.groups, -1, self.n + 1, self.width)

    def lanes_of(self, rows: FloatArray) -> FloatArray:
        """Return a view of rows (groups, ..., k width) as (groups, width, ..., k)."""
        view = rows.reshape(*rows.shape[:-1], rows.shape[-1] // self.width, self.width)
        return np.moveaxis(view, -1, 1)

    def fill(self, view: FloatArray, values: FloatArray) -> None:
        """Write `values` (B, ...) into a view (groups, width, ...), faster than by `place`."""
        whole, rest = divmod(self.size, self.width)
        even = self.size - rest
        view[:whole] = values[:even].reshape(whole, self.width, *values.shape[1:])
        if rest > 0:
            view[whole, :rest] = values[even:]

    def gather(self, view: FloatArray) -> FloatArray:
        """Return a view (groups, width, ...) as a new array (B, ...): what `fill` writes."""
        return view.reshape(self.lanes, *view.shape[2:])[: self.size].copy()

    def read_base(self, field: int) -> FloatArray:
        """Return THETA, OMEGA or TORQUE of bases that move, a new array of shape (B,)."""
        return self.gather(self.of_base(field))

    def read_at(self, field: int, places: Indices) -> FloatArray:
        """Return a field at `places` along all chains, n being the base: a new array (B, k)."""
        return self.gather(self._rods[:, field, places].swapaxes(1, 2))

    def place(self, members: Indices) -> tuple[Indices, Indices]:
        """Return the groups of members and their lanes there: the indices of `per_rod`."""
        return np.divmod(members, self.width)

    def read(self, field: int) -> FloatArray:
        """Return a field of the rods of all members, a new array of shape (B, n)."""
        return self.gather(self.per_rod(field))

    @property
    def parameters(self) -> ChainParameters:
        """The parameters of the members' chains."""
        own = {name: self.read(field) for name, field in _OF_RODS.items()}
        own["gravity"] = self.members[Member.GRAVITY].copy()
        chains = ChainParameters.ideal(*(own[name] for name in SIMPLE_FIELDS))
        for part, fields in zip(self.arrays[2] or (), _OF_MODEL, strict=False):
            rows = self.gather(self.lanes_of(part))
            chains = chains._replace(**{name: rows[:, row] for name, row in fields.items()})
        return chains

    def write_state(self, members: Indices, theta: FloatArray, omega: FloatArray) -> None:
        """Put some members into states, and begin to measure from there."""
        place = self.place(members)
        self.per_rod(Rod.THETA)[place], self.per_rod(Rod.OMEGA)[place] = theta, omega
        self.restart(members)

    def check_kind(self, chains: ChainParameters) -> ChainParameters:
        """Return chains, refused where they need more than the chain the memory was made for."""
        check_terms(chains, len(self.arrays[2] or ()))
        return chains

    def write_base(self, members: Indices, base: FloatArray | None) -> None:
        """Give some members a base, whose rows of `link_terms.Base` are (len(Base), 1)."""
        if base is not None and self.arrays[2] is not None:
            self.arrays[2][BASE_AT][members // self.width, :, members % self.width] = base.T

    @property
    def bases(self) -> FloatArray | None:
        """The rows of `link_terms.Base` of the members, (len(Base), B), where bases move."""
        model = self.arrays[2]
        if model is None or model[BASE_AT].shape[1] == 0:
            return None
        rows = model[BASE_AT]
        return rows.swapaxes(0, 1).reshape(rows.shape[1], -1)[:, : self.size]

    def chain(self, member: int) -> Chain:
        """Return the chain of a member, with its cart."""
        member = _checks.count("member", member, low=-self.size, high=self.size - 1)
        chain, bases = chain_of(self.parameters, member), self.bases
        if bases is None:
            return chain
        inverse_mass, damping = bases[[Base.INVERSE_MASS, Base.DAMPING], member]
        cart = Cart(_inverse(float(inverse_mass)), float(damping))
        return Chain.from_dict(chain.as_dict() | {"base": cart})

    def write_chain(self, members: Indices, chains: ChainParameters) -> None:
        """Give some members, k of them, the parameters (k, n); or (1, n), the same to all."""
        write_chains(*self.arrays, members, self.check_kind(chains).stacked())

    def read_lanes(self, members: Indices) -> list[FloatArray]:
        """Return all that is kept of some members, k of them: arrays of shapes (k, ...), new."""
        place = self.place(members)
        return [self.arrays[0][:, members].T, *(view[place].copy() for view in self._lane_views())]

    def write_lanes(self, members: Indices, parts: Sequence[FloatArray]) -> None:
        """Put some members back to what `read_lanes` returned, of whatever members."""
        place = self.place(members)
        self.arrays[0][:, members] = parts[0].T
        for view, part in zip(self._lane_views(), parts[1:], strict=True):
            view[place] = part

    def _lane_views(self) -> list[FloatArray]:
        """Return views of rods, model and record, (groups, width, rows, columns)."""
        parts = self.arrays[1], *(self.arrays[2] or ()), *(self.record or ())
        return [self.lanes_of(part) for part in parts]

    def restart(self, members: Indices) -> None:
        """Begin to measure from the present state of some members."""
        begin_all_to_measure(*self.arrays[:2], self.record, self.n, members)

    def plan(self, dt: float, substeps: int, max_rotation: float) -> CallPlan:
        """Return how steps of this kind are divided into compiled calls, for `run`."""
        cut = Cut(dt, check_default(substeps, dt), max_rotation)
        return plan_of(cut, self.n * self.width, self.groups, self.threads)

    def run(self, kernel: Callable[..., None], arrays: tuple[Any, ...], plan: CallPlan) -> None:
        """Call ``kernel(*self.arrays, *arrays, timing, scratch)`` for all groups, see `calls`."""
        run(kernel, (*self.arrays, *arrays), plan, self.crew, self._scratch)

    def close(self) -> None:
        """End the threads."""
        self.crew.close()


def _inverse(x: float) -> float:
    """Return the number of fewest digits whose inverse is `x`, as 0.9 for 1 / 0.9."""
    nearest = 1.0 / x
    near = nearest, math.nextafter(nearest, 0.0), math.nextafter(nearest, math.inf)
    same = [each for each in near if 1.0 / each == x]
    return min(same, key=lambda each: len(repr(each)), default=nearest)
