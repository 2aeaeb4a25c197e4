"""Whether a campaign writes the same bytes, however often it is killed.

    python stress/kill_campaign.py --kills 100

Why: "nothing is lost and nothing is done twice" is a claim about moments that no test chooses. Here
a small campaign runs. Drivers and workers are killed with SIGKILL at random moments, from the start
of the interpreter to the last part; between two drivers a part is sometimes damaged as well. The
same command is repeated until it reports that everything is done; then every part must have the
bytes that an undisturbed run wrote. Further campaigns follow until the number of kills is reached.
No process of a killed driver may be alive ten seconds later, and a driver that is left alone must
come to its end. Linux only.
"""

from __future__ import annotations

import argparse
import hashlib
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path

import psutil

PLAN = ["--n", "2,3", "--amplitude", "0.3,0.7", "--trials", "1600", "--batch", "40"]
HANGS = 120.0  # s, after which a driver that nobody disturbs hangs


def start(out: Path, workers: int = 2) -> subprocess.Popen[bytes]:
    """Start the driver, for the first time or again; with one worker it does the work itself."""
    command = [sys.executable, "-m", "npend_gym", "campaign", "--out", str(out), *PLAN]
    with out.with_suffix(".log").open("wb") as log:
        return subprocess.Popen(
            [*command, "--workers", str(workers)], stdout=subprocess.DEVNULL, stderr=log
        )


def digest(out: Path) -> str:
    """Return a SHA-256 of the names and contents of all parts, in order."""
    sha256 = hashlib.sha256()
    for path in sorted(out.rglob("*.parquet")):
        sha256.update(str(path.relative_to(out)).encode() + path.read_bytes())
    return sha256.hexdigest()


def worker_processes(driver: int) -> list[psutil.Process]:
    """Return the worker processes of a driver."""
    with suppress(psutil.NoSuchProcess):
        below = psutil.Process(driver).children(recursive=True)
        return [process for process in below if is_worker(process)]
    return []


def is_worker(process: psutil.Process) -> bool:
    """Return whether a process is a worker; False where it has ended."""
    with suppress(psutil.NoSuchProcess):
        return any("popen_loky" in word for word in process.cmdline())
    return False


class Orphans:
    """The processes below drivers that were killed."""

    PATIENCE = 10.0  # s

    def __init__(self) -> None:
        self.seen = self.alive = 0
        self._waiting: list[tuple[float, psutil.Process]] = []

    def add(self, driver: int) -> None:
        """Remember the processes below a driver that is killed next."""
        with suppress(psutil.NoSuchProcess):
            below = psutil.Process(driver).children(recursive=True)
            self.seen += len(below)
            self._waiting += [(time.monotonic() + self.PATIENCE, process) for process in below]

    def look(self, *, at_end: bool = False) -> None:
        """Count, and end, those that are alive though their time is over."""
        while at_end and self._waiting and self._waiting[-1][0] > time.monotonic():
            time.sleep(0.1)
        due = [process for when, process in self._waiting if when <= time.monotonic()]
        self._waiting = [each for each in self._waiting if each[1] not in due]
        for process in due:
            with suppress(psutil.NoSuchProcess):
                if process.status() != psutil.STATUS_ZOMBIE:
                    print("alive:", process.cmdline(), flush=True)
                    self.alive += 1
                    process.kill()


def wait(process: subprocess.Popen[bytes], out: Path, rng: random.Random, longest: float) -> None:
    """Wait for a random time, or for a random number of further tasks; raise TimeoutExpired then.

    Times alone would mean starts alone where the machine has become slower.
    """
    if rng.random() < 0.5:
        process.wait(rng.uniform(0.0, longest))
        return
    wanted, began = written(out) + rng.randrange(40), time.monotonic()
    while written(out) < wanted and time.monotonic() - began < HANGS:
        with suppress(subprocess.TimeoutExpired):
            process.wait(0.01)
            return
    process.wait(rng.uniform(0.0, 0.05))


def written(out: Path) -> int:
    """Return how many tasks are written."""
    return len(list(out.glob("releases/*/*.parquet")))


