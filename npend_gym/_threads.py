"""Threads that help with one call at a time, and that Ctrl-C may leave at any instant."""

from __future__ import annotations

import _thread
import os
import sys
import weakref
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

from npend_gym import _checks

_Part = TypeVar("_Part")

MAX_THREADS = 1024
_IDLE = 2.0  # s, after which a thread without work looks whether it is still needed


def check_threads(threads: int) -> int:
    """Return a number of threads, or raise an error that names the rule."""
    return _checks.count("threads", threads, high=MAX_THREADS)


class Call:
    """One call of `Helpers.run`, which its threads share.

    Attributes
    ----------
    stopped : bool
        True once the caller has left or a thread has failed: the rest need not be done.
    failure : BaseException or None
        What was raised in a helping thread.
    """

    __slots__ = ("failure", "stopped", "work")

    def __init__(self, work: Callable[[int, Call], None]) -> None:
        self.work: Callable[[int, Call], None] = work
        self.stopped: bool = False
        self.failure: BaseException | None = None


class _Share:
    """The part that one helping thread has in a call."""

    __slots__ = ("call", "finished", "taken", "worker")

    def __init__(self, call: Call, worker: int) -> None:
        self.call, self.worker = call, worker
        self.taken = _thread.allocate_lock()  # by the thread, or by the caller who goes on alone
        self.finished = _thread.allocate_lock()
        self.finished.acquire()


class Helpers:
    """Threads that work beside the caller.

    The exception of a signal, such as KeyboardInterrupt, can be raised after any bytecode. Inside
    `threading` and `concurrent.futures` it leaves locks that are held, or released twice, and
    threads that the interpreter waits for at its end. So this class uses nothing but calls that no
    signal can divide: locks and queues of the interpreter itself, and threads that it does not
    wait for. After such an exception a thread may still be busy, at most until it sees
    `Call.stopped`: do not use the memory that it writes to again, and make new helpers.

    Parameters
    ----------
    count : int
        Number of threads beside the caller's; they start with the first call.
    """

    def __init__(self, count: int) -> None:
        self._count = count
        self._forget_threads()

    def _forget_threads(self) -> None:
        self._process, self._started = os.getpid(), 0
        self._shares: SimpleQueue[_Share | None] = SimpleQueue()

    def run(self, work: Callable[[int, Call], None]) -> None:
        """Call ``work(0, call)`` here and ``work(k, call)`` in thread k; return when all are done.

        A thread that is not awake when ``work(0, call)`` returns is not waited for, and does
        nothing: the work must be something that one thread finishes where the others do not come,
        such as a loop over the `each_once` of a deque.

        Raises
        ------
        BaseException
            What `work` raised, here or in a thread.
        """
        if self._process != os.getpid():
            self._forget_threads()  # the threads did not come along with a fork
        call = Call(work)
        shares = [_Share(call, worker) for worker in range(1, self._count + 1)]
        try:
            while self._started < self._count:
                self._started += 1
                _thread.start_new_thread(_serve, (self._shares, weakref.ref(self)))
            for share in shares:
                self._shares.put(share)
            work(0, call)
            for share in shares:
                if not share.taken.acquire(False):
                    share.finished.acquire()
        except BaseException:
            call.stopped = True
            raise
        if call.failure is not None:
            raise call.failure

    def close(self) -> None:
        """Let the threads end; without this they end some seconds after the last use."""
        for _ in range(self._started):
            self._shares.put(None)
        self._started = 0


class Crew:
    """Helpers of one owner, who may have `threads` threads with his own for each call.

    They start where a call needs them.
    """

    def __init__(self, threads: int = 1) -> None:
        self.threads: int = check_threads(threads)
        self._helpers: Helpers | None = None

    def run(self, work: Callable[[int, Call | None], None], parts: int) -> None:
        """Do work of several `parts` as `Helpers.run`, or as ``work(0, None)`` in this thread."""
        if self.threads == 1 or parts == 1:
            work(0, None)
            return
        helpers, self._helpers = self._helpers, None  # after an interrupt they may still be busy
        helpers = helpers or Helpers(min(self.threads, parts) - 1)
        helpers.run(work)
        self._helpers = helpers

    def close(self) -> None:
        """End the threads."""
        if self._helpers is not None:
            self._helpers.close()
            self._helpers = None

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_helpers": None}  # threads start again where they are needed


def each_once(parts: deque[_Part]) -> Iterator[_Part]:
    """Yield the parts that several threads take from one deque, each to one of them.

    An iterator that threads share may give a part to two of them where Python has no global lock.
    """
    while parts:
        try:
            part = parts.popleft()
        except IndexError:  # another thread was faster
            return
        yield part


def share_out(parts: Sequence[_Part], threads: int, follow: Callable[[_Part, Call], None]) -> None:
    """Call ``follow(part, call)`` for each of the parts, in `threads` threads with the caller's.

    Raises
    ------
    BaseException
        What `follow` raised, here or in a thread.
    """
    remaining = deque(parts)

    def work(worker: int, call: Call) -> None:
        del worker
        for part in each_once(remaining):
            if call.stopped:
                return
            follow(part, call)

    helpers = Helpers(min(threads, len(parts)) - 1)
    try:
        helpers.run(work)
    finally:
        helpers.close()


@contextmanager
def one_torch_thread() -> Generator[None]:
    """Let PyTorch, where it is imported, compute in one thread meanwhile: it rounds the same.

    A product of matrices that several threads share has other roundings, which change a policy
    altogether. For small networks several threads are slower, too, by far on a busy machine.
    """
    torch: Any = sys.modules.get("torch")
    if torch is None:
        yield
        return
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def _serve(shares: SimpleQueue[_Share | None], owner: weakref.ref[Helpers]) -> None:
    """Do shares of calls until there is None, or nobody who could give one."""
    while True:
        try:
            share = shares.get(timeout=_IDLE)
        except Empty:
            # not `Helpers.__del__`: there Python prints the exception of a signal and goes on
            if owner() is None:
                return
            continue
        if share is None:
            return
        if share.taken.acquire(False):
            try:
                share.call.work(share.worker, share.call)
            except BaseException as error:  # noqa: BLE001 - raised where `run` was called
                share.call.failure = error
                share.call.stopped = True
            share.finished.release()
        del share  # while this thread waits it keeps nothing alive
