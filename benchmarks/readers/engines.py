"""Engines, each a function that reads a file and returns accelerations of its joints.

A reader takes the text of a file, "mjcf", "urdf", "sdf" or "usd", and the chain if the engine is to
be mended: the lines under `if mend is not None` are those that a user has to write. It returns a
function of joint positions and velocities, in the order of the file, or raises what the engine
raises.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Generator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from npend_gym import Chain

Accelerations = Callable[[Any, Any], Any]
TINY = 1e-7  # s, a step in float64 from which the acceleration follows
SHORT = 1e-2  # s, one in float32


class Reader(NamedTuple):
    """An engine: its function, its package, the formats it reads, and its rounding."""

    read: Callable[[str, str, Chain | None], Accelerations]
    package: str
    formats: tuple[str, ...]
    within: float = 1e-7  # relative error of accelerations


@contextmanager
def written(text: str, suffix: str) -> Generator[Path]:
    """Text of a chain in a temporary file, for engines that read no strings."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"chain.{suffix}"
        path.write_text(text, encoding="utf-8")
        yield path


def mujoco(text: str, kind: str, mend: Chain | None) -> Accelerations:
    """Read by MuJoCo."""
    mj: Any = import_module("mujoco")
    if kind == "usd":
        with written(text, "usda") as path:
            model = mj.MjSpec.from_file(str(path)).compile()
    else:
        model = mj.MjModel.from_xml_string(text)
    if mend is not None and kind == "urdf":
        model.opt.gravity[2] = -mend.gravity
    data = mj.MjData(model)

    def accelerations(q: Any, v: Any) -> Any:
        data.qpos[:], data.qvel[:] = q, v
        mj.mj_forward(model, data)
        return data.qacc.copy()

    return accelerations


def mjx(text: str, kind: str, mend: Chain | None) -> Accelerations:
    """Read by MJX, in float64."""
    del kind, mend
    jax: Any = import_module("jax")
    jax.config.update("jax_enable_x64", True)
    mj: Any = import_module("mujoco")
    engine: Any = import_module("mujoco.mjx")
    model = engine.put_model(mj.MjModel.from_xml_string(text))
    forward, data = jax.jit(engine.forward), engine.make_data(model)

    def accelerations(q: Any, v: Any) -> Any:
        return forward(model, data.replace(qpos=jax.numpy.array(q), qvel=jax.numpy.array(v))).qacc

    return accelerations


def brax(text: str, kind: str, mend: Chain | None) -> Accelerations:
    """Read by brax, in float64; its generalized pipeline."""
    del kind
    if mend is not None:
        text = text.replace('integrator="RK4"', 'integrator="Euler"')
    jax: Any = import_module("jax")
    jax.config.update("jax_enable_x64", True)
    loader: Any = import_module("brax.io.mjcf")
    pipeline: Any = import_module("brax.generalized.pipeline")
    system = loader.loads(text).tree_replace({"opt.timestep": TINY})
    init, step = jax.jit(pipeline.init), jax.jit(pipeline.step)

    def accelerations(q: Any, v: Any) -> Any:
        start = init(system, jax.numpy.array(q), jax.numpy.array(v))
        return (step(system, start, jax.numpy.zeros(system.act_size())).qd - v) / TINY

    return accelerations


def mujoco_warp(text: str, kind: str, mend: Chain | None) -> Accelerations:
    """Read by MuJoCo Warp, in float32."""
    del kind, mend
    mj: Any = import_module("mujoco")
    wp: Any = import_module("warp")
    engine: Any = import_module("mujoco_warp")
    wp.config.quiet = True
    given = mj.MjModel.from_xml_string(text)
    with wp.ScopedDevice("cpu"):
        model, data = engine.put_model(given), engine.make_data(given)

    def accelerations(q: Any, v: Any) -> Any:
        with wp.ScopedDevice("cpu"):
            data.qpos.assign(np.array([q], np.float32))
            data.qvel.assign(np.array([v], np.float32))
            engine.forward(model, data)
            return data.qacc.numpy()[0]

    return accelerations


