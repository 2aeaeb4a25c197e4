"""Engines that play the cases: each is one function, from a case and a time step to a `Player`.

A player takes a state, (2, m) in the coordinates of the file, a constant torque in each joint,
(n,), and a duration. It returns the state after it and the number of steps. To add an engine, write
such a function and give it a name in `ENGINES`. An engine raises `ValueError` where it cannot
express a case; `to_mjcf` and `to_urdf` do so, and the text says what is missing.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from certify.cases import TIMES, Case
from certify.equations import Array, accelerations, energy
from certify.oracle import right_side
from npend_gym import Cart, Chain, simulate

Player = Callable[[Array, Array, float], tuple[Array, int]]


class Engine(NamedTuple):
    """An engine: who makes its player, which package it needs, how it integrates."""

    make: Callable[[Case, float], Player]
    package: str
    method: str
    precision: str = "float64"


class Played(NamedTuple):
    """What an engine made of a case."""

    states: Array  # at TIMES, (3, 2, m)
    microseconds: float  # a step
    steps: int  # in 10 s


def play(engine: Engine, case: Case, dt: float) -> Played:
    """Play a case; the CPU time is that after a first short run, which compiles."""
    player = engine.make(case, dt)
    player(case.start, case.intervals[0][2], 4.0 * dt)
    state, states, steps, begin = case.start, [], 0, time.process_time()
    for t, end, torque in case.intervals:
        state, made = player(state, torque, end - t)
        steps += made
        if end in TIMES:
            states.append(state)
    return Played(np.array(states), (time.process_time() - begin) / steps * 1e6, steps)


def errors(case: Case, played: Played) -> Array:
    """Return the largest error of any coordinate [rad, m] at each of TIMES."""
    return np.abs(played.states - case.states)[:, 0].max(axis=-1)


def energy_error(case: Case, played: Played) -> float:
    """Return the largest error of the energy at TIMES, in units of the energy to lift the chain.

    Where energy is conserved, this is its drift.
    """
    chain = case.mechanism
    pairs = zip(played.states, case.states, strict=True)
    off = [abs(energy(chain, *got) - energy(chain, *exact)) for got, exact in pairs]
    below = np.cumsum(chain.masses[::-1])[::-1]
    return float(np.max(off) / (2.0 * chain.gravity * below @ chain.lengths))


def chain_of(case: Case) -> Chain:
    """Return the case's chain for the package and its exporters."""
    given = case.mechanism._asdict()
    mass, damping = given.pop("cart_mass"), given.pop("cart_damping")
    return Chain(**given, base=None if mass is None else Cart(mass, damping))


def count_of(duration: float, dt: float) -> int:
    """Return how many steps there are in a duration."""
    return round(duration / dt)


def to_joints(case: Case, values: Array) -> Array:
    """Return coordinates as engines have them: cart, and from the pivot joint and slide."""
    n, springs = case.n, case.mechanism.stiffness is not None
    turns = np.diff(values[:n], prepend=0.0)
    each = np.stack([turns, values[-n:]], axis=1).ravel() if springs else turns
    return np.append(values[n : len(values) - n * springs], each)


def from_joints(case: Case, values: Array) -> Array:
    """Return an engine's coordinates in the order of the file."""
    n, springs = case.n, case.mechanism.stiffness is not None
    per_link = 2 if springs else 1
    cart, each = np.split(np.asarray(values, float), [len(values) - n * per_link])
    angles, stretches = np.cumsum(each[::per_link]), each[1::2] if springs else each[:0]
    return np.concatenate([angles, cart, stretches])