def disturb(
    process: subprocess.Popen[bytes],
    out: Path,
    rng: random.Random,
    longest: float,
    orphans: Orphans,
) -> str:
    """Kill the driver or a worker at a random moment; return what happened.

    A driver is sometimes left alone, also after the death of its workers: it must come to its end.
    """
    alone = rng.random() < 0.05
    try:
        if alone:
            process.wait(HANGS)
        else:
            wait(process, out, rng, longest)
    except subprocess.TimeoutExpired:
        workers = worker_processes(process.pid)
        if workers and rng.random() < 0.5 and not alone:
            with suppress(psutil.NoSuchProcess):
                rng.choice(workers).kill()
            return "worker killed"
        orphans.add(process.pid)
        process.kill()
        process.wait()
        return "driver HUNG" if alone else "driver killed"
    return "ended" if process.returncode == 0 else "gave up"


def damage(out: Path, rng: random.Random) -> str:
    """Truncate, change, remove or double a part."""
    found = [*sorted(out.glob("bobs/**/*.parquet")), *sorted(out.glob("releases/**/*.parquet"))]
    parts = [part for part in found if part.stat().st_size > 0]
    if not parts or rng.random() < 0.7:
        return ""
    part, kind = rng.choice(parts), rng.randrange(4)
    data = bytearray(part.read_bytes())
    if kind == 0:
        part.write_bytes(data[: rng.randrange(len(data))])
        return "part truncated"
    if kind == 1:
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        part.write_bytes(data)
        return "bit of a part flipped"
    if kind == 2:
        part.unlink()
        return "part removed"
    part.with_name(f"{part.name[:8]}{rng.randbytes(8).hex()}.parquet").write_bytes(data)
    return "part with a wrong name"


def undisturbed(folder: Path) -> tuple[dict[int, float], str]:
    """Return how long a whole run takes [s], by the number of workers, and the digest of one."""
    took: dict[int, float] = {}
    for name, workers in (("warm-up", 2), ("two workers", 2), ("one worker", 1)):
        began = time.perf_counter()  # the first run may compile
        if start(folder / name, workers).wait():
            raise RuntimeError("the undisturbed run failed")
        took[workers] = time.perf_counter() - began
    return took, digest(folder / "one worker")


def run_campaign(
    out: Path, rng: random.Random, longest: dict[int, float], orphans: Orphans
) -> Counter[str]:
    """Start, kill and start again until all is done; return what happened."""
    counts, harmed = Counter[str](), False
    while True:
        workers = rng.choice((1, 2))
        process = start(out, workers)
        what = "worker killed"
        while what == "worker killed":
            what = disturb(process, out, rng, longest[workers], orphans)
            counts[what] += 1
            harmed |= "killed" in what
        orphans.look()
        if what == "ended":
            return counts
        if what == "gave up":
            print(out.with_suffix(".log").read_text()[-1000:], flush=True)
            if not harmed:
                raise RuntimeError("a driver gave up, though nothing was killed or damaged")
            harmed = False
        damaged = damage(out, rng)
        counts[damaged or "nothing damaged"] += 1
        harmed |= bool(damaged)


def main() -> int:
    """Kill until the number of kills is reached; return 1 if bytes differed or a worker lived."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--longest", type=float, help="between two [s] (0.8 of a whole run)")
    parser.add_argument("--seed", type=int, default=0, help="of the moments (0)")
    arguments = parser.parse_args()
    rng, counts, orphans = random.Random(arguments.seed), Counter[str](), Orphans()
    with tempfile.TemporaryDirectory() as folder:
        took, expected = undisturbed(Path(folder))
        longest = {
            workers: 0.8 * whole if arguments.longest is None else arguments.longest
            for workers, whole in took.items()
        }
        kills, began = 0, time.monotonic()
        while kills < arguments.kills:
            out = Path(folder) / f"campaign {counts['ended']}"
            counts += run_campaign(out, rng, longest, orphans)
            kills = counts["driver killed"] + counts["worker killed"]
            same = digest(out) == expected
            counts["campaign the same" if same else "campaign DIFFERENT"] += 1
            took = time.monotonic() - began
            print(f"{kills} kills in {took:.0f} s:", dict(+counts), flush=True)
            if same:
                shutil.rmtree(out)
        orphans.look(at_end=True)
        print(
            f"{orphans.seen} processes below killed drivers, {orphans.alive} of them alive after "
            f"{orphans.PATIENCE:g} s"
        )
    return int(counts["campaign DIFFERENT"] + counts["driver HUNG"] + orphans.alive > 0)


if __name__ == "__main__":
    raise SystemExit(main())
