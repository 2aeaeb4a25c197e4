"""The paper's experiment (its section 5, procedure (i)-(vi)): release, time every bob, average."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks, theory
from npend_gym._checks import FloatArray
from npend_gym._streams import Purpose
from npend_gym.chain import MAX_RODS, STANDARD_GRAVITY, Chain
from npend_gym.compiled.philox import first_units, keys_of
from npend_gym.experiments.chains import (
    check_time_scale,
    plain_fields,
    released_chain,
    take_chain,
    take_count,
)
from npend_gym.experiments.sensing import Sensor, sensed_periods
from npend_gym.period import check_definition, pseudo_periods

PAPER_N = (5, 10, 20, 100)
PAPER_AMPLITUDE = math.pi / 4  # rad
PAPER_SPREAD = 0.017  # rad: one degree, the uncertainty of a reading
PAPER_TRIALS = 3
MAX_TRIALS_PER_N = 1_000_000

_Planned: TypeAlias = tuple[int, int, float]  # n, trial, starting angle [rad]


@dataclass(frozen=True)
class ReleaseExperiment:
    """What to release: every n in `n_values`, `trials` times each.

    Attributes
    ----------
    n_values : sequence of int
        Numbers of pendulums.
    trials : int
        Trials for each n.
    amplitude : float
        Angle of all rods at the start, where they are at rest [rad].
    spread : float
        Each trial adds to all rods one angle drawn between zero and this [rad].
    seed : int
        Seed of the draws. Trial t, counted from 1, starts like the environment in mode "passive"
        with the seed `seed` + t - 1, for every n.
    duration : float, optional
        Time for which a release is observed [s]; by default long enough for every bob.
    definition : str
        What completes a pseudo-period: "bob", "link", "height", "com" or "horizontal". See
        `npend_gym.pseudo_periods`.
    masses : float or sequence
        Mass of all bobs, or of each [kg]. For each, `n_values` must be their number.
    lengths : float or sequence
        Length of all rods, or of each [m].
    gravity : float
        Acceleration of gravity [m/s^2].
    damping : float
        Viscous damping of every joint [N m s].
    chain : Chain, dict or str, optional
        A chain, in place of numbers of pendulums, masses, lengths, gravity and damping. It is a
        `Chain`, the dict of its parameters, a preset's name, or a JSON file.
    sensor_interval : float
        Time between two samples of a sensor [s], the first at the release. At 0 there is no sensor:
        instants are exact. The definition decides what it measures: the horizontal velocity of the
        bob or of the centre of mass [m/s], after a start beyond 90 degrees the velocity around the
        pivot; the height of the bob above where it hangs [m]; or for "link" the angular velocity of
        the rod [rad/s], like a gyroscope.
    sensor_noise : float
        Standard deviation of each sample, in the unit of what is measured.
    sensor_offset : float
        Reading of the sensor at zero, in the same unit.
    sensor_scale : float
        Reading of the sensor, minus the offset, for each unit of the measured quantity.

    Examples
    --------
    >>> from npend_gym import experiments
    >>> experiment = experiments.ReleaseExperiment(n_values=[1, 2], trials=1, spread=0.0)
    >>> [round(float(run.mean), 4) for run in experiments.run_release(experiment)]
    [2.0863, 2.7165]
    """

    n_values: Sequence[int] = PAPER_N
    trials: int = PAPER_TRIALS
    amplitude: float = PAPER_AMPLITUDE
    spread: float = PAPER_SPREAD
    seed: int = 0
    duration: float | None = None
    definition: str = "bob"
    masses: ArrayLike = 1.0
    lengths: ArrayLike = 1.0
    gravity: float = STANDARD_GRAVITY
    damping: float = 0.0
    chain: Chain | Mapping[str, Any] | str | None = None
    sensor_interval: float = 0.0
    sensor_noise: float = 0.0
    sensor_offset: float = 0.0
    sensor_scale: float = 1.0

    def __post_init__(self) -> None:
        take_chain(self, "n_values")
        take_count(self, "trials", high=MAX_TRIALS_PER_N)
        take_count(self, "seed", low=0, high=2**63 - 1)
        _checks.number("damping", self.damping)
        check_definition(self.definition)
        self.sensor.check()
        amplitude = abs(_checks.number("amplitude", self.amplitude))
        spread = _checks.nonnegative_number("spread", self.spread)
        if amplitude == 0.0 or amplitude + spread >= math.pi:
            raise ValueError(
                f"amplitude must not be 0 and, with the spread of {spread:g}, must stay "
                f"{_checks.in_radians('pi', self.amplitude)}"
            )
        if self.duration is not None:
            _checks.positive_number("duration", self.duration)
        given: Any = self.n_values
        if not isinstance(given, (Sequence, np.ndarray)):
            raise TypeError(f"n_values must be a list of integers, got {_checks.show(given)}")
        n_values: list[Any] = [*cast("Iterable[Any]", given)]
        if not n_values:
            raise ValueError("n_values must name at least one number of pendulums, got none")
        counts = tuple(_checks.count("n", n, high=MAX_RODS) for n in n_values)
        if len(set(counts)) < len(counts):
            raise ValueError(f"n_values must name each number once, got {_checks.show(n_values)}")
        object.__setattr__(self, "n_values", counts)
        check_time_scale(self.chain_of(self.n_values[0]))
        if not self.has_any_n:  # else rods are alike, and no other n has another time scale
            for n in self.n_values:
                check_time_scale(self.chain_of(n))
        for name in ("masses", "lengths"):
            value = getattr(self, name)
            if np.ndim(value) > 0:  # a list or an array could change later
                object.__setattr__(self, name, tuple(np.asarray(value).tolist()))

    def chain_of(self, n: int) -> Chain:
        """Return the chain of `n` rods that is released."""
        if isinstance(self.chain, Chain):
            return self.chain
        return released_chain(n, self.masses, self.lengths, self.gravity, self.damping)

    @property
    def sensor(self) -> Sensor:
        """The sensor that measures the bobs; an interval of 0 means that there is none."""
        return Sensor(
            self.sensor_interval, self.sensor_noise, self.sensor_offset, self.sensor_scale
        )

    @property
    def has_any_n(self) -> bool:
        """Whether it describes chains of every n, not only of those in `n_values`."""
        return self.chain is None and np.ndim(self.masses) == 0 and np.ndim(self.lengths) == 0

    def runs(self) -> list[_Planned]:
        """Return (n, trial, starting angle [rad]) of every run, trials counted from 1."""
        angles = starts(self.seed, 0, self.trials, self.amplitude, self.spread).tolist()
        return [(n, trial, angle) for n in self.n_values for trial, angle in enumerate(angles, 1)]

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as plain numbers, lists and texts, for a manifest.

        With a `chain`, the fields that it replaces are left out:
        ``ReleaseExperiment(**experiment.as_dict())`` is the same experiment.
        """
        return plain_fields(self, "n_values")


