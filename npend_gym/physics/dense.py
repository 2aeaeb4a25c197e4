"""The state of a motion at any instant, by the polynomials on its steps."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.physics.functions import NAMES
from npend_gym.physics.mechanism import AXIAL, PIVOT, mechanism_of
from npend_gym.physics.motion import Motion
from npend_gym.physics.recipe import AT_REST, Function, motion_of
from npend_gym.physics.signals import varies
from npend_gym.physics.trajectory import Trajectory


def at(trajectory: Trajectory, times: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return angles and angular velocities at any instants: the dense output.

    Parameters
    ----------
    times : array_like, shape (...)
        Instants [s], within the first and the last of the motion.

    Returns
    -------
    theta, omega : ndarray, shape (..., n), or (B, ..., n)

    Raises
    ------
    ValueError, TypeError
        If an instant lies outside, or the motion was not made by `simulate`.

    Notes
    -----
    The polynomials on the steps that were taken, of order 7 for "dop853" and 3 for "rk4". The
    first call integrates once more and keeps the steps, eight states for each.
    """
    states, n = _states(trajectory, times), trajectory.chain.n
    half = states.shape[-1] // 2
    return states[..., :n].copy(), states[..., half : half + n].copy()


def cart_at(trajectory: Trajectory, times: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return position [m] and velocity [m/s] of the cart at any instants, as `at` does.

    Raises
    ------
    ValueError, TypeError
        As `at`, and if there is no cart.
    """
    if trajectory.position is None or trajectory.chain.base is None:
        raise ValueError("cart_at() needs a trajectory of a chain with base=Cart(mass)")
    states, n = _states(trajectory, times), trajectory.chain.n
    return states[..., n].copy(), states[..., states.shape[-1] // 2 + n].copy()


def _states(trajectory: Trajectory, times: ArrayLike) -> FloatArray:
    if trajectory.theta.ndim > 2:
        return np.array([states_at(trajectory[k], times) for k in range(len(trajectory))])
    return states_at(trajectory, times)


def retaken(trajectory: Trajectory) -> tuple[Motion, FloatArray]:
    """Return the motion of a trajectory, ready to be integrated once more, and its first state.

    Raises
    ------
    ValueError
        If `simulate` did not make it on this machine's processor, or a function was lost.
    """
    recipe, chain = trajectory.recipe, trajectory.chain
    if recipe is None:
        raise ValueError(
            "at() and derivatives need a trajectory made by simulate(), which knows how its steps "
            "were taken"
        )
    for name in NAMES:
        each = getattr(recipe, name)
        if isinstance(each, Function) and each.function is None:
            each()
    accelerated = recipe.pivot_acceleration
    if varies(accelerated):
        accelerated = AT_REST
    mechanism = mechanism_of([chain], accelerated)
    parts = [[trajectory.theta], [trajectory.omega]]
    for names in (PIVOT, AXIAL):
        for row, name in zip(parts, names, strict=True):
            value = getattr(trajectory, name)
            if value is not None:
                row.append(value if value.ndim == 2 else value[:, None])
    state = np.concatenate([each[0] for row in parts for each in row])
    return motion_of(mechanism, state, float(trajectory.times[0]), recipe), state


def states_at(trajectory: Trajectory, times: ArrayLike) -> FloatArray:
    """Return the states of one motion at any instants, (..., 2m); see `Trajectory.at`."""
    given, (first, last) = _checks.array("times", times), trajectory.times[[0, -1]]
    if np.any((given < first) | (given > last)):
        raise ValueError(
            f"times must lie within the motion, {first:g} to {last:g} s, got "
            f"{_checks.show(given.tolist())}"
        )
    kept = trajectory.__dict__
    if "_steps" not in kept:
        motion, state = retaken(trajectory)
        if first == last:
            return np.broadcast_to(state, (*given.shape, state.size))
        kept["_steps"] = motion.steps(trajectory.times)
    return kept["_steps"].at(given)
