"""Chains as models of MuJoCo (MJCF)."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from os import PathLike
from typing import Any, ParamSpec, cast
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym.chain import Chain, check_chain

MIN_INERTIA = 2e-15  # kg m^2, what MuJoCo takes for the inertia of a moving body at least
OF_POINT_MASS = 1e-13  # inertia of a point mass over its m c^2: rounding, for a motion
OF_NO_MOTOR = 1e-13  # armature where a chain has none over the mass, or inertia, that a joint moves
_HOLDING = "0.9999 0.9999 0.001"  # MuJoCo's constraint of friction at its hardest
_MAX_BODIES = 496  # which make 500 elements inside each other: MuJoCo reads no more
_MAX_TIMESTEP = 1.0  # s
_P = ParamSpec("_P")
# What every engine has, if only by another law, as of friction near rest
_SHARED = (
    "masses", "lengths", "gravity", "damping", "centres", "inertias", "friction", "friction_speed",
    "axial_damping", "base",
)  # fmt: skip


def all_but(*written: str) -> tuple[str, ...]:
    """Return the parameters of chains that a format lacks which has `written` beside the common."""
    return tuple(name for name in Chain.__annotations__ if name not in (*_SHARED, *written))


LACKS = all_but("armature", "stiffness")  # parameters that MuJoCo has not


def returns_text(function: Callable[_P, str]) -> Callable[_P, str]:
    """Let a function that returns the text of a file say so where it is given the path of one."""

    @functools.wraps(function)
    def checked(*args: _P.args, **kwargs: _P.kwargs) -> str:
        for value in (*args[1:], *kwargs.values()):
            if isinstance(value, (str, PathLike)):
                name, path = function.__name__, _checks.show(str(cast("object", value)))
                raise TypeError(
                    f"{name} must be called without a path, because it returns the text of a file; "
                    f"got {path}: write it by Path({path}).write_text({name}(chain))"
                )
        return function(*args, **kwargs)

    return checked


@returns_text
def to_mjcf(
    chain: Chain,
    motors: Sequence[int] = (),
    limits: ArrayLike | None = None,
    timestep: float = 0.001,
) -> str:
    """Return a chain as a model of MuJoCo, in its XML format.

    The plane of the chain is x, z. Link i turns about -y in the hinge "joint{i}", by the angle
    theta_i - theta_{i-1}. Rods that stretch have the slide "stretch{i}" beside it, and a cart has
    the slide "cart". Coordinates of MuJoCo have the order cart, then joint and stretch of each rod.

    Parameters
    ----------
    chain : Chain
    motors : sequence of int
        Joints that have a motor, for mjcf; n is the force on the cart. Controls are in N m and N.
    limits : float or array_like, shape (motors,), optional
        Largest torque [N m] or force [N] of each motor, for mjcf. Without limits by default.
    timestep : float
        Interval of MuJoCo's integrator, RK4, for mjcf [s], at most 1.

    Returns
    -------
    str

    Raises
    ------
    ValueError
        If MuJoCo has no such thing as the chain's `drag`, `quadratic_drag`, or armature of joints
        behind the first with a finite `gear`; a motor is at no joint, or two are at one; or there
        are limits without motors. If there are more than 496 bodies, which MuJoCo cannot read.

    Notes
    -----
    MuJoCo's bodies have inertia. A point mass gets 1e-13 m c^2, c being its distance from the
    joint, so that motions agree as far as MuJoCo's time step allows: to 1e-9 over 2 s in the tests.
    MuJoCo gives every body 2e-15 kg m^2 at least, which matters to links of milligrams and
    millimetres: of a bob of 1 mg on 1 mm, accelerations are wrong by 0.3 %.
    Joints without armature get 1e-13 of the inertia of their link, because Genesis reads 0 as 0.1.
    Bodies have the names "link{i}", with equal numbers of digits where eleven or more rods stretch.

    Examples
    --------
    >>> from npend_gym import Chain
    >>> from npend_gym.export import to_mjcf
    >>> text = to_mjcf(Chain.uniform(2), motors=(0,), limits=5.0)
    >>> print(text.splitlines()[-3].strip())
    <motor name="motor0" joint="joint0" gear="1" ctrlrange="-5.0 5.0" />
    """
    check_known(check_chain(chain), "MuJoCo", LACKS)
    bodies = chain.n + (chain.base is not None)
    _checks.count("the number of bodies in MuJoCo", bodies, high=_MAX_BODIES)
    root = ET.Element("mujoco", model=f"chain of {chain.n}")
    ET.SubElement(root, "compiler", angle="radian", autolimits="true")
    step = _checks.positive_number("timestep", timestep)
    if step > _MAX_TIMESTEP:
        raise ValueError(f"timestep must be at most {_MAX_TIMESTEP:g} s, got {step:g}")
    gravity = text_of(0.0, 0.0, -chain.gravity)
    option = ET.SubElement(
        root, "option", timestep=text_of(step), integrator="RK4", gravity=gravity
    )
    ET.SubElement(option, "flag", contact="disable")
    body, place = ET.SubElement(root, "worldbody"), text_of(0.0, 0.0, 0.0)
    if chain.base is not None:
        body = ET.SubElement(body, "body", name="cart")
        _inertial(body, chain.base.mass, place, MIN_INERTIA)
        cart = ET.SubElement(body, "joint", name="cart", type="slide", axis="1 0 0")
        cart.set("damping", text_of(chain.base.damping))
        cart.set("armature", text_of(OF_NO_MOTOR * chain.base.mass))
        _shape(body, type="box", size=text_of(*0.05 * chain.total_length * np.array([2, 1, 1])))
    for i in range(chain.n):
        body = _link(chain, i, body, place)
        place = text_of(0.0, 0.0, -chain.lengths[i])
    _motors(root, chain, motors, limits)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def check_known(chain: Chain, where: str, lacks: Sequence[str]) -> None:
    """Refuse the parameters that another format `lacks`; gears matter to rotors behind joint 0."""
    found = held(chain, lacks)
    if found:
        shown = "; ".join(f"{name}={value}" for name, value in found.items())
        raise ValueError(
            f"{' and '.join(found)} must be left out: {where} has no such thing, so fit or make "
            f"the chain without it, or give --drop {','.join(found)} of npend export; got {shown}"
        )


def held(chain: Chain, names: Sequence[str]) -> dict[str, str]:
    """Return those of some parameters that matter to a chain, as texts."""
    behind = chain.armature[1:] > 0.0  # the rotor of joint 0 is as good as inertia of link 0
    found: dict[str, Any] = {name: getattr(chain, name) for name in names}
    matters: dict[str, Any] = found | {
        "gear": np.isfinite(chain.gear[1:]) & behind, "armature": behind
    }  # fmt: skip
    return {
        name: _checks.show(value.tolist())
        for name, value in found.items()
        if value is not None and np.any(matters[name])
    }


def without(chain: Chain, names: Sequence[str], where: str, lacks: Sequence[str]) -> Chain:
    """Return a chain without parameters that another format `lacks`: each has its default.

    The armature of the first joint stays, because `held` does not name it.
    """
    for name in names:
        _checks.choice(f"drop, with {where},", name, tuple(lacks))
    left = {k: v for k, v in chain.as_dict().items() if k not in names}
    if "armature" in names:
        left["armature"] = [float(chain.armature[0]), *[0.0] * (chain.n - 1)]
    return Chain.from_dict(left)


def _link(chain: Chain, i: int, parent: ET.Element, place: str) -> ET.Element:
    """Add link i below `parent`, where the link above ends."""
    # Drake adds a digit to the name of a body with two joints: "link1" and "link10" would clash
    digits = 1 if chain.stiffness is None else len(str(chain.n - 1))
    body = ET.SubElement(parent, "body", name=f"link{i:0{digits}d}", pos=place)
    centre, end = chain.centres[i], -chain.lengths[i]
    inertia = inertia_of(chain, i)
    _inertial(body, chain.masses[i], text_of(0.0, 0.0, -centre), inertia)
    turning = inertia + chain.masses[i] * centre**2
    joint = ET.SubElement(body, "joint", name=f"joint{i}", type="hinge", axis="0 -1 0")
    about = {"damping": chain.damping[i], "frictionloss": chain.friction[i]}
    if chain.friction[i]:
        joint.set("solimpfriction", _HOLDING)
    about["armature"] = chain.armature[i] or OF_NO_MOTOR * turning
    for name, value in about.items():
        joint.set(name, text_of(value))
    if chain.stiffness is not None:
        stretch = ET.SubElement(body, "joint", name=f"stretch{i}", type="slide", axis="0 0 -1")
        stretch.set("stiffness", text_of(chain.stiffness[i]))
        stretch.set("damping", text_of(chain.axial_damping[i]))
        stretch.set("armature", text_of(OF_NO_MOTOR * chain.masses[i]))
    thickness = 0.02 * chain.total_length / chain.n
    _shape(
        body, type="capsule", fromto=text_of(0.0, 0.0, 0.0, 0.0, 0.0, end), size=text_of(thickness)
    )
    _shape(body, type="sphere", pos=text_of(0.0, 0.0, -centre), size=text_of(3.0 * thickness))
    return body


def inertia_of(chain: Chain, i: int) -> float:
    """Return the inertia of link i about its centre [kg m^2], a little for a point mass."""
    inertia = chain.inertias[i] or OF_POINT_MASS * chain.masses[i] * chain.centres[i] ** 2
    return max(float(inertia), MIN_INERTIA)


def _inertial(body: ET.Element, mass: float, place: str, inertia: float) -> None:
    turning = text_of(inertia, inertia, inertia)
    ET.SubElement(body, "inertial", mass=text_of(mass), pos=place, diaginertia=turning)


def _shape(body: ET.Element, **about: str) -> None:
    """Add what is drawn, which has no mass and touches nothing."""
    ET.SubElement(body, "geom", about | {"mass": "0", "contype": "0", "conaffinity": "0"})


def _motors(
    root: ET.Element, chain: Chain, motors: Sequence[int], limits: ArrayLike | None
) -> None:
    """Add the motors, in their order."""
    last = chain.n - (chain.base is None)
    joints = _checks.listed("motors", motors, "[0]")
    joints = [_checks.count("a motor", joint, low=0, high=last) for joint in joints]
    if len(set(joints)) < len(joints):
        raise ValueError(f"motors must be at different joints, got {joints}")
    ends = None
    if limits is not None:
        if not joints:
            raise ValueError(f"limits must be left out without motors, got {_checks.show(limits)}")
        ends = _checks.positive("limits", _checks.vector("limits", limits, len(joints)))
    actuators = ET.SubElement(root, "actuator")
    for k, joint in enumerate(joints):
        name = f"joint{joint}" if joint < chain.n else "cart"
        motor = ET.SubElement(actuators, "motor", name=f"motor{k}", joint=name, gear="1")
        if ends is not None:
            motor.set("ctrlrange", text_of(-ends[k], ends[k]))


def text_of(*numbers: float) -> str:
    """Return numbers with all their digits."""
    return " ".join(repr(float(number)) for number in numbers)
