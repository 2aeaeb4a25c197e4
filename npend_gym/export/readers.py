"""What simulation engines lose of the files that we write, and the line of code that mends it."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

from npend_gym import _checks
from npend_gym.chain import Chain

Engine = Literal[
    "mujoco", "mjx", "mujoco_warp", "newton", "genesis", "drake", "dart", "pinocchio", "idyntree",
    "pybullet", "sapien", "brax", "roboticstoolbox",
]  # fmt: skip
ENGINES: tuple[str, ...] = get_args(Engine)
USUAL_GRAVITY = 9.81  # m/s^2, which engines take where a file has none
_SMALL = 1e-10  # kg m^2, below which Newton changes an inertia
# Of each engine, format and property, the line that mends the property; "" as format: all.
# `benchmarks/engines_read.py` measures what is kept, lost and changed
MENDS: dict[tuple[str, str, str], str] = {
    ("mujoco", "urdf", "gravity"): "model.opt.gravity[2] = -g",
    (
        "mujoco",
        "usd",
        "any",
    ): "MjSpec.from_file('chain.usda').compile(), with pip install mujoco-usd",
    ("newton", "mjcf", "gravity"): "ModelBuilder(gravity=(0, 0, -g)); the file's is ignored",
    ("newton", "urdf", "gravity"): "ModelBuilder(gravity=(0, 0, -g)); the file's is ignored",
    ("newton", "", "friction"): "no line: the Featherstone solver has no friction",
    ("newton", "", "bobs"): "no line: inertia below 1e-10 kg m^2 becomes 1e-6",
    ("newton", "", "springs"): "no line: the joint slides before it turns",
    ("genesis", "", "gravity"): "SimOptions(gravity=(0, 0, -g)); the file's is ignored",
    ("genesis", "urdf", "any"): "morphs.URDF(default_armature=0.0), or joints get 0.1 kg m^2",
    ("drake", "urdf", "gravity"): "plant.mutable_gravity_field().set_gravity_vector([0, 0, -g])",
    ("drake", "sdf", "gravity"): "plant.mutable_gravity_field().set_gravity_vector([0, 0, -g])",
    ("drake", "", "friction"): "no line: joints of the plant have no friction",
    ("drake", "mjcf", "armature"): "plant.AddJointActuator('r1', plant.GetJointByName('joint1'))"
    ".set_default_rotor_inertia(armature[1]), or give --motors at all joints with armature",
    ("drake", "mjcf", "springs"): "no line: hinges stand where the link above begins",
    ("dart", "urdf", "gravity"): "world.setGravity([0, 0, -g])",
    ("dart", "urdf", "damping"): "world.setTimeStep(1e-6), as accelerations depend on the step",
    ("dart", "urdf", "friction"): "no line: accelerations have no friction",
    ("pinocchio", "", "gravity"): "model.gravity.linear = numpy.array([0, 0, -g])",
    ("pinocchio", "", "damping"): "tau -= model.damping * v, before pinocchio.aba",
    ("pinocchio", "", "friction"): "tau -= model.friction * numpy.sign(v), before pinocchio.aba",
    ("pinocchio", "mjcf", "springs"): "tau[1::2] -= stiffness * stretch, before pinocchio.aba",
    ("idyntree", "urdf", "gravity"): "gravity [0, 0, -g], as the last argument of setRobotState",
    ("idyntree", "urdf", "damping"): "tau -= joint.getDamping(0) * v, of each joint",
    ("idyntree", "urdf", "friction"): "tau -= joint.getStaticFriction(0) * numpy.sign(v)",
    ("pybullet", "urdf", "any"): "loadURDF(..., useFixedBase=True, "
    "flags=URDF_USE_INERTIA_FROM_FILE); setGravity(0, 0, -g); changeDynamics(body, link, "
    "linearDamping=0, angularDamping=0) of all links; and setJointMotorControlArray(body, joints, "
    "VELOCITY_CONTROL, forces=friction), or motors hold all joints",
    ("sapien", "urdf", "any"): "physx.set_scene_config(gravity=[0, 0, -g]) before the scene; "
    "link.linear_damping = link.angular_damping = 0; joint.set_friction(0), or it is 0.05",
    ("sapien", "urdf", "damping"): "joint.set_drive_properties(0, damping)",
    ("sapien", "urdf", "friction"): "no line: set_friction brakes otherwise",
    ("brax", "mjcf", "any"): "text.replace('integrator=\"RK4\"', 'integrator=\"Euler\"')",
    ("brax", "mjcf", "friction"): "no line: brax has no friction of joints",
    ("brax", "mjcf", "springs"): "no line: rods that stretch move otherwise",
    ("roboticstoolbox", "urdf", "any"): "text.replace('0 -1 0', '0 1 0'), with angles of opposite "
    "sign, as torques about negative axes have the wrong one",
    ("roboticstoolbox", "urdf", "gravity"): "robot.gravity = [0, 0, -g]",
    ("roboticstoolbox", "urdf", "damping"): "tau -= damping * v, before robot.accel",
    ("roboticstoolbox", "urdf", "friction"): "tau -= friction * numpy.sign(v)",
}
_BOTH = "mjcf", "urdf"
_READ: dict[str, tuple[str, ...]] = {  # formats, of those that read other ones
    **dict.fromkeys(("mjx", "mujoco_warp", "brax"), ("mjcf",)),
    **dict.fromkeys(("dart", "idyntree", "pybullet", "sapien", "roboticstoolbox"), ("urdf",)),
    **dict.fromkeys(("mujoco", "newton"), (*_BOTH, "usd")), "drake": (*_BOTH, "sdf"),
}  # fmt: skip


def advice(engine: str, to: str, chain: Chain) -> list[str]:
    """Sentences on what an engine loses of a chain's file, one for each property.

    Parameters
    ----------
    engine : str
        One of `ENGINES`.
    to : str
        Format, "mjcf", "urdf", "sdf" or "usd".
    chain : Chain

    Returns
    -------
    list of str

    Raises
    ------
    ValueError
        If the engine is not known, or does not read the format `to`.
    """
    _checks.choice("the engine", engine, ENGINES)
    if to not in (formats := _READ.get(engine, _BOTH)):
        raise ValueError(f"{engine} must have --to {' or '.join(formats)}, got {to}")
    has = {
        "any": True,
        "gravity": chain.gravity != USUAL_GRAVITY,
        "damping": bool(np.any(chain.damping)) or (chain.base is not None and chain.base.damping),
        "friction": np.any(chain.friction),
        "armature": np.any(chain.armature[1:]),
        "springs": chain.stiffness is not None,
        "bobs": np.any(chain.inertias < _SMALL),
    }
    return [
        f"{engine} needs for {'any chain' if name == 'any' else f'the {name} of this one'}: {line}"
        for (program, kind, name), line in MENDS.items()
        if program == engine and kind in ("", to) and has[name]
    ]
