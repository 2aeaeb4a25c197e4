"""Robots in URDF as chains: MuJoCo compiles them, without what is drawn or touched."""

from __future__ import annotations

from os import PathLike
from xml.etree import ElementTree as ET

from npend_gym.chain import Chain
from npend_gym.export.mjcf import text_of
from npend_gym.export.read_mjcf import chain_of_text, text_of_source
from npend_gym.export.urdf import MIN_INERTIA, ROOT


def from_urdf(source: str | PathLike[str]) -> Chain:
    """Return the chain that a robot in URDF describes, as `from_mjcf` reads a model of MuJoCo.

    Shapes are left out, so that meshes are not needed and nothing collides. The root link stands
    still. A link whose inertia is zero is a point mass. Gravity is 9.81 m/s^2 along -z, because
    URDF has none. The last link ends at its centre of mass.

    Parameters
    ----------
    source : str or path-like
        The robot in XML, or its file. Expand files of xacro before.

    Returns
    -------
    Chain

    Raises
    ------
    ValueError
        If MuJoCo cannot read the robot, or it has what no chain has; see `from_mjcf`. MuJoCo reads
        no inertia that no body can have.
    ImportError
        If MuJoCo is not installed.

    Warns
    -----
    UserWarning
        If joints have limits, because a chain has none.

    Examples
    --------
    >>> from npend_gym import Chain
    >>> Chain.from_urdf(Chain.uniform(3).to_urdf()).n  # or a file: Chain.from_urdf("arm.urdf")
    3
    """
    try:
        robot = ET.fromstring(text_of_source(source).encode())  # noqa: S314 expat bounds entities
    except ET.ParseError as error:
        raise ValueError(f"source must be XML: {error}") from error
    if robot.tag != "robot":
        raise ValueError(f"source must be URDF, whose root is <robot>, got <{robot.tag}>")
    parents = {each.get("link", "") for each in robot.iterfind("joint/parent")}
    children = {each.get("link", "") for each in robot.iterfind("joint/child")}
    links = {link.get("name", ""): link for link in robot.iterfind("link")}
    if ROOT in parents - links.keys():  # Drake has it without saying so
        ET.SubElement(robot, "link", name=ROOT)
    for name, link in links.items():
        for tag in ("visual", "collision", *(["inertial"] if name not in children else [])):
            for shape in link.findall(tag):
                link.remove(shape)
        inertia, mass = link.find("inertial/inertia"), link.find("inertial/mass")
        if inertia is None or mass is None:
            continue
        if not any(float(value) for value in inertia.attrib.values()):
            if float(mass.get("value", "0")):
                inertia.attrib |= dict.fromkeys(("ixx", "iyy", "izz"), text_of(MIN_INERTIA))
            else:
                link.remove(link.find("inertial"))  # type: ignore[arg-type]
    for unused in ("material", "transmission", "gazebo", "mujoco"):
        for each in robot.findall(unused):
            robot.remove(each)
    return chain_of_text(ET.tostring(robot, encoding="unicode"))
