"""Chains as robots in the Unified Robot Description Format (URDF)."""

from __future__ import annotations

from xml.etree import ElementTree as ET

from npend_gym.chain import Chain, check_chain
from npend_gym.export.mjcf import all_but, check_known, inertia_of, returns_text, text_of

LACKS = all_but("gear")  # which matters to armature alone
MIN_INERTIA = 2e-14  # kg m^2: MuJoCo refuses a body of URDF with 1e-14 or less
ROOT = "world"  # Drake, DART and Genesis take a root of any other name for a body that floats
_NO_LIMIT = {"lower": "-1000", "upper": "1000", "effort": "1e9", "velocity": "1e9"}


@returns_text
def to_urdf(chain: Chain) -> str:
    """Return a chain as a robot in URDF, for Pinocchio, Drake, Gazebo and ROS.

    The plane of the chain is x, z: link i turns about -y in the continuous joint "joint{i}", whose
    angle is theta_i - theta_{i-1}. A cart is moved by the prismatic joint "cart". A point mass has
    the inertia 1e-13 m c^2, c being its distance from the joint, because programs drop links
    without any; it has at least 2e-14 kg m^2, which MuJoCo requires. The armature of joint 0 is
    inertia of link 0, which moves the chain alike. The root link is "world", which does not move.
    The format knows no gravity: the simulator has its own. See docs/engines.md for what each
    simulator makes of the file.

    Parameters
    ----------
    chain : Chain

    Returns
    -------
    str

    Raises
    ------
    ValueError
        If URDF has no such thing as the chain's `drag`, `quadratic_drag`, `stiffness`, or
        `armature` of joints behind the first.

    Examples
    --------
    >>> from npend_gym import Chain
    >>> from npend_gym.export import to_urdf
    >>> to_urdf(Chain.uniform(2)).count("<joint ")
    2
    """
    check_known(check_chain(chain), "URDF", LACKS)
    root = ET.Element("robot", name=f"chain_of_{chain.n}")
    parent, place = ROOT, text_of(0.0, 0.0, 0.0)
    ET.SubElement(root, "link", name=parent)
    if chain.base is not None:
        any_inertia = max(inertia_of(chain, 0), MIN_INERTIA)  # it never turns
        _link(root, "cart", chain.base.mass, 0.0, any_inertia)
        joint = _joint(root, "cart", "prismatic", parent, "cart", place, "1 0 0")
        ET.SubElement(joint, "limit", _NO_LIMIT)
        ET.SubElement(joint, "dynamics", damping=text_of(chain.base.damping))
        parent = "cart"
    for i in range(chain.n):
        child = f"link{i}"
        _link(root, child, chain.masses[i], chain.centres[i], turning_inertia(chain, i))
        joint = _joint(root, f"joint{i}", "continuous", parent, child, place, "0 -1 0")
        losses = {"damping": text_of(chain.damping[i]), "friction": text_of(chain.friction[i])}
        ET.SubElement(joint, "dynamics", losses)
        parent, place = child, text_of(0.0, 0.0, -chain.lengths[i])
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def turning_inertia(chain: Chain, i: int) -> float:
    """Return the inertia of link i about its centre [kg m^2], with the rotor of joint 0.

    That rotor turns as link 0 does. It is at least what MuJoCo requires.
    """
    rotor = 0.0 if i else float(chain.armature[0])
    return max(inertia_of(chain, i) + rotor, MIN_INERTIA)


def _link(root: ET.Element, name: str, mass: float, centre: float, inertia: float) -> None:
    inertial = ET.SubElement(ET.SubElement(root, "link", name=name), "inertial")
    ET.SubElement(inertial, "origin", xyz=text_of(0.0, 0.0, -centre))
    ET.SubElement(inertial, "mass", value=text_of(mass))
    turning = text_of(inertia)
    about = {"ixx": turning, "iyy": turning, "izz": turning, "ixy": "0", "ixz": "0", "iyz": "0"}
    ET.SubElement(inertial, "inertia", about)


def _joint(
    root: ET.Element, name: str, kind: str, parent: str, child: str, place: str, axis: str
) -> ET.Element:
    joint = ET.SubElement(root, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    ET.SubElement(joint, "origin", xyz=place)
    ET.SubElement(joint, "axis", xyz=axis)
    return joint
