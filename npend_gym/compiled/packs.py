"""Sixteen chains as one: a number of many lanes, for compiled code.

A *pack* holds one quantity of WIDTH chains in the vector registers of the processor. It is added,
multiplied and compared as a float is, so that a kernel written for one chain does for many when it
is given arrays of packs: `packs` makes such a view of an array of floats whose innermost axis runs
over the lanes. Each lane's arithmetic is that of a float, to the last bit, whatever the processor.

`where`, `larger` and `any_of` do for packs, and for floats too, what `if` cannot.
"""

# ruff: noqa: ARG001, ARG002, ARG005  Numba hands these functions more than they need
from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

WIDTH = 16  # more than fit the registers, so that the processor need not wait for results

_T = TypeVar("_T")

NumbersOf = Callable[[Any], Any]  # `packs` or `bare`

if TYPE_CHECKING:

    def bare(array: _T) -> _T:
        """Return a view of `array` that does not keep it alive; its caller must.

        Views of it cost nothing, where others count references, some ns each.
        """
        return array

    def packs(array: _T) -> _T:
        """Return a bare view of `array` (..., m WIDTH), contiguous, as packs (..., m).

        Of a tuple of arrays: a view of each; `bare` does the same.
        """
        return array

    def where(condition: bool, a: _T, b: _T) -> _T:
        """Return `a` in the lanes where `condition` holds, `b` in the others."""
        return a if condition else b

    def any_of(condition: Any) -> bool:
        """Return whether `condition` holds in any lane."""
        return condition

