"""Arrays for packs: the lane innermost, from the beginning of a line of the cache, and views."""

# ruff: noqa: ARG001, ARG005  Numba hands these functions more than they need
from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.compiled.packs import WIDTH

_CACHE_LINE = 64  # bytes

_T = TypeVar("_T")

NumbersOf = Callable[[Any], Any]  # `packs` or `bare`


def aligned_zeros(*shape: int) -> FloatArray:
    """Return zeros that begin where a line of the processor's cache does.

    NumPy's own begin at any multiple of 16 bytes. Where half of the reads and writes of packs go to
    two lines at once, kernels take a tenth longer.
    """
    memory = np.zeros(math.prod(shape) + _CACHE_LINE // 8)
    return np.ndarray(shape, float, memory, -memory.ctypes.data % _CACHE_LINE)


def innermost(lanes: FloatArray) -> FloatArray:
    """Return rows of each lane, (..., lanes, n), as (..., n lanes) with the lane innermost."""
    *leading, count, n = np.shape(lanes)
    if count == 1:
        return np.array(lanes)[..., 0, :]
    flat = aligned_zeros(*leading, n * count)
    flat.reshape(*leading, n, count)[:] = np.swapaxes(lanes, -1, -2)
    return flat


if TYPE_CHECKING:

    def bare(array: _T) -> _T:
        """Return a view of `array` that does not keep it alive; its caller must.

        Views of it cost nothing, where others count references, some ns each.
        """
        return array

    def packs(array: _T) -> _T:
        """Return a bare view of `array` (..., m WIDTH), contiguous, as packs (..., m).

        Of floats or bools. Of a tuple of arrays: a view of each; `bare` does the same.
        """
        return array

else:
    from llvmlite import ir
    from numba import config, types
    from numba.core import cgutils
    from numba.core.typing import signature
    from numba.extending import intrinsic
    from numba.np.arrayobj import populate_array

    from npend_gym.compiled.packs import FLOATS, TRUTHS

    def _view(context, builder, array_type, array, view_type, lanes):
        """Return a bare view of an array, `lanes` of its innermost entries as one."""
        old = context.make_array(array_type)(context, builder, array)
        view = context.make_array(view_type)(context, builder)
        width = ir.Constant(old.itemsize.type, lanes)
        size = builder.mul(old.itemsize, width)
        shape = cgutils.unpack_tuple(builder, old.shape)
        strides = cgutils.unpack_tuple(builder, old.strides)
        if lanes > 1:
            shape[-1], strides[-1] = builder.udiv(shape[-1], width), size
        populate_array(
            view,
            data=builder.bitcast(old.data, view.data.type),
            shape=cgutils.pack_array(builder, shape),
            strides=cgutils.pack_array(builder, strides),
            itemsize=size,
            meminfo=None,
        )
        return view._getvalue()  # noqa: SLF001  as all of Numba's extensions do

    def _viewed(given, type_of, lanes):
        """Return signature and code of a view; of each array where `given` is a tuple or None."""
        if given == types.none:
            return signature(given, given), lambda context, builder, sig, args: args[0]
        if isinstance(given, types.Array):
            view = type_of(given)

            def one(context, builder, sig, args):
                return _view(context, builder, given, args[0], view, lanes)

            return signature(view, given), one
        views = [type_of(array) for array in given]
        named = getattr(given, "instance_class", None)
        result = types.NamedTuple(views, named) if named else types.Tuple(views)

        def each(context, builder, sig, args):
            arrays = cgutils.unpack_tuple(builder, args[0], len(views))
            made = [
                _view(context, builder, old, array, view, lanes)
                for old, array, view in zip(given, arrays, views, strict=True)
            ]
            return context.make_tuple(builder, result, made)

        return signature(result, given), each

    @intrinsic
    def _bare_view(typingctx, array):
        """Return a view of `array` that does not keep it alive; its caller must."""
        return _viewed(array, lambda one: one, 1)

    def _itself(array):
        return array

    bare = _itself if config.DISABLE_JIT else _bare_view

    @intrinsic
    def packs(typingctx, array):
        """Return a bare view of `array` (..., m WIDTH), contiguous, as packs (..., m)."""

        def in_packs(one):
            kind = TRUTHS if one.dtype == types.boolean else FLOATS
            # not aligned: a pack may begin at any float
            return types.Array(kind, one.ndim, "C", aligned=False)

        return _viewed(array, in_packs, WIDTH)