def starts(seed: int, first: int, count: int, amplitude: float, spread: float) -> FloatArray:
    """Return the starting angles of trials `first` to `first` + `count` - 1, counted from 0.

    They are the same in the release experiment, in campaigns and in mode "passive". Trial t of seed
    s starts like the environment after a reset with seed s + t:

        start = amplitude + spread * np.random.Generator(np.random.Philox(key=s + t)).random()

    It depends on nothing else: not on N, on the other trials, or on how they are divided among
    workers. So trial t of every chain starts from the same angle, and seeds that differ by less
    than the number of trials share trials.

    Parameters
    ----------
    seed : int
        At least 0.
    first, count : int
        At least 0.
    amplitude, spread : float
        A trial starts at `amplitude` plus one draw from [0, spread) [rad].

    Returns
    -------
    ndarray, shape (count,)
        [rad]

    Examples
    --------
    >>> from npend_gym import experiments
    >>> experiments.starts(0, 0, 3, 0.785, 0.017).round(3).tolist()
    [0.785, 0.79, 0.793]
    """
    given = {"seed": seed, "first": first, "count": count}
    seed, first, count = (_checks.count(name, value, low=0) for name, value in given.items())
    amplitude = _checks.number("amplitude", amplitude)
    spread = _checks.nonnegative_number("spread", spread)
    keys = keys_of(seed + first, count)
    return amplitude + spread * first_units(keys, step=0, purpose=Purpose.START, episode=0)


@dataclass(frozen=True)
class Run:
    """One release: the pseudo-period of every bob [s], NaN where it did not complete.

    `com` is the pseudo-period of the centre of mass, whatever the definition. A sensor measures
    only by the chosen definition, so `com` is exact unless the definition is "com".
    """

    n: int
    trial: int
    start: float
    periods: FloatArray
    com: float = math.nan

    @property
    def mean(self) -> float:
        """Mean over the bobs that completed [s]; NaN if none did."""
        done = self.periods[np.isfinite(self.periods)]
        return float(done.mean()) if done.size else math.nan