def newton(text: str, kind: str, mend: Chain | None) -> Accelerations:
    """Read by Newton, in float32; its Featherstone solver."""
    wp: Any = import_module("warp")
    engine: Any = import_module("newton")
    wp.config.quiet = True
    with wp.ScopedDevice("cpu"):
        builder = engine.ModelBuilder()
        if mend is not None and kind != "usd":
            builder = engine.ModelBuilder(gravity=(0.0, 0.0, -mend.gravity))
        if kind == "usd":
            with written(text, "usda") as path:
                builder.add_usd(str(path))
        else:
            options = {"floating": False} if kind == "urdf" else {}
            (builder.add_urdf if kind == "urdf" else builder.add_mjcf)(text, **options)
        model = builder.finalize()
        damped = {} if mend is None else {"angular_damping": 0.0}
        solver = engine.solvers.SolverFeatherstone(model, **damped)
        now, after, control = model.state(), model.state(), model.control()

    def accelerations(q: Any, v: Any) -> Any:
        with wp.ScopedDevice("cpu"):
            now.joint_q.assign(np.array(q, np.float32))
            now.joint_qd.assign(np.array(v, np.float32))
            engine.eval_fk(model, now.joint_q, now.joint_qd, now)
            now.clear_forces()
            solver.step(now, after, control, None, SHORT)
            return (after.joint_qd.numpy() - np.float32(v)) / SHORT

    return accelerations


def genesis(text: str, kind: str, mend: Chain | None) -> Accelerations:
    """Read by Genesis, in float64."""
    gs: Any = import_module("genesis")
    if not gs._initialized:  # noqa: SLF001
        gs.init(backend=gs.cpu, precision="64", logging_level="error")
    with written(text, "urdf" if kind == "urdf" else "xml") as path:
        options: dict[str, Any] = {"file": str(path)}
        gravity = (0.0, 0.0, -9.81)
        if mend is not None:
            options["default_armature"] = 0.0
            gravity = (0.0, 0.0, -mend.gravity)
        scene = gs.Scene(
            sim_options=gs.options.SimOptions(dt=1e-6, gravity=gravity), show_viewer=False,
            rigid_options=gs.options.RigidOptions(enable_collision=False),
        )  # fmt: skip
        morph = (gs.morphs.URDF if kind == "urdf" else gs.morphs.MJCF)(**options)
        robot = scene.add_entity(morph)
        scene.build()

    def accelerations(q: Any, v: Any) -> Any:
        robot.set_dofs_position(np.array(q))
        robot.set_dofs_velocity(np.array(v))
        scene.step()
        return (robot.get_dofs_velocity().numpy() - v) / 1e-6

    return accelerations


def drake(text: str, kind: str, mend: Chain | None) -> Accelerations:
    """Read by Drake, as a continuous plant."""
    every: Any = import_module("pydrake.all")
    plant = every.MultibodyPlant(0.0)
    every.Parser(plant).AddModelsFromString(text, {"mjcf": "xml"}.get(kind, kind))
    if mend is not None:
        plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, -mend.gravity])
        springs = mend.stiffness if mend.stiffness is not None else []
        for i, stiffness in enumerate(springs):
            joint = plant.GetJointByName(f"stretch{i}")
            plant.AddForceElement(every.PrismaticSpring(joint, 0.0, stiffness))
        for i, armature in enumerate(mend.armature):
            if armature:
                motor = plant.AddJointActuator(f"rotor{i}", plant.GetJointByName(f"joint{i}"))
                motor.set_default_rotor_inertia(armature)
    plant.Finalize()
    context = plant.CreateDefaultContext()

    def accelerations(q: Any, v: Any) -> Any:
        plant.SetPositionsAndVelocities(context, np.r_[q, v])
        return plant.EvalTimeDerivatives(context).CopyToVector()[len(q) :]

    return accelerations


