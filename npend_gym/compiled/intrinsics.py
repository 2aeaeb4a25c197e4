"""What Numba makes of the views of `arrays`, of the words of `philox`, and of foreign functions."""

# Numba's stubs leave parts unknown, and it hands these functions more than they need
# pyright: basic, reportPrivateImportUsage=false, reportGeneralTypeIssues=false
# pyright: reportOptionalMemberAccess=false
# ruff: noqa: ARG001, ARG005
from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing import signature
from numba.core.typing.templates import infer, infer_global, make_intrinsic_template
from numba.extending import lower_builtin, type_callable
from numba.np.arrayobj import populate_array

from npend_gym.compiled.arrays import bare, lane, packs
from npend_gym.compiled.callbacks import call_address
from npend_gym.compiled.pack_types import FLOATS, TRUTHS
from npend_gym.compiled.packs import WIDTH
from npend_gym.compiled.philox import product, word


def _implements(function):
    """Let a definition, as of Numba's ``intrinsic``, stand for a function in kernels."""

    def register(definition):
        template = make_intrinsic_template(function, definition, function.__name__)
        infer(template)
        infer_global(function, types.Function(template))
        return definition

    return register


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
            part(context, builder, one, *more) for (_, part), one in zip(parts, values, strict=True)
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


@_implements(bare)
def _bare_view(typingctx, array):
    """Return a view of `array` that does not keep it alive; its caller must."""
    return _viewed(array, lambda one: one, 1)


@_implements(packs)
def _view_in_packs(typingctx, array):
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


@_implements(lane)
def _lane_view(typingctx, array, k):
    """Lane `k` of an array of packs, as a bare view; floats are one lane."""
    result, make = _each(array, _of_lane)

    def code(context, builder, sig, args):
        return make(context, builder, *args)

    return signature(result, array, types.intp), code


@type_callable(word)
def _type_of_word(context):
    return lambda number: signature(types.uint64, types.unliteral(number))


@lower_builtin(word, types.Number)
def _as_word(context, builder, sig, args):
    return context.cast(builder, args[0], sig.args[0], types.uint64)


@type_callable(product)
def _type_of_product(context):
    words = types.UniTuple(types.uint64, 2)
    return lambda a, b: signature(words, types.uint64, types.uint64)


@lower_builtin(product, types.uint64, types.uint64)
def _wide_product(context, builder, sig, args):
    wide, half = ir.IntType(128), ir.IntType(64)
    whole = builder.mul(*(builder.zext(factor, wide) for factor in args))
    high = builder.trunc(builder.lshr(whole, ir.Constant(wide, 64)), half)
    return context.make_tuple(builder, sig.return_type, (high, builder.trunc(whole, half)))


@_implements(call_address)
def _call_address(typingctx, address, t, q, u, out, m, n):
    def codegen(context, builder, sig, args):
        number, pointer = ir.DoubleType(), ir.DoubleType().as_pointer()
        count = ir.IntType(64)
        kind = ir.FunctionType(ir.VoidType(), [number, pointer, pointer, pointer, count, count])
        function = builder.inttoptr(args[0], kind.as_pointer())
        data = [
            context.make_array(array)(context, builder, value).data
            for array, value in zip(sig.args[2:5], args[2:5], strict=True)
        ]
        builder.call(function, [args[1], *data, *args[5:]])
        return context.get_dummy_value()

    counts = types.int64, types.int64
    return signature(types.none, types.int64, types.float64, q, u, out, *counts), codegen
