"""What drives a motion: constants, quantities that were sampled in time, functions."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from itertools import pairwise
from typing import Any

import numpy as np

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.compiled.callbacks import Callback
from npend_gym.physics.functions import NAMES, callback_of, called, takes_time_alone
from npend_gym.physics.kernels.driven import Driven, Sampled, Torque
from npend_gym.physics.signals import Signal, TimeVarying


class Drives:
    """The torques, the force on a cart and the acceleration of the pivot of one motion.

    Parameters
    ----------
    n : int
        Rods.
    fixed : ndarray, shape (n + AFTER_TORQUES,)
        What stands for those that do not change: torques on joints, force, acceleration.
    varying : dict
        `Signal` or function by name, see NAMES.
    loads : int
        Entries that kernels take as torques: n, or n + 1 where the base moves.

    Raises
    ------
    ValueError
        If functions and signals are mixed.
    """

    def __init__(
        self, n: int, fixed: FloatArray, varying: dict[str, TimeVarying], loads: int
    ) -> None:
        self.n: int = n
        self.fixed: FloatArray = fixed
        self.varying: dict[str, TimeVarying] = varying
        self._loads = loads
        self._callback: Callback | None = None
        self._broken = np.full(1, np.nan)  # instant at which a function wrote NaN or infinity
        functions = [name for name, each in varying.items() if not isinstance(each, Signal)]
        if functions and len(functions) < len(varying):
            raise ValueError(
                f"{' and '.join(varying)} must be all functions or all signals, got a function for "
                f"{' and '.join(functions)} alone; a function may call a Signal"
            )

    def check_time_alone(self, t: float, q: FloatArray, u: FloatArray) -> None:
        """Refuse functions that depend on the state: their derivatives are not known."""
        self.at(np.array([t]), q[None], u[None], alone=True)

    def begin(
        self, t: float, q: FloatArray, u: FloatArray, kept: dict[Any, Callback] | None = None
    ) -> None:
        """Call all functions once; refuse what they return there if it breaks their rules.

        `kept` has the machine code that other motions of the same call were driven by.
        """
        scalar = self.check_functions(t, q, u)
        if self.varying and not any(isinstance(each, Signal) for each in self.varying.values()):
            kept = {} if kept is None else kept
            made = kept.get(scalar) or callback_of(self.varying, self.fixed, scalar=scalar)
            if made.compiled:  # one in Python keeps what it raised
                kept[scalar] = made
            self._callback = made

    def check_functions(self, t: float, q: FloatArray, u: FloatArray) -> bool:
        """Refuse what functions return if it breaks their rules; return if the torque is one."""
        shapes = {"torque": ((), (self.n,)), "force": ((),), "pivot_acceleration": ((2,),)}
        scalar = True
        for name, each in self.varying.items():
            if isinstance(each, Signal):
                _check_width(name, each, shapes[name])
                continue
            value = _called(name, each, t, q, u)
            if value.shape not in shapes[name] or not np.all(np.isfinite(value)):
                rule = " or ".join(str(shape) for shape in shapes[name])
                raise ValueError(
                    f"{name}(t, theta, omega) must return finite numbers of shape {rule}, got "
                    f"{_checks.show(value)} at t = {t:g} s"
                )
            scalar = scalar and (name != "torque" or value.ndim == 0)
        return scalar

    def at(
        self, times: FloatArray, q: FloatArray, u: FloatArray, *, alone: bool = False
    ) -> FloatArray:
        """Loads at instants (S,) in states (S, m) each, (S, n + AFTER_TORQUES).

        With `alone`, refuse functions that depend on the state in any of these.
        """
        values, places = np.tile(self.fixed, (times.size, 1)), slots(self.n)
        for name, each in self.varying.items():
            in_time = isinstance(each, Signal) or takes_time_alone(each)
            for k, t in enumerate(times.tolist()):
                state = () if in_time else (q[k], u[k])
                given = each(t) if isinstance(each, Signal) else called(name, each, t, *state)
                if alone and not in_time:
                    _check_alone(name, each, t, q[k], u[k], given)
                given = np.atleast_1d(given)
                values[k, places[name]][: given.size] = given
        return values

    def pieces(self, begin: float, end: float) -> Iterator[tuple[FloatArray, Torque]]:
        """Yield intervals within which nothing jumps, and what acts there, from begin to end."""
        whole, loads = np.array([begin, end]), self.fixed[: self._loads].copy()
        if end <= begin:
            return
        if not self.varying:
            yield whole, loads
            return
        if self._callback is not None:
            yield whole, Driven(self._callback.address, self.fixed.copy(), loads, self._broken)
            return
        signals = {name: each for name, each in self.varying.items() if isinstance(each, Signal)}
        knots = {name: np.asarray(each.times) for name, each in signals.items()}
        for name, times in knots.items():
            if not signals[name].covers(begin, end):
                raise ValueError(
                    f"{name} must be sampled over the whole motion, {begin:.10g} to {end:.10g} s; "
                    f"its samples are from {times[0]:.10g} to {times[-1]:.10g} s"
                )
        inner = np.unique(np.concatenate([*knots.values()]))
        ends = np.concatenate([[begin], inner[(inner > begin) & (inner < end)], [end]])
        for piece in pairwise(ends):
            yield np.array(piece), self._line(float(piece[0]), signals, loads)

    def _line(self, begin: float, signals: dict[str, Signal], loads: FloatArray) -> Sampled:
        """Return the straight lines on which the signals run from an instant on."""
        line = np.array([self.fixed, np.zeros_like(self.fixed)])
        places = slots(self.n)
        for name, each in signals.items():
            value, slope = each.line(begin)
            line[:, places[name]][:, : value.size] = value, slope
        return Sampled(begin, line, loads)

    @contextmanager
    def interruptible(self) -> Generator[None, None, None]:
        """Hold Ctrl-C back while compiled code calls functions in Python, where it would be lost.

        The functions then write NaN, which ends the compiled call, and the signal is given again.
        """
        callback = self._callback
        if (
            callback is None
            or callback.compiled
            or threading.current_thread() is not threading.main_thread()
        ):
            yield
            return
        pressed: list[int] = []

        def hold(number: int, _: object) -> None:
            pressed.append(number)
            callback.stopped = True

        before = signal.signal(signal.SIGINT, hold)
        try:
            yield
        finally:
            callback.stopped = False
            signal.signal(signal.SIGINT, before)
        if pressed:
            signal.raise_signal(signal.SIGINT)

    def check(self, q: FloatArray, u: FloatArray, t: float, *, stuck: bool) -> None:
        """Raise what a function raised, or where the motion is `stuck` say that it returned NaN."""
        if self._callback is None:
            return
        failure, self._callback.failure = self._callback.failure, None
        at = float(self._broken[0])
        if isinstance(failure, Exception):
            if not np.isfinite(at):  # the state had diverged before the function was called
                return
            raise ValueError(
                f"{' or '.join(self.varying)} raised {type(failure).__name__} soon after "
                f"t = {t:g} s: {failure}"
            ) from failure
        if failure is not None:
            raise failure
        if stuck and np.isfinite(at):
            for name, each in self.varying.items():  # to name the exception of machine code
                _called(name, each, at, q, u)
            raise ValueError(
                f"{' and '.join(self.varying)} must return finite numbers, got NaN, infinity, "
                f"another shape or an exception soon after t = {t:g} s"
            )


def _check_width(name: str, given: Signal, shapes: tuple[tuple[int, ...], ...]) -> None:
    shape = np.shape(given.values)[1:]
    if shape not in shapes:
        raise ValueError(
            f"{name}: values of the signal must have the shape "
            + " or ".join(str(("K", *each)).replace("'", "") for each in shapes)
            + f", got {np.shape(given.values)}"
        )


def _check_alone(
    name: str,
    function: Callable[..., Any],
    t: float,
    q: FloatArray,
    u: FloatArray,
    here: FloatArray,
) -> None:
    """Refuse a function that returns something else than `here` in states nearby."""
    change = 0.1 * np.sqrt(np.arange(1.0, q.size + 1.0))  # changes what lies between rods, too
    for state in ((q + change, u), (q, u + change)):
        if not np.array_equal(here, called(name, function, t, *state)):
            raise ValueError(
                f"{name} must depend on time alone where motions are differentiated, but "
                f"{getattr(function, '__name__', 'the function')} returns something else in "
                "another state, and its derivative is not known: give resistance to the chain "
                "(damping, friction, drag), or take the steps of DifferentiableEnsemble for "
                "feedback"
            )


def _called(
    name: str, function: Callable[..., Any], t: float, q: FloatArray, u: FloatArray
) -> FloatArray:
    return called(name, function, t, *(() if takes_time_alone(function) else (q, u)))


def slots(n: int) -> dict[str, slice]:
    """Return where each drive stands in what kernels are given, by NAMES."""
    return dict(zip(NAMES, (slice(n), slice(n, n + 1), slice(n + 1, n + 3)), strict=True))
