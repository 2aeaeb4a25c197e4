"""All Lyapunov exponents of a motion: tangent vectors, made orthogonal again and again."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import qr, solve

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain, check_chain
from npend_gym.chaos.variations import motion_of, record
from npend_gym.physics import mass_matrix, momentum_jacobian
from npend_gym.physics.arguments import loses_energy
from npend_gym.physics.mechanism import in_frame_of_pivot
from npend_gym.physics.sensitivities import carry
from npend_gym.physics.signals import TimeVarying
from npend_gym.physics.substeps import fastest_rate

MAX_RODS = 500  # each orthogonalisation takes O(n^3) operations: a second of them
_STEPS = 16  # between two orthogonalisations, where no vector shrinks much
_DAMPED_STEPS = 2  # a step of the integrator may shrink a vector by e^-6 where damping is strong


@dataclass(frozen=True, eq=False)
class LyapunovSpectrum:
    """Lyapunov exponents of a motion, and how their estimates converged.

    Attributes
    ----------
    exponents : ndarray, shape (k,)
        The k largest [1/s], decreasing.
    times : ndarray, shape (T,)
        Instants [s], increasing, the last being the end of the motion.
    history : ndarray, shape (T, k)
        Estimates of the exponents at those instants [1/s].
    provenance : dict
        How it was made: versions and arguments.
    """

    exponents: FloatArray
    times: FloatArray
    history: FloatArray
    provenance: dict[str, Any]


def lyapunov_spectrum(
    chain: Chain,
    theta: ArrayLike,
    omega: ArrayLike = 0.0,
    *,
    duration: float,
    count: int | None = None,
    samples: int = 200,
    rtol: float = 1e-11,
    progress: Callable[[Iterable[float]], Iterable[float]] = iter,
    torque: ArrayLike | TimeVarying | None = None,
    force: ArrayLike | TimeVarying = 0.0,
    pivot_acceleration: ArrayLike | TimeVarying | None = None,
) -> LyapunovSpectrum:
    """Return the Lyapunov exponents of a motion: the rates at which small changes of it grow.

    Parameters
    ----------
    chain : Chain
        Of at most 500 rods.
    theta, omega : array_like, shape (n,)
        The start [rad, rad/s]; one number stands for all rods.
    duration : float
        How long the motion is followed [s]: the error falls off as one over its square root in
        chaos, as log t / t in regular motion.
    count : int, optional
        How many exponents, the largest first; by default all, two for each coordinate: rods,
        a cart and stretches of springs. The time grows with it.
    samples : int
        Largest number of instants in the history, one for each orthogonalisation.
    rtol : float
        Relative tolerance of the motion's steps; the absolute tolerance is a hundredth of it.
    progress : callable
        Wraps the iteration over the instants, for a progress bar.
    torque, force, pivot_acceleration : array_like, Signal or callable, optional
        What drives the chain, as in `simulate`; functions of time alone.

    Returns
    -------
    LyapunovSpectrum

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule: for example if `count` exceeds the number of exponents.
    IntegrationError
        If the motion diverges.

    Notes
    -----
    Benettin et al. (Meccanica 15, 1980): the vectors are carried exactly through the
    steps of the integrator. Every few steps a QR factorisation makes them orthogonal. The
    logarithms of its diagonal are summed and divided by the time.

    Lengths are measured in angles and canonical momenta p = M(theta) omega, in units that give both
    the same scale. In these the flow is symplectic without damping, and the vectors start as a
    symplectic basis, partners last to first: exponents then come in pairs +-lambda and add up to
    zero at any time, to the error of the integration. In (theta, omega) the sum has the term [log
    det M(start) - log det M(end)] / t besides. With damping, the sum at any time is the mean of the
    flow's divergence, of -trace(M^-1 D) if the damping torques are -D omega. A drive changes none
    of this. Time and a pivot with prescribed motion have exponents of 0, which are left out.

    Examples
    --------
    >>> from npend_gym import Chain, chaos
    >>> chain = Chain.uniform(2, damping=0.1)
    >>> spectrum = chaos.lyapunov_spectrum(chain, [2.0, 2.0], duration=20.0)
    >>> spectrum.exponents.shape, bool(spectrum.exponents.sum() < 0.0)
    ((4,), True)
    """
    n = _checks.count("n", check_chain(chain).n, high=MAX_RODS)
    drives = {"torque": torque, "force": force, "pivot_acceleration": pivot_acceleration}
    motion = motion_of(chain, theta, omega, rtol, drives)
    start, m = motion.state, motion.mechanism.size
    most = 2 * chain.coordinates
    count = most if count is None else _checks.count("count", count, high=most)
    duration = _checks.positive_number("duration", duration)
    samples = _checks.count("samples", samples)
    instants = np.linspace(0.0, duration, samples + 1)[1:].tolist()
    inertia = float(np.mean(np.diagonal(mass_matrix(chain, start[:n]))[:n]))
    felt = in_frame_of_pivot(chain, motion.mechanism.pivot_acceleration)
    unit = inertia * fastest_rate(felt)
    basis = _basis(chain, m)[:, :count]
    vectors = np.ascontiguousarray(solve(_metric(chain, start, unit), basis).T)
    steps = _DAMPED_STEPS if loses_energy(chain) else _STEPS
    ends = np.array([0.0, duration])
    carried = carry(motion, ends, vectors, steps=steps)
    sums, times, history = np.zeros(count), np.empty(samples), np.empty((samples, count))
    time = 0.0
    for k, instant in enumerate(progress(instants)):
        while time < instant:
            _, _, tape = next(carried)
            time = tape.end
            metric = _metric(chain, tape.after, unit)
            orthogonal, triangle = qr(metric @ vectors.T, mode="economic")
            sums += np.log(np.abs(np.diag(triangle)))
            vectors[:] = solve(metric, orthogonal).T
        times[k], history[k] = time, sums / time
    made_by = record(
        chain, start, duration=duration, count=count, samples=samples,
        rtol=float(motion.settings["rtol"]), **drives,
    )  # fmt: skip
    exponents, new = np.sort(history[-1])[::-1], np.diff(times, prepend=0.0) > 0.0
    return LyapunovSpectrum(exponents, times[new], history[new], made_by)


def _basis(chain: Chain, m: int) -> FloatArray:
    """Return a symplectic and orthogonal basis of (q, p), in no special direction.

    Its columns are vectors (2m,), which leave a pivot where it is that nothing of the chain moves.

    That is a unitary matrix, drawn once for all, as real numbers. Vectors along the angles would be
    nearly alike in the plane of a slow mode.
    """
    own = _own(chain, m)
    drawn = np.random.default_rng(0).normal(size=(2, own.size, own.size))
    unitary = qr(drawn[0] + 1j * drawn[1])[0]
    first = np.vstack([unitary.real, unitary.imag])
    second = np.vstack([-unitary.imag, unitary.real])
    basis = np.zeros((2 * m, 2 * own.size))
    basis[np.concatenate([own, m + own])] = np.hstack([first, second[:, ::-1]])
    return basis


def _own(chain: Chain, m: int) -> NDArray[np.int64]:
    """Return the numbers of the coordinates, without a pivot that nothing of the chain moves."""
    return np.delete(np.arange(m), slice(chain.n, chain.n + m - chain.coordinates))


def _metric(chain: Chain, state: FloatArray, unit: float) -> FloatArray:
    """Return the matrix that takes changes of (q, u) to those of (q, p / unit).

    The place of a cart and the stretches of springs are counted in mean rods, as angles are.
    """
    size = state.size // 2
    own, metric = _own(chain, size), np.eye(2 * size)
    q, u = (half[own] for half in np.split(state, 2))
    momenta = momentum_jacobian(chain, q, u) / unit
    metric[np.ix_(size + own, np.concatenate([own, size + own]))] = momenta
    length, lengths = float(chain.lengths.mean()), own[chain.n :]
    metric[lengths] /= length
    metric[size + lengths] *= length
    return metric
