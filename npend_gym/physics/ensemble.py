"""Ensemble: many chains side by side."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import BoolArray, FloatArray
from npend_gym.chain import Chain, ChainParameters, check_chain
from npend_gym.physics import energy as _energy
from npend_gym.physics.arguments import check_limits, check_members, check_states
from npend_gym.physics.kernels.ensemble import advance_many, advance_one
from npend_gym.physics.kernels.layout import Member, Rod
from npend_gym.physics.memory import Memory
from npend_gym.physics.substeps import MAX_ROTATION, MAX_SUBSTEPS, default_substeps


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

    Attributes
    ----------
    n, size : int
        Number of rods, and of members B.
    joints : ndarray, int64

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
    ) -> None:
        one_for_all = isinstance(chains, Chain)
        listed = [chains] if one_for_all else [*chains]
        first = check_chain(listed[0] if listed else None)
        self.n, self.size = first.n, len(listed)
        if size is not None:
            self.size = _checks.count("size", size)
        if not one_for_all and self.size != len(listed):
            raise ValueError(f"size must be the number of chains, {len(listed)}, got {self.size}")
        self.joints = np.array([_checks.count("joint", j, low=0, high=self.n - 1) for j in joints])
        self._memory = Memory(first.repeated(1), self.size, threads)
        self._substeps: dict[float, int] = {}  # by default, of the last dt
        self._ready = True
        for k, chain in enumerate(listed if not one_for_all else ()):
            self.set_chain([k], chain)

    def set_chain(self, members: Any, chain: Chain | ChainParameters) -> None:
        """Give some members the parameters of a chain; their time and measurements start anew.

        Parameters
        ----------
        members : array_like of int or bool, or slice
            Which members, k of them.
        chain : Chain or ChainParameters
            One for all, or arrays of parameters with a leading axis of k.
        """
        chosen = check_members(members, self.size)
        rows = chain.repeated(chosen.size) if isinstance(chain, Chain) else chain
        if rows.masses.shape != (chosen.size, self.n):
            raise ValueError(
                f"chain must have {self.n} rods, for each of the {chosen.size} members, "
                f"got masses of shape {rows.masses.shape}"
            )
        memory, self._ready = self._intact, False
        self._substeps.clear()
        memory.write_chain(chosen, rows)
        memory.restart(chosen)
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
        chosen = check_members(members, self.size)
        states = check_states(self.n, theta=theta, omega=omega)
        if states[0].shape not in ((self.n,), (chosen.size, self.n)):
            raise ValueError(
                f"theta and omega must have the shape ({self.n},) or ({chosen.size}, {self.n}), "
                f"got {states[0].shape}"
            )
        check_limits(*states)
        memory, self._ready = self._intact, False
        memory.write_state(chosen, *states)
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
        if substeps is None:
            count, rotation = self._default_substeps(dt), MAX_ROTATION
        else:
            count, rotation = _checks.count("substeps", substeps, high=MAX_SUBSTEPS), math.inf
        mask = np.ones(self.size) if active is None else np.asarray(active, np.bool_)
        if mask.shape != (self.size,):
            raise ValueError(f"active must have the shape ({self.size},), got {mask.shape}")
        memory, self._ready = self._intact, False
        place = memory.place(np.arange(self.size))
        for joint, column in zip(self.joints, given.T, strict=True):
            memory.per_rod(Rod.TORQUE)[(*place, joint)] = column
        memory.members[Member.ACTIVE] = mask
        memory.run(advance_one if self.size == 1 else advance_many, (), dt, count, rotation)
        memory.members[Member.ACTIVE] = 1.0
        self._ready = True

    @property
    def time(self) -> FloatArray:
        """Time since the state was set [s], shape (B,)."""
        return self._intact.members[Member.TIME].copy()

    @property
    def work(self) -> FloatArray:
        """Work of torques, damping and drag since the state was set [J], shape (B,)."""
        return self._intact.members[Member.WORK].copy()

    @property
    def diverged(self) -> BoolArray:
        """Members whose state left all bounds in the last step, shape (B,)."""
        return self._intact.members[Member.DIVERGED] != 0.0

    @property
    def theta(self) -> FloatArray:
        """Angles [rad], not wrapped, shape (B, n)."""
        return self._intact.read(Rod.THETA)

    @property
    def omega(self) -> FloatArray:
        """Angular velocities [rad/s], shape (B, n)."""
        return self._intact.read(Rod.OMEGA)

    @property
    def pseudo_periods(self) -> FloatArray:
        """Pseudo-period of each bob [s], shape (B, n), reading "bob"; NaN where not complete."""
        return self._intact.read(Rod.PERIOD)

    @property
    def parameters(self) -> ChainParameters:
        """The parameters of the members' chains, shape (B, n)."""
        return self._intact.parameters

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
        return _energy.centre_of_mass(self.parameters, self.theta)

    @property
    def tip(self) -> FloatArray:
        """Position of the last bob [m], shape (B, 2)."""
        return self.positions[:, -1]

    def chain(self, member: int) -> Chain:
        """Return the chain of a member."""
        values = {name: row[member] for name, row in self.parameters._asdict().items()}
        return Chain.from_dict(values | {"gravity": float(values["gravity"])})

    @property
    def _intact(self) -> Memory:
        """The memory, refused where a call was interrupted."""
        if not self._ready:
            raise RuntimeError(
                "a call was interrupted and members may be in different steps: make a new Ensemble"
            )
        return self._memory

    def _default_substeps(self, dt: float) -> int:
        """Return the substeps that the chain with the fastest mode needs; kept for the last dt."""
        if dt not in self._substeps:
            rows = np.hstack([row.reshape(self.size, -1) for row in self.parameters])
            different = np.unique(rows, axis=0, return_index=True)[1].tolist()
            self._substeps = {dt: max(default_substeps(self.chain(k), dt) for k in different)}
        return self._substeps[dt]

    def close(self) -> None:
        """End the threads; they start again where they are needed."""
        self._memory.close()
