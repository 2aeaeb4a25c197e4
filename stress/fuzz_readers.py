"""Mutated files for every reader of files: whether each is taken, or refused as documented.

    python stress/fuzz_readers.py --inputs 1000000
    python stress/fuzz_readers.py --inputs 100000 --readers part,plan --corpus corpus

Good files of each kind are changed, byte by byte and inside their containers
(`tests/mutations.py`), and read (`tests/readers.py`). Findings are undocumented exceptions,
warnings, actions beyond their bounds, hangs of more than five seconds, and 300 MiB more than ever
before. They are printed, and their files are written to the folder of the corpus. Every later run
starts from it; the tests read the files in `tests/corpus`. All readers get the same time, the quick
ones therefore more inputs. With --guided, Atheris (pip install atheris) keeps mutants that reach
new lines of one reader. The exit code is 1 where there was a finding.
"""

from __future__ import annotations

import argparse
import faulthandler
import hashlib
import importlib
import random
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import FrameType, FunctionType
from typing import Any

TESTS = Path(__file__).parent.parent / "tests"
LONGEST, PATIENCE = 5.0, 60  # s of CPU time, and of waiting, after which a reader hangs
QUICK = 0.01  # s, within which an input must have been read that others are to begin from
MOST = 300.0  # MiB that an input may take more than all before it
_GUIDED = (  # modules whose lines guide; compiled kernels must not be instrumented
    "npend_gym._files", "npend_gym._checks", "npend_gym.rl.policies.files",
    "npend_gym.rl.policies.checks", "npend_gym.physics.trajectory_file",
    "npend_gym.experiments.studies.release_tables", "npend_gym.experiments.campaign.status",
    "npend_gym.experiments.studies.release_plan", "npend_gym.experiments.campaign.plan_file",
    "npend_gym.experiments.release", "npend_gym.identification.recordings",
    "npend_gym.identification.motion", "npend_gym.report.release_tables", "npend_gym.envs.config",
    "npend_gym.envs.keywords", "zipfile", "numpy.lib.format", "tomllib._parser", "json.decoder",
)  # fmt: skip


