"""What Numba makes of packs: their types, their operations, and `where` and `any_of`."""

# Numba's stubs leave parts unknown, and it hands these functions more than they need
# pyright: basic, reportPrivateImportUsage=false, reportGeneralTypeIssues=false
# pyright: reportOptionalMemberAccess=false
# ruff: noqa: ARG001, ARG002
from __future__ import annotations

import math
import operator

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel import PrimitiveModel, register_default
from numba.core.typeconv import Conversion
from numba.core.typing import signature
from numba.extending import lower_builtin, lower_cast, type_callable

from npend_gym.compiled.packs import WIDTH, any_of, where

_NUMBERS = (types.Float, types.Integer)


class _Pack(types.Type):
    """The type of packs of `element`: float64, or boolean for the outcome of comparisons."""

    def __init__(self, element):
        self.element = element
        super().__init__(f"Pack({element})")

    def can_convert_from(self, typingctx, other):
        fits = isinstance(other, _NUMBERS if self == FLOATS else types.Boolean)
        return Conversion.promote if fits else None

    def unify(self, typingctx, other):
        return self if self.can_convert_from(typingctx, other) else None


FLOATS, TRUTHS = _Pack(types.float64), _Pack(types.boolean)
_REGISTERS = {
    FLOATS: ir.VectorType(ir.DoubleType(), WIDTH),
    # 0 or -1: truths as wide as the numbers go into the processor's selection as they are
    TRUTHS: ir.VectorType(ir.IntType(64), WIDTH),
}

_BITS = ir.VectorType(ir.IntType(1), WIDTH)


@register_default(_Pack)
class _PackModel(PrimitiveModel):
    def __init__(self, dmm, fe_type):
        super().__init__(dmm, fe_type, _REGISTERS[fe_type])

    def get_data_type(self):
        """Elements as memory has them: a byte for each truth."""
        if self._fe_type == TRUTHS:
            return ir.VectorType(ir.IntType(8), WIDTH)
        return self.get_value_type()

    def as_data(self, builder, value):
        if self._fe_type == TRUTHS:
            return builder.zext(_holds(builder, value), self.get_data_type())
        return value

    def from_data(self, builder, value):
        if self._fe_type == TRUTHS:
            return builder.sext(builder.trunc(value, _BITS), self.get_value_type())
        return value


def _spread(builder, number, to):
    """Put the number into every lane."""
    nothing = ir.Constant(_REGISTERS[to], ir.Undefined)
    first = builder.insert_element(nothing, number, ir.Constant(ir.IntType(32), 0))
    lanes = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH)
    return builder.shuffle_vector(first, nothing, lanes)


@lower_cast(types.Float, FLOATS)
@lower_cast(types.Integer, FLOATS)
def _from_number(context, builder, fromty, toty, number):
    return _spread(builder, context.cast(builder, number, fromty, types.float64), FLOATS)


@lower_cast(types.Boolean, TRUTHS)
def _from_bool(context, builder, fromty, toty, truth):
    return _spread(builder, builder.sext(truth, ir.IntType(64)), TRUTHS)


def _compare(builder, sign, a, b):
    comparison = builder.fcmp_unordered if sign == "!=" else builder.fcmp_ordered
    return builder.sext(comparison(sign, a, b), _REGISTERS[TRUTHS])


def _holds(builder, mask):
    return builder.icmp_signed("<", mask, ir.Constant(mask.type, [0] * WIDTH))


def _binary(operation, instruction, of=FLOATS, to=None):
    """Let `operation` on packs be an instruction; a number beside a pack is in every lane."""

    @type_callable(operation)
    def _typed(context):
        def typed(a, b):
            fits = [x == of or (of == FLOATS and isinstance(x, _NUMBERS)) for x in (a, b)]
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
        to=TRUTHS,
    )
_binary(operator.and_, ir.IRBuilder.and_, TRUTHS)
_binary(operator.or_, ir.IRBuilder.or_, TRUTHS)
_binary(operator.xor, ir.IRBuilder.xor, TRUTHS)


def _unary(operation, instruction):
    """Let `operation` on a pack of floats be done by `instruction`."""

    @type_callable(operation)
    def _typed(context):
        return lambda a: a if a == FLOATS else None

    @lower_builtin(operation, FLOATS)
    def _lowered(context, builder, sig, args):
        return instruction(builder, *args)


def _root(builder, a):
    name, function_type = f"llvm.sqrt.v{WIDTH}f64", ir.FunctionType(a.type, [a.type])
    return builder.call(cgutils.get_or_insert_function(builder.module, function_type, name), [a])


def _size(builder, a):
    bits = ir.VectorType(ir.IntType(64), WIDTH)
    all_but_the_sign = ir.Constant(bits, [2**63 - 1] * WIDTH)
    return builder.bitcast(builder.and_(builder.bitcast(a, bits), all_but_the_sign), a.type)


_unary(operator.neg, ir.IRBuilder.fneg)
_unary(math.sqrt, _root)
_unary(abs, _size)


@type_callable(where)
def _type_of_where(context):
    def typed(condition, a, b):
        if condition == TRUTHS:
            return signature(FLOATS, TRUTHS, FLOATS, FLOATS)
        common = context.unify_types(types.unliteral(a), types.unliteral(b))
        fits = isinstance(common, (types.Number, types.Boolean, _Pack))
        return signature(common, types.boolean, common, common) if fits else None

    return typed


@lower_builtin(where, TRUTHS, FLOATS, FLOATS)
def _select_lanes(context, builder, sig, args):
    return builder.select(_holds(builder, args[0]), args[1], args[2])


@lower_builtin(where, types.boolean, types.Any, types.Any)
def _select(context, builder, sig, args):
    return builder.select(*args)


@type_callable(any_of)
def _type_of_any(context):
    def typed(condition):
        return signature(types.boolean, TRUTHS if condition == TRUTHS else types.boolean)

    return typed


@lower_builtin(any_of, TRUTHS)
def _any_lane(context, builder, sig, args):
    bits = builder.bitcast(_holds(builder, args[0]), ir.IntType(WIDTH))
    return builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))


@lower_builtin(any_of, types.boolean)
def _itself(context, builder, sig, args):
    return args[0]
