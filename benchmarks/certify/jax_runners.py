"""Engines that JAX or Warp compiles, as in `runners.py`; these have derivatives too."""

from __future__ import annotations

import os
from collections.abc import Callable
from importlib import import_module
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np

from certify.cases import Case
from certify.equations import Array
from certify.runners import (
    Engine,
    Player,
    chain_of,
    count_of,
    forces_on,
    from_joints,
    to_joints,
)

Advance = Callable[[Any, Any], Any]  # joints (2, m) after a step, from joints and forces


def jax_module() -> Any:
    """Return JAX, with numbers of 64 bits, and without threads that wait for each other."""
    os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false")
    jax: Any = import_module("jax")
    jax.config.update("jax_enable_x64", True)
    return jax


def _repeated(case: Case, dt: float, advance: Advance) -> Player:
    """Return the player that repeats a step of JAX."""
    loop = jax_module().lax.fori_loop

    def many(joints: Any, force: Any, steps: Any) -> Any:
        return loop(0, steps, lambda _, now: advance(now, force), joints)

    return _player(case, dt, many)


def _player(case: Case, dt: float, steps_of: Callable[[Any, Any, Any], Any]) -> Player:
    """Return the player of joints after a number of steps, from joints and forces, compiled."""
    many = jax_module().jit(steps_of)

    def player(state: Array, torque: Array, duration: float) -> tuple[Array, int]:
        joints = np.array([to_joints(case, values) for values in state])
        steps = count_of(duration, dt)
        reached = np.asarray(many(joints, forces_on(case, torque), steps))
        return np.array([from_joints(case, values) for values in reached]), steps

    return player


def mjx_step(case: Case, dt: float) -> Advance:
    """Return a step of MuJoCo in JAX, by its RK4."""
    jax = jax_module()
    mujoco: Any = import_module("mujoco")
    mjx: Any = import_module("mujoco.mjx")
    model = mujoco.MjModel.from_xml_string(chain_of(case).to_mjcf(timestep=dt))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    on_device, start = mjx.put_model(model), mjx.make_data(model)

    def advance(joints: Any, force: Any) -> Any:
        now = start.replace(qpos=joints[0], qvel=joints[1], qfrc_applied=force)
        after = mjx.step(on_device, now)
        return jax.numpy.stack([after.qpos, after.qvel])

    return advance


def mjx(case: Case, dt: float) -> Player:
    """Return MuJoCo in JAX."""
    return _repeated(case, dt, mjx_step(case, dt))


def brax_step(case: Case, dt: float) -> Advance:
    """Return a step of brax's generalized pipeline."""
    jax = jax_module()
    pipeline: Any = import_module("brax.generalized.pipeline")
    system = import_module("brax.io.mjcf").loads(_for_brax(case, dt))
    motors = np.flatnonzero(forces_on(case, np.ones(case.n)))

    def advance(joints: Any, force: Any) -> Any:
        state = pipeline.init(system, joints[0], joints[1])
        after = pipeline.step(system, state, force[motors])
        return jax.numpy.stack([after.q, after.qd])

    return advance


def brax(case: Case, dt: float) -> Player:
    """Return brax's generalized coordinates."""
    return _repeated(case, dt, brax_step(case, dt))


def brax_spring(case: Case, dt: float) -> Player:
    """Return brax's spring pipeline, whose joints are stiff springs between bodies."""
    jax = jax_module()
    pipeline: Any = import_module("brax.spring.pipeline")
    system = import_module("brax.io.mjcf").loads(_for_brax(case, dt))
    motors = np.flatnonzero(forces_on(case, np.ones(case.n)))

    def many(joints: Any, force: Any, steps: Any) -> Any:
        start = pipeline.init(system, joints[0], joints[1])
        torque = force[motors]
        end = jax.lax.fori_loop(0, steps, lambda _, now: pipeline.step(system, now, torque), start)
        return jax.numpy.stack([end.q, end.qd])

    return _player(case, dt, many)


def _for_brax(case: Case, dt: float) -> str:
    """Return the chain with a motor in each joint, which is how brax takes torques."""
    if case.mechanism.stiffness is not None:  # not even with steps of 1/4096 s
        raise ValueError("stiffness must be left out: brax turns and slides to another motion")
    text = chain_of(case).to_mjcf(motors=range(case.n), timestep=dt)
    return text.replace('integrator="RK4"', 'integrator="Euler"')


def jaxsim_step(case: Case, dt: float) -> Advance:
    """Return a step of JaxSim, by its RK4."""
    jax = jax_module()
    js: Any = import_module("jaxsim.api")
    model = js.model.JaxSimModel.build_from_model_description(
        _sdf(chain_of(case).to_urdf()), is_urdf=False, time_step=dt,
        gravity=case.mechanism.gravity, integrator=js.model.IntegratorType.RungeKutta4,
    )  # fmt: skip

    def advance(joints: Any, force: Any) -> Any:
        data = js.data.JaxSimModelData.build(
            model, joint_positions=joints[0], joint_velocities=joints[1]
        )
        after = js.model.step(model, data, joint_force_references=force)
        return jax.numpy.stack([after.joint_positions, after.joint_velocities])

    return advance


