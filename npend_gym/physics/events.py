"""Events: instants at which a quantity of a motion is zero, located on the dense solution."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, cast

import numpy as np

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import MAX_RODS, Chain
from npend_gym.physics import energy as _energy
from npend_gym.physics.functions import called

QUANTITIES = ("angle", "angular_velocity", "velocity", "height", "energy", "flip")


@dataclass(frozen=True)
class Event:
    """A zero of a named quantity of one rod or bob.

    Parameters
    ----------
    quantity : {"angle", "angular_velocity", "velocity", "height", "energy", "flip"}
        The angle of the rod [rad]; its angular velocity [rad/s]; the horizontal velocity of its bob
        [m/s]; the height of its bob above the pivot [m]; the energy of its mass, above hanging at
        rest [J]; or "flip": the rod stands upright, after any number of turns. Velocity and energy
        are relative to the pivot, which may be on a cart.
    rod : int
        Counted from 0 at the pivot, as entries of arrays; -1 is the last. In tables of releases and
        campaigns bobs count from 1, so bob k hangs on rod k - 1.
    value : float
        The event occurs when the quantity equals `value`.
    direction : {-1, 0, 1}
        -1: only falling zeros; 0: all zeros; 1: only rising zeros.
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
        """Return the quantity minus `value` in states (..., m) of all coordinates, shape (...)."""
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
    alone: tuple[int, int] | None  # it reads this rod's entry of a half of the states, and no other


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
            half = {"angle": 0, "flip": 0, "angular_velocity": 1}.get(event.quantity)
            alone = None if half is None else (event.rod % chain.n, half)
            function = _of_event(event if alone is None else replace(event, rod=0), chain)
        elif callable(event):
            function, alone = _of_function(event), None
        else:
            raise TypeError(
                "events must be Event, functions event(t, theta, omega), or a list of these; got "
                f"{_checks.show(event)}"
            )
        direction = int(np.sign(getattr(event, "direction", 0)))
        end_at = _end_at(getattr(event, "terminal", False))
        opaque = not isinstance(event, Event)
        found.append(Watched(function, direction, end_at, opaque, alone))
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
