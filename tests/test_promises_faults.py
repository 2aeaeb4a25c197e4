"""Campaigns and policies on disks that fail: every operation once, and power cuts between them."""

import errno
import os
import random
import shutil
from pathlib import Path

import numpy as np
import pytest
from disks import KINDS, LOSSES, FaultyDisk, KillingDisk, Log, after_power_cut, chosen
from policy_files import random_policy

from npend_gym import _files
from npend_gym.experiments import BusyError, Campaign, CampaignPlan, DiskError, FlipMap, flip_map
from npend_gym.report.campaign_report import finish
from npend_gym.rl import Policy

PLAN = CampaignPlan(n=[1, 2], amplitude=0.4, trials=4, batch=4)
DECLARED = (DiskError, BusyError, ValueError, OSError)  # what the command tells in one line


def work(out):
    """Run the campaign in `out` to its end."""
    with Campaign(PLAN, out) as campaign:
        for _, error in campaign.run("threading", 1):
            assert not error
        text, complete = finish(campaign)
        assert complete, text


def content(out):
    """Return the bytes of the plan and of all tables."""
    files = [out / "plan.json", *out.rglob("*.parquet")]
    assert not list(out.rglob("*.part"))
    return {path.relative_to(out): path.read_bytes() for path in files}


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """The content of an undisturbed run, its operations, and their log."""
    folder = tmp_path_factory.mktemp("undisturbed")
    work(folder / "plain")
    logs = {}
    for disk in (FaultyDisk(), Log()):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(_files, "disk", disk)
            out = folder / type(disk).__name__
            work(out)
            logs[type(disk)] = disk
        assert content(out) == content(folder / "plain")
    return content(folder / "plain"), logs[FaultyDisk].done, logs[Log].entries, folder / "Log"


def fail_once(number, kind, code, out, monkeypatch, expected):
    """Let an operation of a campaign fail, then run the campaign again; return the first error."""
    disk, error = FaultyDisk(number, kind, code), None
    with monkeypatch.context() as patch:
        patch.setattr(_files, "disk", disk)
        try:
            work(out)
        except DECLARED as raised:
            error = raised
    assert len(disk.done) > number, "the operation was never reached"
    if error is not None:
        assert str(out) in str(error), error
        assert os.strerror(code) in str(error), error
        work(out)
    assert content(out) == expected
    shutil.rmtree(out)
    return error


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("every", [27, pytest.param(1, marks=pytest.mark.long)])
def test_a_failed_operation_is_told_and_a_second_run_has_the_same_bytes(
    kind, every, undisturbed, tmp_path, monkeypatch
):
    expected, operations, _, _ = undisturbed
    assert {"open", "write", "sync", "close", "replace", "mkdir"} <= set(operations)
    # of the other operations nothing can be half done
    possible = [k for k, name in enumerate(operations) if kind != "half" or name == "write"]
    told = 0
    for number in [possible[k] for k in chosen(len(possible), every)]:
        for code in (errno.EIO, errno.ENOSPC) if every == 1 else (errno.EIO,):
            told += fail_once(number, kind, code, tmp_path / "a", monkeypatch, expected) is not None
    assert told > 0


@pytest.mark.parametrize("step", ["_acquire", "_release"])
def test_a_lock_that_fails_is_told_and_a_second_run_has_the_same_bytes(
    step, undisturbed, tmp_path, monkeypatch
):
    import filelock

    done = getattr(filelock.FileLock, step)

    def fail(lock):
        if step == "_release":  # one that was not released would be held until the process ends
            done(lock)
        raise OSError(errno.ENOLCK, "No locks available")

    out = tmp_path / "a"
    with monkeypatch.context() as patch:
        patch.setattr(filelock.FileLock, step, fail)
        with pytest.raises(DECLARED):
            work(out)
    work(out)
    assert content(out) == undisturbed[0]


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="asks Linux for the names of files")
@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("every", [27, pytest.param(1, marks=pytest.mark.long)])
def test_after_a_power_cut_at_any_moment_the_same_command_comes_to_the_same_bytes(
    loss, every, undisturbed, tmp_path
):
    expected, _, log, folder = undisturbed
    for moment in chosen(len(log) + 1, every):
        out = tmp_path / f"{moment}"
        after_power_cut(log[:moment], loss, folder, out, random.Random(moment))
        work(out)
        assert content(out) == expected
        shutil.rmtree(out)


@pytest.mark.parametrize("kind", KINDS)
def test_a_failure_while_a_policy_is_saved_never_mixes_old_and_new(kind, tmp_path, monkeypatch):
    path, told, number, done = tmp_path / "a.safetensors", 0, 0, []
    env = {"n": 1, "observation": "sincos"}
    old, new = (
        random_policy([(1, 3)], env | {"mode": mode}, seed, provenance={"seed": seed})
        for seed, mode in enumerate(("swingup", "balance"))
    )
    while number <= len(done):  # the last time, no operation fails
        for leftover in tmp_path.iterdir():
            leftover.unlink()
        old.save(path)
        disk = FaultyDisk(number, kind)
        with monkeypatch.context() as patch:
            patch.setattr(_files, "disk", disk)
            error = None
            try:
                new.save(path)
            except OSError as raised:
                error = raised
        if error is not None:
            assert str(path) in str(error)
            told += 1
        found, done = Policy.load(path), disk.done
        which = old if found == old else new
        assert found == which, done
        assert found.provenance == which.provenance, done
        number += 1
    assert which is new
    assert told >= 4  # open, write, sync, replace


