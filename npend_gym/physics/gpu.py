"""Many chains on a GPU, one a thread, and derivatives: by the functions that the processor runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from npend_gym import _checks
from npend_gym.chain import Chain, ChainParameters
from npend_gym.compiled.gpu import DeviceKernel, require_device, simulated
from npend_gym.physics.arguments import check_chains
from npend_gym.physics.directions import KINDS
from npend_gym.physics.kernels import layout, threads
from npend_gym.physics.kernels.link_terms import count_terms
from npend_gym.physics.step import Chains

# Rods up to which a thread has its chain in its own memory, and is compiled for their number: two
# rods take 142 of the 255 registers that it may have, five all of them, in float32 half as many
SHORT = 8


class DeviceChains:
    """B chains of n rods, advanced on a GPU in the caller's arrays.

    Parameters
    ----------
    chains : Chain or sequence of Chain
        One chain for all, or a list of B; all with the same number of rods.
    size : int, optional
        Number of chains B; by default the number of chains given.
    dtype : {float64, float32}
        Type of all arrays. float64 gives the same bits as `Ensemble`; float32 is for speed.
    drag : bool
        Whether later `parameters` may have drag if `chains` have none.

    Attributes
    ----------
    n, size : int
        Number of rods, and of chains B.
    dtype : dtype
    cuda : module
        Numba's, for CUDA: ``cuda.to_device(array)`` copies an array of NumPy to the GPU.

    Raises
    ------
    ImportError
        If the extra "cuda" is not installed.
    RuntimeError
        If there is no GPU.
    TypeError, ValueError
        If an argument breaks its rule.

    Notes
    -----
    The first step of each number of rods compiles for some seconds.
    """

    def __init__(
        self,
        chains: Chain | Sequence[Chain],
        size: int | None = None,
        *,
        dtype: DTypeLike = np.float64,
        drag: bool = False,
    ) -> None:
        self.cuda: Any = require_device()
        self.size: int
        mechanism, self.size = check_chains(chains, size)
        if mechanism.springs is not None or mechanism.base is not None:
            raise ValueError(
                "chains on a GPU must have rigid rods and a pivot at rest: leave out stiffness and "
                "base, or use the processor"
            )
        self.parameters: ChainParameters = mechanism.parameters
        self.n: int = self.parameters.masses.shape[1]
        self.dtype: np.dtype[Any] = np.dtype(dtype)
        _checks.choice("dtype", self.dtype.name, ("float64", "float32"))
        self._rows = self.cuda.to_device(self.parameters.stacked().astype(self.dtype))
        self._resisted = drag or self.parameters.has_drag
        self._terms = _terms_of(self.parameters, drag=drag)
        self._chains = Chains(self.parameters, self._terms)
        self._kernel = kernel_for(self.parameters, self.dtype, drag=drag)
        self._storage: list[Any] = []
        if self.n > SHORT:
            shapes = threads.storage_shapes(self.n, self._terms, self.size)
            self._storage = [self.zeros(shape) for shape in shapes]

    def advance(
        self,
        theta: Any,
        omega: Any,
        torque: Any,
        diverged: Any,
        dt: float,
        substeps: int | None = None,
        *,
        max_rotation: float | None = None,
        parameters: Any = None,
        stream: int = 0,
    ) -> None:
        """Advance the chains by `dt` under constant torques, in place, as `Ensemble.advance` does.

        The call returns when the GPU has the work, not when it is done.

        Parameters
        ----------
        theta, omega, torque : array on the GPU, shape (B, n)
            Angles [rad] and angular velocities [rad/s], which are overwritten, and the torque on
            each joint [N m]: tensors of torch, arrays of cupy or Numba, or any object with
            ``__cuda_array_interface__``. Nothing is copied. Any strides are allowed.
        diverged : array on the GPU, shape (B,)
            Zero for chains that should move. If a state leaves all bounds, its entry becomes one,
            and the chain keeps its last finite state.
        dt : float
            [s]
        substeps : int, optional
            Number of Runge-Kutta steps; by default as in `Ensemble.advance`. With `parameters`,
            every call computes the default from them, which waits for the GPU and copies them from
            it. Give `substeps` if speed matters.
        max_rotation : float, optional
            Largest turn of a rod in a substep [rad]; substeps with a larger turn are divided. By
            default 1/20 if `substeps` is not given; otherwise no substep is divided.
        parameters : array on the GPU, shape (B, 12, n) or (1, 12, n), optional
            Other parameters of the chains, as ``chain.repeated(B).stacked()`` has them. They are
            not checked. They must not turn point masses into links, or add friction, rotors or drag
            to chains without them.
        stream : int
            Handle of the CUDA stream, such as ``torch.cuda.current_stream().cuda_stream``.

        Raises
        ------
        TypeError, ValueError
            If an array is not on the GPU, or has not the shape and type that it must have.
        """
        flags = self._array("diverged", diverged, (self.size,))
        state = self._states(theta=theta, omega=omega, torque=torque)
        rows = self._parameters(parameters)
        steps = self._steps(dt, substeps, max_rotation, rows, stream)
        self._kernel.launch(self.size, *state, flags, rows, *steps, *self._storage, stream=stream)

    def _steps(
        self, dt: float, substeps: int | None, max_rotation: float | None, rows: Any, stream: int
    ) -> Any:
        """Return dt, the substeps, and one over the angle that none may turn, or zero."""
        limit = (
            None if max_rotation is None else _checks.positive_number("max_rotation", max_rotation)
        )
        own = self._chains if substeps is not None else self._chains_of(rows, stream)
        dt, count, rotation = own.cut(dt, substeps)
        per_rotation = 1.0 / (rotation if limit is None else limit)
        return np.array([dt, count, per_rotation], self.dtype)  # entries are of this type

    def _parameters(self, given: Any) -> Any:
        """Return parameters of the caller's, or those of the chains, for the kernel."""
        if given is None:
            return self._rows
        size = 1 if np.shape(given)[:1] == (1,) else self.size
        return self._array("parameters", given, (size, *self._rows.shape[1:]))

    def _states(self, **arrays: Any) -> list[Any]:
        """Return arrays of the caller's of shape (B, n); raise an error if one does not fit."""
        return [self._array(name, one, (self.size, self.n)) for name, one in arrays.items()]

    @property
    def device(self) -> str:
        """Name of the GPU."""
        return "simulator" if simulated() else self.cuda.get_current_device().name.decode()

    def zeros(self, shape: tuple[int, ...]) -> Any:
        """Return an array of zeros on the GPU; the last axis of its shape counts the chains."""
        *_, columns, lanes = shape
        array = self.cuda.device_array(
            (math.prod(shape) // (columns * lanes), columns, lanes), self.dtype
        )
        if array.size > 0:
            _clearing(self.dtype.name).launch(lanes, array)
        return array.reshape(shape)

    def _chains_of(self, rows: Any, stream: int) -> Chains:
        """Return the chains with the parameters in `rows`."""
        if rows is self._rows:
            return self._chains
        queue = self.cuda.external_stream(stream) if stream else None
        # the simulator's caller may hand over an array of NumPy
        stacked = rows.copy_to_host(stream=queue or 0) if hasattr(rows, "copy_to_host") else rows
        if queue is not None:
            queue.synchronize()
        chains = ChainParameters.unstacked(np.asarray(stacked, np.float64))
        return Chains(chains, self._terms)

    def _array(self, name: str, array: Any, shape: tuple[int, ...]) -> Any:
        """Return an array of the caller's as Numba takes it; raise an error if it does not fit."""
        if not hasattr(array, "dtype" if simulated() else "__cuda_array_interface__"):
            raise TypeError(
                f"{name} must be an array on the GPU, which has __cuda_array_interface__, such as "
                f'torch.as_tensor(values, device="cuda"), got {_checks.show(array)}'
            )
        if not simulated():
            array = self.cuda.as_cuda_array(array)
        if array.dtype != self.dtype:
            raise TypeError(f"{name} must be of dtype {self.dtype}, got {array.dtype}")
        if array.shape != shape:
            raise ValueError(f"{name} must have the shape {shape}, got {array.shape}")
        return array


def kernel_for(
    chains: ChainParameters, dtype: DTypeLike = np.float64, *, drag: bool = False
) -> DeviceKernel:
    """Return the kernel that advances chains of this kind and number of rods, one a thread."""
    resisted = drag or chains.has_drag
    short = min(chains.masses.shape[1], SHORT + 1)
    return _kernel(short, _terms_of(chains, drag=drag), resisted, np.dtype(dtype).name)


def _terms_of(chains: ChainParameters, *, drag: bool) -> int:
    """Return the number of arrays of terms of chains that may get `drag`, see `count_terms`."""
    terms = count_terms(chains)
    return 4 if drag and terms == 3 else terms


@cache
def _kernel(n: int, terms: int, resisted: bool, dtype: str) -> DeviceKernel:
    """Return the kernel for `n` rods, or for any number if they are more than SHORT."""
    entry = threads.short_chains(n) if n <= SHORT else threads.long_chains()
    return DeviceKernel(entry, (terms, KINDS[terms]), dtype, _known(resisted))


def _known(resisted: bool) -> dict[Any, Any]:
    """Stand-ins for functions that look for features of chains."""
    drag = threads.always_drag if resisted else threads.never_drag
    return {layout.resists: drag, layout.rubs: threads.always, layout.turns: threads.always}


@cache
def _clearing(dtype: str) -> DeviceKernel:
    return DeviceKernel(threads.clears(), (), dtype)


class DifferentiableDeviceChains(DeviceChains):
    """`DeviceChains` that know the exact derivatives of their steps.

    It takes the parameters of `DeviceChains`. `DifferentiableEnsemble` does the same on the CPU,
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
        """Backpropagate a gradient from the states after a step to the start of the step.

        The call returns when the GPU has the work, not when it is done.

        Parameters
        ----------
        theta, omega, torque : array on the GPU, shape (B, n)
            The states before the step, which stay as they are, and the torques.
        bars : sequence of 3 or 4 arrays on the GPU
            The first two are the derivatives of the function by theta and omega after the step, (B,
            n) each. The call overwrites them with the derivatives by theta and omega before the
            step. It adds the derivatives by the torques to the third array, (B, n). It adds the
            derivatives by the parameters to the fourth, (B, 12, n), in the order of
            `ChainParameters`. The derivative by gravity is the first entry of its row. If a centre
            of mass should stay at the end of its rod, add its derivative to the derivative by the
            length. Point masses add nothing to the rows after `quadratic_drag`. Links without
            friction, rotors and drag add nothing to the rows of drag, nor to the rows after
            `inertias`.
        diverged : array on the GPU, shape (B,)
            As for `advance`: chains with a nonzero entry are left out. If a state leaves all bounds
            in the step, its entry becomes one, and its derivatives have no meaning.
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
        work = self._workspace(int(steps[1]))
        # kernels leave out drag where there is none, and then its derivatives
        kernel = adjoint_kernel(self._terms, bool(wanted) or self._resisted, self.dtype.name)
        kernel.launch(
            self.size, *state, of_parameters, flags, rows, *steps, *work, stream=stream
        )  # fmt: skip

    def _workspace(self, substeps: int) -> list[Any]:
        """Return the arrays in which the threads work, for steps of `substeps` substeps."""
        if self._work[0] != substeps:
            self._work = (0, [])  # free the old ones first
            shapes = threads.adjoint_shapes(self.n, self._terms, self.size, substeps)
            self._work = substeps, [self.zeros(shape) for shape in shapes]
        return self._work[1]


@cache
def adjoint_kernel(terms: int, resisted: bool, dtype: str) -> DeviceKernel:
    """Return the kernel for chains with this number of arrays of terms, of any number of rods."""
    replaced = _known(resisted)
    # point masses are what stands where no number of terms is named
    kinds = {KINDS[terms], *([terms] if terms else [])}
    return DeviceKernel(threads.adjoints(), kinds, dtype, replaced)
