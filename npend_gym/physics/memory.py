"""The memory of many chains, and the compiled calls that work on it."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym._threads import Call, Helpers, check_threads, each_once
from npend_gym.chain import SIMPLE_FIELDS, Cart, Chain, ChainParameters
from npend_gym.compiled.arrays import aligned_zeros
from npend_gym.compiled.packs import WIDTH
from npend_gym.physics.kernels.advance import MAX_PARTS
from npend_gym.physics.kernels.laws import Friction
from npend_gym.physics.kernels.layout import (
    Member,
    Model,
    Rod,
    Timing,
    Turn,
    Turns,
    group_width,
    new_scratch,
)  # fmt: skip
from npend_gym.physics.kernels.link_terms import (
    BASE_AT,
    Base,
    Link,
    Rotor,
    check_terms,
    model_terms,
)  # fmt: skip
from npend_gym.physics.kernels.member_rows import Indices, begin_all_to_measure, write_chains
from npend_gym.physics.substeps import chain_of, check_default

_RODS_PER_CALL = 2_000_000  # rods times substeps in one compiled call: some tenths of a second
_ALIASED = 256  # numbers, of 2 kB
_SPAN = [Timing.FIRST_GROUP, Timing.LAST_GROUP, Timing.FIRST_SUBSTEP, Timing.LAST_SUBSTEP]
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
_CHUNKS = 4  # of a thread's share in a step: with fewer, all wait longer for the last one


class Plan(NamedTuple):
    """How a step is divided into compiled calls."""

    substeps: int
    groups: int  # in one call
    piece: int  # substeps of one call
    whole: bool  # whether one call does it all
    timing: list[FloatArray]  # of each thread


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
    packed : bool
        Whether even one member is kept in a pack, for kernels that know nothing else.
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
        packed: bool = False,
        measured: bool = True,
    ) -> None:
        self.n: int = chains.masses.shape[1]
        self.size: int = size
        self.threads: int = check_threads(threads)
        self.width: int = WIDTH if packed else group_width(size)
        self.groups: int = -(-size // self.width)
        lanes = self.groups * self.width
        self.lanes: int = lanes
        # rows that all begin at the same places of the cache would push each other out of it
        self.columns: int = lanes + (self.width if lanes % _ALIASED == 0 else 0)
        terms = model_terms(chains, base)
        self.arrays: tuple[FloatArray, FloatArray, Model] = (
            aligned_zeros(len(Member) + spare_rows, self.columns),
            aligned_zeros(self.groups, len(Rod) + spare_rod_rows, (self.n + 1) * self.width),
            tuple(aligned_zeros(self.groups, len(t), t.shape[2] * self.width) for t in terms)
            or None,
        )
        if base is not None and self.arrays[2] is not None:
            own = base[:, np.minimum(np.arange(lanes), base.shape[1] - 1)]
            self.arrays[2][BASE_AT][:] = own.reshape(len(base), self.groups, self.width).swapaxes(
                0, 1
            )
        self.record: Turns = (self.new_rows(len(Turn)),) if measured else None
        self._scratch = [new_scratch(self.n, self.width) for _ in range(threads)]
        self._helpers: Helpers | None = None
        self.arrays[0][Member.ACTIVE] = 1.0
        if len(chains.masses) > 1:  # lanes to spare repeat the last chain
            own = np.minimum(np.arange(lanes), size - 1)
            chains = ChainParameters(*(field[own] for field in chains))
        self.write_chain(np.arange(lanes), chains)
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

    def feature(self, name: str) -> FloatArray | None:
        """Return a view of a parameter of all lanes, or None where their kind has none."""
        if name in _OF_RODS:
            return self.per_rod(_OF_RODS[name])
        for part, fields in zip(self.arrays[2] or (), _OF_MODEL, strict=False):
            if name in fields:
                return part[:, fields[name]]
        return None

    def new_rows(self, *count: int) -> FloatArray:
        """Return zeros (groups, *count, (n + 1) width): rows as those of `rods`."""
        return aligned_zeros(self.groups, *count, (self.n + 1) * self.width)

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

    def plan(self, dt: float, substeps: int, max_rotation: float) -> Plan:
        """Return how steps of this kind are divided into compiled calls, for `run`."""
        check_default(substeps, dt)
        most = self.n * self.width * (1 if math.isinf(max_rotation) else int(MAX_PARTS))
        piece = max(1, _RODS_PER_CALL // most)  # substeps of a group
        share = self.groups
        if self.threads > 1:
            share = -(-self.groups // (_CHUNKS * self.threads))
        groups = max(1, min(piece // max(1, substeps), share))
        piece = max(1, min(piece, substeps))
        timing = np.zeros((self.threads, len(Timing)))
        timing[:, Timing.DT], timing[:, Timing.SUBSTEPS] = dt, substeps
        timing[:, Timing.PER_ROTATION] = 1.0 / max_rotation
        timing[:, Timing.LAST_GROUP], timing[:, Timing.LAST_SUBSTEP] = self.groups, substeps
        whole = groups >= self.groups and piece >= substeps
        return Plan(substeps, groups, piece, whole, list(timing))

    def run(
        self,
        kernel: Callable[..., None],
        arrays: tuple[Any, ...],
        plan: Plan,
        work: Sequence[FloatArray] | None = None,
    ) -> None:
        """Call ``kernel(*self.arrays, *arrays, timing, scratch)`` for all groups.

        The scratch of each thread is that of steps, or else from `work`.

        Large steps are divided over threads, and over calls so short that Ctrl-C takes effect
        between them. The caller must check whether one was interrupted.
        """
        if plan.whole:
            kernel(*self.arrays, *arrays, plan.timing[0], (work or self._scratch)[0])
            return
        chunks = deque(range(0, self.groups, plan.groups))

        def share(thread: int, call: Call | None) -> None:
            timing, scratch = plan.timing[thread], (work or self._scratch)[thread]
            for span in self._spans(chunks, plan):
                timing[_SPAN] = span
                kernel(*self.arrays, *arrays, timing, scratch)
                if call is not None and call.stopped:
                    return

        if self.threads == 1 or self.groups == 1:
            share(0, None)
            return
        helpers = self._helpers or Helpers(min(self.threads, self.groups) - 1)
        self._helpers = None  # after an interrupt they may still be busy
        helpers.run(share)
        self._helpers = helpers

    def _spans(self, chunks: deque[int], plan: Plan) -> Iterator[tuple[int, int, int, int]]:
        """Yield the first and last group and substep of each call; threads share the chunks."""
        for first in each_once(chunks):
            last = min(first + plan.groups, self.groups)
            for begin in range(0, max(1, plan.substeps), plan.piece):
                yield first, last, begin, min(begin + plan.piece, plan.substeps)

    def close(self) -> None:
        """End the threads."""
        if self._helpers is not None:
            self._helpers.close()
            self._helpers = None

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_helpers": None}  # threads start again where they are needed


def _inverse(x: float) -> float:
    """Return the number of fewest digits whose inverse is `x`, as 0.9 for 1 / 0.9."""
    nearest = 1.0 / x
    near = nearest, math.nextafter(nearest, 0.0), math.nextafter(nearest, math.inf)
    same = [each for each in near if 1.0 / each == x]
    return min(same, key=lambda each: len(repr(each)), default=nearest)
