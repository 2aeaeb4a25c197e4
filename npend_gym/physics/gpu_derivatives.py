"""Derivatives of the steps of many chains on a GPU."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

from npend_gym.chain import ChainParameters
from npend_gym.compiled.gpu import DeviceKernel
from npend_gym.physics.directions import KINDS
from npend_gym.physics.gpu import DeviceChains
from npend_gym.physics.kernels import layout, threads
from npend_gym.physics.kernels.driven import Kept
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
        bars: Sequence[Any],
        diverged: Any,
        dt: float,
        substeps: int | None = None,
        *,
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
        bars : sequence of 3 or 4 arrays on the GPU
            Derivatives of the function by theta and omega after the step, (B, n) each, which are
            overwritten by those by theta and omega before; an array (B, n) to which those by the
            torques are added; and perhaps one, (B, 12, n), to which those by the parameters are
            added, in the order of `ChainParameters`. Those by gravity are in the first entry of its
            row. Where the centre of mass is to stay at the end of a rod, the derivative by the
            length is the sum of the two.
        diverged : array on the GPU, shape (B,)
            As for `advance`: nothing is done where it is not zero. Where the state leaves all
            bounds in the step, it becomes one, and the derivatives mean nothing.
        dt, substeps, max_rotation, parameters, stream
            As for `advance`.

        Raises
        ------
        TypeError, ValueError
            If an array is not on the GPU, or has not the shape and type that it must have.
        """
        if len(bars) not in (3, 4):
            raise ValueError(
                "bars must be 3 arrays, of theta, omega and torque, or 4 with that of the "
                f"parameters, got {len(bars)}"
            )
        names = ("theta_bar", "omega_bar", "torque_bar")
        by_state = dict(zip(names, bars[:3], strict=True))
        state = self._states(theta=theta, omega=omega, torque=torque, **by_state)
        flags = self._array("diverged", diverged, (self.size,))
        wanted = len(ChainParameters._fields) if len(bars) == 4 else 0
        of_parameters = self.cuda.device_array((self.size, 0, self.n), self.dtype)
        if wanted:
            shape = (self.size, wanted, self.n)
            of_parameters = self._array("parameters_bar", bars[3], shape)
        rows = self._parameters(parameters)
        steps = self._steps(dt, substeps, max_rotation, rows, stream)
        terms, work = count_terms(self.parameters), self._workspace(int(steps[1]))
        # kernels leave out drag where there is none, and then its derivatives
        kernel = adjoint_kernel(terms, bool(wanted) or self._resisted, self.dtype.name)
        kernel.launch(
            self.size, *state, of_parameters, flags, rows, *steps, *work, stream=stream
        )  # fmt: skip

    def _workspace(self, substeps: int) -> list[Any]:
        """Return the arrays in which the threads work, for steps of `substeps` substeps."""
        if self._work[0] != substeps:
            self._work = (0, [])  # free the old ones first
            terms = count_terms(self.parameters)
            shapes = threads.adjoint_shapes(self.n, terms, self.size, substeps)
            self._work = substeps, [self.zeros(shape) for shape in shapes]
        return self._work[1]


@cache
def adjoint_kernel(terms: int, resisted: bool, dtype: str) -> DeviceKernel:
    """Return the kernel for chains with this number of arrays of terms, of any number of rods."""
    replaced = {layout.resists: threads.always if resisted else threads.never}
    # point masses are what stands where no number of terms is named
    kinds = {KINDS[terms], Kept, *([terms] if terms else [])}
    return DeviceKernel(threads.adjoints(), kinds, dtype, replaced)
