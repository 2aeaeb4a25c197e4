"""Chains as worlds in the Simulation Description Format (SDF)."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import numpy as np

from npend_gym.chain import Chain, check_chain
from npend_gym.export.mjcf import check_known, inertia_of, returns_text, text_of
from npend_gym.export.urdf import LACKS, MIN_INERTIA, turning_inertia


@returns_text
def to_sdf(chain: Chain) -> str:
    """Return a chain as a world with one model in SDF 1.7, for Gazebo and Drake.

    The plane of the chain is x, z. Link i turns about -y in the revolute joint "joint{i}", whose
    angle is theta_i - theta_{i-1}, without limits. A cart is moved by the prismatic joint "cart".
    The world has the chain's gravity. Point masses, and the armature of joint 0, are as in
    `to_urdf`. See docs/engines.md for what each simulator makes of the file.

    Parameters
    ----------
    chain : Chain

    Returns
    -------
    str

    Raises
    ------
    ValueError
        If SDF has no such thing as the chain's `drag`, `quadratic_drag`, or `armature` of joints
        behind the first; or the chain has `stiffness`, which needs links without mass there.

    Examples
    --------
    >>> from npend_gym import Chain
    >>> from npend_gym.export import to_sdf
    >>> to_sdf(Chain.uniform(2)).count("<joint ")
    2
    """
    check_known(check_chain(chain), "SDF", LACKS)
    root = ET.Element("sdf", version="1.7")
    world = ET.SubElement(root, "world", name="default")
    _text(world, "gravity", 0.0, 0.0, -chain.gravity)
    model = ET.SubElement(world, "model", name=f"chain_of_{chain.n}")
    parent = "world"
    if chain.base is not None:
        _link(model, "cart_link", 0.0, chain.base.mass, 0.0, max(inertia_of(chain, 0), MIN_INERTIA))
        axis = 1.0, 0.0, 0.0
        _joint(model, "cart", "prismatic", parent, "cart_link", axis, chain.base.damping, 0.0)
        parent = "cart_link"
    heights = np.append(0.0, -np.cumsum(chain.lengths))
    for i in range(chain.n):
        child = f"link{i}"
        inertia = turning_inertia(chain, i)
        _link(model, child, heights[i], chain.masses[i], chain.centres[i], inertia)
        losses = chain.damping[i], chain.friction[i]
        _joint(model, f"joint{i}", "revolute", parent, child, (0.0, -1.0, 0.0), *losses)
        parent = child
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _text(parent: ET.Element, name: str, *numbers: float) -> None:
    ET.SubElement(parent, name).text = text_of(*numbers)


def _link(
    model: ET.Element, name: str, height: float, mass: float, centre: float, inertia: float
) -> None:
    """Add a link whose frame is at its joint; its pose is that in the hanging chain."""
    link = ET.SubElement(model, "link", name=name)
    _text(link, "pose", 0.0, 0.0, height, 0.0, 0.0, 0.0)
    inertial = ET.SubElement(link, "inertial")
    _text(inertial, "pose", 0.0, 0.0, -centre, 0.0, 0.0, 0.0)
    _text(inertial, "mass", mass)
    about = ET.SubElement(inertial, "inertia")
    for moment in ("ixx", "iyy", "izz"):
        _text(about, moment, inertia)


def _joint(
    model: ET.Element, name: str, kind: str, parent: str, child: str,
    axis: tuple[float, float, float], damping: float, friction: float,
) -> None:  # fmt: skip
    joint = ET.SubElement(model, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent").text = parent
    ET.SubElement(joint, "child").text = child
    about = ET.SubElement(joint, "axis")
    _text(about, "xyz", *axis)
    dynamics = ET.SubElement(about, "dynamics")
    _text(dynamics, "damping", damping)
    _text(dynamics, "friction", friction)
