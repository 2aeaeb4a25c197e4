"""Tasks run by joblib's backends: local processes, threads, Ray and Dask, by the same code."""

from __future__ import annotations

import _thread
import multiprocessing
import os
import signal
import warnings
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from npend_gym import _checks, _extras

joblib: Any = _extras.require("joblib", "campaign", "campaigns")

_T = TypeVar("_T")
_R = TypeVar("_R")

BACKENDS = ("loky", "threading", "ray", "dask")
CLUSTERS = ("ray", "dask")
_MOST, _MOST_OF_CLUSTERS = 1000, 100_000  # workers
_MAX_ATTEMPTS = 3  # lost workers while a task was running, after which it is run alone
_MAX_NO_PROGRESS = 5  # losses in a row without any result, after which something else is wrong
# The end of a process, however it ends, closes its end of the pipe, on every system
_driver_is_alive, _kept_open = multiprocessing.Pipe(duplex=False)


class WorkersLostError(RuntimeError):
    """The workers are lost again and again."""


@dataclass(frozen=True)
class WorkerLost:
    """How a pool of workers ended before its tasks were done.

    In place of a result: every attempt at the task ended so.
    """

    running: list[Any]  # tasks, in the order of dispatch
    returned: int  # results before it
    error: Exception | None

    @property
    def reason(self) -> str:
        """What the backend says."""
        text = str(self.error or "the backend gave up").strip()
        kind = type(self.error).__name__ if self.error else "lost"
        return f"{kind}: {text.splitlines()[0]}"


@contextmanager
def workers(
    backend: str = "loky",
    count: int | None = None,
    address: str | None = None,
    tasks: int = _MOST,
) -> Generator[None, None, None]:
    """Choose the backend of joblib that `run` uses: local processes or threads, or a cluster.

    By default there are as many workers as the machine or the cluster has cores. This machine has
    no more than `tasks`, or 2, because one worker would be this process. Without the `address` of a
    running cluster, Ray and Dask start one on this machine.
    """
    check_workers(backend, count, address)
    with ExitStack() as stack:
        number, own = count or -1, dict[str, Any]()
        if backend not in CLUSTERS:
            number = min(count or joblib.cpu_count(), max(tasks, 2))
        if backend == "ray":
            _ray(stack, number, address)
        elif backend == "dask":
            _dask(stack, number, address)
        elif backend == "loky":
            own = {"initializer": end_with_the_driver, "initargs": (_driver_is_alive,)}
            backend = _loky()
        stack.enter_context(joblib.parallel_config(backend=backend, n_jobs=number, **own))
        yield


def check_workers(backend: str, count: int | None, address: str | None) -> None:
    """Check the arguments of `workers`, and raise its errors."""
    _checks.choice("backend", backend, BACKENDS)
    if count is not None:
        most = _MOST_OF_CLUSTERS if backend in CLUSTERS else _MOST
        _checks.count("workers", count, high=most)
    if address is not None and backend not in CLUSTERS:
        raise ValueError(
            f"address must be left out where backend is {backend}: it is that of a Ray or Dask "
            f"cluster, got {_checks.show(address)}"
        )


def end_with_the_driver(driver_is_alive: Connection) -> None:
    """Let this worker end when the other end of a pipe is closed."""

    def wait() -> None:
        with suppress(OSError, EOFError):
            driver_is_alive.poll(None)
        os._exit(1)

    _thread.start_new_thread(wait, ())


def _loky() -> str:
    """Return the name of a backend like loky, whose workers never get the SIGINT of a Ctrl-C.

    The driver ends them. A worker has no handler of its own until its imports are done, but it
    inherits what is blocked. Only the first `submit` starts workers and the thread that replaces
    them.
    """

    def submit(self: Any, *given: Any, **options: Any) -> Any:
        with _interrupts_blocked():
            return loky.submit(self, *given, **options)

    loky = joblib.parallel.LokyBackend
    joblib.register_parallel_backend("npend", type("Loky", (loky,), {"submit": submit}))
    return "npend"


