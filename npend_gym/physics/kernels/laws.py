"""The laws of force of joints, of the air and of springs, each with its derivatives.

A law is a function of the local state: the relative speed of a joint, the velocity of a tip, the
stretch of a spring. The recursion, its tangent and its adjoint call what stands here, and know no
more of a law. A parameter of a law is a row of its array and a field of `ChainParameters`.
"""

# ruff: noqa: ARG001  a law may depend on other rows of its parameters
from __future__ import annotations

import math
from typing import Any, NamedTuple

from npend_gym._checks import FloatArray
from npend_gym.chain import ChainParameters
from npend_gym.compiled.jit import inlined_kernel
from npend_gym.compiled.packs import where

# The rows of a chain (parameters, n), by the names of `ChainParameters`
Parameter: Any = ChainParameters(*range(len(ChainParameters._fields)))  # type: ignore[arg-type]
# Rows of what springs have beside these, where their derivatives are asked for
STIFFNESS, AXIAL_DAMPING = len(Parameter), len(Parameter) + 1


class FrictionFields(NamedTuple):
    """Rows of the friction in joints, (rows, n); those named as in `Chain` are its parameters."""

    FRICTION: int = 0  # N m
    FRICTION_SPEED: int = 1  # rad/s
    PER_SPEED: int = 2  # s/rad: one over the speed at which friction is 0.7 of that


Friction: FrictionFields = FrictionFields()


@inlined_kernel
def friction_terms_of(chain: FloatArray, i: int, rows: FloatArray, column: int) -> None:
    """Write the rows of `Friction` for joint `i` of a chain (parameters, n)."""
    rows[Friction.FRICTION, column] = chain[Parameter.friction, i]
    rows[Friction.FRICTION_SPEED, column] = chain[Parameter.friction_speed, i]
    rows[Friction.PER_SPEED, column] = 1.0 / chain[Parameter.friction_speed, i]


@inlined_kernel
def _share(rows: FloatArray, i: int, u: Any) -> Any:
    """Return the torque per N m of friction, at the scaled speed `u`."""
    return u / math.sqrt(1.0 + u * u)


@inlined_kernel
def friction_torque(rows: FloatArray, i: int, speed: Any) -> Any:
    """Return the torque of dry friction in joint `i`, of the sign of its speed [N m]."""
    u = speed * rows[Friction.PER_SPEED, i]
    return (rows[Friction.FRICTION, i] * u) / math.sqrt(1.0 + u * u)


@inlined_kernel
def friction_slope(rows: FloatArray, i: int, speed: Any) -> Any:
    """Return the derivative of the torque by the speed."""
    u = speed * rows[Friction.PER_SPEED, i]
    root = math.sqrt(1.0 + u * u)
    slope = rows[Friction.FRICTION, i] * rows[Friction.PER_SPEED, i]
    return slope / (root * root * root)


@inlined_kernel
def friction_change(rows: FloatArray, i: int, speed: Any, changed: FloatArray) -> Any:
    """Return the change of the torque with the parameters of the law."""
    u = speed * rows[Friction.PER_SPEED, i]
    share, by_speed = _share(rows, i, u), friction_slope(rows, i, speed) * u
    by_speed = changed[Parameter.friction_speed, i] * by_speed
    return changed[Parameter.friction, i] * share - by_speed


@inlined_kernel
def friction_return(
    rows: FloatArray, i: int, speed: Any, torque_bar: Any, chain_bar: FloatArray
) -> None:
    """Add the derivatives by the parameters of the law to `chain_bar`."""
    u = speed * rows[Friction.PER_SPEED, i]
    share, by_speed = _share(rows, i, u), friction_slope(rows, i, speed) * u
    chain_bar[Parameter.friction, i] += share * torque_bar
    chain_bar[Parameter.friction_speed, i] -= by_speed * torque_bar


@inlined_kernel
def drag_factor(chain: Any, i: int, square: Any) -> Any:
    """Return drag over velocity at tip `i`, from the square of its speed [N s/m]."""
    return chain.drag[i] + chain.quadratic_drag[i] * math.sqrt(square)


@inlined_kernel
def drag_slopes(chain: Any, i: int, x: Any, y: Any) -> tuple[Any, Any, Any]:
    """Return the speed, drag over velocity, and the growth of that along the velocity."""
    speed = math.sqrt(x * x + y * y)
    moving = speed > 0.0
    growth = where(moving, chain.quadratic_drag[i] / where(moving, speed, 1.0), 0.0)
    return speed, chain.drag[i] + chain.quadratic_drag[i] * speed, growth


@inlined_kernel
def drag_change(i: int, speed: Any, changed: FloatArray) -> Any:
    """Return the change of drag over velocity with the parameters of the law."""
    return changed[Parameter.drag, i] + changed[Parameter.quadratic_drag, i] * speed


@inlined_kernel
def drag_return(i: int, speed: Any, power: Any, chain_bar: FloatArray) -> None:
    """Take the derivatives by the parameters from `chain_bar`, the virtual power being given."""
    chain_bar[Parameter.drag, i] -= power
    chain_bar[Parameter.quadratic_drag, i] -= speed * power


@inlined_kernel
def spring_tension(springs: FloatArray, i: int, stretch: Any, rate: Any) -> Any:
    """Return the tension of spring `i` [N], which is linear in what it depends on."""
    return springs[0, i] * stretch + springs[1, i] * rate


@inlined_kernel
def spring_change(i: int, stretch: Any, rate: Any, changed: FloatArray) -> Any:
    """Return the change of the tension with the parameters of the law."""
    change: Any = 0.0 * stretch
    if changed.shape[0] > AXIAL_DAMPING:
        change = changed[STIFFNESS, i] * stretch + changed[AXIAL_DAMPING, i] * rate
    return change


@inlined_kernel
def spring_return(i: int, stretch: Any, rate: Any, virtual: Any, chain_bar: FloatArray) -> None:
    """Take the derivatives by the parameters from `chain_bar`, at the `virtual` rate."""
    if chain_bar.shape[0] > AXIAL_DAMPING:
        chain_bar[STIFFNESS, i] -= virtual * stretch
        chain_bar[AXIAL_DAMPING, i] -= virtual * rate
