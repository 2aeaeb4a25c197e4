"""Derivatives of whole motions: forward through the steps they took, and back from their frames."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain
from npend_gym.physics.arguments import check_inputs
from npend_gym.physics.dense import check_same, retaken
from npend_gym.physics.directions import (
    by_names,
    check_directions,
    check_names,
    row_count,
)
from npend_gym.physics.kernels.driven import AFTER_TORQUES
from npend_gym.physics.kernels.methods import carrier
from npend_gym.physics.kernels.pairs import Pair
from npend_gym.physics.kernels.tape import Rods, carry_back, new_scratch
from npend_gym.physics.motion import Integration
from npend_gym.physics.substeps import LONGEST_PHASE, rate_at_rest
from npend_gym.physics.tapes import AT_A_TIME, Tape, arrays_for, tapes
from npend_gym.physics.trajectory import Trajectory

_WORK = 10_000_000  # of one call, in stages times rods times changes: Ctrl-C is heard after it
_MAX_BYTES = 2**33  # of the derivatives at all times, or of the states that a gradient keeps


class Sensitivities(NamedTuple):
    """The derivatives of a motion at T instants by start, torques and parameters; m coordinates.

    d (q, u) = A d (q, u) at the start + B d torque + C d parameters.
    """

    A: FloatArray  # (T, 2m, 2m)
    B: FloatArray  # (T, 2m, number of joints), with a cart a column more for the force on it
    C: FloatArray  # (T, 2m, K): along each direction of the parameters


class MotionGradient(NamedTuple):
    """The gradient of a function of a motion by start, torques and parameters; m coordinates."""

    by_theta: FloatArray  # (m,)
    by_omega: FloatArray  # (m,)
    by_torque: FloatArray  # (n,), with a cart the force after them
    by_parameters: dict[str, FloatArray]  # (n,) each; () for gravity


def carry(
    motion: Integration,
    times: FloatArray,
    states: FloatArray,
    loads: FloatArray | None = None,
    parameters: FloatArray | None = None,
    *,
    steps: int = AT_A_TIME,
    names: Collection[str] = (),
) -> Iterator[tuple[slice, FloatArray, Tape]]:
    """Carry D small changes along a motion, exactly through at most `steps` steps at a time.

    Those of the states, (D, 2m), stand between two segments at the end of the last step: whoever
    iterates may normalise them there. Those of the loads, (D, n + 3), are constant in time; those
    of the parameters that `names` lists are (D, rows, n). Yield which instants are passed, the
    changes there, (F, D, 2m), and the tape.
    """
    (count, size), n = states.shape, motion.mechanism.n
    loads = np.zeros((count, n + AFTER_TORQUES)) if loads is None else loads
    parameters = np.zeros((count, 0, n)) if parameters is None else parameters
    stages = len(motion.method.instants)
    at_a_time = max(1, min(steps, 2 * _WORK // (stages * size * max(1, count))))
    carry_changes, chain = carrier(motion.method, size // 2), arrays_for(motion, names)
    mass = motion.mechanism.parameters.masses[0].copy()
    for tape in tapes(motion, times, at_a_time):
        frames = np.empty((tape.steps.at.size, count, size))
        rods = Rods(chain, mass, tape.loads)
        carry_changes(tape.steps, rods, states, loads, parameters, frames)
        _check_finite(states, tape.end)
        yield tape.frames, frames, tape


def sensitivities(
    trajectory: Trajectory,
    joints: Sequence[int] = (0,),
    parameters: Mapping[str, ArrayLike] | None = None,
) -> Sensitivities:
    """Return the derivatives of all coordinates and rates by start, torques and parameters.

    Parameters
    ----------
    joints : sequence of int
        Joints whose torques have derivatives; B has a column for each, then one for the force on a
        cart.
    parameters : mapping of str to array_like, shape (K, n), optional
        K directions in which parameters of the chain change together, by their names in `Chain`;
        the shape for gravity is (K,). ``{"masses": np.eye(n)}`` is each mass alone. The notes list
        the parameters of each kind of chain.

    Returns
    -------
    Sensitivities
        A, shape (T, 2m, 2m), by the state at ``times[0]``, in the order of `accelerations`; B,
        shape (T, 2m, inputs), by constant torques; C, shape (T, 2m, K), along the
        directions.

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule, `simulate` did not make the motion, an event ended it, or
        the derivatives would take more than 8 GB. At rest, steps must not be too long for the rods.
    FloatingPointError
        If derivatives grow beyond all bounds.

    Notes
    -----
    They are the derivatives of the steps that were taken, to rounding, their lengths held
    fixed, and of the polynomials between their ends.
    Functions of time and Signals count as given. The motion is integrated once more, with the
    same bits. The time grows as the number of derivatives, the memory is that of the result.

    Parameters are named as in `Chain`, and may be zero; only chains with springs have stiffness and
    axial_damping.
    """
    motion, state, n = *_retaken(trajectory), trajectory.chain.n
    wanted = check_inputs(trajectory.chain, joints)
    kind = type(arrays_for(motion, parameters or ()))
    directions = check_directions(parameters, n, kind, _ends(motion))
    last = state.size + len(wanted)
    total = last + len(directions)
    bytes_wanted = 8 * state.size * total * trajectory.times.size
    if bytes_wanted > _MAX_BYTES:
        raise ValueError(
            f"derivatives at {trajectory.times.size} instants take {bytes_wanted:.2g} bytes, and "
            f"at most {_MAX_BYTES:.2g} are allowed: simulate with fewer times, or use gradient()"
        )
    states, loads = np.eye(total, state.size), np.zeros((total, n + AFTER_TORQUES))
    changed = np.zeros((total, directions.shape[1], n))
    loads[range(state.size, last), wanted] = 1.0
    changed[last:] = directions
    whole = np.empty((trajectory.times.size, total, state.size))
    whole[0], reached = states, state
    carried = carry(motion, trajectory.times, states, loads, changed, names=parameters or ())
    for where, frames, tape in carried:
        _check_rest(trajectory.chain, motion, tape)
        whole[where], reached = frames, tape.after
    check_same(reached, trajectory)
    columns = whole.swapaxes(1, 2)
    return Sensitivities(*np.split(columns, [state.size, last], axis=2))


def gradient(
    trajectory: Trajectory,
    theta_bar: ArrayLike,
    omega_bar: ArrayLike,
    parameters: Sequence[str] = (),
) -> MotionGradient:
    """Return the gradient of a function of this motion by start, torques and parameters.

    Parameters
    ----------
    theta_bar, omega_bar : array_like, shape (T, n) or (T, m)
        Derivatives of the function by the angles (or all coordinates) and their rates at all
        times; one number stands for all.
    parameters : sequence of str
        Names of parameters of `Chain` for further derivatives; the notes of `sensitivities` list
        the parameters of each kind of chain.

    Returns
    -------
    MotionGradient
        `by_theta` and `by_omega`, of the state at ``times[0]``, shape (m,) each, `by_torque` on
        every joint, with a cart the force after them, and `by_parameters`, a dict.

    Raises
    ------
    ValueError, TypeError, FloatingPointError
        As for `sensitivities`, also if an event ended the motion.

    Notes
    -----
    It goes backwards through the steps of the motion, and takes the same time for one derivative or
    all. It holds the state at the beginning of each step.
    """
    motion, state, n = *_retaken(trajectory), trajectory.chain.n
    chain = arrays_for(motion, parameters)
    names, m = check_names(parameters, type(chain)), state.size // 2
    bars = np.zeros((trajectory.times.size, 2 * m))
    for first, (name, given) in zip((0, m), (("theta_bar", theta_bar), ("omega_bar", omega_bar)),
                                    strict=True):  # fmt: skip
        values = _checks.array(name, given)
        width = m if values.ndim == 2 and values.shape[1] == m else n
        shape = (trajectory.times.size, width)
        bars[:, first : first + width] = _checks.broadcast(name, values, shape)
    bar, load_bar = np.zeros(2 * m), np.zeros((1, 1, n + AFTER_TORQUES))
    chain_bar = np.zeros((row_count(type(chain)) if names else 0, n))
    go_back = _returned if isinstance(motion.method, Pair) else _contracted
    reached = go_back(motion, trajectory, bars, (bar, load_bar, chain_bar), names)
    check_same(state if reached is None else reached, trajectory)
    bar += bars[0]
    by_parameters = by_names(chain_bar[None], names, _ends(motion))
    rows = {name: value[0] for name, value in by_parameters.items()}
    loads = load_bar[0, 0, check_inputs(trajectory.chain, range(n))]
    return MotionGradient(bar[:m].copy(), bar[m:].copy(), loads, rows)


_Sums = tuple[FloatArray, FloatArray, FloatArray]  # by the state, the loads and the parameters


def _contracted(
    motion: Integration, trajectory: Trajectory, bars: FloatArray, sums: _Sums, names: Sequence[str]
) -> FloatArray | None:
    """Do as `_returned` by all derivatives forward, which takes O(n) as many operations."""
    sizes = [each.size for each in sums]
    unit, count, reached = np.eye(sum(sizes)), sum(sizes), None
    states, loads, changed = np.split(unit, np.cumsum(sizes)[:2], axis=1)
    changed = np.ascontiguousarray(changed).reshape(count, *sums[2].shape)
    total = np.zeros(count)
    carried = carry(motion, trajectory.times, states.copy(), loads.copy(), changed, names=names)
    for where, frames, tape in carried:
        total += np.einsum("fds,fs->d", frames, bars[where])
        reached = tape.after
    for each, part in zip(sums, np.split(total, np.cumsum(sizes)[:2]), strict=True):
        each[:] = part.reshape(each.shape)
    return reached


def _returned(
    motion: Integration, trajectory: Trajectory, bars: FloatArray, sums: _Sums, names: Sequence[str]
) -> FloatArray | None:
    """Take derivatives by the states back to the start, and return the state at the end."""
    bar, load_bar, chain_bar = sums
    chain, mass = arrays_for(motion, names), motion.mechanism.parameters.masses[0].copy()
    scratch = new_scratch(len(motion.method.tableau), bar.size // 2)
    kept, held = list[Tape](), 0
    for tape in tapes(motion, trajectory.times):
        _check_rest(trajectory.chain, motion, tape)
        kept.append(tape)
        held += tape.steps.states.nbytes + tape.loads.nbytes
        if held > _MAX_BYTES:
            raise ValueError(
                f"the states at the beginning of all steps must take at most {_MAX_BYTES:.2g} "
                "bytes: simulate the motion in segments"
            )
    reached = kept[-1].after if kept else None
    while kept:
        tape = kept.pop()
        rods = Rods(chain, mass, tape.loads)
        carry_back(tape.steps, rods, bar, load_bar, chain_bar, bars[tape.frames], scratch)
        _check_finite(bar, float(trajectory.times[-1]))
    return reached


def _ends(motion: Integration) -> NDArray[np.bool_]:
    """Whether the centre of mass of each link is at its end, and stays there, (1, n)."""
    parameters = motion.mechanism.parameters
    return parameters.centres == parameters.lengths


def _retaken(trajectory: Trajectory) -> tuple[Integration, FloatArray]:
    """Return the motion of a trajectory to be integrated once more, and its first state."""
    if trajectory.theta.ndim != 2:
        raise ValueError(
            f"derivatives are those of one motion, got {len(trajectory)}: take trajectory[k]"
        )
    motion, state = retaken(trajectory)
    motion.drives.check_time_alone(float(trajectory.times[0]), *np.split(state, 2))
    return motion, state


def _check_rest(chain: Chain, motion: Integration, tape: Tape) -> None:
    """Refuse adaptive steps in which rods rest, to the tolerance, and small changes of them do not.

    No error limits such a step, and in a long one the method is unstable. The base may move.
    """
    if not motion.method.adaptive:
        return
    changes = np.abs(np.diff(np.vstack([tape.steps.states, tape.after]), axis=0))
    m, n = motion.mechanism.size, chain.n
    rods = [*range(n), *(range(m - n, m) if chain.stiffness is not None else ())]
    moved = changes.reshape(-1, 2, m)[..., rods].max(axis=(1, 2))
    longest = float(tape.steps.lengths[moved <= motion.settings["atol"]].max(initial=0.0))
    rate = rate_at_rest(chain, motion.mechanism.pivot_acceleration)
    if longest * rate > LONGEST_PHASE * (1.0 + 1e-9):
        raise ValueError(
            f"dt must be at most {0.99 * LONGEST_PHASE / rate:.3g} s in `simulate` for derivatives "
            f"of a chain at rest; got {longest:.3g} s, the length of a step"
        )


def _check_finite(derivatives: FloatArray, time: float) -> None:
    if not np.all(np.isfinite(derivatives)):
        raise FloatingPointError(
            f"derivatives have grown beyond all bounds until t = {time:g} s: the motion is "
            "chaotic, follow it for a shorter time"
        )