def dart(text: str, kind: str, mend: Chain | None) -> Accelerations:
    """Read by DART."""
    del kind
    engine: Any = import_module("dartpy")
    with written(text, "urdf") as path:
        loader = engine.utils.DartLoader() if hasattr(engine, "utils") else engine.io.DartLoader()
        robot = loader.parseSkeleton(str(path))
    world = engine.simulation.World()
    world.addSkeleton(robot)
    if mend is not None:
        world.setGravity([0.0, 0.0, -mend.gravity])
    world.setTimeStep(TINY)

    def accelerations(q: Any, v: Any) -> Any:
        robot.setPositions(np.array(q))
        robot.setVelocities(np.array(v))
        robot.computeForwardDynamics()
        return robot.getAccelerations()

    return accelerations


def pinocchio(text: str, kind: str, mend: Chain | None) -> Accelerations:
    """Read by Pinocchio."""
    pin: Any = import_module("pinocchio")
    build = pin.buildModelFromMJCF if kind == "mjcf" else pin.buildModelFromXML
    if kind == "mjcf":
        with written(text, "xml") as path:
            model = build(str(path))
    else:
        model = build(text)
    damping, friction, springs = np.zeros(model.nv), np.zeros(model.nv), np.zeros(model.nv)
    if mend is not None:
        model.gravity.linear = np.array([0.0, 0.0, -mend.gravity])
        damping, friction = model.damping, model.friction
        if mend.stiffness is not None:
            springs[1::2] = mend.stiffness
    data = model.createData()

    def accelerations(q: Any, v: Any) -> Any:
        parts, left = list[list[float]](), [*q]
        for joint in model.joints[1:]:  # a hinge without a range has cosine and sine
            parts += [[np.cos(left[0]), np.sin(left.pop(0))]] if joint.nq > joint.nv else []
            parts += [[left.pop(0)] for _ in range(joint.nv - (joint.nq > joint.nv))]
        force = -damping * v - friction * np.sign(v) - springs * q
        return pin.aba(model, data, np.concatenate(parts), np.array(v), force)

    return accelerations


def idyntree(text: str, kind: str, mend: Chain | None) -> Accelerations:
    """Read by iDynTree."""
    del kind
    engine: Any = import_module("idyntree.bindings")
    loader = engine.ModelLoader()
    if not loader.loadModelFromString(text, "urdf"):
        raise ValueError("the loader returns False")
    model, inner = loader.model().copy(), engine.KinDynComputations()
    inner.loadRobotModel(model)
    names = [model.getJointName(k) for k in range(model.getNrOfDOFs())]
    order = sorted(range(len(names)), key=lambda k: (names[k] != "cart", len(names[k]), names[k]))
    gravity = np.array([0.0, 0.0, -9.81 if mend is None else -mend.gravity])
    rates = np.zeros((2, len(names)))
    if mend is not None:
        for k in range(len(names)):
            joint = model.getJoint(k)
            rates[:, k] = joint.getDamping(0), joint.getStaticFriction(0)

    def accelerations(q: Any, v: Any) -> Any:
        place, speed = np.empty(len(q)), np.empty(len(q))
        place[order], speed[order] = q, v
        inner.setRobotState(np.eye(4), place, np.zeros(6), speed, gravity)
        mass, bias = (
            engine.FreeFloatingMassMatrix(model),
            engine.FreeFloatingGeneralizedTorques(model),
        )
        inner.getFreeFloatingMassMatrix(mass)
        inner.generalizedBiasForces(bias)
        force = -rates[0] * speed - rates[1] * np.sign(speed) - bias.jointTorques().toNumPy()
        return np.linalg.solve(mass.toNumPy()[6:, 6:], force)[order]

    return accelerations


