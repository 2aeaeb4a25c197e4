"""Derivatives of the steps of an ensemble: forward for Jacobians, backward for gradients."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import BoolArray, FloatArray
from npend_gym.chain import ChainParameters
from npend_gym.compiled.arrays import aligned_zeros
from npend_gym.compiled.sincos import MAX_ANGLE
from npend_gym.physics.directions import (
    FEATURES,
    KINDS,
    Kind,
    by_names,
    check_directions,
    check_names,
)
from npend_gym.physics.ensemble import Ensemble
from npend_gym.physics.kernels.layout import MAX_SPEED
from npend_gym.physics.kernels.rk4 import TAPE_ROWS
from npend_gym.physics.kernels.rk4_derivatives import (
    adjoint_many,
    adjoint_rows,
    tangent_rows,
    tangents_many,
)
from npend_gym.physics.memory import Plan

_TAPE = 2**22  # bytes of the tapes that are kept for the way back: more would leave the cache


class StepJacobian(NamedTuple):
    """The states after a step, and their derivatives; c coordinates are the n angles and the cart.

    d (theta, omega) after = A d (theta, omega) before + B d torque + C d parameters.
    """

    theta: FloatArray  # (B, c): rad, m
    omega: FloatArray  # (B, c)
    A: FloatArray  # (B, 2c, 2c)
    B: FloatArray  # (B, 2c, number of joints), with a cart a column more for the force on it
    C: FloatArray  # (B, 2c, K): along each direction of the parameters


class StepGradient(NamedTuple):
    """The states after a step, and the gradient of a function of them by what the step began with.

    c coordinates are the n angles and the cart.
    """

    theta: FloatArray  # (B, c): rad, m
    omega: FloatArray  # (B, c)
    by_theta: FloatArray  # (B, c)
    by_omega: FloatArray  # (B, c)
    by_torque: FloatArray  # (B, number of joints), with a cart a column more for the force on it
    by_parameters: dict[str, FloatArray]  # (B, n) each; (B,) for gravity


class DifferentiableEnsemble(Ensemble):
    """An `Ensemble` that knows the exact derivatives of its steps, in O(n) operations each.

    Parameters are those of `Ensemble`. The methods of this class leave the members as they are:
    they tell how the next step of `advance` depends on what it begins with.

    Notes
    -----
    Derivatives are those of the Runge-Kutta steps that are taken, not of the motion that they
    approximate. How far a step is cut into substeps counts as given. Parameters of one rod are
    those of `Chain`; where the centre of mass is at the end of a rod, it stays there when the
    length changes. `npend_gym.physics.kernels.virtual_power` has the equations.

    Examples
    --------
    How the angles and velocities after a step of 0.05 s change with the torque:

    >>> from npend_gym import Chain
    >>> from npend_gym.physics import DifferentiableEnsemble
    >>> chain = DifferentiableEnsemble(Chain.uniform(2), size=1)
    >>> step = chain.step_jacobian(torque=[[0.0]], dt=0.05)
    >>> step.B[0, :, 0].round(4).tolist()  # rad/(N m) twice, then rad/s/(N m)
    [0.0012, -0.0012, 0.0494, -0.0492]
    """

    _always_packed = True
    _work: Sequence[FloatArray] = ()  # of each thread

    def step_jacobian(
        self,
        torque: ArrayLike,
        dt: float,
        substeps: int | None = None,
        *,
        force: ArrayLike = 0.0,
        parameters: Mapping[str, ArrayLike] | None = None,
    ) -> StepJacobian:
        """Return where a step leads, and the derivatives of that by state, torque and parameters.

        Parameters
        ----------
        torque, dt, substeps, force
            As for `advance`.
        parameters : mapping of str to array_like, shape (K, n), optional
            K directions in which parameters of all members change together, by their names in
            `Chain`; the shape for gravity is (K,). See the notes of `Trajectory.sensitivities` for
            those of each kind of chain.

        Returns
        -------
        StepJacobian

        Raises
        ------
        ValueError, TypeError
            If an argument breaks its rule.
        FloatingPointError
            If a member leaves all bounds in the step: there are no derivatives then.
        """
        loads, plan = self._check_loads(torque, force), self._check_step(dt, substeps)
        inputs, reached = self._inputs(parameters), self._intact.new_rows(2)
        self._write_loads(*loads)
        self._differentiate(
            tangents_many, (*inputs, reached), plan, tangent_rows(), parameters or ()
        )
        theta, omega = self._states(reached)
        columns, states = self._columns(inputs[0]), 2 * theta.shape[1]
        last = states + self.joints.size + self._has_cart
        parts = columns[..., :states], columns[..., states:last], columns[..., last:]
        return StepJacobian(theta, omega, *parts)

    def step_vjp(
        self,
        torque: ArrayLike,
        dt: float,
        substeps: int | None = None,
        *,
        theta_bar: ArrayLike,
        omega_bar: ArrayLike,
        force: ArrayLike = 0.0,
        parameters: Sequence[str] = (),
    ) -> StepGradient:
        """Take the gradient of a function of the states after a step back to the step's beginning.

        It is the product of a vector and the Jacobian, for the price of about two steps more.

        Parameters
        ----------
        torque, dt, substeps, force
            As for `advance`.
        theta_bar, omega_bar : array_like, shape (B, c)
            Derivatives of the function by the states after the step; one number stands for all.
        parameters : sequence of str
            Names of the parameters of `Chain` by which derivatives are wanted as well; see the
            notes of `Trajectory.sensitivities` for those of each kind of chain.

        Returns
        -------
        StepGradient

        Raises
        ------
        ValueError, TypeError
            If an argument breaks its rule.
        FloatingPointError
            If a member leaves all bounds in the step: there are no derivatives then.
        """
        loads, plan = self._check_loads(torque, force), self._check_step(dt, substeps)
        names, memory, c = check_names(parameters, self._kind), self._intact, self._coordinates
        bars, reached = memory.new_rows(3), memory.new_rows(2)
        chain_bars = memory.new_rows(len(ChainParameters._fields) if names else 0)
        view = memory.lanes_of(bars)
        for row, (name, bar) in enumerate((("theta_bar", theta_bar), ("omega_bar", omega_bar))):
            memory.fill(view[:, :, row, :c], _checks.broadcast(name, bar, (self.size, c)))
        self._write_loads(*loads)
        slots = max(1, min(plan.substeps, _TAPE // (8 * TAPE_ROWS * (self.n + 2) * memory.width)))
        rows = adjoint_rows(plan.substeps, slots)
        kept = np.zeros((len(bars), plan.substeps))
        arrays = bars, chain_bars, reached, slots, kept
        self._differentiate(adjoint_many, arrays, plan, rows, names)
        by_theta, by_omega, by_torque = (memory.gather(view[:, :, row]) for row in range(3))
        gradients: dict[str, FloatArray] = {}
        if names:
            rows_of = memory.gather(memory.lanes_of(chain_bars))[..., : self.n]
            gradients = by_names(rows_of, names, self._centres_at_ends)
        return StepGradient(
            *self._states(reached),
            by_theta[:, :c],
            by_omega[:, :c],
            by_torque[:, self._inputs_at],
            gradients,
        )

    @property
    def _coordinates(self) -> int:
        return self.n + self._has_cart

    @property
    def _inputs_at(self) -> list[int]:
        """The entries of torques that are inputs: those of joints, and the force on a cart."""
        return [*self.joints.tolist(), self.n] if self._has_cart else self.joints.tolist()

    @property
    def _kind(self) -> Kind:
        return KINDS[len(self._memory.arrays[2] or ())]

    def _inputs(self, parameters: Mapping[str, ArrayLike] | None) -> tuple[FloatArray, ...]:
        """Return unit changes of all states, then of all torques, and of the parameters as given.

        They are in the form of `tangents_many`: changes, pushed, changed.
        """
        c = self._coordinates
        changed = np.zeros((0, 0, self.n))
        if parameters:  # to read where all centres are takes longer than the rest of this
            changed = check_directions(parameters, self.n, self._kind, self._centres_at_ends)
        count, inputs = len(changed), len(self._inputs_at)
        total = 2 * c + inputs + count
        changes, pushed = self._intact.new_rows(total, 2), np.zeros((total, self.n + 1))
        view = self._memory.lanes_of(changes)
        for k in range(c):
            view[:, :, k, 0, k] = view[:, :, c + k, 1, k] = 1.0
        pushed[range(2 * c, 2 * c + inputs), self._inputs_at] = 1.0
        return changes, pushed, changed if count else np.zeros((1, 0, self.n))

    @property
    def _centres_at_ends(self) -> BoolArray:
        """Whether the centre of mass of each link is at its end, and stays there, (B, n)."""
        parameters = self.parameters
        return parameters.centres == parameters.lengths

    def _differentiate(
        self, kernel: Any, arrays: tuple[Any, ...], plan: Plan, rows: int, names: Collection[str]
    ) -> None:
        """Call a kernel that takes all substeps at once, with work space of `rows` rows."""
        memory, work = self._intact, self._work
        if not work or len(work[0]) != rows:  # zeros at the ends of rows must stay
            size = (self.n + 2) * memory.width
            work = [aligned_zeros(rows, size) for _ in range(memory.threads)]
        self._work = ()  # after an interrupt threads may still write to it, and read the timing
        timing = [each.copy() for each in plan.timing]
        features = [
            (own, own == 0.0)
            for feature in FEATURES
            if not {*feature}.isdisjoint(names) and (own := memory.feature(feature[0])) is not None
        ]
        try:
            for own, none in features:
                own[none] = _checks.SMALLEST  # kernels leave out what there is none of
            whole = plan._replace(piece=max(1, plan.substeps), timing=timing)
            memory.run(kernel, arrays, whole, work)
        finally:
            for own, none in features:
                own[none] = 0.0
        self._work = work

    def _states(self, reached: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return theta and omega, (B, c) each, from the rows that a kernel has left."""
        memory, c = self._memory, self._coordinates
        after = memory.gather(memory.lanes_of(reached))[..., :c]
        lost = ~(np.abs(after) <= [[MAX_ANGLE], [MAX_SPEED]])
        lost[..., self.n :] = ~np.isfinite(after[..., self.n :])  # a cart may be anywhere
        if np.any(lost):
            members = np.flatnonzero(lost.any(axis=(1, 2))).tolist()
            raise FloatingPointError(
                f"members {_checks.show(members)} leave all bounds in the step, where nothing can "
                "be differentiated: take shorter steps, or more substeps"
            )
        return after[:, 0], after[:, 1]

    def _columns(self, changes: FloatArray) -> FloatArray:
        """Return the changes of theta and omega as columns, (B, 2c, D)."""
        rows = self._memory.gather(self._memory.lanes_of(changes))[..., : self._coordinates]
        return np.ascontiguousarray(rows.reshape(*rows.shape[:2], -1).swapaxes(1, 2))
