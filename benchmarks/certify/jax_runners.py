"""Engines that JAX or Warp compiles, as in `runners.py`; these have derivatives too."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

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

# joints (2, m) after a step of dt, or after a number of steps, from joints and forces
Advance = Callable[[Any, Any, Any], Any]


def jax_module() -> Any:
    """Return JAX, with numbers of 64 bits."""
    jax: Any = import_module("jax")
    jax.config.update("jax_enable_x64", True)
    return jax


def _repeated(case: Case, dt: float, advance: Advance) -> Player:
    """Return the player that repeats a step of JAX."""
    loop = jax_module().lax.fori_loop

    def many(joints: Any, force: Any, steps: Any) -> Any:
        return loop(0, steps, lambda _, now: advance(now, force, dt), joints)

    return _player(case, dt, many)


def _player(case: Case, dt: float, steps_of: Advance) -> Player:
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

    def advance(joints: Any, force: Any, dt: float) -> Any:
        del dt
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

    def advance(joints: Any, force: Any, dt: float) -> Any:
        del dt
        state = pipeline.init(system, joints[0], joints[1])
        after = pipeline.step(system, state, force)
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

    def many(joints: Any, force: Any, steps: Any) -> Any:
        start = pipeline.init(system, joints[0], joints[1])
        end = jax.lax.fori_loop(0, steps, lambda _, now: pipeline.step(system, now, force), start)
        return jax.numpy.stack([end.q, end.qd])

    return _player(case, dt, many)


def _for_brax(case: Case, dt: float) -> str:
    """Return the chain with a motor in each joint, which is how brax takes forces."""
    motors = [*range(case.n)]
    if case.mechanism.cart_mass is not None:
        motors = [case.n, *motors]
    text = chain_of(case).to_mjcf(motors=motors, timestep=dt)
    return text.replace('integrator="RK4"', 'integrator="Euler"')


def jaxsim_step(case: Case, dt: float) -> Advance:
    """Return a step of JaxSim, by its RK4; it reads URDF by a program of Gazebo, gz."""
    jax = jax_module()
    js: Any = import_module("jaxsim.api")
    model = js.model.JaxSimModel.build_from_model_description(
        chain_of(case).to_urdf(), is_urdf=True, time_step=dt, gravity=case.mechanism.gravity,
        integrator=js.model.IntegratorType.RungeKutta4,
    )  # fmt: skip

    def advance(joints: Any, force: Any, dt: float) -> Any:
        del dt
        data = js.data.JaxSimModelData.build(
            model, joint_positions=joints[0], joint_velocities=joints[1]
        )
        after = js.model.step(model, data, joint_force_references=force)
        return jax.numpy.stack([after.joint_positions, after.joint_velocities])

    return advance


def jaxsim(case: Case, dt: float) -> Player:
    """Return JaxSim."""
    return _repeated(case, dt, jaxsim_step(case, dt))


def newton(case: Case, dt: float, solver: str = "Featherstone") -> Player:
    """Return Newton, on the CPU by Warp."""
    wp: Any = import_module("warp")
    wp.config.quiet = True
    engine: Any = import_module("newton")
    with wp.ScopedDevice("cpu"):
        builder = engine.ModelBuilder(gravity=(0.0, 0.0, -case.mechanism.gravity))
        builder.add_mjcf(chain_of(case).to_mjcf(timestep=dt), parse_visuals=False)
        model = builder.finalize()
        options = {"angular_damping": 0.0} if solver == "Featherstone" else {}
        stepper = getattr(engine.solvers, f"Solver{solver}")(model, **options)
        now, after, control = model.state(), model.state(), model.control()

    def player(state: Array, torque: Array, duration: float) -> tuple[Array, int]:
        nonlocal now, after
        joints = np.array([to_joints(case, values) for values in state], np.float32)
        steps = count_of(duration, dt)
        with wp.ScopedDevice("cpu"):
            now.joint_q.assign(joints[0])
            now.joint_qd.assign(joints[1])
            control.joint_f.assign(forces_on(case, torque).astype(np.float32))
            engine.eval_fk(model, now.joint_q, now.joint_qd, now)
            for _ in range(steps):
                now.clear_forces()
                stepper.step(now, after, control, None, dt)
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
