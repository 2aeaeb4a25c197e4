"""What is likely wrong with measured motion, or with what is known of its chain: units, angles."""

from __future__ import annotations

import math
import warnings
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np

from npend_gym.chain import Chain
from npend_gym.identification.motion import Motion
from npend_gym.identification.parameters import INERTIA, LIFT, Model, values_of, weighs
from npend_gym.identification.stages import Fit, Stages

_UNLIKELY, _IMPOSSIBLE = 10.0, 100.0  # times the expected period: milliseconds give 1000
_AIR = 1.2  # kg/m^3, its density
_BETTER = 3.0  # times smaller are the errors of angles that were taken wrongly

_BUT = "but those given fit {} times better if they"
_READINGS = {
    f"theta must be absolute angles, {_BUT} are relative to the link above: convert with "
    "np.cumsum(theta, axis=1), or give --relative of npend identify": partial(np.cumsum, axis=1),
    f"theta must be absolute angles, {_BUT} were absolute before they were added up: give them as "
    "measured, or leave out --relative of npend identify": partial(np.diff, axis=1, prepend=0.0),
    f"theta must be angles from where a link hangs, {_BUT} are from where it stands upright: add "
    "np.pi to them": partial(np.add, np.pi),
}


def check_units(chain: Chain, motion: Motion, *, driven: bool) -> None:
    """Compare the period of the measured swings with that which the given chain would have.

    Motors may move a chain as slowly as they like. So a `driven` chain can only be too fast. A
    factor above 10 is warned of; one above 100 is an error: times in milliseconds, for example.
    """
    values, measured = values_of(chain), motion.period()
    if not np.all(weighs(chain)):  # nothing makes such a link swing
        return
    periods = 2.0 * np.pi * np.sqrt(values[INERTIA] / (chain.gravity * np.abs(values[LIFT])))
    expected = float(np.clip(measured, periods.min(), periods.max()))  # a balanced link is slow
    factor = measured / expected
    if factor >= 1.0 / _UNLIKELY and (driven or factor <= _UNLIKELY):
        return
    text = (
        "times must be in seconds, and lengths and centres in metres: the angles swing with a "
        f"period of about {measured:.2g} s, those of a chain like the one given with one of about "
        f"{expected:.2g} s; are these milliseconds, or millimetres?"
    )
    if max(factor, 1.0 / factor) > _IMPOSSIBLE:
        raise ValueError(text)
    warnings.warn(text, stacklevel=4)


def warn_of_other_angles(motion: Motion, model: Model, fitted: Fit) -> None:
    """Warn if the angles fit much better as angles of joints, or not so, or as from upright.

    `fitted` is the fit of the angles as they were given; the same segments are fitted again.
    """
    tried: list[tuple[float, str]] = []
    for meaning, convert in list(_READINGS.items())[0 if motion.links > 1 else -1 :]:
        stages = Stages(replace(motion, theta=convert(motion.theta)), model)
        with suppress(RuntimeError, np.linalg.LinAlgError):
            other = stages.fit_once(fitted.rows)
            tried += [] if other is None else [(other.rmse, meaning)]
    error, meaning = min(tried, default=(math.inf, ""))
    if error * _BETTER < fitted.rmse:
        warnings.warn(meaning.format(f"{fitted.rmse / error:.1f}"), stacklevel=4)


def warn_of_values(chain: Chain, segments: int, fitted: int, *, rough: bool) -> None:
    """Warn if few segments determine many values, or a value is none of a pendulum in air."""
    if rough:
        warnings.warn(
            f"standard errors are large, and rough: {segments} segments, whose errors last long, "
            f"must tell {fitted} values; record more or livelier motions, or fit fewer quantities",
            stacklevel=4,
        )
    unlikely = [
        f"quadratic_drag[{link}] = {drag:.3g} N s^2/m^2, more than that of a plate of the chain's "
        f"length in both directions in air, {most:.2g} N s^2/m^2"
        for link, drag in enumerate(chain.quadratic_drag.tolist())
        if drag > (most := _AIR * chain.total_length**2)
    ]
    unlikely += [
        f"centres[{link}] = {centre:.3g} m, more than two lengths of the link from its joint"
        for link, (centre, length) in enumerate(
            zip(chain.centres.tolist(), chain.lengths.tolist(), strict=True)
        )
        if abs(centre) > 2.0 * length
    ]
    if unlikely:
        warnings.warn(
            f"the fit found {'; '.join(unlikely)}: record more or livelier motions, fit fewer "
            "quantities, or check lengths and masses",
            stacklevel=4,
        )
