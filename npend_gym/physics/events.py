"""Events: instants at which a quantity of a motion is zero, located on the dense solution."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import MAX_RODS, Chain
from npend_gym.physics import energy as _energy
from npend_gym.physics.functions import called
from npend_gym.physics.motion import TakenSteps
from npend_gym.physics.substeps import longest_step

QUANTITIES = ("angle", "angular_velocity", "velocity", "height", "energy", "flip")
_PLACES = np.linspace(0.0, 1.0, 5)  # of a step, or a piece of it, where the sign is looked at
_MOST_PIECES = 1e12  # of a step
_RESOLUTION = 1e-13  # s, of an instant
_RODS_AT_ONCE = 10_000  # rods times steps: what is copied of them stays small, and Ctrl-C is heard


@dataclass(frozen=True)
class Event:
    """A zero of a named quantity of one rod or bob.

    Parameters
    ----------
    quantity : {"angle", "angular_velocity", "velocity", "height", "energy", "flip"}
        The angle of the rod [rad]; its angular velocity [rad/s]; the horizontal velocity of its bob
        [m/s]; the height of its bob above the pivot [m]; the energy of its mass, above hanging at
        rest [J]; or "flip": the rod stands upright, in whatever turn. Velocity and energy are
        relative to the pivot, which may be on a cart.
    rod : int
        Counted from 0 at the pivot, as entries of arrays; -1 is the last. In tables of releases and
        campaigns bobs count from 1, so bob k hangs on rod k - 1.
    value : float
        The event is where the quantity less `value` is zero.
    direction : {-1, 0, 1}
        Falling zeros alone, all, or rising ones alone.
    terminal : bool or int
        Whether the motion ends at the first of them; a number k ends it at the k-th, 0 never.

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.

    Examples
    --------
    >>> import numpy as np
    >>> from npend_gym import Chain, Event, simulate
    >>> top = Event("angular_velocity", rod=0, direction=-1)
    >>> motion = simulate(Chain.uniform(1), 0.5, 0.0, [0.0, 5.0], events=[top])
    >>> motion.t_events[0].round(4).tolist()
    [2.0379, 4.0757]
    """

    quantity: str
    rod: int = -1
    value: float = 0.0
    direction: int = 0
    terminal: bool | int = False

    def __post_init__(self) -> None:
        """Check the arguments."""
        _checks.choice("quantity", self.quantity, QUANTITIES)
        _checks.number("value", self.value)
        _checks.count("rod", self.rod, low=-MAX_RODS, high=MAX_RODS)
        _checks.count("direction", self.direction, low=-1, high=1)
        _end_at(self.terminal)
        if self.quantity == "flip" and (self.value, self.direction) != (0.0, 0):
            raise ValueError(
                "value and direction must be 0 for a flip, which has no sign; got "
                f"value {self.value:g} and direction {self.direction}: use an angle"
            )

    def of(self, chain: Chain, q: FloatArray, u: FloatArray) -> FloatArray:
        """Return the quantity less `value` in states (..., m) of all coordinates, shape (...)."""
        i, n = self.rod, chain.n
        theta, omega, axial = q[..., :n], u[..., :n], ()
        if chain.stiffness is not None:
            axial = q[..., -n:], u[..., -n:]
        if self.quantity == "angle":
            found = theta[..., i]
        elif self.quantity == "angular_velocity":
            found = omega[..., i]
        elif self.quantity == "flip":
            return np.cos(0.5 * theta[..., i])
        elif self.quantity == "velocity":
            found = _energy.velocities_of_motion(chain, theta, omega, *axial)[..., i, 0]
        elif self.quantity == "height":
            rods = _energy.stretched(chain, axial[0]) if axial else chain
            found = _energy.positions(rods, theta)[..., i, 1]
        else:
            found = _energy.energy_of_links(chain, theta, omega)[..., i]
        return np.asarray(found - self.value)


EventFunction = Callable[[float, FloatArray, FloatArray], float]


class Watched(NamedTuple):
    """An event as it is looked for."""

    # Of instants and states, many at once; writes into a fourth array, which it returns
    function: Callable[..., FloatArray]
    direction: int
    end_at: int  # its occurrence that ends the motion, counted from 1; 0 is none
    opaque: bool  # a function of the user's, which need not follow the motion alone


class Occurrence(NamedTuple):
    """An instant of an event, and the state there."""

    time: float  # s
    state: FloatArray  # (m,)


class Looked(NamedTuple):
    """What an event showed in some steps."""

    found: list[Occurrence]
    last: float  # its value at the end
    failure: tuple[float, ValueError] | None  # the instant at which it raised, and what


class Watch:
    """Looks for events in steps that come one after another.

    Parameters
    ----------
    events, chain
        As for `watched`.
    times : ndarray, shape (T,)
        Of the motion [s].

    Attributes
    ----------
    end : Occurrence or None
        The one that ends the motion, after which nothing is kept.
    """

    def __init__(self, events: Any, chain: Chain, times: FloatArray) -> None:
        self._events, self._n = watched(events, chain), chain.n
        opaque = any(event.opaque for event in self._events)
        # no step is cut, which would change the motion: its pieces are looked at
        self._longest = longest_step(chain, times) if opaque else math.inf
        self._found: list[list[Occurrence]] = [[] for _ in self._events]
        self._last = [math.nan for _ in self._events]  # values at the end of the last step
        self.end: Occurrence | None = None

    def look(self, steps: TakenSteps) -> bool:
        """Keep the events in some steps; return whether one of them ends the motion.

        An event that raises after the end of the motion is no error.
        """
        for pieces in self._pieces(steps):
            each_event = zip(self._events, self._last, strict=True)
            looked = [_occurrences(event, last, steps, *pieces) for event, last in each_event]
            new, self._last = [each.found for each in looked], [each.last for each in looked]
            each_event = zip(self._events, self._found, new, strict=True)
            ends = [found[event.end_at - len(kept) - 1] for event, kept, found in each_event
                    if 0 < event.end_at <= len(kept) + len(found)]  # fmt: skip
            self.end = end = min(ends, key=lambda each: each.time, default=None)
            failures = [each.failure for each in looked if each.failure is not None]
            failure = min(failures, key=lambda each: each[0], default=None)
            if failure is not None and (end is None or failure[0] < end.time):
                raise failure[1]
            for kept, found in zip(self._found, new, strict=True):
                kept += [each for each in found if end is None or each.time <= end.time]
            if end is not None:
                return True
        return False

    def _pieces(self, steps: TakenSteps) -> Iterator[tuple[NDArray[np.int64], FloatArray]]:
        """Yield pieces of steps in time, some at once: their steps (K,), fractions of these."""
        most = max(1, 2 * _RODS_AT_ONCE // steps.states.shape[1])
        pieces = np.ceil((steps.end - steps.begin) / self._longest)
        ends = np.cumsum(np.clip(pieces, 1.0, _MOST_PIECES).astype(np.int64))
        for first in range(0, int(ends[-1]) if ends.size else 0, most):
            piece = np.arange(first, min(first + most, int(ends[-1])))
            index = np.searchsorted(ends, piece, side="right")
            count = np.diff(ends, prepend=0)[index]
            yield index, ((piece - ends[index] + count)[:, None] + _PLACES) / count[:, None]

    def as_dict(self) -> dict[str, list[FloatArray]]:
        """Return what was found, by the names of `Trajectory`."""
        n = self._n
        states = [np.array([each.state for each in found]) for found in self._found]
        halves = [each.reshape(len(each), 2, -1) if each.size else np.zeros((0, 2, n))
                  for each in states]  # fmt: skip
        return {
            "t_events": [np.array([each.time for each in found]) for found in self._found],
            "theta_events": [half[:, 0, :n] for half in halves],
            "omega_events": [half[:, 1, :n] for half in halves],
        }


def watched(events: Any, chain: Chain) -> list[Watched]:
    """Return the events that an argument means: one, or a sequence; see `simulate`.

    Raises
    ------
    ValueError, TypeError
        If one is neither an `Event` nor a function, or has no such rod.
    """
    if events is None:
        return []
    listed = cast("list[Any]", [*events] if isinstance(events, (list, tuple)) else [events])
    found: list[Watched] = []
    for event in listed:
        if isinstance(event, Event):
            if not -chain.n <= event.rod < chain.n:
                raise ValueError(
                    f"rod of an event must be from {-chain.n} to {chain.n - 1} for {chain.n} rods, "
                    f"got {event.rod}"
                )
            if event.quantity == "energy" and chain.stiffness is not None:
                raise ValueError(
                    "quantity of an event must not be energy for springs, whose energy belongs to "
                    "no bob: use a function event(t, theta, omega)"
                )
            function = _of_event(event, chain)
        elif callable(event):
            function = _of_function(event)
        else:
            raise TypeError(
                "events must be Event, functions event(t, theta, omega), or a list of these; got "
                f"{_checks.show(event)}"
            )
        direction = int(np.sign(getattr(event, "direction", 0)))
        end_at = _end_at(getattr(event, "terminal", False))
        found.append(Watched(function, direction, end_at, not isinstance(event, Event)))
    return found


def _end_at(terminal: Any) -> int:
    """Return the occurrence at which a motion ends, counted from 1; 0 where it does not."""
    if terminal is None or isinstance(terminal, (bool, np.bool_)):
        return 1 if terminal else 0
    return _checks.count("terminal", terminal, low=0)


def _of_event(event: Event, chain: Chain) -> Callable[..., FloatArray]:
    def values(_: FloatArray, q: FloatArray, u: FloatArray, out: FloatArray) -> FloatArray:
        out[...] = event.of(chain, q, u)
        return out

    return values


def _of_function(event: Callable[..., Any]) -> Callable[..., FloatArray]:
    """Return a function of one state as one of many."""
    name = getattr(event, "__name__", "an event")

    def values(t: FloatArray, q: FloatArray, u: FloatArray, out: FloatArray) -> FloatArray:
        for at in np.ndindex(t.shape):
            value = called(name, event, float(t[at]), q[at], u[at])
            if value.shape != () or not np.isfinite(value):
                raise ValueError(
                    f"{name}(t, theta, omega) must return one finite number, got "
                    f"{_checks.show(value)} at t = {t[at]:g} s"
                )
            out[at] = value
        return out

    return values


def _occurrences(
    event: Watched, last: float, steps: TakenSteps, index: NDArray[np.int64], x: FloatArray
) -> Looked:
    """Return the zeros within pieces of steps that are looked at together, and the last value.

    The sign is looked at in a few places `x` of each. Where two steps meet, their values differ by
    rounding, perhaps in sign: that of the earlier step counts. It is `last` for the first of these
    steps, or NaN if the motion begins there. A value of zero has no sign: a motion that begins
    there is no event, and one that comes there is.
    """
    from scipy.optimize import brentq

    half, length = steps.states.shape[1] // 2, steps.end - steps.begin
    states = steps.states_at(np.broadcast_to(index[:, None], x.shape), x)
    times = steps.begin[index, None] + length[index, None] * x
    values, failure = np.full(times.shape, np.nan), None
    try:
        event.function(times, states[..., :half], states[..., half:], values)
    except ValueError as error:
        failure = float(times.flat[np.isnan(values).argmax()]), error
    values[1:, 0] = values[:-1, -1]
    values[0, 0] = values[0, 0] if math.isnan(last) else last
    before, after = values[:, :-1], values[:, 1:]
    rising, falling = (before < 0.0) & (after >= 0.0), (before > 0.0) & (after <= 0.0)
    wanted = {1: rising, -1: falling, 0: rising | falling}[event.direction]
    found: list[Occurrence] = []
    for k, part in np.argwhere(wanted):
        step = index[k]

        def value(fraction: float, step: Any = step) -> float:
            state = steps.states_at(step, np.array(fraction))
            at = steps.begin[step] + fraction * length[step]
            return float(event.function(at, state[:half], state[half:], np.empty(())))

        tolerance = max(_RESOLUTION / float(length[step]), 4.0 * np.finfo(float).eps)
        low, high = float(x[k, part]), float(x[k, part + 1])
        ends = value(low), value(high)
        if ends[0] * ends[1] > 0.0:  # zero at an end, but for rounding
            root = high if abs(ends[1]) < abs(ends[0]) else low
        else:
            root = float(brentq(value, low, high, xtol=tolerance))
        instant = float(steps.begin[step] + root * length[step])
        found.append(Occurrence(instant, steps.states_at(step, np.array(root))))
    return Looked(found, float(values[-1, -1]), failure)
