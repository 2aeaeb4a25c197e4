"""The dynamics beside MuJoCo and Pinocchio: evaluations and steps, of one chain and of many."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from importlib import import_module
from typing import Any

import numpy as np

from npend_gym import Chain
from npend_gym.compiled.arrays import aligned_zeros, packs
from npend_gym.compiled.jit import kernel
from npend_gym.compiled.packs import WIDTH
from npend_gym.physics.kernels.dynamics import AnyArrays, accelerations, new_work
from npend_gym.physics.kernels.member_rows import arrays_of
from npend_gym.physics.kernels.rk4 import new_rk4_scratch, rk4_step
from npend_gym.tools import FloatArray
from suites.timing import Job, Peers, Row, rates

LANES = 256  # chains side by side
_H = 1e-6  # s; so short that the chain hardly moves while it is timed


def rows(peers: Peers) -> Iterator[Row]:
    """Yield the comparisons; where a peer is left out, the package's own speed alone."""
    for n in (2, 5, 20, 100, 1000):
        bobs = Chain.uniform(n)
        ours = {"one evaluation": evaluations(bobs), "one RK4 step": steps(bobs)}
        for what, job in ours.items():
            theirs = peers.job("MuJoCo", lambda n=n, what=what: mujoco_jobs(n)[what])
            yield row_of(f"{what}, N = {n}", job, "MuJoCo", theirs)
    for n in (2, 5, 20, 100):
        theirs = peers.job("Pinocchio", lambda n=n: pinocchio_job(n))
        if theirs is not None:
            job = evaluations(Chain.uniform(n))
            yield row_of(f"one evaluation, N = {n}", job, "Pinocchio ABA", theirs)
    yield from batch_rows(peers)
    yield growth()
    yield from link_rows(peers)


def batch_rows(peers: Peers) -> Iterator[Row]:
    """Yield the comparisons of many chains with MuJoCo's batches, on one thread."""
    for n in (2, 5, 20, 100):
        for what, with_rods in (("point masses", False), ("rods", True)):
            ours = many_steps(rods(n) if with_rods else Chain.uniform(n), LANES)
            theirs = {
                "mujoco.batch.Batch": partial(mujoco_batch, n, with_rods),
                "mujoco.rollout": partial(mujoco_rollouts, n, with_rods),
            }
            for name, make in theirs.items():
                job = peers.job(name, make)
                yield row_of(f"RK4 steps of {LANES} chains of {what}, N = {n}", ours, name, job)


def link_rows(peers: Peers) -> Iterator[Row]:
    """Yield the comparisons of chains of uniform rods, which have inertia."""
    for n in (2, 5, 20, 100, 1000):
        theirs = peers.job("MuJoCo", lambda n=n: mujoco_jobs(n, rods=True)["one RK4 step"])
        yield row_of(f"one RK4 step of rods, N = {n}", steps(rods(n)), "MuJoCo", theirs)
    for n in (2, 5, 20, 100):
        bobs, joints = Chain.uniform(n), rods(n, friction=0.01)
        yield row_of(f"one RK4 step of rods, N = {n}", steps(rods(n)), "point masses", steps(bobs))
        many = many_steps(bobs, LANES)
        for what, chain in (("rods", rods(n)), ("rods with dry friction", joints)):
            name = f"RK4 steps of {LANES} chains of {what}, N = {n}"
            yield row_of(name, many_steps(chain, LANES), "point masses", many)


def rods(n: int, friction: float = 0.0) -> Chain:
    """Return a chain of uniform rods of 1 kg and 1 m."""
    return Chain.rods(np.ones(n), np.ones(n), friction=friction)


def row_of(name: str, ours: Job, peer: str, theirs: Job | None) -> Row:
    """Return the row of a job beside that of a peer, if there is one, timed in turns."""
    best = rates({"": ours} if theirs is None else {"": ours, peer: theirs})
    return Row(name, peer if theirs else "", best[""], best.get(peer, math.nan))


def growth() -> Row:
    """Return how the time of an evaluation grows from 100 to 100 000 rods."""
    counts = (100, 1_000, 10_000, 100_000)
    best = [rates({"": evaluations(Chain.uniform(n))}, rounds=3)[""] for n in counts]
    slope = -float(np.polyfit(np.log(counts), np.log(best), 1)[0])
    return Row("one evaluation, N = 100000", "", best[-1], math.nan, f"time grows as N^{slope:.2f}")


@kernel
def _repeat_evaluation(
    theta: FloatArray, omega: FloatArray, torque: FloatArray, rods: AnyArrays, work: FloatArray,
    alpha: FloatArray, times: int,
) -> None:  # fmt: skip
    """Evaluate the dynamics many times, as an integrator does: from compiled code."""
    for _ in range(times):
        accelerations(theta, omega, torque, rods, work, alpha)


@kernel
def _repeat_step(
    theta: FloatArray, omega: FloatArray, h: float, torque: FloatArray, rods: AnyArrays,
    scratch: FloatArray, times: int,
) -> None:  # fmt: skip
    for _ in range(times):
        rk4_step(0.0, theta, omega, h, torque, rods, scratch)


@kernel
def _repeat_steps(
    theta: FloatArray, omega: FloatArray, h: float, torque: FloatArray, rods: AnyArrays,
    scratch: FloatArray, times: int,
) -> None:  # fmt: skip
    """Take steps with groups of WIDTH equal chains, (groups, n WIDTH)."""
    wide = packs(rods)
    for group in range(theta.shape[0]):
        x, w = packs(theta[group]), packs(omega[group])
        for _ in range(times):
            rk4_step(0.0, x, w, h, packs(torque), wide, packs(scratch))


