"""The steps of a motion taken once more, with what their derivatives need."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import NamedTuple

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.physics.directions import with_features
from npend_gym.physics.kernels.driven import Sampled, Torque
from npend_gym.physics.kernels.dynamics import AnyArrays
from npend_gym.physics.kernels.tape import Steps
from npend_gym.physics.motion import Integration, TakenSteps

AT_A_TIME = 256  # steps


class Tape(NamedTuple):
    """Some steps of a motion, for kernels that differentiate them."""

    steps: Steps
    loads: FloatArray  # (S or 1, stages or 1, loads)
    frames: slice  # which of the instants lie in them
    end: float  # s
    after: FloatArray  # the state at the end of the last of them, (2m,)


def tapes(motion: Integration, times: FloatArray, steps: int = AT_A_TIME) -> Iterator[Tape]:
    """Integrate a motion from ``times[0]`` on, and yield its steps in pieces.

    They have the bits of those that `simulate` takes from the same start with the same settings.
    """
    method = motion.method
    ends = times if motion.stops else times[[0, -1]]  # what lies between changes no steps
    for segment in motion.segments(ends, kept=True, dense=False, most=steps):
        (taken,) = segment.steps
        if not taken.begin.size:
            continue
        begin, end, length = taken.begin, taken.end, taken.end - taken.begin
        first, last = np.searchsorted(times, [begin[0], end[-1]], side="right")
        instants = times[first:last]
        at = np.searchsorted(end, instants)
        within, stages = instants < end[at], np.full(len(begin), method.stages)
        weights = np.tile(method.end, (at.size, 1))
        if within.any():
            inside = at[within]
            fraction = (instants[within] - begin[inside]) / length[inside]
            weights[within] = method.weights(fraction)
            stages[inside] = len(method.instants)
        kernel_steps = Steps(
            taken.states.copy(), length, method.tableau, stages, method.end, at, weights
        )
        loads = _loads(motion, segment.torque, taken, method.instants[: stages.max()])
        span = slice(int(first), int(last))
        yield Tape(kernel_steps, loads, span, float(end[-1]), segment.after)


def _loads(
    motion: Integration, torque: Torque, taken: TakenSteps, instants: FloatArray
) -> FloatArray:
    """Loads at each stage of each step, (S or 1, stages or 1, loads)."""
    drives = motion.drives
    if isinstance(torque, np.ndarray):
        return torque.copy()[None, None]
    times = taken.begin[:, None] + (taken.end - taken.begin)[:, None] * instants
    if isinstance(torque, Sampled):
        return torque.line[0] + (times - torque.begin)[..., None] * torque.line[1]
    states = np.repeat(taken.states, instants.size, axis=0)
    q, u = np.split(states, 2, axis=1)
    return drives.at(times.ravel(), q, u, alone=True).reshape(*times.shape, -1)


def arrays_for(motion: Integration, names: Collection[str]) -> AnyArrays:
    """Return the chain of a motion for kernels that differentiate by the named parameters."""
    resisting = sorted({"friction", "friction_speed", "drag", "quadratic_drag"} & {*names})
    if motion.method.conservative and resisting:
        raise ValueError(
            f"{resisting[0]} cannot be differentiated with a method for chains that keep their "
            'energy: simulate with method "dop853"'
        )
    own = with_features(motion.mechanism.parameters, names)
    return motion.mechanism._replace(parameters=own).arrays()
