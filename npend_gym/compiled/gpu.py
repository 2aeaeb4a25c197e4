"""Kernels on a GPU: the text of the package's compiled functions, compiled by Numba for CUDA.

`translation` makes the text. No product is fused with a sum, so that each thread computes the bits
that the processor does; for GPUs this has to be asked for, see `_unfused`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Generator, Mapping
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from types import FunctionType
from typing import Any, NamedTuple

import numpy as np

from npend_gym._extras import require
from npend_gym.compiled.translation import Translation, text_of

_THREADS = 64  # of a block: small ones, because each thread takes many registers
_PURPOSE = "kernels on a GPU"
_FUSED = re.compile(rb"\bfma\.|\bmad\.(?:rn\.)?f|\b(?:add|sub|mul)\.f")


def simulated() -> bool:
    """Return whether Numba's simulator stands in for a GPU, see NUMBA_ENABLE_CUDASIM."""
    return bool(import_module("numba").config.ENABLE_CUDASIM)


def require_cuda() -> Any:
    """Return Numba's module for CUDA, which the extra "cuda" installs.

    Raises
    ------
    ImportError
        If it is not installed. The simulator, which comes with Numba, needs no extra.
    """
    if not simulated():
        require("numba_cuda", "cuda", _PURPOSE)
    return import_module("numba.cuda")


def require_device() -> Any:
    """Return Numba's module for CUDA where there is a GPU for it, or the simulator.

    Raises
    ------
    ImportError
        If the extra "cuda" is not installed.
    RuntimeError
        If there is no GPU, or its driver does not work.
    """
    cuda = require_cuda()
    if not simulated() and not cuda.is_available():
        why = " ".join(str(cuda.cuda_error() or "no device was found").split())
        raise RuntimeError(
            f"{_PURPOSE} need an NVIDIA GPU with its driver, but: {why} "
            'Use device="cpu"; or, to try small cases without a GPU, set NUMBA_ENABLE_CUDASIM=1 '
            "before Python starts"
        )
    return cuda


class DeviceKernel:
    """A function of the package, compiled for a GPU.

    Parameters
    ----------
    entry : function
        What each thread runs, returning nothing: ``CUDA.grid(1)`` is the number of the thread.
    kinds : collection
        Which of the choices of `chosen_by_type` stand where: types of NamedTuples, or numbers of
        entries.
    dtype : dtype
        Of the numbers: float64 or float32.
    replaced : mapping, optional
        Functions that stand for others, in the text of all: what is known of the chains beforehand
        need not be computed.
    """

    def __init__(
        self,
        entry: Callable[..., None],
        kinds: Collection[type | int],
        dtype: Any = np.float64,
        replaced: Mapping[Any, Any] | None = None,
    ) -> None:
        self._entry, self._kinds, self._dtype = entry, kinds, np.dtype(dtype)
        self._replaced = dict(replaced or {})
        self._compiled: Any = None

    def launch(self, threads: int, *arguments: Any, stream: int = 0) -> None:
        """Run the function in `threads` threads, or some more; return before they are done.

        Parameters
        ----------
        threads : int
        *arguments
            Arrays on the GPU, and numbers.
        stream : int
            The handle of the CUDA stream to run in; by default the usual one.
        """
        if self._compiled is None:
            cuda = require_device()
            self._compiled = cuda.jit(self._translated(cuda), **_options())
        given = require_cuda().external_stream(stream) if stream else 0
        self._compiled[-(-threads // _THREADS), _THREADS, given](*arguments)

    def ptx(self, *arguments: Any, compute_capability: tuple[int, int] = (9, 0)) -> str:
        """Return the assembly text for a GPU; none needs to be there.

        Parameters
        ----------
        *arguments
            Arrays of NumPy, and numbers, of the types that the function is to be compiled for.
        compute_capability : tuple
            Of the GPU; (9, 0) is Hopper.
        """
        cuda, typeof = require_cuda(), import_module("numba").typeof
        if simulated():
            raise RuntimeError("Numba's simulator runs Python: it has no assembly text")
        _unfused()
        with _compiling_for(compute_capability):
            function = self._translated(cuda)
            types = tuple(typeof(argument) for argument in arguments)
            return cuda.compile_ptx(function, types, cc=compute_capability)[0]

    def _translated(self, cuda: Any) -> FunctionType:
        def device_function(function: FunctionType, inline: str) -> Any:
            if simulated():
                return function
            # Only where all is inlined do a thread's arrays stand in registers
            forced = inline != "always"
            return cuda.jit(function, device=True, inline=inline, forceinline=forced, **_options())

        given = self._kinds, self._dtype, self._replaced
        return Translation(cuda, device_function, *given).function(text_of(self._entry))


def _options() -> dict[str, Any]:
    """Return the options of compilation for a GPU."""
    if simulated():
        return {}
    _unfused()
    # at link time it would be fused again
    return {"lto": False, "fastmath": False}


@cache
def _unfused() -> None:
    """Let Numba compile this package's kernels without fused multiply-add, and change no others.

    Numba has no option for it. The compiler that it calls has: with it the text for the GPU has
    ``mul.rn.f64`` and ``add.rn.f64``, which the driver may not fuse either, as it does with
    ``mul.f64`` and ``add.f64``.
    """
    nvvm: Any = import_module("numba.cuda.cudadrv.nvvm")
    compile_ir = nvvm.compile_ir

    def compile_unfused(llvmir: Any, **options: Any) -> bytes:
        texts = [llvmir] if isinstance(llvmir, str) else llvmir
        if not any(_MANGLED in text for text in texts):
            return compile_ir(llvmir, **options)
        ptx = compile_ir(llvmir, **options, fma=False, prec_div=True, prec_sqrt=True, ftz=False)
        if found := _FUSED.search(ptx):
            raise RuntimeError(
                f"numba-cuda {import_module('numba_cuda').__version__} compiled {found[0]!r}, "
                "which rounds otherwise than the processor does: use another version of it"
            )
        return ptx

    nvvm.compile_ir = compile_unfused


_MANGLED = f"{len('npend_gym')}npend_gym"  # in the names that Numba gives to kernels


@contextmanager
def _compiling_for(compute_capability: tuple[int, int]) -> Generator[None]:
    """Let Numba compile for a kind of GPU that need not be there.

    For the functions that a kernel calls, Numba asks the GPU for its kind, although it is given.
    """
    dispatcher: Any = import_module("numba.cuda.dispatcher")
    asked = dispatcher.get_current_device
    dispatcher.get_current_device = lambda: _Target(compute_capability)
    try:
        yield
    finally:
        dispatcher.get_current_device = asked


class _Target(NamedTuple):
    compute_capability: tuple[int, int]
