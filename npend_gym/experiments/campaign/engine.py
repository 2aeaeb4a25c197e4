"""Tasks through joblib's backends: local processes, threads, Ray and Dask, one path for all."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

from npend_gym import _checks, _extras

joblib: Any = _extras.require("joblib", "campaign", "campaigns")

_T = TypeVar("_T")
_R = TypeVar("_R")

BACKENDS = ("loky", "threading", "ray", "dask")
CLUSTERS = ("ray", "dask")
_STRIKES = 3  # lost workers with a task under way, after which it is run alone
_FRUITLESS = 5  # losses in a row without any result, after which something else is wrong


class WorkersLostError(RuntimeError):
    """The workers are lost again and again."""


@dataclass(frozen=True)
class Lost:
    """In place of a result: the task took its worker with it, each time."""

    reason: str


@contextmanager
def workers(
    backend: str = "loky", count: int | None = None, address: str | None = None
) -> Generator[None, None, None]:
    """Have `run` use a backend of joblib.

    Parameters
    ----------
    backend : {"loky", "threading", "ray", "dask"}
        Local processes, local threads, or a cluster.
    count : int, optional
        Workers; by default as many as the machine or the cluster has cores.
    address : str, optional
        Of a running cluster; by default Ray and Dask start one on this machine.

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.
    ImportError
        If the library is missing, with how to install it.
    """
    check_workers(backend, count, address)
    with ExitStack() as stack:
        count = count or -1
        if backend == "ray":
            _ray(stack, count, address)
        elif backend == "dask":
            _dask(stack, count, address)
        stack.enter_context(joblib.parallel_config(backend=backend, n_jobs=count))
        yield


def check_workers(backend: str, count: int | None, address: str | None) -> None:
    """Refuse what `workers` cannot do."""
    _checks.choice("backend", backend, BACKENDS)
    if count is not None:
        _checks.count("workers", count)
    if address is not None and backend not in CLUSTERS:
        raise ValueError(
            f"address must be left out where backend is {backend}: it is that of a Ray or Dask "
            f"cluster, got {_checks.show(address)}"
        )


def _ray(stack: ExitStack, count: int, address: str | None) -> None:
    ray = _extras.require("ray", "ray", "campaigns on Ray")
    backend = _extras.require("ray.util.joblib.ray_backend", "ray", "campaigns on Ray").RayBackend
    # Ray's backend has all that joblib needs to hand out results as they come, but does not say so
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


def run(work: Callable[[_T], _R], tasks: Iterable[_T]) -> Iterator[tuple[_T, _R | Lost]]:
    """Yield each of `tasks` with what `work` returns, in the order in which they end.

    Tasks are hashable. A lost worker costs nothing but time: what was under way is done again,
    and a task that was under way each of three times is run alone. `work` raises nothing; an
    exception from it counts as a lost worker.

    Raises
    ------
    WorkersLostError
        If workers are lost five times in a row without any result.
    """
    coming = iter(tasks)
    again: deque[_T] = deque()
    alone: list[_T] = []
    strikes: Counter[_T] = Counter()
    fruitless = 0

    def waiting() -> Iterator[_T]:
        while again:
            yield again.popleft()
        # not `yield from`: that would end `coming` when a round is cut off
        for task in coming:  # noqa: UP028
            yield task

    while True:
        before = _Round()
        yield from before.results(work, waiting())
        if not before.under_way and before.trouble is None:
            break
        fruitless = 0 if before.returned else fruitless + 1
        if fruitless == _FRUITLESS:
            raise WorkersLostError(
                f"workers were lost {fruitless} times in a row: {before.reason}"
            ) from before.trouble
        strikes.update(list(before.under_way))
        again.extend(task for task in before.under_way if strikes[task] < _STRIKES)
        alone += [task for task in before.under_way if strikes[task] >= _STRIKES]
    for task in alone:
        last = _Round()
        for _ in range(_STRIKES):
            last = _Round()
            yield from last.results(work, [task])
            if last.returned or last.under_way:
                break  # else the workers were not up yet again, and it has not been tried
        if not last.returned:
            yield task, Lost(last.reason)


class _Round:
    """Tasks until all are done or a worker is lost."""

    def __init__(self) -> None:
        self.under_way: dict[Any, None] = {}
        self.returned = 0
        self.trouble: Exception | None = None

    @property
    def reason(self) -> str:
        text = str(self.trouble or "the backend gave up").strip()
        kind = type(self.trouble).__name__ if self.trouble else "lost"
        return f"{kind}: {text.splitlines()[0]}"

    def results(
        self, work: Callable[[_T], _R], tasks: Iterable[_T]
    ) -> Generator[tuple[_T, _R], None, None]:
        """Yield tasks and results; note what is under way, and what went wrong with the workers."""

        def handed_out() -> Iterator[Any]:
            for task in tasks:
                self.under_way[task] = None
                yield joblib.delayed(_labelled)(work, task)

        parallel = joblib.Parallel(
            return_as="generator_unordered", pre_dispatch="2*n_jobs", batch_size=1
        )
        try:
            for task, result in parallel(handed_out()):
                del self.under_way[task]
                self.returned += 1
                yield task, result
        except Exception as error:  # noqa: BLE001 - each backend has its own for a lost worker
            self.trouble = error


def _labelled(work: Callable[[_T], _R], task: _T) -> tuple[_T, _R]:
    return task, work(task)
