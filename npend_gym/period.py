"""The pseudo-period of every bob, or of the whole chain, after a release: array in, array out."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from npend_gym import _checks, theory
from npend_gym._checks import FloatArray
from npend_gym._threads import Call, check_threads, share_out
from npend_gym.chain import Chain, ChainParameters, check_chain
from npend_gym.compiled.arrays import aligned_zeros, innermost
from npend_gym.compiled.packs import WIDTH
from npend_gym.compiled.sincos import MAX_ANGLE
from npend_gym.physics.arguments import check_rtol, warn_of_degrees
from npend_gym.physics.energy import centre_of_mass, positions, sincos, stretched
from npend_gym.physics.equations import assembled
from npend_gym.physics.kernels.layout import MAX_SPEED
from npend_gym.physics.kernels.releases import RELEASE_ROWS, Releases
from npend_gym.physics.kernels.turning_points import (
    AROUND,
    BOB,
    COM,
    COM_AROUND,
    HEIGHT,
    LINK,
    new_record,
    speed_threshold,
)
from npend_gym.physics.mechanism import hanging_angle, in_frame_of_pivot, mechanism_of
from npend_gym.physics.motion import Integration, pack_of, packs_of

CODES = {"bob": BOB, "link": LINK, "height": HEIGHT, "com": COM, "horizontal": BOB}
DEFINITIONS = tuple(CODES)
_BEYOND = {"bob": AROUND, "com": COM_AROUND}  # what counts where a rod starts beyond 90 degrees

_WINDOW = 10.0  # fundamental periods, after which a bob is given up
_HEIGHT_TOLERANCE = 10.0  # times rtol times the chain's length: below it a height is the start's
_WORTH_A_PACK = 8  # releases; fewer are followed faster one by one


def pseudo_periods(
    chain: Chain,
    theta: ArrayLike,
    omega: ArrayLike = 0.0,
    *,
    definition: str = "bob",
    duration: float | None = None,
    rtol: float = 1e-10,
    threads: int = 1,
    pivot_acceleration: ArrayLike | None = None,
) -> FloatArray:
    """Return the pseudo-period [s] of every bob after a release, or after each of many.

    Parameters
    ----------
    chain : Chain
        Springs are released with the tensions of rigid rods, a cart at rest; velocities are
        relative to the pivot.
    theta, omega : array_like, shape (n,) or (R, n)
        Angles [rad] and angular velocities [rad/s] at the release, or at each of R releases.
        Releases are followed side by side, a few times faster than one by one, with the same bits.
        One number stands for all. For a chain at rest, angles beyond 2 pi raise an error, because
        they are likely to be degrees. For a moving chain, angles that look like degrees bring a
        warning.
    definition : {"bob", "link", "height", "com", "horizontal"}
        What completes a pseudo-period (the paper's procedure (iv) allows each of the first three):

        - "bob": the bob has reversed its horizontal velocity twice; if a rod starts beyond 90
          degrees, its velocity around the pivot;
        - "link": the rod's angular velocity has been 0, negative, positive and 0 again;
        - "height": the bob is back at its starting height;
        - "com": the chain's centre of mass has reversed twice, by the same rule: one
          pseudo-period for all bobs;
        - "horizontal": the bob's horizontal velocity has reversed twice, from any angle.

        The bob of a link with inertia is its far end: the next joint, or the tip.
    duration : float, optional
        Length of the window [s]. By default it lasts until every bob has completed, at most ten
        fundamental periods.
    rtol : float
        Relative tolerance of the integration; the absolute one is a hundredth of it.
    threads : int
        Number of threads that share the releases. Results do not depend on it.
    pivot_acceleration : array_like of shape (2,), optional
        Constant acceleration of the pivot [m/s^2]. A bob is then released from the side of where
        it hangs at rest.

    Returns
    -------
    ndarray, shape (n,) or (R, n)
        NaN where the bob does not complete within the window. For "com" all n entries of a release
        are the same number.

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule, or no period sets the window: without gravity, in motion,
        or where a link is balanced on its joint.
    IntegrationError
        If the integration cannot continue.

    Notes
    -----
    For a release from positive angles, "bob" and "link" take the first + to - crossing after a - to
    + crossing. Negative angles are mirrored; for "bob" the side on which the bob starts counts. So
    a first drift of a rod in the other direction does not count. t = 0 is not a crossing. A bob
    that starts at zero counts as released from positive angles. "com" does the same with the centre
    of mass. A sign counts once the speed has exceeded 1e-6 sqrt(g/l), times l for "bob" and "com",
    l being the mean length: the outer rods of a uniform release rest, at rounding level, until the
    wave reaches them. "height" takes a touch within 10 rtol of the chain's length as a return, at
    the instant of the touch (for one pendulum at T/2: the paper asks for the height, not the side).
    Instants are zeros of the dense solution, located to 1e-11 s.

    A bob that passes 90 degrees reverses its horizontal velocity there, in the middle of a swing:
    "horizontal" gives half the period of one pendulum. So "bob" and "com" count reversals of the
    velocity around the pivot where a rod starts more than 90 degrees from where it rests. With r
    the position from the pivot, this velocity is r x v divided by the distance in a straight chain,
    so that the same threshold holds.

    Examples
    --------
    >>> import numpy as np
    >>> from npend_gym import Chain, pseudo_periods
    >>> pseudo_periods(Chain.uniform(3), np.pi / 4).round(4).tolist()
    [3.1361, 3.2237, 3.2233]
    """
    check_chain(chain)
    theta, omega = _starts(chain, theta, omega)
    releases = theta.reshape(-1, chain.n), omega.reshape(-1, chain.n)
    definition = check_definition(definition)
    rtol = check_rtol(rtol)
    threads = check_threads(threads)
    if duration is not None:
        duration = _checks.positive_number("duration", duration)
    if chain.gravity == 0.0 and pivot_acceleration is None and not np.any(omega):
        return np.full(theta.shape, np.nan)
    if duration is None:
        felt = in_frame_of_pivot(chain.hung(), pivot_acceleration)
        duration = _WINDOW * slowest_period(felt)
    mechanism_of([chain]).check_vibrations(duration)

    codes = codes_of(chain, releases[0], definition, pivot_acceleration)
    periods = np.empty_like(releases[0])

    def follow(share: NDArray[np.int64], call: Call) -> None:
        given = int(codes[share[0]]), duration, rtol, pivot_acceleration
        periods[share] = _measure(chain, releases[0][share], releases[1][share], *given, call)

    alike = [np.flatnonzero(codes == code) for code in np.unique(codes)]
    share_out([own[share] for own in alike for share in _shares(own.size)], threads, follow)
    return periods.reshape(theta.shape)


def codes_of(
    chain: Chain, theta: FloatArray, definition: str, accelerated: ArrayLike | None = None
) -> NDArray[np.int64]:
    """Codes (...) of what a definition follows after releases at `theta` (..., n)."""
    c = sincos(theta - hanging_angle(chain, accelerated))[1]
    beyond = np.any(chain.lift * c < 0.0, axis=-1)
    return np.where(beyond, _BEYOND.get(definition, CODES[definition]), CODES[definition])


def slowest_period(chain: Chain) -> float:
    """Return the fundamental period [s], by which windows are chosen, refused where it is NaN."""
    period = theory.fundamental_period(chain)
    if math.isnan(period):
        raise ValueError(
            "duration must be given where gravity is 0 or a link is balanced on its joint: "
            "no period sets a window"
        )
    return period


def check_definition(definition: str) -> str:
    """Return `definition`, which must be one of `DEFINITIONS`."""
    if definition == "listing":
        raise ValueError(
            f'definition must be one of {", ".join(DEFINITIONS)}; "listing", the paper\'s own '
            "estimator, is `listing_periods` in paper/estimator.py of a clone"
        )
    return _checks.choice("definition", definition, DEFINITIONS)


def _starts(chain: Chain, theta: ArrayLike, omega: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return angles and angular velocities of one release (n,) or of many (R, n)."""
    given = {"theta": _checks.array("theta", theta), "omega": _checks.array("omega", omega)}
    _checks.within("theta", given["theta"], MAX_ANGLE)
    _checks.within("omega", given["omega"], MAX_SPEED)
    if not np.any(given["omega"]):
        largest = float(np.abs(given["theta"]).max(initial=0.0))
        if largest > 2.0 * np.pi:
            raise ValueError(f"theta must be {_checks.in_radians('2 pi', largest)}")
    warn_of_degrees("theta", given["theta"])
    rows = [array.shape[:1] for array in given.values() if array.ndim == 2]
    shape = (*max(rows, default=()), chain.n)
    for name, array in given.items():
        if array.shape not in ((), (chain.n,), shape) or shape[0] == 0:
            raise ValueError(
                f"{name} must be one number or have the shape ({chain.n},) or (R, {chain.n}) with "
                f"the same R > 0 for theta and omega, got shape {array.shape}"
            )
    first, second = (np.broadcast_to(array, shape).copy() for array in given.values())
    return first, second


def _shares(count: int) -> list[slice]:
    """Return how `count` releases are shared out: packs, and the last few one by one."""
    last = count - count % WIDTH
    if count - last >= _WORTH_A_PACK:
        last = count
    return packs_of(last) + [slice(k, k + 1) for k in range(last, count)]


def _measure(
    chain: Chain, theta: FloatArray, omega: FloatArray, definition: int, duration: float,
    rtol: float, accelerated: ArrayLike | None, call: Call,
) -> FloatArray:  # fmt: skip
    """Return the pseudo-periods of one release, or of up to WIDTH side by side, (releases, n).

    `definition` is a code. For the centre of mass every bob has that of the chain.
    """
    count, n = len(theta), chain.n
    lanes = 1 if count == 1 else WIDTH
    # lanes to spare repeat the last release
    theta, omega = (np.pad(x, ((0, lanes - count), (0, 0)), mode="edge") for x in (theta, omega))
    motion, release = _release(chain, theta, omega, definition, rtol, accelerated)
    motion.follow(0.0, duration, release, call)
    return np.broadcast_to(release.record.period.reshape(-1, lanes).T, (lanes, n))[:count]


def _release(
    chain: Chain, theta: FloatArray, omega: FloatArray, definition: int, rtol: float,
    accelerated: ArrayLike | None,
) -> tuple[Integration, Releases]:  # fmt: skip
    """Return the motion from these states (lanes, n), and what is to be measured of it."""
    lanes, n = len(theta), chain.n
    states = assembled(chain, theta, omega, np.zeros_like(theta), pivot_acceleration=accelerated)
    per_rod = theta
    rods: ChainParameters = chain.repeated(lanes)
    if chain.stiffness is not None:
        rods = stretched(chain, states.q[:, -n:])
        per_rod = -np.diff(positions(rods, theta)[..., 1], axis=1, prepend=0.0)
    if definition in (COM, COM_AROUND):
        whole = chain.lengths * float(chain.masses.sum())
        per_rod = np.broadcast_to(chain.lift / whole, theta.shape)
    elif definition == AROUND:
        per_rod = np.ones_like(theta)
    settings = {"rtol": rtol, "atol": 1e-2 * rtol}
    motion = pack_of(states, slice(0, lanes), settings, lanes)
    sides = orientation(rods, theta - hanging_angle(chain, accelerated), definition)
    record = new_record(innermost(per_rod), innermost(sides))
    threshold = _threshold(in_frame_of_pivot(chain, accelerated), omega, definition, rtol)
    scratch = aligned_zeros(RELEASE_ROWS, n * lanes)
    return motion, Releases(definition, threshold, record, scratch)


def orientation(rods: Chain | ChainParameters, theta: FloatArray, definition: int) -> FloatArray:
    """Return +1 for rods released from positive angles (or from zero), -1 from negative ones.

    For the centre of mass (lanes, 1): for the side on which it is. Around the pivot they are over
    the distance of the bob, or of the centre of mass, in a straight chain [m]. There a link that
    rests upright has the other side, from which it falls away.
    """
    if definition == HEIGHT:
        return np.ones_like(theta)
    if definition == LINK:
        side = theta - 2.0 * np.pi * np.round(theta * (0.5 / np.pi))  # no whole turns
    elif definition in (COM, COM_AROUND):
        side = centre_of_mass(rods, theta)[..., :1]
    elif definition == AROUND:
        side = np.cumsum(
            np.where(rods.lift < 0.0, -1.0, 1.0) * rods.lengths * sincos(theta)[0], axis=-1
        )
    else:
        side = positions(rods, theta)[..., 0]
    return np.where(side < 0.0, -1.0, 1.0) / distances(rods, definition)


def distances(rods: Chain | ChainParameters, definition: int) -> FloatArray | float:
    """Return over what velocities around the pivot are taken [m], (n,) or (1,); else 1."""
    if definition == AROUND:
        return np.cumsum(rods.lengths, axis=-1)
    if definition == COM_AROUND:
        straight = np.abs(rods.lift).sum(axis=-1, keepdims=True)
        return straight / rods.masses.sum(axis=-1, keepdims=True)
    return 1.0


def _threshold(chain: Chain, omega: FloatArray, definition: int, rtol: float) -> FloatArray:
    """Return the size [rad/s, m/s or m] above which the sign of a signal counts, (lanes,)."""
    if definition == HEIGHT:
        return np.full(len(omega), _HEIGHT_TOLERANCE * rtol * chain.total_length)
    mean = float(chain.lengths.mean())
    rate = speed_threshold(np.sqrt(chain.gravity / mean), np.max(np.abs(omega), axis=1))
    return rate if definition == LINK else rate * mean