def forces_on(case: Case, torque: Array) -> Array:
    """Return torques of the joints as an engine's generalised forces."""
    turning = np.zeros(case.mechanism.size)
    turning[: case.n] = torque
    out = to_joints(case, turning)
    joints = out[len(out) - case.n * (2 if case.mechanism.stiffness is not None else 1) :]
    joints[:: len(joints) // case.n] = torque
    return out


def names_of(chain: Chain) -> list[tuple[str, str]]:
    """Return what `simulate` calls the coordinates of a chain and their velocities, in order."""
    return [("theta", "omega"), *[("position", "velocity")] * (chain.base is not None),
            *[("stretch", "stretch_rate")] * (chain.stiffness is not None)]  # fmt: skip


def start_of(chain: Chain, state: Array) -> dict[str, Any]:
    """Return a state (2, m) as keywords of `simulate`."""
    names = names_of(chain)
    ends = np.cumsum([chain.n if name[0] != "position" else 1 for name in names])[:-1]
    parts = zip(names, np.split(state, ends, axis=1), strict=True)
    given = {name: value for both, two in parts for name, value in zip(both, two, strict=True)}
    return given | {name: given[name][0] for name in ("position", "velocity") if name in given}


def ours(case: Case, dt: float, method: str = "dop853") -> Player:
    """Return the player of the package."""
    chain = chain_of(case)
    how: Any = {"dt": dt} if method == "rk4" else {"rtol": 1e-13, "atol": 1e-14}

    def player(state: Array, torque: Array, duration: float) -> tuple[Array, int]:
        given = start_of(chain, state)
        motion = simulate(
            chain, times=[0.0, duration], torque=torque, method=method, **how, **given
        )
        names = names_of(chain)
        rows = [[np.atleast_1d(getattr(motion, both[k])[-1]) for both in names] for k in (0, 1)]
        steps = count_of(duration, dt) if motion.counts is None else int(motion.counts[0])
        return np.array([np.concatenate(row) for row in rows]), steps

    return player


def ours_rk4(case: Case, dt: float) -> Player:
    """Return the player of the package with Runge-Kutta steps."""
    return ours(case, dt, "rk4")


def scipy(case: Case, dt: float) -> Player:
    """Return SciPy's DOP853 on the dense equations."""
    from scipy.integrate import solve_ivp

    del dt
    m, chain = case.mechanism.size, case.mechanism

    def player(state: Array, torque: Array, duration: float) -> tuple[Array, int]:
        def rates(_t: float, y: Array) -> Array:
            return np.append(y[m:], accelerations(chain, y[:m], y[m:], torque))

        span = (0.0, duration)
        found = solve_ivp(rates, span, state.ravel(), "DOP853", rtol=1e-13, atol=1e-14)
        return found.y[:, -1].reshape(2, m), len(found.t) - 1

    return player


def heyoka(case: Case, dt: float) -> Player:
    """Return heyoka's Taylor method, which compiles the dense equations."""
    hy: Any = import_module("heyoka")
    del dt
    m, n = case.mechanism.size, case.n
    method = hy.taylor_adaptive(right_side(case), [0.0] * (2 * m), compact_mode=m > 3)

    def player(state: Array, torque: Array, duration: float) -> tuple[Array, int]:
        method.time, method.state[:], method.pars[:n] = 0.0, state.ravel(), torque
        steps = method.propagate_until(duration)[3]
        return method.state.reshape(2, m).copy(), steps

    return player


def mujoco(case: Case, dt: float, integrator: str = "RK4") -> Player:
    """Return MuJoCo with a model by `to_mjcf`."""
    mj: Any = import_module("mujoco")
    model = mj.MjModel.from_xml_string(chain_of(case).to_mjcf(timestep=dt))
    model.opt.integrator = getattr(mj.mjtIntegrator, f"mjINT_{integrator.upper()}")
    data = mj.MjData(model)

    def player(state: Array, torque: Array, duration: float) -> tuple[Array, int]:
        data.qpos[:], data.qvel[:] = (to_joints(case, values) for values in state)
        data.qfrc_applied[:], steps = forces_on(case, torque), count_of(duration, dt)
        mj.mj_step(model, data, nstep=steps)
        return np.array([from_joints(case, v) for v in (data.qpos, data.qvel)]), steps

    return player


def pinocchio(case: Case, dt: float) -> Player:
    """Return Pinocchio's articulated-body algorithm, called from Python by RK4."""
    pin: Any = import_module("pinocchio")
    chain, n = case.mechanism, case.n
    model = pin.buildModelFromXML(_urdf(case))
    model.gravity.linear = np.array([0.0, 0.0, -chain.gravity])
    data, damping = model.createData(), forces_on(case, chain.damping)
    damping[: len(damping) - n] = chain.cart_damping
    sizes = [joint.nq for joint in model.joints[1:]]  # joints without limits: cosine and sine

    def player(state: Array, torque: Array, duration: float) -> tuple[Array, int]:
        q, v = (to_joints(case, values) for values in state)
        force = forces_on(case, torque)

        def acceleration(q: Array, v: Array) -> Array:
            pairs = zip(sizes, q, strict=True)
            parts = [[x] if k == 1 else [np.cos(x), np.sin(x)] for k, x in pairs]
            return pin.aba(model, data, np.concatenate(parts), v, force - damping * v)

        steps = count_of(duration, dt)
        for _ in range(steps):
            a1 = acceleration(q, v)
            v2 = v + 0.5 * dt * a1
            a2 = acceleration(q + 0.5 * dt * v, v2)
            v3 = v + 0.5 * dt * a2
            a3 = acceleration(q + 0.5 * dt * v2, v3)
            v4 = v + dt * a3
            a4 = acceleration(q + dt * v3, v4)
            q = q + dt / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4)
            v = v + dt / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
        return np.array([from_joints(case, q), from_joints(case, v)]), steps

    return player


