"""Ensemble: many chains side by side."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from npend_gym import _checks
from npend_gym._checks import BoolArray, FloatArray
from npend_gym._threads import MAX_THREADS, Call, Helpers
from npend_gym.chain import STANDARD_GRAVITY, Chain, ChainParameters, check_chain
from npend_gym.physics import energy as _energy
from npend_gym.physics.arguments import check_limits
from npend_gym.physics.kernels.ensemble import MAX_PARTS, advance_many, advance_one
from npend_gym.physics.kernels.layout import Member, Rod, Timing, group_width, new_scratch
from npend_gym.physics.kernels.turning_points import speed_threshold
from npend_gym.theory import fastest_frequency

Indices = NDArray[np.int64]

MAX_SUBSTEPS = 100_000
# By default a substep is so short that the fastest normal mode turns by no more than this [rad],
# and that what damping and drag brake decays by no more than this. Turning points of a release
# then come out within 1e-6 s of the adaptive method's for the paper's chains up to N = 20.
_PHASE = 1.0 / 16.0
# A chain that is whirled round turns faster than it swings. Substeps in which no rod turns by more
# than this keep the energy of chains under random torques to some 1e-4 in an episode.
MAX_ROTATION = 1.0 / 20.0  # rad
_RODS_PER_CALL = 2_000_000  # rods times substeps in one compiled call: some tenths of a second
_CHUNKS = 4  # of a thread's share in a step: with fewer, all wait longer for the last one


class Ensemble:
    """B chains of n rods each, advanced side by side.

    No chain depends on another, on B or on the number of threads.

    Parameters
    ----------
    chains : Chain or sequence of Chain
        One chain for all members, or one for each; all with the same number of rods.
    size : int, optional
        Number of members B; needed where one chain is given for all.
    joints : sequence of int
        Joints that `advance` puts torques on; joint 0 is the pivot.
    threads : int
        Threads that share the members. No result depends on it.
    spare_rows : int
        Rows after those of `Member` in the first of `arrays`, for the use of the caller.

    Attributes
    ----------
    n, size : int
        Number of rods, and of members B.
    joints : ndarray, int64
    arrays : tuple of ndarray
        The memory that kernels work on; kernels/layout.py names its fields.

    Raises
    ------
    TypeError, ValueError
        If an argument breaks its rule.

    Notes
    -----
    An exception that interrupts a call, such as that of Ctrl-C, may leave some members advanced and
    others not. The ensemble then refuses all further use with a RuntimeError: make a new one.
    """

    def __init__(
        self,
        chains: Chain | Sequence[Chain],
        size: int | None = None,
        *,
        joints: Sequence[int] = (0,),
        threads: int = 1,
        spare_rows: int = 0,
    ) -> None:
        listed = [chains] * (1 if size is None else 0) if isinstance(chains, Chain) else [*chains]
        first = chains if isinstance(chains, Chain) else check_chain(listed[0] if listed else None)
        self.n = n = first.n
        self.size = len(listed) if size is None else _checks.count("size", size)
        self.joints = np.array([_checks.count("joint", j, low=0, high=n - 1) for j in joints])
        self.threads = _checks.count("threads", threads, high=MAX_THREADS)
        self._width = width = group_width(self.size)
        self._groups = -(-self.size // width)
        lanes = self._groups * width  # the last group is filled up
        self.arrays = (
            np.zeros((len(Member) + spare_rows, lanes)),
            np.zeros((self._groups, len(Rod), (n + 1) * width)),
        )
        self._scratch = [new_scratch(n, width) for _ in range(self.threads)]
        self._timing = np.zeros((self.threads, len(Timing)))
        self._substeps: dict[float, int] = {}  # by default, of the last dt
        self._plan: tuple[float, int, float] | None = None  # of the last `run`
        self._helpers: Helpers | None = None
        self._ready = True
        every = np.arange(lanes)
        self._write_chain(every, first.repeated(lanes))
        self._restart(every)
        self.members[Member.ACTIVE] = 1.0
        for k, chain in enumerate(listed):
            self.set_chain([k], chain)

    # -- state -------------------------------------------------------------------------------

    @property
    def members(self) -> FloatArray:
        """The rows of `Member` and the spare ones, a view of shape (rows, B)."""
        return self.arrays[0][:, : self.size]

    def per_rod(self, field: Rod) -> FloatArray:
        """Return a view of a field of all rods, shape (groups, width, n): see `place`."""
        rods = self.arrays[1].reshape(self._groups, len(Rod), self.n + 1, self._width)
        return rods[:, field, : self.n].swapaxes(1, 2)

    def place(self, members: Indices) -> tuple[Indices, Indices]:
        """Return the groups of members and their lanes there: the indices of `per_rod`."""
        return np.divmod(members, self._width)

    def set_chain(self, members: Any, chain: Chain | ChainParameters) -> None:
        """Give some members the parameters of a chain; their time and measurements start anew.

        Parameters
        ----------
        members : array_like of int or bool, or slice
            Which members, k of them.
        chain : Chain or ChainParameters
            One for all, or arrays of parameters with a leading axis of k.
        """
        chosen = self._indices(members)
        rows = chain.repeated(chosen.size) if isinstance(chain, Chain) else chain
        if rows.masses.shape != (chosen.size, self.n):
            raise ValueError(
                f"chain must have {self.n} rods, for each of the {chosen.size} members, "
                f"got masses of shape {rows.masses.shape}"
            )
        self._begin()
        self._substeps.clear()
        self._write_chain(chosen, rows)
        self._restart(chosen)
        self._ready = True

    def set_state(self, members: Any, theta: ArrayLike, omega: ArrayLike = 0.0) -> None:
        """Put some members into a state; their time, work and measurements start anew.

        Parameters
        ----------
        members : array_like of int or bool, or slice
            Which members, k of them.
        theta, omega : array_like, shape (k, n) or (n,)
            Angles [rad] and angular velocities [rad/s]; one number stands for all rods.
        """
        chosen = self._indices(members)
        shape = (chosen.size, self.n)
        states = [_checks.array("theta", theta), _checks.array("omega", omega)]
        for name, value in zip(("theta", "omega"), states, strict=True):
            if value.shape not in ((), shape[1:], shape):
                raise ValueError(
                    f"{name} must be one number or have the shape {shape[1:]} or {shape}, "
                    f"got {value.shape}"
                )
        check_limits(*states)
        self._begin()
        place = self.place(chosen)
        self.per_rod(Rod.THETA)[place], self.per_rod(Rod.OMEGA)[place] = states
        self._restart(chosen)
        self._ready = True

    def advance(
        self,
        torque: ArrayLike,
        dt: float,
        substeps: int | None = None,
        *,
        active: ArrayLike | None = None,
    ) -> None:
        """Advance the members by `dt` under constant torques, by Runge-Kutta steps of order 4.

        Parameters
        ----------
        torque : array_like, shape (B, joints)
            Torque on each of `joints` [N m]; one number stands for all.
        dt : float
            [s]
        substeps : int, optional
            Number of Runge-Kutta steps. By default as many as the chain with the fastest normal
            mode needs, see `default_substeps`, and more where a rod turns by more than 1/20 rad.
        active : array_like of bool, shape (B,), optional
            Members to advance; all by default.

        Raises
        ------
        ValueError, TypeError
            If an argument breaks its rule; nothing has changed then.
        RuntimeError
            If an earlier call was interrupted.

        Notes
        -----
        A member that leaves all bounds keeps its last finite state; `diverged` is True for it.
        """
        given = _checks.broadcast("torque", torque, (self.size, self.joints.size))
        dt = _checks.positive_number("dt", dt)
        rotation = MAX_ROTATION if substeps is None else math.inf
        if substeps is None and dt not in self._substeps:
            different = [self.chain(k) for k in self._different_chains()]
            self._substeps = {dt: max(default_substeps(chain, dt) for chain in different)}
        substeps = self._substeps[dt] if substeps is None else substeps
        substeps = _checks.count("substeps", substeps, high=MAX_SUBSTEPS)
        mask = np.ones(self.size) if active is None else np.asarray(active, np.bool_)
        if mask.shape != (self.size,):
            raise ValueError(f"active must have the shape ({self.size},), got {mask.shape}")
        self._begin()
        place = self.place(np.arange(self.size))
        for column, joint in enumerate(self.joints):
            self.per_rod(Rod.TORQUE)[(*place, joint)] = given[:, column]
        self.members[Member.ACTIVE] = mask
        self.run(advance_one if self.size == 1 else advance_many, (), dt, substeps, rotation)
        self.members[Member.ACTIVE] = 1.0
        self._ready = True

    # -- what can be read ----------------------------------------------------------------------

    @property
    def time(self) -> FloatArray:
        """Time since the state was set [s], shape (B,)."""
        return self._read_members(Member.TIME)

    @property
    def work(self) -> FloatArray:
        """Work of torques, damping and drag since the state was set [J], shape (B,)."""
        return self._read_members(Member.WORK)

    @property
    def diverged(self) -> BoolArray:
        """Members whose state left all bounds in the last step, shape (B,)."""
        return self._read_members(Member.DIVERGED) != 0.0

    @property
    def theta(self) -> FloatArray:
        """Angles [rad], not wrapped, shape (B, n)."""
        return self._read_rods(Rod.THETA)

    @property
    def omega(self) -> FloatArray:
        """Angular velocities [rad/s], shape (B, n)."""
        return self._read_rods(Rod.OMEGA)

    @property
    def pseudo_periods(self) -> FloatArray:
        """Pseudo-period of each bob [s], shape (B, n), reading "bob"; NaN where not complete."""
        return self._read_rods(Rod.PERIOD)

    @property
    def parameters(self) -> ChainParameters:
        """The parameters of the members' chains, shape (B, n)."""
        return ChainParameters(
            self._read_rods(Rod.MASS),
            self._read_rods(Rod.LENGTH),
            self._read_members(Member.GRAVITY),
            self._read_rods(Rod.DAMPING),
            self._read_rods(Rod.DRAG),
            self._read_rods(Rod.QUADRATIC_DRAG),
        )

    @property
    def kinetic_energy(self) -> FloatArray:
        """Kinetic energy [J], shape (B,)."""
        return _energy.kinetic_energy(self.parameters, self.theta, self.omega)

    @property
    def energy(self) -> FloatArray:
        """Energy above hanging at rest [J], shape (B,)."""
        return _energy.energy(self.parameters, self.theta, self.omega)

    @property
    def positions(self) -> FloatArray:
        """Positions of the bobs [m], shape (B, n, 2)."""
        return _energy.positions(self.parameters, self.theta)

    @property
    def centre_of_mass(self) -> FloatArray:
        """Position of the centre of mass [m], shape (B, 2)."""
        weights = self.parameters.masses[..., None]
        return (weights * self.positions).sum(axis=1) / weights.sum(axis=1)

    @property
    def tip(self) -> FloatArray:
        """Position of the last bob [m], shape (B, 2)."""
        return self.positions[:, -1]

    def chain(self, member: int) -> Chain:
        """Return the chain of a member."""
        values = (row[member] for row in self.parameters)
        masses, lengths, gravity, *resisting = values
        return Chain(masses, lengths, float(gravity), *resisting)

    # -- one compiled call ---------------------------------------------------------------------

    def run(
        self,
        kernel: Callable[..., None],
        arrays: tuple[NDArray[Any], ...],
        dt: float,
        substeps: int,
        max_rotation: float,
    ) -> None:
        """Call ``kernel(*self.arrays, *arrays, timing, scratch)`` for all groups.

        Large steps are divided over several calls, so short that Ctrl-C is heard between them, and
        over the threads. `arrays` are those of a kernel which does more than `advance`. This
        method does not check whether it was interrupted: its caller must.
        """
        if self._plan != (dt, substeps, max_rotation):
            self._per_call = groups, piece = self._divide(substeps, max_rotation)
            self._one_call = groups >= self._groups and piece >= substeps
            self._timing[:] = dt, substeps, 1.0 / max_rotation, 0, self._groups, 0, substeps
            self._plan = dt, substeps, max_rotation
        if self._one_call:
            kernel(*self.arrays, *arrays, self._timing[0], self._scratch[0])
            return
        chunks = iter(range(0, self._groups, self._per_call[0]))

        def work(thread: int, call: Call | None) -> None:
            timing, scratch = self._timing[thread], self._scratch[thread]
            for span in self._spans(chunks, substeps):
                timing[3:] = span
                kernel(*self.arrays, *arrays, timing, scratch)
                if call is not None and call.stopped:
                    return

        if self.threads == 1 or self._groups == 1:
            work(0, None)
            return
        if self._helpers is None:
            self._helpers = Helpers(min(self.threads, self._groups) - 1)
        self._helpers.run(work)

    def _spans(self, chunks: Iterator[int], substeps: int) -> Iterator[tuple[int, int, int, int]]:
        """Yield the first and last group and substep of each call; threads share the chunks."""
        groups, piece = self._per_call
        for first in chunks:
            for begin in range(0, max(1, substeps), piece):
                yield first, min(first + groups, self._groups), begin, min(begin + piece, substeps)

    def _divide(self, substeps: int, max_rotation: float) -> tuple[int, int]:
        """Return the largest number of groups and of substeps in one compiled call."""
        most = self.n * self._width * (1 if math.isinf(max_rotation) else int(MAX_PARTS))
        piece = max(1, _RODS_PER_CALL // most)  # substeps of a group
        share = self._groups
        if self.threads > 1:
            share = -(-self._groups // (_CHUNKS * self.threads))
        return max(1, min(piece // max(1, substeps), share)), max(1, min(piece, substeps))

    # -- parts ---------------------------------------------------------------------------------

    def _begin(self) -> None:
        """Refuse use after an interruption; from now on until the end a call can be interrupted."""
        self._check_ready()
        self._ready = False

    def _check_ready(self) -> None:
        if not self._ready:
            raise RuntimeError(
                "a call was interrupted and members may be in different steps: make a new Ensemble"
            )

    def _indices(self, members: Any) -> Indices:
        """Return the numbers of the members meant."""
        try:
            return np.atleast_1d(np.arange(self.size)[members])
        except (IndexError, TypeError) as error:
            raise ValueError(
                f"members must be indices below {self.size}, a mask or a slice, "
                f"got {_checks.show(members)}"
            ) from error

    def _read_members(self, field: Member) -> FloatArray:
        self._check_ready()
        return self.members[field].copy()

    def _read_rods(self, field: Rod) -> FloatArray:
        self._check_ready()
        return self.per_rod(field).reshape(-1, self.n)[: self.size].copy()

    def _different_chains(self) -> list[int]:
        """Return one member of each chain that differs from the others."""
        rows = np.hstack([row.reshape(self.size, -1) for row in self.parameters])
        return np.unique(rows, axis=0, return_index=True)[1].tolist()

    def _write_chain(self, members: Indices, chains: ChainParameters) -> None:
        place = self.place(members)
        carried = chains.carried_masses * chains.lengths
        for field, values in (
            (Rod.MASS, chains.masses),
            (Rod.LENGTH, chains.lengths),
            (Rod.INVERSE_LENGTH, 1.0 / chains.lengths),
            (Rod.DAMPING, chains.damping),
            (Rod.DRAG, chains.drag),
            (Rod.QUADRATIC_DRAG, chains.quadratic_drag),
            (Rod.CARRIED, carried),
        ):
            self.per_rod(field)[place] = values
        # at joints 0..n: zero at the pivot, which cannot move
        rods = self.arrays[1].reshape(self._groups, len(Rod), self.n + 1, self._width)
        rods[:, Rod.INVERSE_MASS, 1:].swapaxes(1, 2)[place] = 1.0 / chains.masses
        self.arrays[0][Member.GRAVITY, members] = chains.gravity

    def _restart(self, members: Indices) -> None:
        """Begin to measure from the present state of some members."""
        place = self.place(members)
        theta, omega = self.per_rod(Rod.THETA)[place], self.per_rod(Rod.OMEGA)[place]
        lengths, gravity = self.per_rod(Rod.LENGTH)[place], self.arrays[0][Member.GRAVITY, members]
        fastest = np.abs(omega).max(axis=1)
        threshold = speed_threshold(gravity, lengths, fastest) * lengths.mean(axis=1)
        self.arrays[0][[[Member.TIME], [Member.WORK], [Member.COMPLETED], [Member.DIVERGED]],
                       members] = 0.0  # fmt: skip
        self.arrays[0][Member.THRESHOLD, members] = threshold
        self.per_rod(Rod.ORIENTATION)[place] = np.where(
            _energy.sideways(lengths, theta) < 0.0, -1.0, 1.0
        )
        for field, value in (
            (Rod.PERIOD, np.nan), (Rod.ZERO, np.nan), (Rod.SIGN, 0.0), (Rod.RISEN, 0.0)
        ):  # fmt: skip
            self.per_rod(field)[place] = value

    def close(self) -> None:
        """End the threads."""
        if self._helpers is not None:
            self._helpers.close()
            self._helpers = None

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_helpers": None}  # threads start again where they are needed


def default_substeps(chain: Chain, dt: float) -> int:
    """Return the number of Runge-Kutta steps that resolve `dt` seconds of a chain's motion.

    In each the fastest normal mode turns by at most 1/16 rad, and what damping and drag brake
    decays by at most that much.
    """
    return max(1, min(MAX_SUBSTEPS, math.ceil(dt * _fastest_rate(chain) / _PHASE)))


def _fastest_rate(chain: Chain) -> float:
    """Return the rate [1/s] that the substeps must resolve: of the fastest mode, or of braking."""
    gravity = chain.gravity or STANDARD_GRAVITY
    swinging = Chain(chain.masses, chain.lengths, gravity)
    v = np.concatenate([[0.0], 1.0 / chain.masses])
    damping = np.append(chain.damping, 0.0)
    # a bound by Gershgorin's circles on the inverse mass matrix times the damping matrix
    braking = 4.0 * (v[:-1] + v[1:]) * (damping[:-1] + damping[1:]) / chain.lengths**2
    # drag slows no motion faster than the most slowed bob would be alone; that of the square at the
    # speed of a pendulum as long as the chain that has fallen from upright, its slope 2 |v|
    fallen = 2.0 * math.sqrt(gravity * chain.total_length)
    slowing = (chain.drag + 2.0 * fallen * chain.quadratic_drag) / chain.masses
    return max(fastest_frequency(swinging), float(braking.max()) + float(slowing.max()))
