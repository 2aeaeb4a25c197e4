"""Chains as stages of OpenUSD with its physics schemas."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, cast

from npend_gym.chain import Chain, check_chain
from npend_gym.export.mjcf import all_but, check_known, inertia_of, returns_text

LACKS = all_but("armature")
_HEAD = """\
#usda 1.0
(
    defaultPrim = "chain"
    kilogramsPerUnit = 1
    metersPerUnit = 1
    upAxis = "Z"
)

def Xform "chain"
{
"""
_DEGREE = math.radians(1.0)  # the schema has damping of turns by degrees


@returns_text
def to_usd(chain: Chain) -> str:
    """Return a chain as a stage of OpenUSD (.usda), for Newton and MuJoCo 4.

    It has the schemas UsdPhysics, and that of Newton for damping, friction and armature of joints.
    The plane of the chain is x, z. Link i turns about -y in the revolute joint "joint{i}", whose
    angle is theta_i - theta_{i-1}, without limits. A cart is moved by the prismatic joint "cart".
    USD keeps masses, damping and gravity in float32, so accelerations are right to about 1e-7.
    Point masses are as in `to_mjcf`. See docs/engines.md for what each simulator makes of the file.

    Parameters
    ----------
    chain : Chain

    Returns
    -------
    str

    Raises
    ------
    ValueError
        If USD has no such thing as the chain's `drag`, `quadratic_drag` or `stiffness`, or armature
        of joints behind the first with a finite `gear`.

    Examples
    --------
    >>> from npend_gym import Chain
    >>> from npend_gym.export import to_usd
    >>> to_usd(Chain.uniform(2)).count("def PhysicsRevoluteJoint")
    2
    """
    check_known(check_chain(chain), "USD", LACKS)
    scene: dict[str, Any] = {"vector3f physics:gravityDirection": (0.0, 0.0, -1.0)}
    scene |= {"float physics:gravityMagnitude": chain.gravity}
    parts = [_prim("PhysicsScene", "scene", scene)]
    # MuJoCo makes a body without mass of any other prim that is the root of an articulation
    parts.append(_link("base", 0.0, 1.0, 0.0, 1.0, "PhysicsArticulationRootAPI"))
    parts.append(_prim("PhysicsFixedJoint", "root", {"rel physics:body1": "</chain/base>"}))
    parent, end, height = "base", 0.0, 0.0
    if (base := chain.base) is not None:
        parts.append(_link("cart_link", 0.0, base.mass, 0.0, inertia_of(chain, 0)))
        losses: dict[str, Any] = {"newton:damping": base.damping}
        parts.append(_joint("cart", "Prismatic", "X", parent, "cart_link", 0.0, losses))
        parent = "cart_link"
    for i in range(chain.n):
        name = f"link{i}"
        parts.append(_link(name, height, chain.masses[i], chain.centres[i], inertia_of(chain, i)))
        losses = {
            "newton:damping": chain.damping[i] * _DEGREE,
            "newton:friction": chain.friction[i],
            "newton:armature": chain.armature[i],
        }
        parts.append(_joint(f"joint{i}", "Revolute", "Y", parent, name, end, losses))
        parent, end = name, -float(chain.lengths[i])
        height += end
    return _HEAD + "\n".join(parts) + "}\n"


def _link(
    name: str, height: float, mass: float, centre: float, inertia: float, *schemas: str
) -> str:
    """Return a body whose frame is at its joint; `height` is that in the hanging chain."""
    about = {
        "float physics:mass": mass,
        "point3f physics:centerOfMass": (0.0, 0.0, -centre),
        "float3 physics:diagonalInertia": (inertia, inertia, inertia),
        "quatf physics:principalAxes": (1.0, 0.0, 0.0, 0.0),
        "double3 xformOp:translate": (0.0, 0.0, height),
        "uniform token[] xformOpOrder": ["xformOp:translate"],
    }
    return _prim("Xform", name, about, "PhysicsRigidBodyAPI", "PhysicsMassAPI", *schemas)


def _joint(
    name: str, kind: str, axis: str, parent: str, child: str, end: float,
    losses: Mapping[str, float],
) -> str:  # fmt: skip
    """Return a joint where the parent ends; a half turn about z reverses the axis y."""
    turned = (1.0, 0.0, 0.0, 0.0) if axis == "X" else (0.0, 0.0, 0.0, 1.0)
    about: dict[str, Any] = {
        "uniform token physics:axis": axis,
        "rel physics:body0": f"</chain/{parent}>",
        "rel physics:body1": f"</chain/{child}>",
        "point3f physics:localPos0": (0.0, 0.0, end),
        "quatf physics:localRot0": turned,
        "point3f physics:localPos1": (0.0, 0.0, 0.0),
        "quatf physics:localRot1": turned,
    }
    about |= {f"float {key}": value for key, value in losses.items()}
    return _prim(f"Physics{kind}Joint", name, about, "NewtonJointAPI")


def _prim(kind: str, name: str, about: Mapping[str, Any], *schemas: str) -> str:
    """Return a prim below the chain, as text."""
    shown = ", ".join(f'"{schema}"' for schema in schemas)
    applied = f" (\n        prepend apiSchemas = [{shown}]\n    )" if schemas else ""
    lines = "".join(f"        {key} = {_value(value)}\n" for key, value in about.items())
    return f'    def {kind} "{name}"{applied}\n    {{\n{lines}    }}\n'


def _value(value: Any) -> str:
    if isinstance(value, str):
        return value if value.startswith("<") else f'"{value}"'
    if isinstance(value, list):
        return "[" + ", ".join(map(_value, cast("list[Any]", value))) + "]"
    if isinstance(value, tuple):
        return "(" + ", ".join(map(_value, cast("tuple[Any, ...]", value))) + ")"
    return repr(float(value))
