"""What gradients cost: beside the step they belong to, beside differences, beside JAX's engines."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from importlib import import_module
from typing import Any

import numpy as np

from npend_gym.chain import Chain
from npend_gym.physics import DifferentiableEnsemble, Ensemble
from npend_gym.physics.step import Chains, Cut, State, vjp
from npend_gym.tools import FloatArray
from suites.dynamics import many_steps, mujoco_chain, row_of
from suites.timing import Job, Peers, Row

_H = 1e-6  # s; so short that the chains hardly move while they are timed
_LANES = {2: 1024, 5: 1024, 20: 1024, 100: 256, 1000: 64}  # by N
_STATES = 240  # whose Jacobians a planner wants: 12 s of environment steps
_DT = 0.05  # s, of an environment step
_DOUBLE = 1024  # double pendulums beside other engines


def rows(peers: Peers) -> Iterator[Row]:
    """Yield the comparisons with the package's own steps, with differences and with peers."""
    for n, lanes in _LANES.items():
        chain = Chain.uniform(n)
        step = many_steps(chain, lanes)
        for what, by_parameters in (("state, torque", False), ("state, torque, parameters", True)):
            name = f"RK4 step with its gradient by {what}, N = {n}, {lanes} lanes"
            row = row_of(name, gradients(chain, lanes, by_parameters), "the step", step)
            yield row._replace(note=f"{1.0 / row.ratio:.2f} times the time of the step")
    for n in (2, 3, 5, 10, 20):
        name = f"Jacobians of {_STATES} environment steps, N = {n}"
        yield row_of(name, jacobians(n), "central differences", differences(n))
    name = f"a step and its gradient, {_DOUBLE} double pendulums"
    for peer, make in {"MJX": mjx, "brax": brax}.items():
        theirs = peers.job(peer, make)
        if theirs is not None:
            yield row_of(name, double_pendulums(), f"{peer}, float32", theirs)


def gradients(chain: Chain, lanes: int, by_parameters: bool) -> Job:
    """Return the job of taking Runge-Kutta steps and gradients back through them."""
    chains = Chains(chain.repeated(1), terms=0)
    q, ones = np.full((lanes, chain.n), np.pi / 4), np.ones((lanes, chain.n))
    state = State(q, 0.0 * q, q[:, :0], np.zeros(0, np.int64))
    names = ("masses", "lengths", "damping", "gravity") if by_parameters else ()

    def run(calls: int) -> None:
        for _ in range(calls):
            vjp(chains, state, Cut(_H, 1, math.inf), (ones, ones), names)

    return Job(run, lanes)


def _states(n: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    rng = np.random.default_rng(n)
    theta, omega = rng.uniform(-np.pi, np.pi, (_STATES, n)), rng.normal(size=(_STATES, n))
    return theta, omega, rng.normal(size=(_STATES, 1))


def jacobians(n: int) -> Job:
    """Return the job of the exact Jacobians of steps from many states, one motor at the pivot."""
    theta, omega, torque = _states(n)
    ensemble = DifferentiableEnsemble(Chain.uniform(n), _STATES)

    def run(calls: int) -> None:
        for _ in range(calls):
            ensemble.set_state(slice(None), theta, omega)
            ensemble.step_jacobian(torque, _DT)

    return Job(run, _STATES)


def differences(n: int, step: float = 1e-5) -> Job:
    """Return the job of the same Jacobians by central differences, all side by side."""
    at, inputs = np.hstack(_states(n)), 2 * n + 1
    shift = step * np.eye(inputs)
    ensemble = Ensemble(Chain.uniform(n), _STATES * 2 * inputs)

    def run(calls: int) -> None:
        for _ in range(calls):
            places = at[:, None, None] + np.stack([shift, -shift], axis=1)
            flat = places.reshape(-1, inputs)
            ensemble.set_state(slice(None), flat[:, :n], flat[:, n : 2 * n])
            ensemble.advance(flat[:, 2 * n :], _DT)
            reached = np.hstack([ensemble.theta, ensemble.omega])
            reached = reached.reshape(_STATES, inputs, 2, 2 * n)
            np.swapaxes(reached[:, :, 0] - reached[:, :, 1], 1, 2) / (2.0 * step)

    return Job(run, _STATES)


def double_pendulums() -> Job:
    """Return the job of a Runge-Kutta step and its gradient by the public names."""
    ensemble = DifferentiableEnsemble(Chain.uniform(2), _DOUBLE, joints=(0, 1))
    theta = np.random.default_rng(0).normal(size=(_DOUBLE, 2))
    torque = np.zeros_like(theta)

    def run(calls: int) -> None:
        for _ in range(calls):
            ensemble.set_state(slice(None), theta, 0.0)
            ensemble.step_vjp(torque, 0.01, 1, theta_bar=1.0, omega_bar=1.0)

    return Job(run, _DOUBLE)


def _jax_job(step: Callable[[Any, Any, Any], Any]) -> Job:
    """Return the job of a sum over the state after `step`, and its gradient, of many lanes."""
    jax: Any = import_module("jax")
    state = jax.numpy.asarray(np.random.default_rng(0).normal(size=(_DOUBLE, 2)), "float32")
    rest = jax.numpy.zeros_like(state)
    gradient = jax.jit(jax.vmap(jax.value_and_grad(step, argnums=(0, 1, 2))))

    def run(calls: int) -> None:
        for _ in range(calls):
            jax.block_until_ready(gradient(state, rest, rest))

    return Job(run, _DOUBLE)


def mjx() -> Job:
    """Return the job of MJX: MuJoCo's step in JAX, by its own Runge-Kutta method."""
    mujoco: Any = import_module("mujoco")
    engine: Any = import_module("mujoco.mjx")
    model, data = mujoco_chain(2)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    on_device, start = engine.put_model(model), engine.put_data(model, data)

    def step(angles: Any, rates: Any, torque: Any) -> Any:
        now = start.replace(qpos=angles, qvel=rates, qfrc_applied=torque)
        after = engine.step(on_device, now)
        return after.qpos.sum() + after.qvel.sum()

    return _jax_job(step)


def brax() -> Job:
    """Return the job of brax's generalized pipeline, with one step of its semi-implicit method."""
    pipeline: Any = import_module("brax.generalized.pipeline")
    mjcf: Any = import_module("brax.io.mjcf")
    bob = '<geom type="sphere" size="0.01" pos="0 0 -1" mass="1" contype="0" conaffinity="0"/>'
    rod = f'<joint type="hinge" axis="0 -1 0"/>{bob}'
    bodies = f'<body>{rod}<body pos="0 0 -1">{rod}</body></body>'
    system = mjcf.loads(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
    nothing = np.zeros(system.act_size())

    def step(angles: Any, rates: Any, torque: Any) -> Any:
        del torque  # there are no actuators
        after = pipeline.step(system, pipeline.init(system, angles, rates), nothing)
        return after.q.sum() + after.qd.sum()

    return _jax_job(step)
