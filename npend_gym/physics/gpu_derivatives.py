"""Derivatives of the steps of many chains on a GPU."""

from __future__ import annotations

from functools import cache
from typing import Any

from npend_gym.chain import ChainParameters
from npend_gym.compiled.gpu import DeviceKernel
from npend_gym.physics.directions import KINDS
from npend_gym.physics.gpu import DeviceChains
from npend_gym.physics.kernels import layout, threads
from npend_gym.physics.kernels.link_terms import count_terms


class DifferentiableDeviceChains(DeviceChains):
    """`DeviceChains` that know the exact derivatives of their steps.

    Parameters are those of `DeviceChains`; `DifferentiableEnsemble` is the same on the processor,
    and its notes hold here.
    """

    _work: tuple[int, list[Any]] = (0, [])  # of so many substeps

    def step_vjp(
        self,
        theta: Any,
        omega: Any,
        torque: Any,
        theta_bar: Any,
        omega_bar: Any,
        torque_bar: Any,
        diverged: Any,
        dt: float,
        substeps: int | None = None,
        *,
        parameters_bar: Any = None,
        max_rotation: float | None = None,
        parameters: Any = None,
        stream: int = 0,
    ) -> None:
        """Take the gradient of a function of the states after a step back to the step's beginning.

        The call returns when the GPU has the work, not when it is done.

        Parameters
        ----------
        theta, omega, torque : array on the GPU, shape (B, n)
            The states before the step, which stay as they are, and the torques.
        theta_bar, omega_bar : array on the GPU, shape (B, n)
            Derivatives of the function by the states after the step, which are overwritten by those
            by the states before.
        torque_bar : array on the GPU, shape (B, n)
            The derivatives by the torques are added to it.
        diverged : array on the GPU, shape (B,)
            As for `advance`: nothing is done where it is not zero. Where the state leaves all
            bounds in the step, it becomes one, and the derivatives mean nothing.
        dt, substeps, max_rotation, parameters, stream
            As for `advance`.
        parameters_bar : array on the GPU, shape (B, 12, n), optional
            The derivatives by the parameters are added to it, in the order of `ChainParameters`;
            those by gravity are in the first entry of its row. Where the centre of mass is to stay
            at the end of a rod, the derivative by the length is the sum of the two.

        Raises
        ------
        TypeError, ValueError
            If an array is not on the GPU, or has not the shape and type that it must have.
        """
        state = self._states(
            theta=theta, omega=omega, torque=torque, theta_bar=theta_bar, omega_bar=omega_bar,
            torque_bar=torque_bar,
        )  # fmt: skip
        flags = self._array("diverged", diverged, (self.size,))
        wanted = 0 if parameters_bar is None else len(ChainParameters._fields)
        of_parameters = self.cuda.device_array((self.size, 0, self.n), self.dtype)
        if wanted:
            shape = (self.size, wanted, self.n)
            of_parameters = self._array("parameters_bar", parameters_bar, shape)
        rows = self._parameters(parameters)
        steps = self._steps(dt, substeps, max_rotation, rows, stream)
        terms, work = count_terms(self.parameters), self._workspace(int(steps[1]))
        # kernels leave out drag where there is none, and then its derivatives
        kernel = adjoint_kernel(terms, bool(wanted) or self._resisted, self.dtype.name)
        kernel.launch(
            self.size, *state, of_parameters, flags, rows, *steps, *work, stream=stream
        )  # fmt: skip

    def _workspace(self, substeps: int) -> list[Any]:
        """Return the arrays in which the threads work, for steps of so many substeps."""
        if self._work[0] != substeps:
            self._work = (0, [])  # free the old ones first
            terms = count_terms(self.parameters)
            shapes = threads.adjoint_shapes(self.n, terms, self.size, substeps)
            self._work = substeps, [self.zeros(shape) for shape in shapes]
        return self._work[1]


@cache
def adjoint_kernel(terms: int, resisted: bool, dtype: str) -> DeviceKernel:
    """Return the kernel for chains with so many arrays of terms, of any number of rods."""
    replaced = {layout.resists: threads.always if resisted else threads.never}
    return DeviceKernel(threads.adjoints(), (terms, KINDS[terms]), dtype, replaced)