else:
    from llvmlite import ir
    from numba import config, types
    from numba.core import cgutils
    from numba.core.datamodel import PrimitiveModel, register_default
    from numba.core.typeconv import Conversion
    from numba.core.typing import signature
    from numba.extending import intrinsic, lower_builtin, lower_cast, overload, type_callable
    from numba.np.arrayobj import populate_array

    _NUMBERS = (types.Float, types.Integer)

    class _Pack(types.Type):
        """The type of packs of `element`: float64, or boolean for the outcome of comparisons."""

        def __init__(self, element):
            self.element = element
            super().__init__(f"Pack({element})")

        def can_convert_from(self, typingctx, other):
            fits = isinstance(other, _NUMBERS if self == _FLOATS else types.Boolean)
            return Conversion.promote if fits else None

        def unify(self, typingctx, other):
            return self if self.can_convert_from(typingctx, other) else None

    _FLOATS, _MASK = _Pack(types.float64), _Pack(types.boolean)
    _REGISTERS = {
        _FLOATS: ir.VectorType(ir.DoubleType(), WIDTH),
        # 0 or -1: masks as wide as the numbers go into the processor's selection as they are
        _MASK: ir.VectorType(ir.IntType(64), WIDTH),
    }

    @register_default(_Pack)
    class _PackModel(PrimitiveModel):
        def __init__(self, dmm, fe_type):
            super().__init__(dmm, fe_type, _REGISTERS[fe_type])

    def _spread(builder, number, to):
        """Put the number into every lane."""
        nothing = ir.Constant(_REGISTERS[to], ir.Undefined)
        first = builder.insert_element(nothing, number, ir.Constant(ir.IntType(32), 0))
        lanes = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH)
        return builder.shuffle_vector(first, nothing, lanes)

    @lower_cast(types.Float, _FLOATS)
    @lower_cast(types.Integer, _FLOATS)
    def _from_number(context, builder, fromty, toty, number):
        return _spread(builder, context.cast(builder, number, fromty, types.float64), _FLOATS)

    @lower_cast(types.Boolean, _MASK)
    def _from_bool(context, builder, fromty, toty, truth):
        return _spread(builder, builder.sext(truth, ir.IntType(64)), _MASK)

    def _compare(builder, sign, a, b):
        comparison = builder.fcmp_unordered if sign == "!=" else builder.fcmp_ordered
        return builder.sext(comparison(sign, a, b), _REGISTERS[_MASK])

    def _holds(builder, mask):
        return builder.icmp_signed("<", mask, ir.Constant(mask.type, [0] * WIDTH))

    def _binary(operation, instruction, of=_FLOATS, to=None):
        """Let `operation` on packs be an instruction; a number beside a pack is in every lane."""

        @type_callable(operation)
        def _typed(context):
            def typed(a, b):
                fits = [x == of or (of == _FLOATS and isinstance(x, _NUMBERS)) for x in (a, b)]
                return signature(to or of, of, of) if all(fits) and of in (a, b) else None

            return typed

        @lower_builtin(operation, of, of)
        def _lowered(context, builder, sig, args):
            return instruction(builder, *args)

    for _name, _instruction in {
        "add": ir.IRBuilder.fadd,
        "sub": ir.IRBuilder.fsub,
        "mul": ir.IRBuilder.fmul,
        "truediv": ir.IRBuilder.fdiv,
    }.items():
        _binary(getattr(operator, _name), _instruction)
        _binary(getattr(operator, f"i{_name}"), _instruction)

    # as for floats, != alone is true of what is not a number
    for _name, _sign in zip(
        ("lt", "le", "gt", "ge", "eq", "ne"), ("<", "<=", ">", ">=", "==", "!="), strict=True
    ):
        _binary(
            getattr(operator, _name),
            lambda builder, a, b, sign=_sign: _compare(builder, sign, a, b),
            to=_MASK,
        )
    _binary(operator.and_, ir.IRBuilder.and_, _MASK)
    _binary(operator.or_, ir.IRBuilder.or_, _MASK)
    _binary(operator.xor, ir.IRBuilder.xor, _MASK)

    def _unary(operation, instruction):
        """Let `operation` on a pack of floats be done by `instruction`."""

        @type_callable(operation)
        def _typed(context):
            return lambda a: a if a == _FLOATS else None

        @lower_builtin(operation, _FLOATS)
        def _lowered(context, builder, sig, args):
            return instruction(builder, *args)

    def _root(builder, a):
        name, function_type = f"llvm.sqrt.v{WIDTH}f64", ir.FunctionType(a.type, [a.type])
        return builder.call(
            cgutils.get_or_insert_function(builder.module, function_type, name), [a]
        )

    def _size(builder, a):
        bits = ir.VectorType(ir.IntType(64), WIDTH)
        all_but_the_sign = ir.Constant(bits, [2**63 - 1] * WIDTH)
        return builder.bitcast(builder.and_(builder.bitcast(a, bits), all_but_the_sign), a.type)

    _unary(operator.neg, ir.IRBuilder.fneg)
    _unary(math.sqrt, _root)
    _unary(abs, _size)

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
        # not aligned: a pack may begin at any float
        return _viewed(array, lambda one: types.Array(_FLOATS, one.ndim, "C", aligned=False), WIDTH)

    @intrinsic
    def _select(typingctx, condition, a, b):
        def codegen(context, builder, sig, args):
            return builder.select(_holds(builder, args[0]), args[1], args[2])

        return signature(_FLOATS, _MASK, _FLOATS, _FLOATS), codegen

    @intrinsic
    def _any_lane(typingctx, condition):
        def codegen(context, builder, sig, args):
            bits = builder.bitcast(_holds(builder, args[0]), ir.IntType(WIDTH))
            return builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))

        return signature(types.boolean, _MASK), codegen

    def where(condition, a, b):
        """Return `a` in the lanes where `condition` holds, `b` in the others."""
        return np.where(condition, a, b)

    @overload(where)
    def _where(condition, a, b):
        if condition == _MASK:
            return lambda condition, a, b: _select(condition, a, b)  # noqa: PLW0108
        return lambda condition, a, b: a if condition else b

    def any_of(condition):
        """Return whether `condition` holds in any lane."""
        return bool(np.any(condition))

    @overload(any_of)
    def _any_of(condition):
        if condition == _MASK:
            return lambda condition: _any_lane(condition)  # noqa: PLW0108
        return lambda condition: condition
