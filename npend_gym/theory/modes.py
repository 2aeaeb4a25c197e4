"""Small oscillations about hanging at rest: their frequencies, shapes and decay.

M theta'' + K theta = 0, with M the mass matrix of the hanging chain and K = diag(g h), h being the
chain's `lift`. For point masses the inverse of M is tridiagonal, the tension matrix of a hanging
chain; for links `npend_gym.theory.pivots` counts frequencies without any matrix.
"""

from __future__ import annotations

import math

import numpy as np

from npend_gym import _checks
from npend_gym._checks import BoolArray, FloatArray
from npend_gym.chain import MAX_DENSE, Chain, ChainParameters, check_hung
from npend_gym.chain.inertia import link_inertia, rotor_inertia

_SPREAD = 1e-9  # of squares of frequencies, below which rounding spoils the smallest


def normal_modes(chain: Chain) -> tuple[FloatArray, FloatArray]:
    """Return the exact frequencies and shapes of small oscillations about hanging at rest.

    Returns
    -------
    omega : ndarray, shape (n,)
        Angular frequencies [rad/s], increasing.
    modes : ndarray, shape (n, n)
        Column k: the angles of mode k, the largest being 1.

    Notes
    -----
    The linearised system M theta'' + K theta = 0 has the mass matrix of `npend_gym.physics`,
    M_ij = l_i l_j sum_{k>=max(i,j)} m_k for point masses, full where the paper has it diagonal,
    and K = diag(g h), h_i = l_i sum_{k>=i} m_k. The inverse of that M is tridiagonal, so that
    omega^2 are the eigenvalues of the symmetric tridiagonal K^(1/2) M^(-1) K^(1/2). With links,
    h is `Chain.lift`; a link with h < 0 rests upright, and its angles are measured from there.

    Examples
    --------
    >>> from npend_gym import Chain, theory
    >>> omega, modes = theory.normal_modes(Chain.uniform(2))
    >>> omega.round(4).tolist(), modes.shape
    ([2.3972, 5.7874], (2, 2))
    """
    from scipy.linalg import eigh, eigh_tridiagonal, svd

    check_hung(chain, "normal_modes")
    _checks.count("n", chain.n, high=MAX_DENSE)
    if chain.has_bobs:
        squares, vectors = eigh_tridiagonal(*_stiffness(chain))
        if squares[0] < _SPREAD * squares[-1]:
            # of a bidiagonal matrix all singular values are exact, small ones too
            _, values, rows = svd(_factor(chain), lapack_driver="gesvd")
            squares, vectors = values[::-1] ** 2, rows[::-1].T
        modes = vectors / np.sqrt(chain.lengths * chain.carried_masses)[:, None]
    else:
        direction = _resting(chain)
        inertia = link_inertia(chain) * np.outer(direction, direction) + rotor_inertia(chain)
        squares, modes = eigh(np.diag(chain.gravity * np.abs(chain.lift)), inertia)
    peak = modes[np.argmax(np.abs(modes), axis=0), np.arange(chain.n)]
    return np.sqrt(np.maximum(squares, 0.0)), modes / peak


def fundamental_period(chain: Chain) -> float:
    """Return the period [s] of the slowest normal mode.

    NaN where nothing swings back: without gravity, or where a link is balanced on its joint.

    Examples
    --------
    >>> from npend_gym import Chain, theory
    >>> round(theory.fundamental_period(Chain.uniform(3)), 4)
    3.1111
    """
    check_hung(chain, "fundamental_period")
    frequency = _frequency(chain, 0) if chain.gravity > 0.0 else 0.0
    return 2.0 * math.pi / frequency if frequency > 0.0 else math.nan


def fastest_frequency(chain: Chain) -> float:
    """Return the angular frequency [rad/s] of the fastest normal mode; zero without gravity.

    Examples
    --------
    >>> from npend_gym import Chain, theory
    >>> round(theory.fastest_frequency(Chain.uniform(3)), 4)
    7.8552
    """
    check_hung(chain, "fastest_frequency")
    return _frequency(chain, chain.n - 1)


