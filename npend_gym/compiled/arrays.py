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

        Of floats or bools. Of a tuple, also of tuples: a view of each array; `bare` and `lane` do
        the same.
        """
        return array

    def lane(array: _T, k: int) -> _T:
        """Return what lane `k` of an array of packs holds, a bare view; floats are one lane."""
        del k
        return array

else:
    from llvmlite import ir
    from numba import config, types
    from numba.core import cgutils
    from numba.core.typing import signature
    from numba.extending import intrinsic
    from numba.np.arrayobj import populate_array

    from npend_gym.compiled.packs import FLOATS, TRUTHS

    def _in_memory(context, builder, array_type, array, view_type, lanes):
        """Return a bare view of an array, `lanes` of its innermost entries as one."""
        old = context.make_array(array_type)(context, builder, array)
        width = ir.Constant(old.itemsize.type, lanes)
        size = builder.mul(old.itemsize, width)
        shape = cgutils.unpack_tuple(builder, old.shape)
        strides = cgutils.unpack_tuple(builder, old.strides)
        if lanes > 1:
            shape[-1], strides[-1] = builder.udiv(shape[-1], width), size
        return _populated(context, builder, view_type, old.data, (shape, strides, size))

    def _populated(context, builder, view_type, data, layout):
        """Return a bare view of memory with a layout of (shape, strides, size of an entry)."""
        view = context.make_array(view_type)(context, builder)
        shape, strides, size = layout
        populate_array(
            view,
            data=builder.bitcast(data, view.data.type),
            shape=cgutils.pack_array(builder, shape),
            strides=cgutils.pack_array(builder, strides),
            itemsize=size,
            meminfo=None,
        )
        return view._getvalue()  # noqa: SLF001  as all of Numba's extensions do

    def _each(given, of_array):
        """Return the type of a view, and what makes it: of each array in nested tuples.

        `of_array` returns both for an array. All else stays as it is.
        """
        if isinstance(given, types.Array):
            return of_array(given)
        if not isinstance(given, types.BaseTuple):
            return given, lambda context, builder, value, *more: value
        parts = [_each(one, of_array) for one in given]
        named = getattr(given, "instance_class", None)
        result = types.BaseTuple.from_types([kind for kind, _ in parts], named)

        def make(context, builder, value, *more):
            values = cgutils.unpack_tuple(builder, value, len(parts))
            made = [
                part(context, builder, one, *more)
                for (_, part), one in zip(parts, values, strict=True)
            ]
            return context.make_tuple(builder, result, made)

        return result, make

    def _viewed(given, type_of, lanes):
        """Return signature and code of views with a number of lanes in an entry."""

        def of_array(one):
            kind = type_of(one)
            return kind, lambda context, builder, value: _in_memory(
                context, builder, one, value, kind, lanes
            )

        result, make = _each(given, of_array)
        return signature(result, given), lambda context, builder, sig, args: make(
            context, builder, args[0]
        )

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

    def _of_lane(one):
        """Return the type of one lane of an array, and what makes the view of it."""
        if one.dtype != FLOATS:
            return one, lambda context, builder, value, k: _in_memory(
                context, builder, one, value, one, 1
            )
        kind = types.Array(types.float64, one.ndim, "A")

        def make(context, builder, value, k):
            old = context.make_array(one)(context, builder, value)
            first = builder.bitcast(old.data, ir.PointerType(ir.DoubleType()))
            size = ir.Constant(old.itemsize.type, 8)
            shape, strides = (cgutils.unpack_tuple(builder, x) for x in (old.shape, old.strides))
            layout = shape, strides, size
            return _populated(context, builder, kind, builder.gep(first, [k]), layout)

        return kind, make

    @intrinsic
    def _lane_view(typingctx, array, k):
        """Return what lane `k` of an array of packs holds, a bare view; floats are one lane."""
        result, make = _each(array, _of_lane)

        def code(context, builder, sig, args):
            return make(context, builder, *args)

        return signature(result, array, types.intp), code

    def _only_lane(array, k):
        return array

    lane = _only_lane if config.DISABLE_JIT else _lane_view