@contextmanager
def _interrupts_blocked() -> Generator[None, None, None]:
    """Block SIGINT in this thread, and in the threads and processes that the block starts."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    resource_tracker.ensure_running()  # its start would unblock SIGINT
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _ray(stack: ExitStack, count: int, address: str | None) -> None:
    ray = _extras.require("ray", "ray", "campaigns on Ray")
    backend = _extras.require("ray.util.joblib.ray_backend", "ray", "campaigns on Ray").RayBackend
    # Ray's backend can return results as they come, but does not declare that it can
    streaming = type("StreamingRay", (backend,), {"supports_return_generator": True})
    joblib.register_parallel_backend("ray", streaming)
    if not ray.is_initialized():
        local = {} if count < 0 else {"num_cpus": count}
        options = {"address": address} if address else {**local, "include_dashboard": False}
        ray.init(**options, logging_level="warning", log_to_driver=False)
        stack.callback(ray.shutdown)


def _dask(stack: ExitStack, count: int, address: str | None) -> None:
    dask = _extras.require("distributed", "dask", "campaigns on Dask")
    cores = joblib.cpu_count() if count < 0 else count
    cluster: Any = address or stack.enter_context(
        dask.LocalCluster(n_workers=cores, threads_per_worker=1, dashboard_address=None)
    )
    stack.enter_context(dask.Client(cluster))


def run(work: Callable[[_T], _R], tasks: Iterable[_T]) -> Iterator[tuple[_T, _R | WorkerLost]]:
    """Yield each of `tasks` with what `work` returns, in the order in which they end.

    The loss of a worker costs only time: the tasks that were running are run again, and a task that
    was running at three losses is run alone. An exception from `work` counts as a lost worker. Five
    losses in a row without any result raise a WorkersLostError.
    """
    pending = iter(tasks)
    retry: deque[_T] = deque()
    retry_alone: list[_T] = []
    attempts: Counter[_T] = Counter()
    no_progress = 0

    def remaining() -> Iterator[_T]:
        while retry:
            yield retry.popleft()
        # not `yield from`: closing this generator would close `pending` too
        for task in pending:  # noqa: UP028
            yield task

    while loss := (yield from _in_one_pool(work, remaining())):
        no_progress = 0 if loss.returned else no_progress + 1
        if no_progress == _MAX_NO_PROGRESS:
            raise WorkersLostError(
                f"workers were lost {no_progress} times in a row: {loss.reason}; what is done is "
                "kept, the same command continues"
            ) from loss.error
        for task in loss.running:
            attempts[task] += 1
            (retry if attempts[task] < _MAX_ATTEMPTS else retry_alone).append(task)
    for task in retry_alone:
        for _ in range(_MAX_ATTEMPTS):
            loss = yield from _in_one_pool(work, [task])
            if loss is None or loss.returned or loss.running:
                break  # otherwise the workers were not ready yet: it has not been tried
        if loss is not None and not loss.returned:
            yield task, loss


def _in_one_pool(
    work: Callable[[_T], _R], tasks: Iterable[_T]
) -> Generator[tuple[_T, _R], None, WorkerLost | None]:
    """Yield tasks and results, until all are done or a worker is lost; return that loss."""
    running: dict[_T, None] = {}
    returned, error = 0, None

    def dispatch() -> Iterator[Any]:
        for task in tasks:
            running[task] = None
            yield joblib.delayed(_labelled)(work, task)

    parallel = joblib.Parallel(
        return_as="generator_unordered", pre_dispatch="2*n_jobs", batch_size=1
    )
    try:
        with _closed_silently(parallel(dispatch())) as results:
            for task, result in results:
                del running[task]
                returned += 1
                yield task, result
    except Exception as raised:  # noqa: BLE001 - each backend has its own for a lost worker
        error = raised
    return WorkerLost([*running], returned, error) if running or error else None


@contextmanager
def _closed_silently(results: Any) -> Generator[Any, None, None]:
    """Close the results of joblib after the block, without its warning about unfinished tasks."""
    try:
        yield results
    finally:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            results.close()


def _labelled(work: Callable[[_T], _R], task: _T) -> tuple[_T, _R]:
    return task, work(task)
