"""One motion by DOP853: its states at given times, its steps, and where torques change in time."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import FloatArray
from npend_gym.physics.driving import Drive
from npend_gym.physics.integration import RODS_PER_CALL, check_adaptive_steps
from npend_gym.physics.kernels.dop853 import Problem, dop853_frames, new_solver
from npend_gym.physics.kernels.dynamics import AnyArrays

_STEPS_KEPT = 4096  # in one compiled call that keeps them
MAX_BYTES = 2**33  # of the steps of a motion that are kept
_NOWHERE = np.zeros((0, 0))  # steps are not recorded


class Steps(NamedTuple):
    """Steps one after another, with the polynomials of order 7 between their ends."""

    begin: FloatArray  # s, (S,)
    end: FloatArray  # (S,)
    states: FloatArray  # at the beginning of each, (S, m)
    polynomials: FloatArray  # (S, 7, m)

    def states_at(self, step: NDArray[np.int64], fraction: FloatArray) -> FloatArray:
        """Return the states at fractions of steps, shape (..., m); the bits of `interpolate`."""
        poly, x = self.polynomials[step], fraction[..., None]
        u = 1.0 - x
        p = poly[..., 6, :] * x
        for row in range(5, 0, -1):
            p = (p + poly[..., row, :]) * (u if row % 2 else x)
        return self.states[step] + (p + poly[..., 0, :]) * x

    def parts(self, size: int) -> Iterator[Steps]:
        """Yield these steps, so many at a time."""
        for first in range(0, len(self.begin), size):
            yield Steps(*(each[first : first + size] for each in self))

    def at(self, times: FloatArray) -> FloatArray:
        """Return the states at instants within the steps, shape (..., m)."""
        step = np.clip(np.searchsorted(self.end, times), 0, self.end.size - 1)
        fraction = (times - self.begin[step]) / (self.end - self.begin)[step]
        return self.states_at(step, fraction)


class Motion:
    """A motion to be integrated from a state.

    Parameters
    ----------
    chain : AnyArrays
        As the kernels take it.
    state : ndarray, shape (m,)
        Of angles, n, and what else stands in it; then of their rates.
    drive : Drive
        What acts on it in the course of time.
    rtol, atol, longest : float
        Tolerances, and the longest step [s].
    ends : (float, float)
        Begin and end [s].
    n : int
        Rods.
    """

    def __init__(
        self,
        chain: AnyArrays,
        state: FloatArray,
        drive: Drive,
        rtol: float,
        atol: float,
        longest: float,
        ends: tuple[float, float],
        n: int,
    ) -> None:
        self.chain, self.state, self.drive, self.n = chain, state, drive, n
        self.rtol, self.atol, self.longest, self.ends = rtol, atol, longest, ends

    def segments(
        self, times: FloatArray, *, kept: bool = False
    ) -> Iterator[tuple[slice, FloatArray, Steps | None, FloatArray]]:
        """Integrate from ``times[0]`` on; what is yielded comes from one compiled call.

        Yields
        ------
        slice, ndarray, Steps or None, ndarray
            Which of the times have been passed, the states there, the steps if they are to be
            `kept`, and the numbers of steps taken, refused, and with dense output.
        """
        state, n = self.state, self.n
        most = max(1, RODS_PER_CALL // n)
        row, count = 2 + 8 * state.size, min(most, _STEPS_KEPT) if kept else most
        for piece, torque in self.drive.pieces(float(times[0]), float(times[-1])):
            first, last = np.searchsorted(times, piece, side="right")
            inner = times[first:last]
            # the last instant of a piece need not be one that is asked for
            extra = inner.size == 0 or inner[-1] != piece[1]
            ends = np.concatenate([piece[:1], inner, piece[1:] if extra else inner[:0]])
            solver = new_solver(float(piece[0]), state)
            problem = Problem(self.chain, torque, self.rtol, self.atol)
            frames, done, starting = np.empty((ends.size, state.size)), 1, True
            while done < ends.size:
                before, counted = done, solver.counts.copy()
                visited = np.zeros((count, row)) if kept else _NOWHERE
                with self.drive.heard():
                    done = dop853_frames(
                        solver, problem, starting, ends, done, count, self.longest, frames, visited
                    )
                starting = False
                angles, rates = solver.y[:n], solver.y[state.size // 2 :][:n]
                self.drive.check(angles, rates, float(solver.clock[1]), stuck=done < 0)
                check_adaptive_steps(done, solver, problem, n)
                span = slice(int(first) + before - 1, int(first) + min(done, last - first + 1) - 1)
                states = frames[before : before + span.stop - span.start]
                steps = _steps_of(visited, state.size) if kept else None
                yield span, states, steps, solver.counts - counted
            state = frames[-1]

    @cached_property
    def steps(self) -> Steps:
        """All steps, taken once more; they take 8 states each."""
        parts: list[Steps] = []
        for _, _, part, _ in self.segments(np.array(self.ends), kept=True):
            parts += [] if part is None else [part]
            if sum(part.polynomials.nbytes for part in parts) > MAX_BYTES:
                raise ValueError(
                    f"the steps of a motion must take at most {MAX_BYTES:g} bytes: "
                    "simulate it in segments"
                )
        return Steps(*(np.concatenate(each) for each in zip(*parts, strict=True)))


def _steps_of(visited: FloatArray, size: int) -> Steps:
    visited = visited[visited[:, 1] > visited[:, 0]]
    polynomials = visited[:, 2 + size :].reshape(-1, 7, size)
    return Steps(visited[:, 0], visited[:, 1], visited[:, 2 : 2 + size], polynomials)
