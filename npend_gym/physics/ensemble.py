"""Ensemble: many chains side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain, ChainParameters
from npend_gym.physics.arguments import (
    check_chains,
    check_limits,
    check_members,
    check_parameters,
    check_states,
    checked_joints,
)
from npend_gym.physics.calls import CallPlan, Cut
from npend_gym.physics.kernels.advance import advance_many, advance_one
from npend_gym.physics.kernels.layout import Member, Rod
from npend_gym.physics.members import Members
from npend_gym.physics.memory import Memory


def check_rigid(springs: object) -> None:
    """Raise an error for chains with springs."""
    if springs is not None:
        raise ValueError(
            "chains of an ensemble must have rigid rods, because equal steps do not resolve "
            "the vibrations of springs: leave out stiffness, or use simulate"
        )


class Ensemble(Members):
    """B chains of n rods each, advanced side by side.

    The chains do not act on each other, and results do not depend on the number of threads. By
    default all chains take as many substeps as the fastest one needs. So a chain beside a faster
    one has different rounding errors and smaller integration errors. With `substeps` given, each
    member moves as it does alone, to the last bit.

    Parameters
    ----------
    chains : Chain or sequence of Chain
        One chain for all members, or one for each; all with the same number of rods, and all with a
        cart or none. Energies and positions are relative to the pivot.
    size : int, optional
        Number of members B; by default the number of chains given.
    joints : sequence of int
        Joints that `advance` puts torques on; joint 0 is the pivot.
    threads : int
        Number of threads that share the members. Results do not depend on it.

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
    An exception that interrupts a call, such as Ctrl-C, may leave some members advanced and others
    not. All later calls then raise a RuntimeError: make a new ensemble.

    Examples
    --------
    Three chains of two rods, with a motor at the pivot that turns each of them differently:

    >>> import numpy as np
    >>> from npend_gym import Chain
    >>> from npend_gym.physics import Ensemble
    >>> ensemble = Ensemble(Chain.uniform(2), size=3)
    >>> for _ in range(20):
    ...     ensemble.advance(np.array([[-1.0], [0.0], [2.0]]), dt=0.05)
    >>> ensemble.theta.round(3).tolist()
    [[-0.048, -0.058], [0.0, 0.0], [0.097, 0.114]]
    >>> bool(np.allclose(ensemble.energy, ensemble.work))
    True
    """

    def __init__(
        self,
        chains: Chain | Sequence[Chain],
        size: int | None = None,
        *,
        joints: Sequence[int] = (0,),
        threads: int = 1,
    ) -> None:
        self.size: int
        mechanism, self.size = check_chains(chains, size)
        check_rigid(mechanism.springs)
        self.n: int = mechanism.n
        self.joints: NDArray[Any] = np.array(checked_joints(joints, self.n), np.int64)
        super().__init__(Memory(mechanism.parameters, self.size, threads, base=mechanism.base))
        self._has_cart = mechanism.base is not None
        self._plans: dict[Cut, CallPlan] = {}  # of the last step

    def set_chain(self, members: Any, chain: Chain | ChainParameters) -> None:
        """Set the chain of some members; their time and measurements start again.

        Parameters
        ----------
        members : array_like of int or bool, or slice
            Which members, k of them.
        chain : Chain or ChainParameters
            One for all, or arrays of parameters with a leading axis of k.
        """
        chosen = check_members(members, self.size)
        base = None
        if not isinstance(chain, Chain):
            rows = check_parameters(chain, chosen.size, self.n)
        else:
            given, _ = check_chains(chain, None)
            kind = given.n, given.base is not None
            if given.springs is not None or kind != (self.n, self._has_cart):
                raise ValueError(
                    f"chain must have {self.n} rigid rods, and a cart where the other members have "
                    f"one, got {chain!r}"
                )
            rows, base = chain.repeated(chosen.size), given.base
        memory = self._intact
        memory.check_kind(rows)  # refused before anything changes
        self._ready = False
        self._chains = None
        memory.write_chain(chosen, rows)
        memory.write_base(chosen, base)
        memory.restart(chosen)
        self._ready = True

    def set_state(
        self,
        members: Any,
        theta: ArrayLike,
        omega: ArrayLike = 0.0,
        *,
        cart: tuple[ArrayLike, ArrayLike] = (0.0, 0.0),
    ) -> None:
        """Set the state of some members; their time, work and measurements start again.

        Parameters
        ----------
        members : array_like of int or bool, or slice
            Which members, k of them.
        theta, omega : array_like, shape (k, n) or (n,)
            Angles [rad] and angular velocities [rad/s]; one number stands for all rods.
        cart : (array_like, array_like), shape (k,) each
            Position [m] and velocity [m/s] of the carts.
        """
        chosen = check_members(members, self.size)
        pair = _checks.listed("cart", cart, "(0.0, 0.0)")
        if len(pair) != 2:
            raise ValueError(
                "cart must be two entries, the positions [m] and the velocities [m/s] of the "
                f"carts, got {_checks.show(cart)}"
            )
        carts = [self._of_cart("cart", value, (chosen.size,)) for value in pair]
        states = check_states(self.n, theta=theta, omega=omega)
        if states[0].shape not in ((self.n,), (chosen.size, self.n)):
            raise ValueError(
                f"theta and omega must have the shape ({self.n},) or ({chosen.size}, {self.n}), "
                f"got {states[0].shape}"
            )
        check_limits(*states)
        memory, self._ready = self._intact, False
        for field, values in zip((Rod.THETA, Rod.OMEGA), carts, strict=True):
            memory.of_base(field)[memory.place(chosen)] = values
        memory.write_state(chosen, *states)
        self._ready = True

    def _of_cart(self, name: str, value: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
        """Return numbers that belong to carts; raise an error if there are none."""
        values = _checks.broadcast(name, value, shape)
        if np.any(values) and not self._has_cart:
            raise ValueError(f"{name} must be 0 for chains without a cart: base=Cart(mass)")
        return values

    def advance(
        self,
        torque: ArrayLike,
        dt: float,
        substeps: int | None = None,
        *,
        active: ArrayLike | None = None,
        force: ArrayLike = 0.0,
    ) -> None:
        """Advance the members by `dt` under constant torques, by Runge-Kutta steps of order 4.

        Parameters
        ----------
        torque : array_like, shape (B, joints)
            Torque on each of `joints` [N m]; one number stands for all.
        dt : float
            [s]
        substeps : int, optional
            Number of Runge-Kutta steps of every member. By default as many as the fastest chain
            needs: in each, the phase of its fastest normal mode advances by at most 1/16 rad, and
            damped motion decays by at most that much. If a rod would turn by more than 1/20 rad in
            a substep, its member divides that substep. With `substeps` given, no substep is
            divided.
        active : array_like of bool, shape (B,), optional
            Members to advance; all by default.
        force : array_like, shape (B,)
            Horizontal force on the carts [N]; one number stands for all.

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
        loads = self._check_loads(torque, force)
        plan = self._plan(dt, substeps)
        given = np.ones(self.size, np.bool_) if active is None else active
        mask = np.asarray(_checks.unmasked("active", given))
        if mask.dtype != np.bool_:
            raise TypeError(
                f"active must hold True or False for each member, got {_checks.show(active)}"
            )
        if mask.shape != (self.size,):
            raise ValueError(f"active must have the shape ({self.size},), got {mask.shape}")
        memory, self._ready = self._intact, False
        self._write_loads(*loads)
        memory.members[Member.ACTIVE] = mask
        self._run(plan)
        memory.members[Member.ACTIVE] = 1.0
        self._ready = True

    def _check_loads(self, torque: ArrayLike, force: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return the torques, (B, joints), and the forces on the carts, (B,)."""
        given = _checks.broadcast("torque", torque, (self.size, self.joints.size))
        return given, self._of_cart("force", force, (self.size,))

    def _write_loads(self, torque: FloatArray, force: FloatArray) -> None:
        memory = self._memory
        memory.fill(memory.of_base(Rod.TORQUE), force)
        on_joints = memory.per_rod(Rod.TORQUE)
        for joint, column in zip(self.joints, torque.T, strict=True):
            memory.fill(on_joints[..., joint], column)

    def rollout(
        self, torques: ArrayLike, dt: float, substeps: int | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Advance all members by T steps and return their states before and after each.

        The result has the same bits as T calls of `advance`, without the cost of each call.

        Parameters
        ----------
        torques : array_like, shape (T, B, joints)
            As for `advance` in each step, like `dt` and `substeps`.

        Returns
        -------
        tuple of ndarray, shape (T + 1, B, n)
            Angles [rad] and angular velocities [rad/s].
        """
        given, (members, joints) = _checks.array("torques", torques), (self.size, self.joints)
        if given.ndim != 3 or given.shape[1:] != (members, joints.size):
            shape = f"(T, {members}, {joints.size})"
            raise ValueError(f"torques must have the shape {shape}, got {given.shape}")
        plan, memory = self._plan(dt, substeps), self._intact
        fields = [memory.per_rod(field) for field in (Rod.TORQUE, Rod.THETA, Rod.OMEGA)]
        wanted = np.zeros((len(given), memory.lanes, self.n))
        wanted[:, :members, joints] = given
        states = np.empty((2, len(given) + 1, *fields[0].shape))
        states[:, 0] = fields[1:]
        self._ready = False
        memory.of_base(Rod.TORQUE)[:] = 0.0
        for k, torque in enumerate(wanted.reshape(-1, *fields[0].shape), start=1):
            fields[0][:] = torque
            self._run(plan)
            states[:, k] = fields[1:]
        self._ready = True
        return tuple(states.reshape(2, len(given) + 1, -1, self.n)[:, :, :members])

    def _run(self, plan: CallPlan) -> None:
        memory = self._memory
        memory.run(advance_one if memory.width == 1 else advance_many, (memory.record,), plan)

    def _plan(self, dt: float, substeps: int | None) -> CallPlan:
        """Return how a step of `dt` is taken; kept for the last one."""
        cut = self._steps.cut(dt, substeps)
        if cut not in self._plans:
            self._plans = {cut: self._memory.plan(*cut)}
        return self._plans[cut]

    def close(self) -> None:
        """End the threads; they start again when they are needed."""
        self._memory.close()
