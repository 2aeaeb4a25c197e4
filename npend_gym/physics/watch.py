"""Events looked for in the steps of motions side by side: their signs, then their zeros."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import count
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import BoolArray, FloatArray
from npend_gym.chain import Chain
from npend_gym.physics.events import Watched, watched
from npend_gym.physics.motion import TakenSteps
from npend_gym.physics.substeps import longest_step

_PLACES = np.linspace(0.0, 1.0, 5)  # of a step, or a piece of it, where the sign is looked at
_MOST_PIECES = 1e12  # of a step
_MOST_CHOSEN = 60  # points at which a zero is guessed
_RESOLUTION = 1e-13  # s, of an instant
_RODS_AT_ONCE = 10_000  # rods times steps: what is copied of them stays small, and Ctrl-C is heard


class Occurrence(NamedTuple):
    """An instant of an event, and the state there."""

    time: float  # s
    state: FloatArray  # (2m,)


class Zeros(NamedTuple):
    """Zeros of an event in motions side by side, in the order of these and of time."""

    lane: NDArray[np.int64]  # (Z,)
    time: FloatArray  # s, (Z,)
    state: FloatArray  # (Z, 2m)

    def some(self, which: Any) -> Zeros:
        """Return some of them."""
        return Zeros(self.lane[which], self.time[which], self.state[which])


class Sightings:
    """What was seen of each event in one motion.

    Attributes
    ----------
    end : Occurrence or None
        The one that ends the motion, after which nothing is kept.
    """

    def __init__(self, events: int) -> None:
        self._events = events
        self.clear()

    def clear(self) -> None:
        """Forget all."""
        events = self._events
        self.found: list[list[Zeros]] = [[] for _ in range(events)]
        self.counts: list[int] = [0] * events
        self.last: list[float] = [math.nan] * events  # values at the end of the last step
        self.end: Occurrence | None = None

    def keep(self, events: list[Watched], found: list[Zeros]) -> None:
        """Keep what came next, up to the event that ends the motion."""
        ends: list[Occurrence] = []
        for event, before, zeros in zip(events, self.counts, found, strict=True):
            if 0 < event.end_at <= before + zeros.time.size:
                k = event.end_at - before - 1
                ends.append(Occurrence(float(zeros.time[k]), zeros.state[k]))
        self.end = min(ends, key=lambda each: each.time, default=None)
        for k, zeros in enumerate(found):
            own = zeros if self.end is None else zeros.some(zeros.time <= self.end.time)
            self.found[k].append(own)
            self.counts[k] += own.time.size

    def as_dict(self, n: int, width: int) -> dict[str, list[FloatArray]]:
        """Events found, by the names of `Trajectory`; `width` is that of a state, 2m."""
        half, no_time, no_state = width // 2, np.zeros(0), np.zeros((0, width))
        states = [np.concatenate([no_state, *(each.state for each in found)])
                  for found in self.found]  # fmt: skip
        return {
            "t_events": [np.concatenate([no_time, *(each.time for each in found)])
                         for found in self.found],
            "theta_events": [state[:, :n].copy() for state in states],
            "omega_events": [state[:, half : half + n].copy() for state in states],
        }  # fmt: skip


class Watch:
    """Looks for events in steps of motions side by side, which come one after another.

    Parameters
    ----------
    events, chain
        As for `watched`.
    times : ndarray, shape (T,)
        Of the motions [s].
    seen : list of Sightings
        What is found, of each motion.
    """

    def __init__(self, events: Any, chain: Chain, times: FloatArray, seen: list[Sightings]) -> None:
        self._events, self._seen = watched(events, chain), seen
        opaque = any(event.opaque for event in self._events)
        # no step is cut, which would change the motion: its pieces are looked at
        self._longest = longest_step(chain, times) if opaque else math.inf

    def look(self, steps: Sequence[TakenSteps]) -> bool:
        """Keep the events in some steps of each motion; return whether events have ended all.

        An event that raises after the end of the motion is no error.
        """
        steps = steps[: len(self._seen)]  # lanes to spare repeat the last motion
        lanes = np.repeat(np.arange(len(steps)), [each.begin.size for each in steps])
        joined = TakenSteps(*map(np.concatenate, zip(*steps, strict=True)))
        for index, x in self._pieces(joined):
            live = np.array([one.end is None for one in self._seen])[lanes[index]]
            pieces = lanes[index[live]], index[live], x[live]
            if not live.any():
                continue
            looked = [
                _look(event, [one.last[k] for one in self._seen], joined, *pieces)
                for k, event in enumerate(self._events)
            ]
            for lane in cast("set[int]", {*pieces[0].tolist()}):
                seen, row = self._seen[lane], int(np.searchsorted(pieces[0], lane, "right")) - 1
                own: list[Zeros] = []
                for k, each in enumerate(looked):
                    first, last = np.searchsorted(each.zeros.lane, [lane, lane + 1])
                    own.append(each.zeros.some(slice(first, last)))
                    seen.last[k] = float(each.last[row])
                seen.keep(self._events, own)
            failures = [each.failure for each in looked if each.failure is not None]
            failure = min(failures, key=lambda each: each[0], default=None)
            end = self._seen[0].end  # functions, which fail, are looked for in one motion alone
            if failure is not None and (end is None or failure[0] < end.time):
                raise failure[1]
        return all(one.end is not None for one in self._seen)

    def _pieces(self, steps: TakenSteps) -> Iterator[tuple[NDArray[np.int64], FloatArray]]:
        """Yield pieces of steps in time, some at once: their steps (K,), fractions of these."""
        most = max(1, 2 * _RODS_AT_ONCE // steps.states.shape[1])
        pieces = np.ceil((steps.end - steps.begin) / self._longest)
        ends = np.cumsum(np.clip(pieces, 1.0, _MOST_PIECES).astype(np.int64))
        for first in range(0, int(ends[-1]) if ends.size else 0, most):
            piece = np.arange(first, min(first + most, int(ends[-1])))
            index = np.searchsorted(ends, piece, side="right")
            cuts = np.diff(ends, prepend=0)[index]
            yield index, ((piece - ends[index] + cuts)[:, None] + _PLACES) / cuts[:, None]


class Looked(NamedTuple):
    """What an event showed in pieces of steps."""

    zeros: Zeros
    last: FloatArray  # its value at the end of each piece, (K,)
    failure: tuple[float, ValueError] | None  # the instant at which it raised, and what


def _look(
    event: Watched, last: list[float], steps: TakenSteps, lane: NDArray[np.int64],
    index: NDArray[np.int64], x: FloatArray,
) -> Looked:  # fmt: skip
    """Return the zeros within pieces of steps, which are looked at together.

    The sign is looked at in a few places `x` of each. Where two pieces meet, their values differ by
    rounding, perhaps in sign: that of the earlier counts. It is `last` for the first of a motion
    among these, or NaN if the motion begins there. A value of zero has no sign: a motion that
    begins there is no event, and one that comes there is.
    """
    half, read = steps.states.shape[1] // 2, steps
    if event.alone is not None:
        place = event.alone[0] + event.alone[1] * half
        read, half = steps.columns(slice(place, place + 1)), None

    def values_at(step: NDArray[np.int64], fraction: FloatArray, out: FloatArray) -> FloatArray:
        states = read.states_at(step, fraction)
        halves = states[..., :half], states[..., half or 0 :]
        return event.function(steps.times_at(step, fraction), *halves, out)

    values, failure = np.full(x.shape, np.nan), None
    try:
        values_at(index[:, None], x, values)
    except ValueError as error:
        failure = float(steps.times_at(index[:, None], x).flat[np.isnan(values).argmax()]), error
    starts = np.diff(lane, prepend=-1) > 0
    before_first = np.array(last)[lane[starts]]
    first = np.where(np.isnan(before_first), values[starts, 0], before_first)
    values[1:, 0] = values[:-1, -1]
    values[starts, 0] = first
    before, after = values[:, :-1], values[:, 1:]
    rising, falling = (before < 0.0) & (after >= 0.0), (before > 0.0) & (after <= 0.0)
    k, part = {1: rising, -1: falling, 0: rising | falling}[event.direction].nonzero()
    step, roots = index[k], np.zeros(k.size)
    if k.size:
        length = steps.end[step] - steps.begin[step]
        tolerance = np.maximum(_RESOLUTION / length, 4.0 * np.finfo(float).eps)
        roots = _roots(lambda which, fraction: values_at(step[which], fraction, fraction.copy()),
                       x[k, part], x[k, part + 1], tolerance)  # fmt: skip
    found = Zeros(lane[k], steps.times_at(step, roots), steps.states_at(step, roots))
    return Looked(found, values[:, -1], failure)


def _roots(
    function: Callable[[NDArray[np.int64], FloatArray], FloatArray],
    low: FloatArray, high: FloatArray, tolerance: FloatArray,
) -> FloatArray:  # fmt: skip
    """Return zeros of many functions between ends of unlike sign, by Chandrupatla's method.

    T. R. Chandrupatla, Adv. Eng. Softw. 28, 1997. Where the signs of the ends are alike, but for
    rounding, the end with the smaller value is the zero. `function` has the values of those that
    are counted in its first argument.
    """
    which, roots = np.arange(low.size), np.empty(low.size)
    at_ends = function(which, low), function(which, high)
    kept: FloatArray = np.array([high, low, low, at_ends[1], *at_ends[:1] * 2, 0.5 + 0.0 * low])
    done: BoolArray = kept[3] * kept[4] >= 0.0
    for k in count():
        roots[which] = np.where(np.abs(kept[3]) < np.abs(kept[4]), kept[0], kept[1])
        which, kept = which[~done], kept[:, ~done]
        a, b, c, fa, fb, fc, t = cast("tuple[FloatArray, ...]", tuple(kept))
        if not which.size:
            break
        at = a + t * (b - a)
        value = function(which, at)
        same = (value < 0.0) == (fa < 0.0)
        c, fc = np.where(same, a, b), np.where(same, fa, fb)
        b, fb = np.where(same, b, a), np.where(same, fb, fa)
        a, fa = at, value
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            least = np.minimum(0.5, 0.5 * tolerance[which] / np.abs(b - a))
            xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
            inverse = fa / (fb - fa) * fc / (fb - fc)
            inverse = inverse + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
            sound = (phi * phi < xi) & ((1.0 - phi) ** 2 < 1.0 - xi) & np.isfinite(inverse)
        done = (value == 0.0) | (least >= 0.5)
        # values that are no smooth function are halved to the end
        t = np.clip(np.where(sound & (k < _MOST_CHOSEN), inverse, 0.5), least, 1.0 - least)
        kept = np.array([a, b, c, fa, fb, fc, t])
    return roots
