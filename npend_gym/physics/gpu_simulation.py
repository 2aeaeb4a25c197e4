"""`simulate` of many motions on a GPU."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym._provenance import provenance
from npend_gym.chain import Chain, check_hung
from npend_gym.physics.arguments import check_limits, check_states, check_torque
from npend_gym.physics.gpu import DeviceChains
from npend_gym.physics.integration import check_times, count_steps, diverged
from npend_gym.physics.trajectory import Trajectory

_MAX_LAUNCH = 2**16  # steps in one launch, so that Ctrl-C is heard

IntArray = NDArray[np.int64]


def simulate_on_device(
    chain: Chain,
    theta: ArrayLike,
    omega: ArrayLike,
    times: ArrayLike,
    *,
    dt: float,
    torque: ArrayLike | None = None,
) -> Trajectory:
    """Return many motions side by side from a GPU, by the method "rk4" of `simulate`.

    Needs the extra "cuda".

    Parameters
    ----------
    chain : Chain
        One for all, of rigid rods on a pivot at rest.
    theta, omega : array_like, shape (..., n)
        Angles [rad] and angular velocities [rad/s] at ``times[0]``.
    times : array_like, shape (T,)
        Instants at which the states are wanted [s], increasing.
    dt : float
        Longest step [s].
    torque : float or array_like, shape (..., n), optional
        Constant torque [N m]: a number acts on joint 0, an array on every joint.

    Returns
    -------
    Trajectory
        Its `theta` has the shape (..., T, n).

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.
    IntegrationError
        If a state diverges.

    Examples
    --------
    >>> import numpy as np
    >>> from npend_gym import Chain, physics
    >>> starts = np.random.default_rng(0).uniform(-1.0, 1.0, (1000, 2))
    >>> chain, times = Chain.uniform(2), [0.0, 1.0]
    >>> physics.simulate_on_device(chain, starts, 0.0, times, dt=0.01)  # doctest: +SKIP
    """
    n, given = check_hung(chain, "simulate_on_device").n, check_torque(torque, chain.n)
    times, dt = check_times(times, n), _checks.positive_number("dt", dt)
    states = check_states(n, theta=theta, omega=omega, torque=given)
    check_limits(*states[:2])
    leading, rods = states[0].shape[:-1], states[0].size
    if rods == 0:
        raise ValueError(
            f"theta, omega and torque must hold one state or more, got shape {states[0].shape}"
        )
    check_times(times, rods)
    lanes = [values.reshape(-1, n).T for values in states]
    steps, chains = count_steps(times, dt), DeviceChains(chain, rods // n)
    frames = np.empty((2, times.size, n, rods // n))
    frames[:, 0] = lanes[:2]
    for k, frame in enumerate(_frames(chains, lanes, np.diff(times), steps[1:]), start=1):
        if frame is None:
            raise diverged(times[k - 1 : k + 1], dt)
        frames[:, k] = frame
    result = np.moveaxis(frames, 3, 1).reshape(2, *leading, times.size, n)
    arguments = {"method": "rk4", "dt": dt, "torque": given.tolist(), "device": chains.device}
    return Trajectory(chain, times, result[0], result[1], provenance=provenance(arguments))


def _frames(
    chains: DeviceChains, state: Sequence[FloatArray], intervals: FloatArray, steps: IntArray
) -> Iterator[FloatArray | None]:
    """Yield angles and velocities, shape (2, n, B), after each interval; None where one diverged.

    `state` is angles, angular velocities, and torques, (n, B) each; an interval is cut into
    `steps`.
    """
    # the lane innermost: threads side by side read side by side
    theta, omega, torque = (chains.cuda.to_device(np.ascontiguousarray(rows)) for rows in state)
    diverged = chains.cuda.to_device(np.zeros(chains.size))
    for interval, count in zip(intervals.tolist(), steps.tolist(), strict=True):
        for span, substeps in _launches(interval, count):
            chains.advance(theta.T, omega.T, torque.T, diverged, span, substeps)
        if np.any(diverged.copy_to_host()):
            yield None
            return
        yield np.stack([theta.copy_to_host(), omega.copy_to_host()])


def _launches(interval: float, steps: int) -> Iterator[tuple[float, int]]:
    """Yield durations and numbers of steps, MAX_LAUNCH at most, that together make an interval.

    Long ones are cut by powers of two, which changes no bit of the step.
    """
    if steps <= _MAX_LAUNCH:
        yield interval, steps
        return
    step = interval / steps
    while steps:
        part = min(_MAX_LAUNCH, 1 << (steps.bit_length() - 1))
        yield step * part, part
        steps -= part
