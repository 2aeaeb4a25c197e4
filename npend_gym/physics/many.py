"""Many motions side by side in packs: those that constants alone drive."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym._threads import Call, share_out
from npend_gym.compiled.arrays import innermost
from npend_gym.compiled.packs import WIDTH
from npend_gym.physics.drives import Drives
from npend_gym.physics.integration import MAX_BYTES
from npend_gym.physics.mechanism import AXIAL, PIVOT, Mechanism
from npend_gym.physics.motion import Motion
from npend_gym.physics.start import Start
from npend_gym.physics.trajectory import EVENTS, Trajectory


class Packs(NamedTuple):
    """Motions to be integrated side by side."""

    mechanism: Mechanism
    states: FloatArray  # of each at the start, (B, 2m)
    loads: FloatArray  # constant torques, and forces on carts, (B, n) or (B, n + 1)
    settings: dict[str, float]

    def motion(self, members: slice, width: int = WIDTH) -> Motion:
        """Return the motions of a pack; lanes to spare repeat the last of its members."""
        lanes = np.minimum(np.arange(width) + members.start, members.stop - 1)
        loads = innermost(self.loads[lanes])
        drives = Drives(self.mechanism.n, loads, {}, loads.size)
        state = innermost(self.states[lanes])
        return Motion(self.mechanism.of(lanes), state, drives, self.settings, members)


def packs_of(count: int) -> list[slice]:
    """Return which of `count` motions stand in a pack together."""
    return [slice(k, min(k + WIDTH, count)) for k in range(0, count, WIDTH)]


def frames_of_packs(
    packs: Packs, times: FloatArray, threads: int
) -> tuple[FloatArray, FloatArray | None]:
    """Return the states at all times, (B, T, 2m), and of DOP853 what was counted, (3, B)."""
    count, size = packs.states.shape
    n = packs.mechanism.n
    if 8 * times.size * count * size > MAX_BYTES:
        raise ValueError(
            f"times must hold at most {MAX_BYTES // (8 * size * count)} instants for {n * count} "
            f"rods in all, got {times.size}: simulate them in segments"
        )
    frames, counts = np.empty((count, times.size, size)), np.zeros((3, count))
    frames[:, 0] = packs.states

    def follow(members: slice, call: Call) -> None:
        motion, most = packs.motion(members), members.stop - members.start
        for segment in motion.segments(times):
            frames[members, segment.frames] = segment.states[:most]
            counts[:, members] += segment.counts.reshape(3, WIDTH)[:, :most]
            if call.stopped:
                return

    share_out(packs_of(count), threads, follow)
    return frames, counts if "rtol" in packs.settings else None


def stacked(each: Sequence[Trajectory], started: Start) -> Trajectory:
    """Return motions from the same instants as one trajectory.

    After a terminal event there is no motion: the states are NaN, and its `status` is 1.
    """
    times = max((motion.times for motion in each if not np.any(motion.status)),
                key=len, default=None)  # fmt: skip
    if times is None:
        times = max((motion.times[:-1] for motion in each), key=len)
    own: dict[str, Any] = {}
    for name in ("theta", "omega", *PIVOT, *AXIAL):
        rows = [getattr(motion, name) for motion in each]
        own[name] = None
        if rows[0] is not None:
            own[name] = np.full((len(each), times.size, *rows[0].shape[1:]), np.nan)
            for to, row, motion in zip(own[name], rows, each, strict=True):
                size = min(len(row) - motion.status, times.size)
                to[:size] = row[:size]
    first, counts = each[0], [motion.counts for motion in each if motion.counts is not None]
    for name in EVENTS:
        own[name] = [list(found) for found in zip(*(getattr(m, name) for m in each), strict=True)]
    recipe = None if first.recipe is None else started.recipe(first.recipe.settings)
    return Trajectory(
        first.chain, times, provenance=first.provenance | {"motions": len(each)}, recipe=recipe,
        chains=started.chains if len(started.chains) > 1 else (),
        status=np.array([motion.status for motion in each]),
        counts=np.array(counts).T if counts else None, **own,
    )  # fmt: skip
