"""Derivatives of the state after 1 s by the start, which engines that can have them compute."""

from __future__ import annotations

from typing import Any

import numpy as np

from certify.cases import Case
from certify.equations import Array
from certify.jax_runners import STEPS, count_of, forces_on, from_joints, jax_module, to_joints
from certify.runners import chain_of
from npend_gym import simulate

FIELDS = ("case", "engine", "version", "method", "precision", "error", "reason", "made_by")


def compared(name: str, case: Case, dt: float) -> dict[str, Any]:
    """Return the error of an engine's derivative, relative to the largest entry."""
    matrix = ours(case) if name == "npend_gym dop853" else by_jax(name, case, dt)
    exact = case.derivative
    return {"error": f"{np.abs(matrix - exact).max() / np.abs(exact).max():.3g}"}


def ours(case: Case) -> Array:
    """Return the derivative by the package's variational equations."""
    n, m = case.n, case.mechanism.size
    given: dict[str, Any] = dict(zip(("theta", "omega"), case.start[:, :n], strict=True))
    if m > n:
        given |= dict(zip(("position", "velocity"), case.start[:, n], strict=True))
    motion = simulate(
        chain_of(case), times=[0.0, 1.0], torque=case.intervals[0][2], rtol=1e-13, atol=1e-14,
        **given,
    )  # fmt: skip
    return motion.sensitivities().A[-1]


def by_jax(name: str, case: Case, dt: float) -> Array:
    """Return the derivative through an engine's steps, by forward differentiation."""
    jax, advance = jax_module(), STEPS[name](case, dt)
    force, steps = forces_on(case, case.intervals[0][2]), count_of(1.0, dt)

    def end(joints: Any) -> Any:
        return jax.lax.fori_loop(0, steps, lambda _, now: advance(now, force, dt), joints)

    joints = np.array([to_joints(case, values) for values in case.start])
    size = 2 * case.mechanism.size
    matrix = np.asarray(jax.jit(jax.jacfwd(end))(joints)).reshape(size, size)
    # angles of the file are sums of angles of the joints
    change = np.kron(np.eye(2), [from_joints(case, e) for e in np.eye(case.mechanism.size)]).T
    return change @ matrix @ np.linalg.inv(change)


ENGINES = ("npend_gym dop853", *STEPS)
