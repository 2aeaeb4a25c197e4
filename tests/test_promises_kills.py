"""Whether the harness that kills campaigns notices what it looks for."""

import random
import subprocess
import sys
import time
from pathlib import Path

import kill_campaign
import psutil
import pytest

FOREVER = "import time; time.sleep(600)"
PARENT = f"import subprocess, sys; subprocess.Popen([sys.executable, '-c', {FOREVER!r}]).wait()"


class Always(random.Random):
    """Draws what lies at `value`, between 0 and 1, of every range."""

    def __init__(self, value):
        super().__init__(0)
        self.value = value

    def random(self):
        return self.value

    def uniform(self, low, high):
        return low + self.value * (high - low)


@pytest.fixture
def orphans(monkeypatch):
    monkeypatch.setattr(kill_campaign.Orphans, "PATIENCE", 0.2)
    return kill_campaign.Orphans()


def disturb(code, value, longest, orphans, out=Path("nowhere")):
    return kill_campaign.disturb(python(code), out, Always(value), longest, orphans)


def python(code):
    return subprocess.Popen([sys.executable, "-c", code])


def test_a_driver_that_is_left_alone_and_hangs_is_a_finding(monkeypatch, orphans):
    monkeypatch.setattr(kill_campaign, "HANGS", 0.2)
    assert disturb(FOREVER, 0.0, 5.0, orphans) == "driver HUNG"
    assert disturb(FOREVER, 0.4, 0.1, orphans) == "driver killed"
    assert disturb("", 0.4, 60.0, orphans) == "ended"
    assert disturb("1 / 0", 0.9, 60.0, orphans) == "gave up"


def test_a_driver_is_killed_once_it_has_done_some_tasks(orphans, tmp_path):
    code = f"""
import pathlib, time
folder = pathlib.Path({str(tmp_path)!r}, "releases", "n=2")
folder.mkdir(parents=True)
for k in range(1000):
    (folder / f"{{k}}.parquet").touch()
    time.sleep(0.005)
"""
    assert disturb(code, 0.9, 60.0, orphans, tmp_path) == "driver killed"
    assert 10 <= kill_campaign.written(tmp_path) < 300


@pytest.mark.skipif(sys.platform != "linux", reason="the harness is of Linux")
def test_a_process_that_outlives_its_driver_is_a_finding(orphans, capsys, tmp_path):
    driver = python(PARENT)
    while not (below := psutil.Process(driver.pid).children()):
        time.sleep(0.01)
    assert kill_campaign.disturb(driver, tmp_path, Always(0.4), 0.1, orphans) == "driver killed"
    orphans.look(at_end=True)
    assert (orphans.seen, orphans.alive) == (1, 1)
    assert "alive" in capsys.readouterr().out
    assert psutil.wait_procs(below, 5.0)[1] == []


def test_every_damage_changes_the_folder_and_is_named(tmp_path):
    (tmp_path / "bobs").mkdir()
    rng, seen = random.Random(0), set()
    for _ in range(100):
        for file in (tmp_path / "bobs").iterdir():
            file.unlink()
        (tmp_path / "bobs" / "0000001-00.parquet").write_bytes(b"12345")
        name = kill_campaign.damage(tmp_path, rng)
        found = {file.name: file.read_bytes() for file in (tmp_path / "bobs").iterdir()}
        assert (found == {"0000001-00.parquet": b"12345"}) == (name == "")
        seen.add(name)
    assert len(seen) == 5
