"""Eight chains as one: a number of eight lanes, for compiled code.

A *pack* holds one quantity of WIDTH chains in the vector registers of the processor. It is added,
multiplied and compared as a float is, so that a kernel written for one chain does for eight when it
is given arrays of packs: `packs` makes such a view of an array of floats whose innermost axis runs
over the lanes. Each lane's arithmetic is that of a float, to the last bit, whatever the processor.

`where` and `any_of` do for packs, and for floats too, what `if` cannot.
"""

from __future__ import annotations

import operator
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from npend_gym._checks import FloatArray

WIDTH = 8  # two registers of AVX, one of AVX-512

_T = TypeVar("_T")

if TYPE_CHECKING:

    def packs(array: FloatArray) -> FloatArray:
        """Return a view of `array` (..., m WIDTH), contiguous, as packs (..., m)."""
        return array

    def where(condition: bool, a: _T, b: _T) -> _T:
        """Return `a` in the lanes where `condition` holds, `b` in the others."""
        return a if condition else b

    def any_of(condition: bool) -> bool:
        """Return whether `condition` holds in any lane."""
        return condition

else:
    from llvmlite import ir
    from numba import types
    from numba.core import cgutils
    from numba.core.datamodel import PrimitiveModel, register_default
    from numba.core.imputils import impl_ret_borrowed
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
            return Conversion.promote if self == _FLOATS and isinstance(other, _NUMBERS) else None

        def unify(self, typingctx, other):
            return self if self.can_convert_from(typingctx, other) else None

    _FLOATS, _MASK = _Pack(types.float64), _Pack(types.boolean)
    _REGISTERS = {
        _FLOATS: ir.VectorType(ir.DoubleType(), WIDTH),
        _MASK: ir.VectorType(ir.IntType(1), WIDTH),
    }

    @register_default(_Pack)
    class _PackModel(PrimitiveModel):
        def __init__(self, dmm, fe_type):
            super().__init__(dmm, fe_type, _REGISTERS[fe_type])

    @lower_cast(types.Float, _FLOATS)
    @lower_cast(types.Integer, _FLOATS)
    def _spread(context, builder, fromty, toty, number):
        """Put the number into every lane."""
        number = context.cast(builder, number, fromty, types.float64)
        nothing = ir.Constant(_REGISTERS[_FLOATS], ir.Undefined)
        first = builder.insert_element(nothing, number, ir.Constant(ir.IntType(32), 0))
        lanes = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH)
        return builder.shuffle_vector(first, nothing, lanes)

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

    for _name, _sign in {"lt": "<", "le": "<=", "gt": ">", "ge": ">=", "eq": "=="}.items():
        _binary(
            getattr(operator, _name),
            lambda builder, a, b, sign=_sign: builder.fcmp_ordered(sign, a, b),
            to=_MASK,
        )
    # as for floats, != alone is true of what is not a number
    _binary(operator.ne, lambda builder, a, b: builder.fcmp_unordered("!=", a, b), to=_MASK)
    _binary(operator.and_, ir.IRBuilder.and_, _MASK)
    _binary(operator.or_, ir.IRBuilder.or_, _MASK)
    _binary(operator.xor, ir.IRBuilder.xor, _MASK)

    @type_callable(operator.neg)
    def _negated(context):
        return lambda a: a if a == _FLOATS else None

    @lower_builtin(operator.neg, _FLOATS)
    def _negate(context, builder, sig, args):
        return builder.fneg(args[0])

    @type_callable(abs)
    def _sizes(context):
        return lambda a: a if a == _FLOATS else None

    @lower_builtin(abs, _FLOATS)
    def _size(context, builder, sig, args):
        bits = ir.VectorType(ir.IntType(64), WIDTH)
        all_but_the_sign = ir.Constant(bits, [2**63 - 1] * WIDTH)
        size = builder.and_(builder.bitcast(args[0], bits), all_but_the_sign)
        return builder.bitcast(size, _REGISTERS[_FLOATS])

    @intrinsic
    def packs(typingctx, array):
        """Return a view of `array` (..., m WIDTH), contiguous, as packs (..., m)."""
        # not aligned: a pack may begin at any float
        view = types.Array(_FLOATS, array.ndim, "C", aligned=False)

        def codegen(context, builder, sig, args):
            floats = context.make_array(array)(context, builder, args[0])
            made = context.make_array(view)(context, builder)
            integer = floats.itemsize.type
            width = ir.Constant(integer, WIDTH)
            shape = cgutils.unpack_tuple(builder, floats.shape)
            shape[-1] = builder.udiv(shape[-1], width)
            strides = cgutils.unpack_tuple(builder, floats.strides)
            strides[-1] = size = builder.mul(floats.itemsize, width)
            populate_array(
                made,
                data=builder.bitcast(floats.data, _REGISTERS[_FLOATS].as_pointer()),
                shape=cgutils.pack_array(builder, shape),
                strides=cgutils.pack_array(builder, strides),
                itemsize=size,
                meminfo=floats.meminfo,
                parent=floats.parent,
            )
            return impl_ret_borrowed(context, builder, view, made._getvalue())

        return signature(view, array), codegen

    @intrinsic
    def _select(typingctx, condition, a, b):
        def codegen(context, builder, sig, args):
            return builder.select(*args)

        return signature(_FLOATS, _MASK, _FLOATS, _FLOATS), codegen

    @intrinsic
    def _any_lane(typingctx, condition):
        def codegen(context, builder, sig, args):
            bits = builder.bitcast(args[0], ir.IntType(WIDTH))
            return builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))

        return signature(types.boolean, _MASK), codegen

    def where(condition, a, b):
        """Return `a` in the lanes where `condition` holds, `b` in the others."""
        return np.where(condition, a, b)

    @overload(where)
    def _where(condition, a, b):
        if condition == _MASK:
            return lambda condition, a, b: _select(condition, a, b)
        return lambda condition, a, b: a if condition else b

    def any_of(condition):
        """Return whether `condition` holds in any lane."""
        return bool(np.any(condition))

    @overload(any_of)
    def _any_of(condition):
        if condition == _MASK:
            return lambda condition: _any_lane(condition)
        return lambda condition: condition