def decay_rate(chain: Chain, damping: FloatArray, drag: FloatArray) -> float:
    """Return the rate [1/s] at which the most damped motion of the hanging chain decays.

    Parameters
    ----------
    chain : Chain
    damping, drag : ndarray, shape (n,)
        Torque on each joint over its speed [N m s/rad], force on each tip over its speed [N s/m].
    """
    return _eigenvalue(chain, chain.n - 1, np.zeros(chain.n), damping, drag)


def any_faster(
    chains: ChainParameters, rate: float, damping: FloatArray, drag: FloatArray
) -> BoolArray:
    """Return which of many chains have a `fastest_frequency` or a `decay_rate` above `rate`.

    Parameters
    ----------
    chains : ChainParameters
    rate : float
        [1/s]
    damping, drag : ndarray, shape (B, n)
        As for `decay_rate`.

    Returns
    -------
    ndarray of bool, shape (B,)
        To rounding: a chain that is faster by less than 1e-12 of the rate may be missed.
    """
    stiffness, none = chains.gravity[:, None] * np.abs(chains.lift), np.zeros_like(chains.masses)
    swings = _any_above(chains, rate * rate, stiffness, none, none)
    return swings | _any_above(chains, rate, none, damping, drag)


def _any_above(chains: ChainParameters, mu: float, *forces: FloatArray) -> BoolArray:
    """Return which chains have an eigenvalue of M^(-1) B above `mu`, B being as in `pivots`."""
    from npend_gym.theory.pivots import any_above

    found = np.zeros(len(chains.masses), np.bool_)
    any_above(np.full(found.size, mu), _bodies(chains), np.stack(forces, axis=1), found)
    return found


def _frequency(chain: Chain, k: int) -> float:
    none = np.zeros(chain.n)
    return math.sqrt(_eigenvalue(chain, k, chain.gravity * np.abs(chain.lift), none, none))


def _stiffness(chain: Chain) -> tuple[FloatArray, FloatArray]:
    """Return diagonal and off-diagonal of K^(1/2) M^(-1) K^(1/2) [1/s^2]."""
    v = 1.0 / chain.masses
    scale = np.sqrt(chain.gravity * chain.carried_masses / chain.lengths)
    at_joint = np.concatenate([[0.0], v])
    return (at_joint[:-1] + v) * scale**2, -v[:-1] * scale[:-1] * scale[1:]


def _factor(chain: Chain) -> FloatArray:
    """Return the upper bidiagonal F with F' F = K^(1/2) M^(-1) K^(1/2), shape (n, n)."""
    scale, root = np.sqrt(chain.gravity * chain.carried_masses / chain.lengths), chain.masses**-0.5
    return np.diag(scale * root) - np.diag(scale[1:] * root[:-1], 1)


def _resting(chain: Chain | ChainParameters) -> FloatArray:
    """Return 1 for links that hang at rest, -1 for those that rest upright, shape (..., n)."""
    return np.where(chain.lift < 0.0, -1.0, 1.0)


def _bodies(chain: Chain | ChainParameters) -> FloatArray:
    """Return the links of a chain, or of many, as in `pivots`, shape (..., 6, n)."""
    direction = _resting(chain)
    at_rest = direction * chain.lengths, direction * chain.centres
    motors = chain.armature, 1.0 / chain.gear - 1.0
    return np.stack([*at_rest, chain.masses, chain.inertias, *motors], axis=-2)


def _eigenvalue(chain: Chain, k: int, *forces: FloatArray) -> float:
    """Return eigenvalue k, in increasing order, of M^(-1) B, B being as in `pivots`."""
    from npend_gym.theory.pivots import eigenvalue

    return eigenvalue(_bodies(chain), np.array(forces), k)
