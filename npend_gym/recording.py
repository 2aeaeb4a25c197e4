"""Motions recorded to be shown: a release, or an episode that a policy controls."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym._provenance import provenance
from npend_gym.chain import Chain, check_chain, plain_keywords
from npend_gym.envs.registration import ENV_ID
from npend_gym.experiments import ReleaseExperiment, Run
from npend_gym.experiments.sensing import signals
from npend_gym.period import AROUND, check_definition, codes_of, pseudo_periods
from npend_gym.physics import Trajectory, simulate
from npend_gym.physics.mechanism import AXIAL, PIVOT

DEFAULT_SECONDS = 15.0  # of an episode
_INCOMPLETE_SECONDS = 10.0  # the paper's window, for releases that complete nothing
_AFTERWARDS = 1.05  # a release is recorded a little longer than its last pseudo-period
_MOST_ANGLES = 20_000_000  # in a recording: 160 MB
_PAGE_INTERVAL = 0.04  # s: instants so close that straight lines join them well
_LEAST_INSTANTS, _PAGE_INSTANTS = 100, 600  # at least and at most, of a recording for a page


@dataclass(frozen=True, eq=False)
class Recording:
    """A motion and when each bob completed its pseudo-period."""

    motion: Trajectory  # of T instants from 0 on
    # of every bob [s], (n,), also the instant that completes it; NaN beyond the recording
    periods: FloatArray
    # at `joint`, or force on the cart, over its limit, from each instant on, (T,); the last repeats
    torque: FloatArray
    definition: str  # what completes a pseudo-period, see `npend_gym.pseudo_periods`
    caption: str  # what it is, in a few words
    provenance: dict[str, Any]
    joint: int = 0  # whose torque is recorded; 0 is the pivot, n the cart
    rail: float = 0.0  # half its length [m]; 0 where there is none
    timed: bool = True  # whether pseudo-periods are asked for: of a release

    def signals(self) -> FloatArray:
        """Return the signal of every bob whose changes of sign the definition counts, shape (T, n).

        That is the bob's horizontal velocity [m/s], its rod's angular velocity [rad/s], or its
        height above the start [m]. The horizontal velocity of the centre of mass [m/s] is the same
        for all bobs. From a start beyond 90 degrees velocities are those around the pivot.
        """
        shown = signals(self.motion, self.definition)
        return np.broadcast_to(shown, self.motion.theta.shape)

    @property
    def is_around(self) -> bool:
        """Whether `signals` are velocities around the pivot."""
        return bool(codes_of(self.motion.chain, self.motion.theta[0], self.definition) >= AROUND)

    def cart(self) -> FloatArray:
        """Return where the cart is on its rail [m], shape (T,); zeros where there is none."""
        position = self.motion.position
        if position is None or position.ndim > 1:  # of a pivot that is moved
            return np.zeros(self.motion.times.size)
        return position

    def positions(self) -> FloatArray:
        """Return where the bobs are [m], (T, n, 2), from the pivot or the middle of the rail."""
        return self.on_rail(self.motion.positions())

    def on_rail(self, places: FloatArray) -> FloatArray:
        """Return places from the middle of the rail [m], of those from the cart, (T, k, 2)."""
        return places + self.cart()[:, None, None] * (1.0, 0.0)

    def turning_points(self) -> FloatArray:
        """Return where each bob completed its pseudo-period [m], shape (n, 2), NaN where not.

        Interpolated between the recorded instants: for pictures.
        """
        places, turned = self.positions(), np.empty((self.motion.chain.n, 2))
        for bob, period in enumerate(self.periods.tolist()):
            for axis in (0, 1):
                turned[bob, axis] = np.interp(period, self.motion.times, places[:, bob, axis])
        return turned


def record_release(experiment: ReleaseExperiment, run: Run, interval: float) -> Recording:
    """Record one measured run of `experiment` every `interval` [s].

    It lasts for `experiment.duration`, by default until the last bob has completed; the last
    instant is the first at or after that.
    """
    interval = _checks.positive_number("interval", interval)
    chain, seconds = experiment.chain_of(run.n), _seconds(experiment, run)
    check_angles(seconds / interval, run.n)
    times = interval * np.arange(math.ceil(seconds / interval - 1e-9) + 1)
    motion = simulate(chain, run.start, 0.0, times)
    periods = _recorded(run.periods, motion)
    caption = f"release from {np.degrees(run.start):.3g} degrees, n = {run.n}"
    arguments = experiment.as_dict() | {"n_values": [run.n], "trial": run.trial, "start": run.start}
    return Recording(
        motion, periods, np.zeros(times.size), experiment.definition, caption,
        provenance(arguments, experiment.seed),
    )  # fmt: skip


def _seconds(experiment: ReleaseExperiment, run: Run) -> float:
    """Return for how long a run is recorded [s]."""
    if experiment.duration is not None:
        return experiment.duration
    last = _AFTERWARDS * float(np.nanmax([*run.periods, 0.0]))
    return max(last, _INCOMPLETE_SECONDS) if np.isnan(run.periods).any() else last


def record_simulation(
    chain: Chain,
    theta: ArrayLike,
    omega: ArrayLike,
    seconds: float,
    *intervals: float,
    definition: str = "bob",
    method: str = "dop853",
    dt: float | None = None,
) -> list[Recording]:
    """Record one motion at each of `intervals`, with the pseudo-periods after a release from rest.

    Parameters
    ----------
    chain : Chain
    theta, omega : array_like, shape (n,)
        Angles [rad] and angular velocities [rad/s] at the start; one number stands for all rods.
    seconds : float
        [s]
    *intervals : float
        From instant to instant of a recording [s], one at least.
    definition : str
        What completes a pseudo-period.
    method, dt
        Of `simulate`.

    Returns
    -------
    list of Recording
        One for each of the intervals; they share one simulation.

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule, or the recordings would be too long to be held.
    """
    seconds, n = _checks.positive_number("duration", seconds), check_chain(chain).n
    definition = check_definition(definition)
    theta, omega = _checks.vector("theta", theta, n), _checks.vector("omega", omega, n)
    if not intervals:
        raise ValueError("intervals must be one or more times between instants [s], got none")
    steps = [min(_checks.positive_number("interval", each), seconds) for each in intervals]
    check_angles(sum(seconds / step for step in steps), n)
    instants = [step * np.arange(int(seconds / step + 1e-9) + 1.0) for step in steps]
    options: dict[str, Any] = {"method": method, "dt": dt}
    motion = simulate(chain, theta, omega, np.unique(np.concatenate(instants)), **options)
    first, periods = motion.theta[0], np.full(chain.n, np.nan)
    is_release = not motion.omega[0].any() and 0.0 < np.abs(first).max() <= np.pi
    if is_release:
        periods = pseudo_periods(chain, first, definition=definition, duration=seconds)
    caption = f"n = {chain.n}"
    if is_release and np.ptp(first) == 0.0:
        caption = f"release from {np.degrees(first[0]):.3g} degrees, {caption}"
    given = {"chain": chain, "theta": first, "omega": motion.omega[0]}
    given |= options if options != {"method": "dop853", "dt": None} else {}
    made = provenance(plain_keywords(given | {"seconds": seconds, "definition": definition}))
    shared: dict[str, Any] = {
        "definition": definition,
        "caption": caption,
        "provenance": made,
        "timed": is_release,
    }
    return [
        Recording(one, _recorded(periods, one), np.zeros(one.times.size), **shared)
        for one in (_at(motion, some) for some in instants)
    ]


def _recorded(periods: FloatArray, motion: Trajectory) -> FloatArray:
    """Return pseudo-periods, NaN where they end after the recorded motion."""
    return np.where(periods <= motion.times[-1], periods, np.nan)


def _at(motion: Trajectory, instants: FloatArray) -> Trajectory:
    """Return a motion at some of its instants."""
    rows = np.searchsorted(motion.times, instants)
    names = ("times", "theta", "omega", *PIVOT, *AXIAL)
    kept = {name: getattr(motion, name) for name in names}
    return replace(motion, **{name: each[rows] for name, each in kept.items() if each is not None})


def check_angles(
    instants: float, n: int, remedy: str = "take a longer interval or a shorter duration"
) -> None:
    """Refuse a recording, or a film, that would have too many instants of n rods."""
    if instants * n > _MOST_ANGLES:
        raise ValueError(
            f"a recording must hold at most {_MOST_ANGLES} angles, got {instants:.6g} instants of "
            f"{n} rods; {remedy}"
        )


def record_motion(motion: Trajectory) -> Recording:
    """Return one motion as a recording that starts at 0 s, without pseudo-periods.

    Raises
    ------
    ValueError
        If it is many motions, or less than two instants.
    """
    if motion.theta.ndim > 2:
        raise ValueError(
            f"motion must be one to be shown, got {len(motion)} of them: take trajectory[k]"
        )
    if motion.times.size < 2:
        raise ValueError("motion must have at least two instants to be shown, got 1")
    moved = replace(motion, times=motion.times - motion.times[0])
    still = np.zeros(motion.times.size)
    caption = f"n = {motion.chain.n}"
    return Recording(
        moved, np.full(motion.chain.n, np.nan), still, "bob", caption, motion.provenance,
        timed=False,
    )  # fmt: skip


def record_first_trials(
    experiment: ReleaseExperiment,
    runs: Sequence[Run],
    progress: Callable[[Iterable[Run]], Iterable[Run]] = iter,
) -> list[Recording]:
    """Record the first run of every n among `runs`, in the order of n, for a page.

    `progress` may wrap the iteration over these runs.
    """
    firsts = {run.n: run for run in reversed(runs)}
    recordings: list[Recording] = []
    for run in progress([firsts[n] for n in sorted(firsts)]):
        seconds = _seconds(experiment, run)
        interval = max(min(_PAGE_INTERVAL, seconds / _LEAST_INSTANTS), seconds / _PAGE_INSTANTS)
        recordings.append(record_release(experiment, run, interval))
    return recordings


def _of_one(given: Any) -> Any:
    """Return an array, or each of a dictionary, with a leading axis of one."""
    if not isinstance(given, dict):
        return given[None]
    entries = cast("dict[str, Any]", given)
    return {key: np.asarray(value)[None] for key, value in entries.items()}


def record_episode(
    policy: Callable[[NDArray[np.float32], Any], NDArray[Any]],
    keywords: Mapping[str, Any],
    *,
    seed: int = 0,
    seconds: float = DEFAULT_SECONDS,
    name: str = "policy",
) -> Recording:
    """Record every step of an episode.

    Parameters
    ----------
    policy : callable
        Is called with observations and info that have a leading axis of one, as in a vector
        environment, and returns actions with that axis.
    keywords : mapping
        Keywords of the environment.
    seed : int
        Seed of the reset, zero or more.
    seconds : float
        The recording ends with the episode, at the latest after this time [s].
    name : str
        Name of the policy, for the caption.

    Raises
    ------
    ValueError
        If the recording would be too long to be held.
    """
    seconds, seed = _checks.positive_number("seconds", seconds), _checks.count("seed", seed, low=0)
    env: Any = gym.make(ENV_ID, **keywords)
    config = env.unwrapped.config
    check_angles(seconds / config.dt, config.n)
    observation, info = env.reset(seed=seed)
    infos, done = [info], False
    while not done:
        action = np.asarray(policy(_of_one(observation), _of_one(info)))[0]
        if isinstance(env.action_space, gym.spaces.Box):
            action = action.astype(env.action_space.dtype)
        observation, _, terminated, truncated, info = env.step(action)
        done = terminated or truncated or info["time"] >= seconds - 0.5 * config.dt
        infos.append(info)
    chain = env.unwrapped.chain  # `randomize` may have drawn it
    env.close()
    times, theta, omega = (np.array([i[key] for i in infos]) for key in ("time", "theta", "omega"))
    cart: dict[str, Any] = {}
    if config.has_cart:
        cart = {name: np.array([i[f"cart_{name}"] for i in infos]) for name in PIVOT}
    found = info.get("pseudo_periods", np.zeros(config.n))
    periods = np.where(found > 0.0, found, np.nan)
    name_of_limit = "max_force" if config.has_cart else "max_torque"
    drawn = dict(zip(config.context_names, info.get("context", ()), strict=True))
    limit = drawn.get(name_of_limit, getattr(config, name_of_limit)) or 1.0
    acted = [np.ravel(i.get("torque", 0.0))[0] / limit for i in infos[1:]]
    return Recording(
        Trajectory(chain, times, theta, omega, **cart),
        periods,
        np.array([*acted, acted[-1]]),
        "bob",
        f"{config.mode.name} by {name}, n = {config.chain.n}",
        provenance({"policy": name, "seconds": seconds, "env": plain_keywords(keywords)}, seed),
        int(config.joints[0]) if config.joints.size else 0,
        config.rail or 0.0,
        config.measure_periods,
    )
