"""Derivatives of the state after 1 s by the start, which engines that can have them compute."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np

from certify.cases import Case
from certify.equations import Array
from certify.jax_runners import (
    STEPS,
    count_of,
    featherstone,
    forces_on,
    from_joints,
    jax_module,
    newton_of,
    set_newton,
    to_joints,
)
from certify.runners import chain_of, start_of
from npend_gym import simulate

FIELDS = ("case", "engine", "version", "method", "precision", "error", "reason", "made_by")


def compared(name: str, case: Case, dt: float) -> dict[str, Any]:
    """Return the error of an engine's derivative, relative to the largest entry."""
    if name == "npend_gym dop853":
        matrix = ours(case)
    else:
        matrix = by_jax(name, case, dt) if name in STEPS else by_warp(case, dt)
    exact = case.derivative
    return {"error": f"{np.abs(matrix - exact).max() / np.abs(exact).max():.3g}"}


def ours(case: Case) -> Array:
    """Return the derivative by the package's variational equations."""
    chain = chain_of(case)
    motion = simulate(
        chain, times=[0.0, 1.0], torque=case.intervals[0][2], rtol=1e-13, atol=1e-14,
        **start_of(chain, case.start),
    )  # fmt: skip
    return motion.sensitivities().A[-1]


def by_jax(name: str, case: Case, dt: float) -> Array:
    """Return the derivative through an engine's steps, by forward differentiation."""
    jax, advance = jax_module(), STEPS[name](case, dt)
    force, steps = forces_on(case, case.intervals[0][2]), count_of(1.0, dt)

    def end(joints: Any) -> Any:
        return jax.lax.fori_loop(0, steps, lambda _, now: advance(now, force), joints)

    joints = np.array([to_joints(case, values) for values in case.start])
    size = 2 * case.mechanism.size
    return _by_angles(case, np.asarray(jax.jit(jax.jacfwd(end))(joints)).reshape(size, size))


def by_warp(case: Case, dt: float) -> Array:
    """Return the derivative through Newton's steps, by Warp's tape, backward."""
    model = newton_of(case, dt, requires_grad=True)
    wp: Any = import_module("warp")
    steps, m = count_of(1.0, dt), case.mechanism.size
    with wp.ScopedDevice("cpu"):
        states = [model.state(requires_grad=True) for _ in range(steps + 1)]
        control, tape, begin, end = model.control(), wp.Tape(), states[0], states[-1]
        solvers = [featherstone(model) for _ in range(steps)]  # each keeps one mass matrix
        set_newton(case, model, begin, control, case.start, case.intervals[0][2])
        with tape:
            for now, after, solver in zip(states[:-1], states[1:], solvers, strict=True):
                now.clear_forces()
                solver.step(now, after, control, None, dt)
        rows = []
        for seed in np.eye(2 * m, dtype=np.float32):
            parts = [wp.array(part, dtype=wp.float32) for part in seed.reshape(2, m)]
            tape.zero()
            tape.backward(grads=dict(zip((end.joint_q, end.joint_qd), parts, strict=True)))
            grads = begin.joint_q.grad.numpy(), begin.joint_qd.grad.numpy()
            rows.append(np.concatenate(grads).astype(float))
    return _by_angles(case, np.array(rows))


def _by_angles(case: Case, matrix: Array) -> Array:
    """Return a derivative of joints as one of angles, which are sums of angles of the joints."""
    change = np.kron(np.eye(2), [from_joints(case, e) for e in np.eye(case.mechanism.size)]).T
    return change @ matrix @ np.linalg.inv(change)


ENGINES = ("npend_gym dop853", *STEPS, "Newton Featherstone")