def drake(case: Case, dt: float, discrete: bool = False) -> Player:
    """Return Drake's multibody plant: fixed steps of its RK3, or its own discrete steps."""
    every: Any = import_module("pydrake.all")
    builder = every.DiagramBuilder()
    plant = every.MultibodyPlant(dt if discrete else 0.0)
    builder.AddSystem(plant)
    every.Parser(plant).AddModelsFromString(_urdf(case), "urdf")
    plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, -case.mechanism.gravity])
    plant.Finalize()
    diagram = builder.Build()
    simulator = every.Simulator(diagram)
    if not discrete:
        every.ResetIntegratorFromFlags(simulator, "runge_kutta3", dt)
        simulator.get_mutable_integrator().set_fixed_step_mode(True)
    context = simulator.get_mutable_context()
    inner = plant.GetMyMutableContextFromRoot(context)
    port, m = plant.get_applied_generalized_force_input_port(), case.mechanism.size

    def player(state: Array, torque: Array, duration: float) -> tuple[Array, int]:
        values = np.concatenate([to_joints(case, values) for values in state])
        plant.SetPositionsAndVelocities(inner, values)
        port.FixValue(inner, forces_on(case, torque))
        context.SetTime(0.0)
        simulator.Initialize()
        simulator.AdvanceTo(duration)
        reached = plant.GetPositionsAndVelocities(inner).reshape(2, m)
        return np.array([from_joints(case, values) for values in reached]), count_of(duration, dt)

    return player


def pybullet(case: Case, dt: float) -> Player:
    """Return PyBullet's articulated bodies."""
    import tempfile
    from pathlib import Path

    pb: Any = import_module("pybullet")
    text = _urdf(case)  # what it cannot express is refused before the engine starts
    client = pb.connect(pb.DIRECT)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "chain.urdf"
        path.write_text(text, encoding="utf-8")
        flags = pb.URDF_USE_INERTIA_FROM_FILE
        body = pb.loadURDF(str(path), useFixedBase=True, flags=flags, physicsClientId=client)
    here = {"physicsClientId": client}
    pb.setGravity(0.0, 0.0, -case.mechanism.gravity, **here)
    pb.setTimeStep(dt, **here)
    joints = [*range(pb.getNumJoints(body, **here))]
    quiet = {"linearDamping": 0.0, "angularDamping": 0.0, "maxJointVelocity": 1e9}
    for link in (-1, *joints):
        pb.changeDynamics(body, link, **quiet, **here)
    pb.setJointMotorControlArray(
        body, joints, pb.VELOCITY_CONTROL, forces=[0.0] * len(joints), **here
    )

    def player(state: Array, torque: Array, duration: float) -> tuple[Array, int]:
        values = np.array([to_joints(case, values) for values in state])
        for joint in joints:
            pb.resetJointState(body, joint, *values[:, joint], **here)
        force, steps = forces_on(case, torque).tolist(), count_of(duration, dt)
        for _ in range(steps):
            if any(force):
                pb.setJointMotorControlArray(body, joints, pb.TORQUE_CONTROL, forces=force, **here)
            pb.stepSimulation(**here)
        reached = np.array([one[:2] for one in pb.getJointStates(body, joints, **here)]).T
        return np.array([from_joints(case, values) for values in reached]), steps

    return player


def _urdf(case: Case) -> str:
    return chain_of(case).to_urdf()


def _with(function: Callable[..., Player], **options: Any) -> Callable[[Case, float], Player]:
    """Return a maker of players with options."""
    return lambda case, dt: function(case, dt, **options)


ENGINES = {
    "npend_gym dop853": Engine(ours, "npend_gym", "Dormand-Prince 8(5,3), rtol 1e-13"),
    "npend_gym rk4": Engine(ours_rk4, "npend_gym", "Runge-Kutta 4"),
    "SciPy DOP853": Engine(scipy, "scipy", "Dormand-Prince 8(5,3), rtol 1e-13, dense equations"),
    "heyoka": Engine(heyoka, "heyoka", "Taylor, dense equations compiled"),
    "MuJoCo RK4": Engine(mujoco, "mujoco", "Runge-Kutta 4"),
    "MuJoCo Euler": Engine(_with(mujoco, integrator="Euler"), "mujoco", "semi-implicit Euler"),
    "MuJoCo implicitfast": Engine(
        _with(mujoco, integrator="implicitfast"), "mujoco", "Euler, implicit in velocities"
    ),
    "Pinocchio RK4": Engine(pinocchio, "pin", "Runge-Kutta 4 in Python"),
    "Drake RK3": Engine(drake, "drake", "Runge-Kutta 3"),
    "Drake discrete": Engine(_with(drake, discrete=True), "drake", "semi-implicit Euler"),
    "PyBullet": Engine(pybullet, "pybullet", "semi-implicit Euler"),
}