def pybullet(text: str, kind: str, mend: Chain | None) -> Accelerations:
    """Read by PyBullet."""
    del kind
    pb: Any = import_module("pybullet")
    pb.connect(pb.DIRECT)
    with written(text, "urdf") as path:
        flags = pb.URDF_USE_INERTIA_FROM_FILE if mend is not None else 0
        body = pb.loadURDF(str(path), useFixedBase=True, flags=flags)
    pb.setGravity(0.0, 0.0, 0.0 if mend is None else -mend.gravity)
    pb.setTimeStep(TINY)
    joints = [*range(pb.getNumJoints(body))]
    if mend is not None:
        for link in (-1, *joints):
            pb.changeDynamics(body, link, linearDamping=0.0, angularDamping=0.0)
        held = [0.0] * (len(joints) - mend.n) + mend.friction.tolist()
        pb.setJointMotorControlArray(body, joints, pb.VELOCITY_CONTROL, forces=held)

    def accelerations(q: Any, v: Any) -> Any:
        for joint, place, speed in zip(joints, q, v, strict=True):
            pb.resetJointState(body, joint, place, speed)
        pb.stepSimulation()
        after = np.array([state[1] for state in pb.getJointStates(body, joints)])
        return (after - v) / TINY

    return accelerations


def sapien(text: str, kind: str, mend: Chain | None) -> Accelerations:
    """Read by SAPIEN, in float32."""
    del kind
    engine: Any = import_module("sapien")
    if mend is not None:
        engine.physx.set_scene_config(gravity=np.array([0.0, 0.0, -mend.gravity]))
    scene = engine.Scene([engine.physx.PhysxCpuSystem()])
    scene.set_timestep(SHORT / 100.0)
    loader = scene.create_urdf_loader()
    loader.fix_root_link = True
    with written(text, "urdf") as path:
        robot = loader.load(str(path))
    if mend is not None:
        for joint in robot.active_joints:
            joint.set_friction(0.0)
        for joint, damping, friction in zip(
            robot.active_joints[-mend.n :], mend.damping, mend.friction, strict=True
        ):
            joint.set_friction(friction)
            joint.set_drive_properties(0.0, damping)
        for link in robot.links:
            link.linear_damping = link.angular_damping = 0.0

    def accelerations(q: Any, v: Any) -> Any:
        robot.set_qpos(np.array(q, np.float32))
        robot.set_qvel(np.array(v, np.float32))
        scene.step()
        return (robot.get_qvel() - v) / (SHORT / 100.0)

    return accelerations


def roboticstoolbox(text: str, kind: str, mend: Chain | None) -> Accelerations:
    """Read by the Robotics Toolbox for Python."""
    del kind
    engine: Any = import_module("roboticstoolbox")
    if mend is not None:  # the same axis, as a turn about y of a turned frame
        text = text.replace('xyz="0 -1 0"', 'xyz="0 1 0"')
    with written(text, "urdf") as path:
        robot = engine.Robot.URDF(str(path))
    if mend is not None:
        robot.gravity = [0.0, 0.0, -mend.gravity]
    sign = np.ones(robot.n)
    if mend is not None:
        sign[robot.n - mend.n :] = -1.0

    def accelerations(q: Any, v: Any) -> Any:
        return sign * robot.accel(sign * q, sign * v, np.zeros(len(q)))

    return accelerations


BOTH, MJCF, URDF = ("mjcf", "urdf"), ("mjcf",), ("urdf",)
WITH_SDF, WITH_USD = (*BOTH, "sdf"), (*BOTH, "usd")
READERS = {
    "MuJoCo": Reader(mujoco, "mujoco", WITH_USD),
    "MJX": Reader(mjx, "mujoco-mjx", MJCF),
    "MuJoCo Warp": Reader(mujoco_warp, "mujoco-warp", MJCF, 1e-3),
    "Newton": Reader(newton, "newton", WITH_USD, 2e-3),
    "Genesis": Reader(genesis, "genesis-world", BOTH, 1e-4),
    "Drake": Reader(drake, "drake", WITH_SDF),
    "DART": Reader(dart, "dartpy", URDF, 1e-5),
    "Pinocchio": Reader(pinocchio, "pin", BOTH),
    "iDynTree": Reader(idyntree, "idyntree", URDF),
    "PyBullet": Reader(pybullet, "pybullet", URDF, 1e-5),
    "SAPIEN": Reader(sapien, "sapien", URDF, 2e-2),
    "brax": Reader(brax, "brax", MJCF, 1e-5),
    "roboticstoolbox": Reader(roboticstoolbox, "roboticstoolbox-python", URDF),
}
