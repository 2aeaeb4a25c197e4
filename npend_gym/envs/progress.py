"""How far the last call has come, and the error of a call that must wait for a reset."""

from __future__ import annotations

from enum import Enum

import gymnasium as gym
import numpy as np

from npend_gym import _checks
from npend_gym._checks import BoolArray


class Progress(Enum):
    """How far the last call of an environment that changes its state has come.

    `step` and `reset` note UNFINISHED before their first change and READY after their last. At
    whatever instant an exception ends them (KeyboardInterrupt, or one in a user's mode), the
    environment has changed nothing, or it has done everything, or it refuses to continue until it
    is reset. That reset replaces everything but the seeds.
    """

    NEW = "call reset() before {}()"
    READY = ""
    UNFINISHED = "the last step() or reset() was interrupted: call reset() before {}()"

    def refuse(self, call: str) -> ResetNeeded:
        """Return the error of a call, by name, that must not be made now."""
        return ResetNeeded(self.value.format(call))


class ResetNeeded(gym.error.ResetNeeded, RuntimeError):  # noqa: N818 - a name of Gymnasium
    """Raised by `step` and `render` where `reset` must be called first."""


def lanes_are_done(done: BoolArray) -> ResetNeeded:
    """Return the error of a step with autoreset disabled in which lanes are done."""
    return ResetNeeded(
        f"autoreset is disabled and lanes {_checks.show(np.flatnonzero(done).tolist())} are done: "
        'reset them with reset(options={"reset_mask": done})'
    )