def _sdf(urdf: str) -> str:
    """Return a robot in SDF; JaxSim reads URDF by Gazebo only, which is in no package index."""
    root = ET.Element("sdf", version="1.10")
    robot, model = ET.fromstring(urdf), ET.SubElement(root, "model", name="chain")

    def add(above: ET.Element, **texts: str | None) -> None:
        for tag, text in texts.items():
            ET.SubElement(above, tag).text = text

    def placed(tag: str, name: str, relative_to: str, xyz: str, **about: str) -> ET.Element:
        made = ET.SubElement(model, tag, name=name, **about)
        ET.SubElement(made, "pose", relative_to=relative_to).text = f"{xyz} 0 0 0"
        return made

    base = ET.SubElement(ET.SubElement(model, "link", name="world-link"), "inertial")
    add(base, mass="1")  # of any: it is fixed
    add(ET.SubElement(base, "inertia"), ixx="1", iyy="1", izz="1", ixy="0", ixz="0", iyz="0")
    add(
        ET.SubElement(model, "joint", name="held", type="fixed"), parent="world", child="world-link"
    )
    for joint in robot.iter("joint"):
        given = {each.tag: each.attrib for each in joint}
        name, parent = joint.attrib["name"], f"{given['parent']['link']}-link"
        child = given["child"]["link"]
        kind = joint.attrib["type"].replace("continuous", "revolute")
        made = placed("joint", name, parent, given["origin"]["xyz"], type=kind)
        add(made, parent=parent, child=f"{child}-link")
        axis = ET.SubElement(made, "axis")
        add(axis, xyz=given["axis"]["xyz"])
        damping = given["dynamics"]["damping"]
        loss = {"damping": damping, "spring_reference": "0", "spring_stiffness": "0"}
        add(ET.SubElement(axis, "dynamics"), **loss)
        body = {
            each.tag: each.attrib for each in robot.iterfind(f"link[@name='{child}']/inertial/")
        }
        inertial = ET.SubElement(placed("link", f"{child}-link", name, "0 0 0"), "inertial")
        add(inertial, pose=f"{body['origin']['xyz']} 0 0 0", mass=body["mass"]["value"])
        add(ET.SubElement(inertial, "inertia"), **body["inertia"])
    return ET.tostring(root, encoding="unicode")


def jaxsim(case: Case, dt: float) -> Player:
    """Return JaxSim."""
    return _repeated(case, dt, jaxsim_step(case, dt))


def newton_of(case: Case, dt: float, **options: bool) -> Any:
    """Return Newton's model of a case, on the CPU by Warp."""
    if case.mechanism.stiffness is not None:
        raise ValueError("stiffness must be left out: a joint of Newton slides before it turns")
    wp: Any = import_module("warp")
    wp.config.quiet = True
    engine: Any = import_module("newton")
    with wp.ScopedDevice("cpu"):
        builder = engine.ModelBuilder(gravity=(0.0, 0.0, -case.mechanism.gravity))
        builder.add_mjcf(chain_of(case).to_mjcf(timestep=dt), parse_visuals=False)
        return builder.finalize(**options)


def featherstone(model: Any) -> Any:
    """Return Newton's solver of Featherstone without its damping."""
    return import_module("newton").solvers.SolverFeatherstone(model, angular_damping=0.0)


def set_newton(case: Case, model: Any, now: Any, control: Any, state: Array, torque: Array) -> None:
    """Set the state `now` and the torques of a model of Newton."""
    joints = np.array([to_joints(case, values) for values in state], np.float32)
    now.joint_q.assign(joints[0])
    now.joint_qd.assign(joints[1])
    control.joint_f.assign(forces_on(case, torque).astype(np.float32))
    import_module("newton").eval_fk(model, now.joint_q, now.joint_qd, now)


def newton(case: Case, dt: float) -> Player:
    """Return Newton, on the CPU by Warp."""
    model = newton_of(case, dt)
    wp: Any = import_module("warp")
    with wp.ScopedDevice("cpu"):
        solver, control = featherstone(model), model.control()
        now, after = model.state(), model.state()

    def player(state: Array, torque: Array, duration: float) -> tuple[Array, int]:
        nonlocal now, after
        steps = count_of(duration, dt)
        with wp.ScopedDevice("cpu"):
            set_newton(case, model, now, control, state, torque)
            for _ in range(steps):
                now.clear_forces()
                solver.step(now, after, control, None, dt)
                now, after = after, now
            reached = now.joint_q.numpy(), now.joint_qd.numpy()
        return np.array([from_joints(case, values) for values in reached]), steps

    return player


ENGINES = {
    "MJX RK4": Engine(mjx, "mujoco-mjx", "Runge-Kutta 4"),
    "brax generalized": Engine(brax, "brax", "semi-implicit Euler"),
    "brax spring": Engine(brax_spring, "brax", "bodies held by springs"),
    "JaxSim RK4": Engine(jaxsim, "jaxsim", "Runge-Kutta 4"),
    "Newton Featherstone": Engine(newton, "newton", "semi-implicit Euler", "float32"),
}
STEPS = {"MJX RK4": mjx_step, "brax generalized": brax_step, "JaxSim RK4": jaxsim_step}
