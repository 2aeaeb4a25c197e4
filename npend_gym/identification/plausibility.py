"""What is likely wrong with measured motion, or with what is known of its chain: units, angles."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from scipy.integrate import cumulative_trapezoid

from npend_gym._checks import FloatArray
from npend_gym.chain import Chain
from npend_gym.identification.motion import MAX_DEVIATION, RADIANS, Motion
from npend_gym.identification.parameters import INERTIA, LIFT, OFFSET, FitModel, values_of, weighs
from npend_gym.identification.stages import Fit, Stages
from npend_gym.physics.arguments import warn_caller

# times the expected period: milliseconds give 1000, millimetres 32, centimetres 10; a motor may
# move a link fast, and a link that is nearly balanced is slow
_FAST, _DRIVEN_FAST, _SLOW, _IMPOSSIBLE = 4.0, 10.0, 10.0, 100.0
_POOR = 0.05  # scatter of the errors, of that of the angles, from which on there is a warning ...
_NOTHING = 0.3  # ... and an error
DOUBTED = 0.01  # ... and other meanings of the angles are tried
_SHORT = 0.6  # of the segments' longest duration: where fewer could be followed, angles are doubted
_ROUGHLY = 8  # iterations of a fit of other angles: a better meaning shows at once
_LEAST_DEGREES = 2.0  # the largest angle of a swing that is measured in degrees, at least
# times smaller are the errors of angles that were taken wrongly; integrals have less noise anyway
_BETTER, _RATES_BETTER = 1.5, 5.0
LEVEL = 0.35  # rad; angles that are off by more are so on purpose
_AIR = 1.2  # kg/m^3, its density
_OUTSIDE, _FAR = 2.0, 10.0  # lengths of a link, between its joint and its centre
_TOO_LARGE = 2.0  # times the inertia that the given masses can have in a link of its length
_HEAVIER = 10.0  # times the given mass of a link
_CHECK = (
    "check lengths, centres, masses and times, which must be in m, kg and s, the signs and the "
    "order of the angles, and that they are absolute ones in radians, not in degrees ("
    f"{RADIANS}), and no angular velocities"
)


def _integrated(motion: Motion) -> FloatArray:
    """Return the angles whose rates are those of `motion`, about their mean."""
    out = motion.theta.copy()
    for rows in motion.stretches():
        theta, times = motion.theta[rows], motion.times[rows]
        angle: FloatArray = np.asarray(cumulative_trapezoid(theta, times, axis=0, initial=0))
        out[rows] = angle - angle.mean(axis=0)
    return out


_ADD_UP = "convert with np.cumsum(theta, axis=1), or give --relative of npend identify"
_ADDED_UP = (
    "absolute before they were added up: give them as measured, or leave out --relative of npend "
    "identify"
)
_INTEGRATE = 'integrate them with scipy.integrate.cumulative_trapezoid, and fit "offset" too'
_ANGLES = "theta must be absolute angles from where a link hangs [rad]"
_TIMES = "times must be in seconds"
_SLOW_MOTIONS = 2.0, 4.0, 8.0  # frames a second of a film, of those with which it is shown


def _angles(convert: Callable[[Motion], FloatArray]) -> Callable[[Motion], Motion]:
    return lambda motion: replace(motion, theta=convert(motion))


# Other motions that may be meant, of how many links at least, what is wrong then, and the way out;
# one link moves alike at any speed
_READINGS: list[tuple[Callable[[Motion], Motion], int, str, str]] = [
    (_angles(lambda motion: np.cumsum(motion.theta, axis=1)), 2, _ANGLES,
     f"relative to the link above: {_ADD_UP}"),
    (_angles(lambda motion: np.diff(motion.theta, axis=1, prepend=0.0)), 2, _ANGLES, _ADDED_UP),
    (_angles(lambda motion: motion.theta + np.pi), 1, _ANGLES,
     "from where it stands upright: add np.pi to them"),
    *((_angles(lambda motion, turn=turn: motion.theta + turn), 1, _ANGLES,
       f"from an axis that points sideways, as theta_r of Tracker: {way} np.pi / 2")
      for turn, way in ((0.5 * np.pi, "add"), (-0.5 * np.pi, "subtract"))),
    (_angles(lambda motion: np.radians(motion.theta)), 1, _ANGLES, f"degrees: {RADIANS}"),
    (_angles(_integrated), 1, _ANGLES,
     f"angular velocities, as a gyroscope measures: {_INTEGRATE}"),
    *((lambda motion, factor=factor: replace(motion, times=motion.times / factor), 2, _TIMES,
       f"{factor:.0f} times as short: a film in slow motion is shown so much too slowly")
      for factor in _SLOW_MOTIONS),
]  # fmt: skip


def check_units(chain: Chain, motion: Motion) -> None:
    """Compare the period of the measured swings with that which the given chain would have.

    Motors may move a chain as slowly as they like. So a driven chain can only be too fast. A large
    factor is warned of; one above 100 is an error: times in milliseconds, for example.
    """
    factor, measured, expected = _slowness(chain, motion)
    fast, slow = (_DRIVEN_FAST, math.inf) if motion.forced else (_FAST, _SLOW)
    if 1.0 / fast <= factor <= slow:
        return
    text = (
        "times must be in seconds, and lengths and centres in metres: the angles swing with a "
        f"period of about {measured:.2g} s, those of a chain like the one given with one of about "
        f"{expected:.2g} s; are these milliseconds, centimetres or millimetres?"
    )
    if np.all(np.diff(motion.times) == 1.0) and motion.times[0] in (0.0, 1.0):
        text = (
            "times must be in seconds, but the rows have 0, 1, 2, ...: are these frame numbers? "
            "Divide them by the frames a second, or give --fps of npend identify"
        )
    if max(factor, 1.0 / factor) > _IMPOSSIBLE:
        raise ValueError(text)
    warn_caller(text)


def _slowness(chain: Chain, motion: Motion) -> tuple[float, float, float]:
    """Return the measured period over that of a chain, both [s]; 1 where nothing makes it swing."""
    values, measured = values_of(chain), motion.period()
    if not np.all(weighs(chain)):
        return 1.0, measured, measured
    periods = 2.0 * np.pi * np.sqrt(values[INERTIA] / (chain.gravity * np.abs(values[LIFT])))
    expected = float(np.clip(measured, periods.min(), periods.max()))  # a balanced link is slow
    return measured / expected, measured, expected


def spread_of(motion: Motion) -> float:
    """Return by how much angles vary [rad], those that turn over by pi at most."""
    spreads = [np.std(motion.theta[rows], axis=0) for rows in motion.stretches()]
    return float(np.sqrt(np.mean(np.minimum(spreads, MAX_DEVIATION) ** 2)))


def check_explained(
    motion: Motion, model: FitModel, fitted: Fit, duration: float, longest: float
) -> None:
    """Refuse, or warn of, a fit that moves otherwise than the data.

    `duration` is that of its segments [s], `longest` what was possible.

    Raises
    ------
    ValueError
        If the angles fit much better with another meaning: as degrees, for example.
    RuntimeError
        If the fit explains nothing.
    """
    moved = spread_of(motion)
    if fitted.scatter > DOUBTED * moved or duration < _SHORT * longest:
        check_readings(motion, model, fitted.rows, fitted.rmse)
    if fitted.scatter <= _POOR * moved:
        return
    text = (
        f"the fitted chain moves otherwise than the data, by {fitted.scatter:.2g} rad where angles "
        f"vary by {moved:.2g} rad: {_CHECK}"
    )
    if fitted.scatter > _NOTHING * moved:
        raise RuntimeError(text)
    warn_caller(text)


def is_off(found: Fit, before: Fit, model: FitModel, *, longer: bool) -> bool:
    """Return whether angles are off by a little: a camera is not level, the zero of a sensor wrong.

    `found` has offsets, which `before` has not. It may have `longer` segments.
    """
    better = found.rmse * (1.0 if longer else _BETTER) < before.rmse
    return better and bool(np.abs(model.unpack(found.solution.fitted)[OFFSET]).max() < LEVEL)


def say_offsets(offsets: FloatArray) -> None:
    """Warn of offsets [rad] that nobody asked to fit."""
    if offsets.any():
        shown = ", ".join(f"{offset:.3g}" for offset in offsets.tolist())
        warn_caller(
            f"the angles are off by {shown} rad, as of a camera that is not level or a sensor "
            'whose zero is wrong: "offset" is fitted, too'
        )


def check_readings(motion: Motion, model: FitModel, rows: Sequence[slice], error: float) -> None:
    """Refuse angles that fit much better with another meaning.

    `error` is the root mean square error of these rows as they were given [rad].
    """
    largest = float(np.abs(motion.theta).max())
    own = _spread(motion)
    tried: list[tuple[float, float, str, str]] = []
    for convert, links, rule, meaning in _READINGS:
        if motion.links < links or (meaning.startswith("degrees") and largest < _LEAST_DEGREES):
            continue
        if rule == _TIMES and motion.forced:  # motors may move a chain as slowly as they like
            continue
        other, is_rate = convert(motion), meaning.startswith("angular")
        free = model.free.copy()
        free[OFFSET] |= is_rate and model.chain.gravity > 0.0
        with suppress(RuntimeError, ValueError, np.linalg.LinAlgError):
            fit = Stages(other, replace(model, free=free)).fit_once(rows, _ROUGHLY)
            if fit is not None and not fit.may_be_lost:  # a lost fit explains nothing
                size = min(_spread(other) / own, 1.0)  # angles of other units vary by less
                better = _RATES_BETTER if is_rate else _BETTER
                tried.append((fit.rmse / size, better, rule, meaning))
    best, factor, rule, meaning = min(tried, default=(math.inf, 1.0, "", ""))
    if best * factor < error and best < _NOTHING * own:
        better = f"{error / best:.1f} times better" if math.isfinite(error) else "better"
        raise ValueError(f"{rule}, but those given fit {better} if they were {meaning}")


def _spread(motion: Motion) -> float:
    return float(np.sqrt(np.asarray(motion.theta.var(axis=0)).mean()))


def check_values(found: Chain, given: Chain, motion: Motion, *, weighed: bool) -> None:
    """Refuse a fitted chain that no pendulum can be, and warn of values that are unlikely.

    Parameters
    ----------
    found, given : Chain
        The fitted chain, and the one that was given.
    motion : Motion
        What was fitted.
    weighed : bool
        Whether inertia or lift of the links were fitted.

    Raises
    ------
    RuntimeError
        If a centre of mass is more than ten lengths of its link from its joint. Of free swings,
        also if their period is ten times that of the fitted chain, or a tenth. The same where a
        link needs ten times the given mass.
    """
    lengths = found.lengths.tolist()
    away = [abs(c) / length for c, length in zip(found.centres.tolist(), lengths, strict=True)]
    impossible = [
        f"centres[{k}] = {found.centres[k]:.3g} m, {far:.3g} lengths of the link from its joint"
        for k, far in enumerate(away)
        if far > _FAR
    ]
    if not motion.forced:
        factor, measured, own = _slowness(found, motion)
        if not 1.0 / _SLOW <= factor <= _SLOW:
            impossible.append(
                f"a chain with a period of about {own:.2g} s, where that of the data is about "
                f"{measured:.2g} s"
            )
        impossible += [
            f"inertia{k} and lift{k}, which need a mass of {found.masses[k]:.3g} kg in place of "
            f"{given.masses[k]:.3g} kg: centimetres, or millimetres, bring such a factor"
            for k, heavier in enumerate((found.masses / given.masses).tolist())
            if heavier > _HEAVIER
        ]
    if impossible and weighed:
        raise RuntimeError(
            f"no pendulum is like the fit, which has {'; '.join(impossible)}: {_CHECK}"
        )
    unlikely = [
        f"quadratic_drag[{link}] = {drag:.3g} N s^2/m^2, more than that of a plate of the chain's "
        f"length in both directions in air, {most:.2g} N s^2/m^2"
        for link, drag in enumerate(found.quadratic_drag.tolist())
        if drag > (most := _AIR * found.total_length**2)
    ]
    slower = math.sqrt(float(values_of(found)[INERTIA, 0] / values_of(given)[INERTIA, 0]))
    most = float(given.masses.sum() * given.lengths[0] ** 2)
    if not motion.driven and weighed and values_of(found)[INERTIA, 0] > _TOO_LARGE * most:
        warn_caller(
            f"inertia0 = {values_of(found)[INERTIA, 0]:.3g} kg m^2 is more than the given masses "
            f"have within the length of link 0, {most:.3g} kg m^2: are times {slower:.2g} times "
            "too slow, as of a film in slow motion? Divide them by that, or check the lengths"
        )
    unlikely += [
        f"centres[{k}] = {found.centres[k]:.3g} m, more than two lengths of the link from its joint"
        for k, far in enumerate(away)
        if far > _OUTSIDE
    ]
    if unlikely:
        warn_caller(
            f"the fit found {'; '.join(unlikely)}: record more or livelier motions, fit fewer "
            "quantities, or check lengths and masses"
        )
