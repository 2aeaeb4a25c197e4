"""Derivatives of the steps of an ensemble: forward for Jacobians, backward for gradients."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.physics.ensemble import Ensemble
from npend_gym.physics.kernels.layout import Rod
from npend_gym.physics.step import Reached, State, tangents, vjp


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
    """The states after a step, and the gradient of a function of them by start and parameters.

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

    It takes the parameters of `Ensemble`. The methods of this class do not change the members. They
    return how the next step of `advance` depends on its state, its inputs and the chains.

    Notes
    -----
    Derivatives are exact for the Runge-Kutta steps taken, not for the motion that they approximate.
    The number of substeps is a constant. Parameters are named as in `Chain`. If the centre of mass
    is at the end of a rod, it stays there when the length changes.
    `npend_gym.physics.kernels.virtual_power` has the equations.

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

    def step_jacobian(
        self,
        torque: ArrayLike,
        dt: float,
        substeps: int | None = None,
        *,
        force: ArrayLike = 0.0,
        parameters: Mapping[str, ArrayLike] | None = None,
    ) -> StepJacobian:
        """Return the states after a step, and their derivatives by state, torque and parameters.

        Parameters
        ----------
        torque, dt, substeps, force
            As for `advance`.
        parameters : mapping of str to array_like, shape (K, n), optional
            K directions in which parameters of all members change together, by their names in
            `Chain`; the shape for gravity is (K,). The notes of `Trajectory.sensitivities` list the
            parameters of each kind of chain.

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
        state, cut = self._begin(torque, force), self._steps.cut(dt, substeps)
        reached, columns = tangents(self._steps, state, cut, parameters, self._memory.crew)
        theta, omega = sound(reached)
        parts = np.split(columns, np.cumsum([2 * theta.shape[1], state.inputs.size]), axis=-1)
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
        """Backpropagate a gradient from the states after a step to the start of the step.

        This vector-Jacobian product costs about two more steps.

        Parameters
        ----------
        torque, dt, substeps, force
            As for `advance`.
        theta_bar, omega_bar : array_like, shape (B, c)
            Derivatives of the function by the states after the step; one number stands for all.
        parameters : sequence of str
            Names of parameters of `Chain` for further derivatives. The notes of
            `Trajectory.sensitivities` list the parameters of each kind of chain.

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
        state, cut = self._begin(torque, force), self._steps.cut(dt, substeps)
        bars = [
            _checks.broadcast(name, bar, state.q.shape)
            for name, bar in (("theta_bar", theta_bar), ("omega_bar", omega_bar))
        ]
        found = vjp(self._steps, state, cut, bars, parameters, self._memory.crew)
        reached, by_state, by_torque, gradients = found
        (theta, omega), (by_theta, by_omega) = sound(reached), by_state
        return StepGradient(theta, omega, by_theta, by_omega, by_torque, gradients)

    def _begin(self, torque: ArrayLike, force: ArrayLike) -> State:
        """Return the states of the members, and the loads on them."""
        memory, every = self._intact, np.arange(self.n + self._has_cart)
        loads, on_carts = self._check_loads(torque, force)
        inputs = self.joints
        if self._has_cart:
            loads = np.concatenate([loads, on_carts[:, None]], axis=1)
            inputs = np.append(inputs, self.n)
        q, u = memory.read_at(Rod.THETA, every), memory.read_at(Rod.OMEGA, every)
        return State(q, u, loads, inputs)


def sound(reached: Reached) -> FloatArray:
    """Return theta and omega after a step, (2, B, c), or say which members leave all bounds."""
    if reached.lost.any():
        members = np.flatnonzero(reached.lost).tolist()
        raise FloatingPointError(
            f"members {_checks.show(members)} leave all bounds in the step, where nothing can "
            "be differentiated: take shorter steps, or more substeps"
        )
    return reached.states