def measure(experiment: ReleaseExperiment, n: int, trial: int, start: float) -> Run:
    """Measure one run of `experiment`, from rest with all rods at `start` [rad].

    Examples
    --------
    >>> from npend_gym import experiments
    >>> plan = experiments.ReleaseExperiment(n_values=[2], trials=1)
    >>> experiments.measure(plan, *plan.runs()[0]).n
    2
    """
    chain, window, sensor = experiment.chain_of(n), experiment.duration, experiment.sensor

    def periods(definition: str) -> FloatArray:
        if sensor.interval > 0.0 and definition == experiment.definition:
            seed = experiment.seed + trial - 1
            return sensed_periods(chain, start, definition, sensor, window, seed)
        return pseudo_periods(chain, start, definition=definition, duration=window)

    return Run(n, trial, start, periods(experiment.definition), float(periods("com")[0]))


def run_release(
    experiment: ReleaseExperiment,
    progress: Callable[[Iterable[_Planned]], Iterable[_Planned]] = iter,
) -> list[Run]:
    """Measure every run of `experiment`; `progress` may wrap the iteration, for a progress bar.

    Examples
    --------
    >>> from npend_gym import experiments
    >>> plan = experiments.ReleaseExperiment(n_values=[2], trials=1, spread=0.0)
    >>> experiments.run_release(plan)[0].periods.round(4).tolist()
    [2.7157, 2.7173]
    """
    return [measure(experiment, *run) for run in progress(experiment.runs())]


def bob_rows(runs: Sequence[Run]) -> list[dict[str, Any]]:
    """Return the tidy table: a row for every n, trial and bob (counted from 1 at the pivot).

    Examples
    --------
    >>> from npend_gym import experiments
    >>> plan = experiments.ReleaseExperiment(n_values=[2], trials=1)
    >>> len(experiments.bob_rows(experiments.run_release(plan)))
    2
    """
    return [
        {
            "n": run.n,
            "trial": run.trial,
            "start_rad": run.start,
            "bob": bob,
            "completed": bool(np.isfinite(period)),
            "pseudo_period_s": float(period),
            "com_s": run.com,
        }
        for run in runs
        for bob, period in enumerate(run.periods, start=1)
    ]


def summary_rows(experiment: ReleaseExperiment, runs: Sequence[Run]) -> list[dict[str, Any]]:
    r"""Return a row for every n: the measurements, the models, and the errors of the models.

    The relative error is the paper's, \|S - T\| / S with S measured and T the model. For the law S
    is the pseudo-period of the centre of mass.

    Examples
    --------
    >>> from npend_gym import experiments
    >>> plan = experiments.ReleaseExperiment(n_values=[1, 2], trials=1)
    >>> [row["n"] for row in experiments.summary_rows(plan, experiments.run_release(plan))]
    [1, 2]
    """
    return [
        _summary(experiment, n, [run for run in runs if run.n == n])
        for n in dict.fromkeys(run.n for run in runs)
    ]


def _summary(experiment: ReleaseExperiment, n: int, runs: Sequence[Run]) -> dict[str, Any]:
    chain = experiment.chain_of(n)
    periods = np.array([run.periods for run in runs])
    done = np.isfinite(periods)
    means = np.array([run.mean for run in runs])
    measured = float(np.nanmean(means)) if done.any() else math.nan
    angles = np.array([run.start for run in runs])
    timed = np.isfinite(means) | (not done.any())
    models = theory.models(chain, angles[timed])
    if not timed.all():  # `com` is of all runs, or not a number
        models = models._replace(law=theory.models(chain, angles).law)
    com = float(np.mean([run.com for run in runs]))
    spreads = [_std(p[d]) for p, d in zip(periods, done, strict=True) if d.any()]
    return {
        "n": n,
        "trials": len(runs),
        "measured_s": measured,
        "bob_spread_s": float(np.mean(spreads)) if spreads else math.nan,
        "trial_spread_s": _std(means[np.isfinite(means)]),
        "completed": int(done.sum()),
        "bobs": int(done.size),
        "com_s": com,
        **{f"{name}_s": period for name, period in models._asdict().items()},
        **{
            f"{name}_error": abs(compared - period) / compared
            for name, period in models._asdict().items()
            for compared in [com if name == "law" else measured]
        },
    }


def _std(values: FloatArray) -> float:
    return float(values.std()) if values.size else math.nan
