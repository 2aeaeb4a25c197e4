"""Tasks that kill the worker process they run in; a worker imports this file and no other test."""

import os
import signal
import time


def the_sixth(task):
    """Return the square of a task; the one with number 5 is deadly."""
    if task == 5:
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.02)
    return task * task


def each(_task):
    os.kill(os.getpid(), signal.SIGKILL)