def peak_memory() -> float:
    """Return the most memory that this process has had [MiB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


class Hang(BaseException):
    """A reader takes too long."""


def _too_long(_signal: int, _frame: FrameType | None) -> None:
    raise Hang


class Watch:
    """Reads inputs, counts them and keeps the findings."""

    def __init__(self, corpus: Path | None) -> None:
        self.corpus = corpus
        self.counts: Counter[str] = Counter()
        self.found: Counter[str] = Counter()
        self.longest, self.peak = 0.0, peak_memory()
        self.judge_memory = True
        for each in (signal.SIGALRM, signal.SIGPROF):
            signal.signal(each, _too_long)

    def attempt(self, name: str, reader: Any, data: bytes) -> bool:
        """Read `data`; return whether it was taken."""
        began = time.process_time()
        signal.setitimer(signal.ITIMER_PROF, LONGEST)
        signal.alarm(PATIENCE)
        error: BaseException | None = None
        try:
            taken = reader.attempt(data)
        except (Exception, Hang) as raised:  # noqa: BLE001 - this is what is looked for
            taken, error = False, raised
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            signal.alarm(0)
        took = time.process_time() - began
        if took > QUICK and self.judge_memory:  # in less time nobody fills so much
            before, self.peak = self.peak, peak_memory()  # a look takes milliseconds
            if self.peak > before + MOST:
                error = error or MemoryError(f"{self.peak - before:.0f} MiB more than ever before")
        if error is not None:
            self._keep(name, data, error)
        self.longest = max(self.longest, took)
        self.counts[f"{name} taken" if taken else f"{name} refused"] += 1
        return taken

    def _keep(self, name: str, data: bytes, error: BaseException) -> None:
        trace = traceback.extract_tb(error.__traceback__)
        place = f" at {Path(trace[-1].filename).name}:{trace[-1].lineno}" if trace else ""
        key = f"{name}: {type(error).__name__}{place}"
        self.found[key] += 1
        if self.found[key] > 1:
            return
        print(f"FOUND {key}: {str(error)[:200]}", flush=True)
        if self.corpus is not None:
            file = self.corpus / name / hashlib.sha256(data).hexdigest()[:16]
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(data)

    def text(self, seconds: float) -> str:
        """Return the counts in a line."""
        total = sum(self.counts.values())
        taken = sum(count for name, count in self.counts.items() if name.endswith("taken"))
        return (
            f"{total} inputs in {seconds:.0f} s ({total / seconds:.0f} a second), {taken} taken, "
            f"{sum(self.found.values())} findings of {len(self.found)} kinds, longest "
            f"{self.longest:.2f} s, peak memory {peak_memory():.0f} MiB"
        )


def kept(corpus: Path | None, name: str) -> list[bytes]:
    """Return the inputs for a reader that earlier runs have kept."""
    folders = [TESTS / "corpus" / name, *([corpus / name] if corpus else [])]
    return [file.read_bytes() for folder in folders if folder.is_dir() for file in folder.iterdir()]


def fuzz(names: list[str], readers: Any, options: argparse.Namespace, watch: Watch) -> None:
    """Read inputs, which give each reader the same time."""
    from readers import mutants

    sources = {
        name: mutants(readers[name], options.seed + k, kept(options.corpus, name))
        for k, name in enumerate(names)
    }
    inputs = {name: next(source) for name, source in sources.items()}
    for name in names:
        for data in kept(options.corpus, name):
            watch.attempt(name, readers[name], data)
    spent = dict.fromkeys(names, 0.0)
    began = shown = before = time.perf_counter()
    for _ in range(options.inputs):
        name = min(names, key=spent.__getitem__)  # the quick ones get more inputs
        taken = watch.attempt(name, readers[name], inputs[name])
        quick = time.perf_counter() - before < QUICK
        inputs[name] = sources[name].send(taken and quick)
        now = time.perf_counter()
        spent[name] += now - before
        before = now
        if now - shown > 60.0:
            shown = now
            print(watch.text(now - began), flush=True)
        if options.seconds and now - began > options.seconds:
            break


def functions_of(modules: Iterable[str]) -> Iterator[FunctionType]:
    """Yield the functions and methods that stand in modules."""
    for module in map(importlib.import_module, modules):
        for held in vars(module).values():
            for member in vars(held).values() if isinstance(held, type) else (held,):
                one = getattr(member, "__func__", getattr(member, "fget", member))
                if isinstance(one, FunctionType) and one.__module__ == module.__name__:
                    yield one


def guide(name: str, readers: Any, options: argparse.Namespace, watch: Watch) -> None:
    """Let Atheris choose the inputs of one reader."""
    import atheris  # it has no wheel for every Python

    watch.judge_memory = False  # what Atheris looks at is never freed
    for function in functions_of(_GUIDED):
        atheris.instrument_func(function)

    def custom(data: bytes, size: int, seed: int) -> bytes:
        rng = random.Random(seed)
        if rng.random() < 0.3:
            return bytes(atheris.Mutate(data, size))
        return readers[name].mutate(data, rng)[:size]

    began = time.perf_counter()

    def one(data: bytes) -> None:
        watch.attempt(name, readers[name], data)
        if sum(watch.counts.values()) % 1000 == 0 or sum(watch.counts.values()) == options.inputs:
            print(f"{name}, guided: {watch.text(time.perf_counter() - began)}", flush=True)

    corpus = Path(options.corpus or tempfile.mkdtemp()) / f"guided-{name}"
    corpus.mkdir(parents=True, exist_ok=True)
    for k, data in enumerate([*readers[name].seeds, *kept(options.corpus, name)]):
        (corpus / f"seed-{k}").write_bytes(data)
    limits = ["-max_len=20000", "-timeout=60", "-rss_limit_mb=8192", "-len_control=0"]
    places = [f"-artifact_prefix={corpus}/", str(corpus)]
    arguments = [sys.argv[0], *limits, f"-atheris_runs={options.inputs}", *places]
    atheris.Setup(arguments, one, custom_mutator=custom)
    atheris.Fuzz()


def main() -> int:
    """Fuzz; return 1 where anything was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--inputs", type=int, default=100_000)
    parser.add_argument("--seconds", type=float, help="stop after this time at the latest")
    parser.add_argument("--readers", help="names joined by commas (all)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--corpus", type=Path, help="folder in which findings are kept")
    parser.add_argument("--guided", action="store_true", help="by coverage, one reader, Atheris")
    options = parser.parse_args()
    sys.path.insert(0, str(TESTS))
    faulthandler.enable()  # a library may end the process
    from readers import make_readers

    with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as own:
        readers = make_readers(Path(own))
        names = options.readers.split(",") if options.readers else list(readers)
        if unknown := [name for name in names if name not in readers]:
            parser.error(f"--readers must be of {', '.join(readers)}; got {', '.join(unknown)}")
        if options.guided and len(names) > 1:
            parser.error("--guided needs one name in --readers")
        for name in names:  # compile what they need before any clock runs
            assert all(map(readers[name].attempt, readers[name].seeds)), name
        watch = Watch(options.corpus)
        warnings.simplefilter("error")
        warnings.filterwarnings(
            "ignore", message=r"theta reaches|times are rounded", category=UserWarning
        )
        warnings.filterwarnings(
            "ignore", message=r".*does not say for which environment", category=UserWarning
        )
        if options.guided:
            guide(names[0], readers, options, watch)
        began = time.perf_counter()
        fuzz(names, readers, options, watch)
    for key, count in sorted(watch.counts.items()):
        print(f"  {key}: {count}")
    for key, count in watch.found.most_common():
        print(f"  FOUND {count} times: {key}")
    print(watch.text(time.perf_counter() - began))
    return int(bool(watch.found))


if __name__ == "__main__":
    raise SystemExit(main())
