"""Ctrl-C, pressed while this process is at work."""

import os
import signal
import sys
import threading
import time

PATIENCE = 2.0  # s


def rooms_on_the_stack(frame):
    """Return the top-level packages that the frames of a stack stand in."""
    rooms = set()
    while frame is not None:
        rooms.add(frame.f_globals["__name__"].partition(".")[0])
        frame = frame.f_back
    return rooms


class Interrupt:
    """Send this process a SIGINT once its main thread is at work in the package, and note when.

    At work means: `ready` is set, where it is given, and for `SAMPLES` looks in a row the thread
    was in a call of the package, neither importing nor compiling. The work must end within
    `patience` seconds from then.
    """

    SAMPLES, EVERY = 10, 0.02  # s
    GIVE_UP = 300.0  # s, after which the work is ended and the test fails
    PREPARING = ("importlib", "numba")

    def __init__(self, ready=None, patience=PATIENCE):
        self.ready, self.patience = ready, patience
        self.sent = None
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch)

    def _watch(self):
        main_thread = threading.main_thread().ident
        seen, begun = 0, time.perf_counter()
        while seen < self.SAMPLES and not self._over.wait(self.EVERY):
            if time.perf_counter() - begun > self.GIVE_UP:
                os.kill(os.getpid(), signal.SIGINT)
                return
            rooms = rooms_on_the_stack(sys._current_frames()[main_thread])
            at_work = "npend_gym" in rooms and rooms.isdisjoint(self.PREPARING)
            at_work &= self.ready is None or self.ready.is_set()
            seen = seen + 1 if at_work else 0
        if not self._over.is_set():
            self.sent = time.perf_counter()
            os.kill(os.getpid(), signal.SIGINT)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        ended = time.perf_counter()
        self._over.set()
        self._thread.join()
        assert self.sent is not None, "the work ended, or never began"
        assert ended - self.sent < self.patience
