"""One call at a time changes an environment; how far the last one has come."""

from __future__ import annotations

import sys
from _thread import get_ident
from enum import Enum
from typing import Any

import gymnasium as gym
import numpy as np

from npend_gym import _checks
from npend_gym._checks import BoolArray

# The calls that change an environment
_CHANGING = ("step", "reset", "set_state", "set_options", "state")


class Progress(Enum):
    """How far the last call of an environment that changes its state has come.

    `step` and `reset` note UNFINISHED before their first change and READY after their last. An
    exception (KeyboardInterrupt, or one in a user's mode) may end them at any instant. Then the
    environment has changed nothing, or it has done everything, or it requires a reset. That reset
    replaces everything but the seeds.
    """

    NEW = "call reset() before {}()"
    READY = ""
    UNFINISHED = "the last step() or reset() was interrupted: call reset() before {}()"


class ResetNeeded(gym.error.ResetNeeded, RuntimeError):  # noqa: N818 - a name of Gymnasium
    """Raised by `step` and `render` where `reset` must be called first."""


class EnvInUse(gym.error.AlreadyPendingCallError, RuntimeError):  # noqa: N818 - as ResetNeeded
    """Raised by a call of an environment while another thread is inside `step` or `reset`."""

    def __init__(self, call: str) -> None:
        super().__init__(
            f"{call}() was called while another thread is in step() or reset() of the same "
            "environment: let threads take turns, with a lock, or make an environment for each",
            call,
        )


class CallGuard:
    """Lets one thread at a time change an environment, and keeps the `Progress` of its calls.

    Attributes
    ----------
    ready : list
        Holds one entry where the progress is READY, else none. A call that changes the environment
        takes the entry and puts it back at its end: Python removes an entry for one thread alone,
        and an exception of a signal comes before or after that.
    """

    __slots__ = ("_is_new", "ready")

    def __init__(self) -> None:
        self.ready: list[bool] = []
        self._is_new = True

    @property
    def progress(self) -> Progress:
        """How far the last call has come, or the one that another thread is in."""
        if self.ready:
            return Progress.READY
        return Progress.NEW if self._is_new else Progress.UNFINISHED

    def begin(self, env: Any, call: str, before: Progress = Progress.READY) -> None:
        """Begin a call that changes `env`, which was checked for the progress `before`."""
        try:
            self.ready.pop()
        except IndexError:
            if before is Progress.READY or self.progress is not before or _used_elsewhere(env):
                raise self.refuse(env, call) from None
        self._is_new = False

    def check(self, env: Any, call: str) -> None:
        """Raise the error of a call that needs an environment which is ready, where it is not."""
        if not self.ready:
            raise self.refuse(env, call)

    def finish(self) -> None:
        """Note that the call has done everything."""
        self.ready[:] = [True]

    def refuse(self, env: Any, call: str) -> ResetNeeded | EnvInUse:
        """Return the error of a call, by name, that must not be made now."""
        # another thread may end its call, and begin the next, between any two of these looks
        for _ in range(3):
            if _used_elsewhere(env) or self.progress is Progress.READY:
                return EnvInUse(call)
        return ResetNeeded(self.progress.value.format(call))


def _used_elsewhere(env: Any) -> bool:
    """Return whether another thread is inside a call that changes `env`."""
    own = get_ident()
    for thread, top in sys._current_frames().items():  # noqa: SLF001 - documented, for debuggers
        frame = top if thread != own else None
        while frame is not None:
            if frame.f_code.co_name in _CHANGING and frame.f_locals.get("self") is env:
                return True
            frame = frame.f_back
    return False


def lanes_are_done(done: BoolArray) -> ResetNeeded:
    """Return the error of a step with autoreset disabled in which sub-environments are done."""
    return ResetNeeded(
        "autoreset is disabled and the sub-environments "
        f"{_checks.show(np.flatnonzero(done).tolist())} are done: reset them "
        'with reset(options={"reset_mask": done})'
    )


def check_running(done: BoolArray) -> None:
    """Raise an error if a state is set while lanes are done: the next step may replace it."""
    if done.any():
        raise ValueError(
            "state must be set while no sub-environment is done, got done sub-environments "
            f"{_checks.show(np.flatnonzero(done).tolist())}: reset them first with "
            'reset(options={"reset_mask": done})'
        )
