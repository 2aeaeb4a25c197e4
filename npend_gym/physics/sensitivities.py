"""Derivatives of whole motions: forward through the steps they took, and back from their frames."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import ChainParameters
from npend_gym.physics.directions import by_names, check_directions, check_names
from npend_gym.physics.kernels.dynamics import arrays_of
from npend_gym.physics.kernels.sensitivities import Rods, carry_back, carry_changes, new_scratch
from npend_gym.physics.replay import Replay, replay

if TYPE_CHECKING:
    from npend_gym.physics.trajectory import Trajectory

_WORK = 10_000_000  # of one call, in stages times rods times changes: Ctrl-C is heard after it
_FIRST = 16  # steps of the first segment; the k-th has k times as many
_MAX_BYTES = 2**33  # of the derivatives at all times


class Sensitivities(NamedTuple):
    """The derivatives of a motion at T instants by what it began with.

    d (theta, omega) = A d (theta, omega) at the start + B d torque + C d parameters.
    """

    A: FloatArray  # (T, 2n, 2n)
    B: FloatArray  # (T, 2n, number of joints)
    C: FloatArray  # (T, 2n, K): along each direction of the parameters


class MotionGradient(NamedTuple):
    """The gradient of a function of a motion by what the motion began with."""

    by_theta: FloatArray  # (n,)
    by_omega: FloatArray  # (n,)
    by_torque: FloatArray  # (n,)
    by_parameters: dict[str, FloatArray]  # (n,) each; () for gravity


def rods_of(motion: Replay, names: Sequence[str] = ()) -> Rods:
    """Return the chain of a replay for kernels that differentiate by the named parameters."""
    parameters, chain = motion.parameters, motion.chain
    if not parameters.has_drag and {"drag", "quadratic_drag"}.intersection(names):
        # kernels leave out drag where there is none
        least = np.full_like(parameters.drag, _checks.SMALLEST)
        chain = arrays_of(parameters._replace(drag=least))
    return Rods(chain, parameters.masses[0].copy(), motion.torque[None, None])


def carry(
    motion: Replay,
    rods: Rods,
    changes: FloatArray,
    pushed: FloatArray | None = None,
    changed: FloatArray | None = None,
    steps: int = 256,
) -> Iterator[tuple[slice, FloatArray]]:
    """Carry D small changes along a motion to its end, at most `steps` at a time.

    `changes` (D, 2n), of theta and omega, stands between two segments at the end of the last step:
    whoever iterates may normalise it there. `pushed` (D, n) and `changed` (D, rows, n) are changes
    of torques and parameters. Yield which instants are passed, and the changes there, (F, D, 2n).
    """
    count, size = changes.shape
    n = size // 2
    pushed = np.zeros((count, n)) if pushed is None else pushed
    changed = np.zeros((count, 0, n)) if changed is None else changed
    scratch = new_scratch(motion.stages, n)
    at_a_time = max(1, min(steps, _WORK // (motion.stages * n * count)))
    while not motion.ended:
        taken, where = motion.advance(at_a_time)
        frames = np.empty((taken.at.size, count, size))
        carry_changes(taken, rods, changes, pushed, changed, frames, scratch)
        _check_finite(changes, float(motion.times[min(where.stop, motion.times.size - 1)]))
        yield where, frames


def sensitivities(
    trajectory: Trajectory, joints: Sequence[int], parameters: Mapping[str, ArrayLike] | None
) -> Sensitivities:
    """See `Trajectory.sensitivities`."""
    motion, n = _replay(trajectory), trajectory.chain.n
    wanted = [_checks.count("joint", joint, low=0, high=n - 1) for joint in joints]
    ends = motion.parameters.centres == motion.parameters.lengths
    directions = check_directions(parameters, n, type(motion.chain), ends)
    last = 2 * n + len(wanted)
    total = last + len(directions)
    bytes_wanted = 16 * n * total * trajectory.times.size
    if bytes_wanted > _MAX_BYTES:
        raise ValueError(
            f"derivatives at {trajectory.times.size} instants take {bytes_wanted:.2g} bytes, and "
            f"at most {_MAX_BYTES:.2g} are allowed: simulate with fewer times, or use gradient()"
        )
    changes, pushed = np.eye(total, 2 * n), np.zeros((total, n))
    pushed[range(2 * n, last), wanted] = 1.0
    changed = np.zeros((total, directions.shape[1], n))
    changed[last:] = directions
    whole = np.empty((trajectory.times.size, total, 2 * n))
    whole[0] = changes
    for where, frames in carry(
        motion, rods_of(motion, [*(parameters or ())]), changes, pushed, changed
    ):
        whole[where] = frames
    _check_same(motion, trajectory)
    columns = whole.swapaxes(1, 2)
    return Sensitivities(*np.split(columns, [2 * n, last], axis=2))


def gradient(
    trajectory: Trajectory, theta_bar: ArrayLike, omega_bar: ArrayLike, parameters: Sequence[str]
) -> MotionGradient:
    """See `Trajectory.gradient`."""
    motion, n, shape = _replay(trajectory), trajectory.chain.n, trajectory.theta.shape
    names = check_names(parameters, type(motion.chain))
    bars = np.concatenate(
        [
            _checks.broadcast("theta_bar", theta_bar, shape),
            _checks.broadcast("omega_bar", omega_bar, shape),
        ],
        axis=1,
    )
    rods, scratch = rods_of(motion, names), new_scratch(motion.stages, n)
    bar, torque_bar = np.zeros(2 * n), np.zeros(n)
    chain_bar = np.zeros((len(ChainParameters._fields) if names else 0, n))
    marks = [(motion.mark(), 0)]
    while not motion.ended:
        marks[-1] = (marks[-1][0], _FIRST * len(marks))
        motion.advance(marks[-1][1])
        marks.append((motion.mark(), 0))
    _check_same(motion, trajectory)
    for mark, count in marks[-2::-1]:
        motion.go_back(mark)
        steps, where = motion.advance(count)
        carry_back(steps, rods, bar, torque_bar[None, None], chain_bar, bars[where], scratch)
        _check_finite(bar, float(trajectory.times[-1]))
    bar += bars[0]
    ends = motion.parameters.centres == motion.parameters.lengths
    by_parameters = by_names(chain_bar[None], names, ends)
    rows = {name: value[0] for name, value in by_parameters.items()}
    return MotionGradient(bar[:n].copy(), bar[n:].copy(), torque_bar, rows)


def _replay(trajectory: Trajectory) -> Replay:
    """Return the motion from the start of a trajectory, refused where it has no derivatives."""
    made = trajectory.integration
    if made is None or trajectory.theta.ndim != 2:
        raise ValueError(
            "derivatives need one motion made by simulate(), which knows how its steps were taken"
        )
    if trajectory.pivot.moves or trajectory.springs is not None:
        raise ValueError(
            "derivatives of a whole motion are there for rigid rods on a pivot at rest: for a cart "
            "take the steps of DifferentiableEnsemble"
        )
    state = np.concatenate([trajectory.theta[0], trajectory.omega[0]])
    parameters = trajectory.chain.repeated(1)
    return replay(made.method, parameters, state, trajectory.times, made.torque, made.settings)


def _check_same(motion: Replay, trajectory: Trajectory) -> None:
    """Refuse derivatives of a motion that does not lead where the trajectory does."""
    reached = np.concatenate([trajectory.theta[-1], trajectory.omega[-1]])
    if not np.array_equal(motion.state, reached):
        raise ValueError(
            "the trajectory does not end where its start and settings lead: it was changed, or "
            "made by another version; simulate it again"
        )


def _check_finite(derivatives: FloatArray, time: float) -> None:
    if not np.all(np.isfinite(derivatives)):
        raise FloatingPointError(
            f"derivatives have grown beyond all bounds until t = {time:g} s: the motion is "
            "chaotic, follow it for a shorter time"
        )