@pytest.fixture
def counted(monkeypatch):
    """The starts of the parts of maps that are computed, by a stand-in that compiles nothing."""
    starts = []

    def flip_times(chain, angles, *, duration, rtol, threads):  # noqa: ARG001
        starts.append(angles)
        return chain.masses[0] * angles[..., 0] + duration * angles[..., 1]

    monkeypatch.setattr(flip_map, "flip_times", flip_times)
    return starts


MAP = FlipMap(size=35, duration=2.0)  # four parts


def in_a_process_that_is_killed(out, number, kind, monkeypatch):
    """Run the map, killed at an operation of its disk; return whether it was."""
    child = os.fork()
    if child == 0:
        monkeypatch.setattr(_files, "disk", KillingDisk(number, kind))
        MAP.run(out)
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 9


@pytest.mark.long
@pytest.mark.skipif(not hasattr(os, "fork"), reason="fork")
@pytest.mark.parametrize("kind", KINDS)
def test_a_map_that_is_killed_at_any_moment_resumes_and_leaves_nothing(
    kind, counted, tmp_path, monkeypatch
):
    whole, told = MAP.run(tmp_path / "whole"), []
    bytes_of_whole = (tmp_path / "whole" / "map.npz").read_bytes()
    number = 0
    while in_a_process_that_is_killed(out := tmp_path / str(number), number, kind, monkeypatch):
        done = len(list(out.glob("parts-*/[0-9]-*")))
        finished = (out / "map.npz").exists()
        counted.clear()
        np.testing.assert_array_equal(MAP.run(out, tell=told.append), whole)
        assert len(counted) == (0 if finished else 4 - done), number
        assert [path.name for path in out.iterdir()] == ["map.npz"]
        assert (out / "map.npz").read_bytes() == bytes_of_whole
        number += 1
    assert number > 25
    assert all("is this map already" in line for line in told)


@pytest.mark.parametrize("number", range(5))  # four parts and the map
def test_a_run_beside_another_of_the_same_map_that_ends_first_ends_with_the_map(
    number, counted, tmp_path, monkeypatch
):
    whole, out, real = MAP.run(tmp_path / "whole"), tmp_path / "beside", _files.disk

    class Beside(_files.Disk):
        done = 0

        def replace(self, source, target):
            self.done += 1
            if self.done == number + 1:
                with monkeypatch.context() as patch:
                    patch.setattr(_files, "disk", real)
                    MAP.run(out)
            real.replace(source, target)

    monkeypatch.setattr(_files, "disk", Beside())
    np.testing.assert_array_equal(MAP.run(out), whole)
    assert len(counted) == 4 + 4 + (4 - number)
    assert [path.name for path in out.iterdir()] == ["map.npz"]


def test_a_part_of_another_map_or_version_is_told_of_and_computed_again(
    counted, tmp_path, monkeypatch, caplog
):
    def two_parts(parts):
        yield from parts[:2]
        raise KeyboardInterrupt

    def begun(plan, name):
        with pytest.raises(KeyboardInterrupt):
            plan.run(tmp_path / name, progress=two_parts)
        return next((tmp_path / name).glob("parts-*"))

    other = begun(FlipMap(size=35, duration=2.0, masses=2.0), "other")
    mine = begun(MAP, "mine")
    assert mine.name != other.name
    (foreign,), (first,), (second,) = other.glob("0-*"), mine.glob("0-*"), mine.glob("1-*")
    shutil.move(foreign, mine)
    first.unlink()
    shutil.copy(second, mine / second.name.replace("1-", "2-", 1))
    (mine / "notes.txt").write_text("mine")
    counted.clear()
    told = []
    result = MAP.run(tmp_path / "mine", tell=told.append)
    assert len(counted) == 3
    line = "2 part(s) are damaged, or of another map or version of npend_gym"
    assert [line in text for text in told] == [True]
    np.testing.assert_array_equal(result, MAP.run(tmp_path / "whole"))
    assert [path.name for path in mine.iterdir()] == ["notes.txt"]
    np.testing.assert_array_equal(MAP.run(str(tmp_path / "mine")), result)
    assert "is this map already, by the same version" in caplog.text
    begun(MAP, "older")
    monkeypatch.setattr(flip_map, "__version__", "99.0")
    for name in ("older", "mine"):  # the parts of one, the finished map of the other
        counted.clear()
        np.testing.assert_array_equal(MAP.run(tmp_path / name, tell=told.append), result)
        assert len(counted) == 4
    assert f"{line} (this is 99.0)" in told[1]
