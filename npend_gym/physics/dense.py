"""The state of a motion at any instant, by the polynomials on its steps."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.physics.mechanism import mechanism_of
from npend_gym.physics.motion import MAX_BYTES, Integration, TakenSteps
from npend_gym.physics.recipe import AT_REST, motion_of
from npend_gym.physics.signals import varies
from npend_gym.physics.trajectory import STATE, Trajectory

_ROUNDING = 1e-9  # of the polynomial on the last step, at its end


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
        If an instant lies outside, the motion was not made by `simulate`, or its functions now lead
        to another end.

    Notes
    -----
    The polynomials on the steps that were taken, of order 7 for "dop853", 4 for "tsit5" and 3 for
    "rk4". Those of symplectic methods have degree 5. The first call integrates once more and keeps
    the steps, eight states for each, up to 8 GiB.

    It integrates up to the last of the times of the trajectory. After a terminal event its steps
    therefore differ from those of `simulate`: with "dop853" and "tsit5" the states agree within the
    tolerances, with others within the error of the method.
    """
    q, u = _halves(trajectory, times)
    n = trajectory.chain.n
    return q[..., :n].copy(), u[..., :n].copy()


def cart_at(trajectory: Trajectory, times: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return position [m] and velocity [m/s] of the cart at any instants, as `at` does.

    Raises
    ------
    ValueError, TypeError
        As `at`, and if there is no cart.
    """
    if trajectory.position is None or trajectory.chain.base is None:
        raise ValueError("cart_at() needs a trajectory of a chain with base=Cart(mass)")
    q, u = _halves(trajectory, times)
    n = trajectory.chain.n
    return q[..., n].copy(), u[..., n].copy()


def _halves(trajectory: Trajectory, times: ArrayLike) -> list[FloatArray]:
    """Return the coordinates and their rates at any instants."""
    if trajectory.theta.ndim < 3:
        return np.split(states_at(trajectory, times), 2, axis=-1)
    kept, states, size = trajectory.__dict__, list[FloatArray](), 0
    if "_steps" not in kept:
        kept["_steps"] = [trajectory[k] for k in range(len(trajectory))]
    latest = np.max(_checks.array("times", times), initial=-np.inf)
    for k, own in enumerate(kept["_steps"]):
        if own.status and latest > own.times[-1]:
            raise ValueError(
                f"times must lie within every motion: an event ended motion {k} at "
                f"{own.times[-1]:g} s, got {latest:g} s; ask each up to its end, "
                "trajectory[k].at(times)"
            )
        states.append(states_at(own, times))
        steps: TakenSteps | None = own.__dict__.get("_steps")
        size += 0 if steps is None else steps.polynomials.nbytes
        if size > MAX_BYTES:
            own.__dict__.pop("_steps", None)
    return np.split(np.array(states), 2, axis=-1)


def state_of(trajectory: Trajectory, k: int) -> FloatArray:
    """Return the coordinates, then their rates, at ``times[k]`` of one motion, (2m,)."""
    parts = (getattr(trajectory, name) for name in STATE)
    return np.concatenate([np.atleast_1d(part[k]) for part in parts if part is not None])


def retaken(trajectory: Trajectory) -> tuple[Integration, FloatArray]:
    """Return the motion of a trajectory, ready to be integrated once more, and its first state.

    Raises
    ------
    ValueError
        If `simulate` did not make it on this machine's processor, or a function was lost.
    """
    recipe = trajectory.recipe
    if recipe is None:
        raise ValueError(
            "at() and derivatives need a trajectory made by simulate(), which knows how its steps "
            "were taken"
        )
    accelerated, state = recipe.pivot_acceleration, state_of(trajectory, 0)
    mechanism = mechanism_of([trajectory.chain], AT_REST if varies(accelerated) else accelerated)
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
        steps = motion.steps(trajectory.times)
        if trajectory.status == 0:  # no event ended the motion: the same steps lead to its end
            check_same(steps.at(np.array(last)), trajectory, _ROUNDING)
        kept["_steps"] = steps
    return kept["_steps"].at(given)


def check_same(reached: FloatArray, trajectory: Trajectory, rounding: float = 0.0) -> None:
    """Raise a ValueError if a motion, integrated once more, reaches another state at its end."""
    if not np.allclose(reached, state_of(trajectory, -1), rtol=rounding, atol=rounding):
        raise ValueError(
            "the trajectory does not end where its start and settings lead: it was changed, or "
            "made by another version, or an event ended it, or a function of it returns something "
            "else than in simulate(); simulate it again, with values bound in the function "
            "(lambda t, theta, omega, gain=gain: ...)"
        )