def evaluations(chain: Chain) -> Job:
    """Return the job of evaluating the dynamics of one chain released from pi/4."""
    theta, rest = np.full(chain.n, np.pi / 4), np.zeros(chain.n)
    given, work, alpha = arrays_of(chain.repeated(1)), new_work(chain.n), np.zeros(chain.n)

    def run(calls: int) -> None:
        _repeat_evaluation(theta, rest, rest, given, work, alpha, calls)

    return Job(run)


def steps(chain: Chain) -> Job:
    """Return the job of taking Runge-Kutta steps with one chain released from pi/4."""
    n, given = chain.n, arrays_of(chain.repeated(1))
    theta, omega, torque = np.full(n, np.pi / 4), np.zeros(n), np.zeros(n)
    scratch = new_rk4_scratch(n)

    def run(calls: int) -> None:
        _repeat_step(theta, omega, _H, torque, given, scratch, calls)

    return Job(run)


def many_steps(chain: Chain, lanes: int) -> Job:
    """Return the job of taking Runge-Kutta steps with many chains, a multiple of WIDTH."""
    n, groups, size = chain.n, lanes // WIDTH, chain.n * WIDTH
    theta, omega = aligned_zeros(groups, size), aligned_zeros(groups, size)
    theta[:] = np.pi / 4
    given = arrays_of(chain.repeated(WIDTH))
    scratch, torque = new_rk4_scratch(n, WIDTH), aligned_zeros(size)

    def run(calls: int) -> None:
        _repeat_steps(theta, omega, _H, torque, given, scratch, calls)

    return Job(run, lanes)


def mujoco_chain(n: int, dt: float = 0.01, *, rods: bool = False) -> tuple[Any, Any]:
    """Return MuJoCo's model and data of n bobs of 1 kg on rods of 1 m, released from pi/4.

    With `rods`, of uniform rods of 1 kg and 1 m. MuJoCo needs some inertia of bobs too; 1e-9 kg m^2
    has no visible effect.
    """
    centre, inertia = (0.5, 1.0 / 12.0) if rods else (1.0, 1e-9)
    mujoco: Any = import_module("mujoco")
    spec: Any = mujoco.MjSpec()
    spec.option.timestep, spec.option.integrator = dt, mujoco.mjtIntegrator.mjINT_RK4
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    body = spec.worldbody
    for i in range(n):
        body = body.add_body(pos=[0, 0, -1 if i else 0])
        body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, -1, 0])
        body.mass, body.ipos, body.inertia = 1.0, [0, 0, -centre], [inertia] * 3
        body.explicitinertial = True
    model = spec.compile()
    data: Any = mujoco.MjData(model)
    data.qpos[0] = np.pi / 4
    return model, data


def mujoco_jobs(n: int, *, rods: bool = False) -> dict[str, Job]:
    """Return MuJoCo's jobs of the same names as ours."""
    mujoco: Any = import_module("mujoco")
    model, data = mujoco_chain(n, rods=rods)

    def repeat(call: Callable[[Any, Any], None]) -> Callable[[int], None]:
        def run(times: int) -> None:
            for _ in range(times):
                call(model, data)

        return run

    forward, step = repeat(mujoco.mj_forward), repeat(mujoco.mj_step)
    return {"one evaluation": Job(forward), "one RK4 step": Job(step)}


def pinocchio_job(n: int) -> Job:
    """Return the job of Pinocchio's articulated-body algorithm, O(n), on the same chain."""
    pin: Any = import_module("pinocchio")
    model, joint = pin.Model(), 0
    for i in range(n):
        above = pin.SE3(np.eye(3), np.array([0.0, 0.0, -1.0 if i else 0.0]))
        joint = model.addJoint(joint, pin.JointModelRY(), above, f"joint {i}")
        bob = pin.Inertia(1.0, np.array([0.0, 0.0, -1.0]), np.zeros((3, 3)))
        model.appendBodyToJoint(joint, bob, pin.SE3.Identity())
    data, rest = model.createData(), np.zeros(n)
    angles = np.zeros(n)
    angles[0] = np.pi / 4

    def run(times: int) -> None:
        for _ in range(times):
            pin.aba(model, data, angles, rest, rest)

    return Job(run)


def mujoco_batch(n: int, with_rods: bool) -> Job:
    """Return the job of stepping many chains by mujoco.batch, one thread, two steps a call."""
    batch: Any = import_module("mujoco.batch")
    model, data = mujoco_chain(n, rods=with_rods)
    chains = batch.Batch(model, LANES, nthread=1)
    chains.qpos[:] = data.qpos

    def run(times: int) -> None:
        for _ in range(times):
            chains.step(nstep=2)

    return Job(run, 2.0 * LANES)


def mujoco_rollouts(n: int, with_rods: bool) -> Job:
    """Return the job of stepping many chains by mujoco.rollout, one thread, two steps a call."""
    mujoco: Any = import_module("mujoco")
    rollout: Any = import_module("mujoco.rollout")
    model, data = mujoco_chain(n, rods=with_rods)
    whole = mujoco.mjtState.mjSTATE_FULLPHYSICS
    size: int = mujoco.mj_stateSize(model, whole)
    state = np.zeros(size)
    mujoco.mj_getState(model, data, state, whole)
    states = np.tile(state, (LANES, 1))

    def run(times: int) -> None:
        for _ in range(times):
            rollout.rollout([model] * LANES, [data], states, nstep=2)

    return Job(run, 2.0 * LANES)
