"""`python benchmarks/peers.py`: that it measures what it says, never how fast."""

import csv
import json
import math
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import peers
import pytest
import yardstick
from peers import main
from suites import accuracy, chaos, derivatives, dynamics, environments, episodes, timing
from suites.timing import Job, Peers, Row

from npend_gym import Chain, simulate


@pytest.fixture
def short_rounds(monkeypatch):
    monkeypatch.setattr(timing, "SECONDS", 1e-4)


def test_the_yardstick_shows_its_help_and_measures_nothing(monkeypatch, capsys):
    monkeypatch.delattr(yardstick, "measure")
    monkeypatch.setattr("sys.argv", ["yardstick.py", "--help"])
    with pytest.raises(SystemExit):
        yardstick.main()
    assert "--out" in capsys.readouterr().out


def test_the_yardsticks_job_moves_every_lane_as_dop853_does():
    job, angles = yardstick.numba_job(2)
    job()
    theta, _, v, lengths, _ = (each.reshape(yardstick.LANES, -1) for each in yardstick.chains(2, 1))
    for lane in (0, 17, yardstick.LANES - 1):
        chain = Chain(masses=1.0 / v[lane, 1:], lengths=lengths[lane], gravity=yardstick.GRAVITY)
        path = simulate(chain, theta[lane], 0.0, [0.0, yardstick.STEPS * yardstick.H])
        moved = yardstick.by_lane(angles)[lane]
        np.testing.assert_allclose(moved, path.theta[-1], atol=1e-9)


def test_a_job_with_twice_the_items_per_call_has_twice_the_rate():
    def wait(calls):
        end = time.process_time() + 1e-4 * calls
        while time.process_time() < end:
            pass

    best = timing.rates({"one": Job(wait), "two": Job(wait, items_per_call=2.0)}, rounds=2)
    assert best["one"] == pytest.approx(1e4, rel=0.3)
    assert best["two"] == pytest.approx(2.0 * best["one"], rel=0.3)


def test_a_peer_whose_import_fails_is_left_out_and_the_reason_is_reported_once(
    monkeypatch, tmp_path
):
    (tmp_path / "broken_peer.py").write_text("import a_library_that_is_not_installed")
    monkeypatch.syspath_prepend(tmp_path)
    messages = []
    peers = Peers(messages.append)

    def job():
        import broken_peer

        return Job(broken_peer.run)

    assert peers.job("a peer", job) is None
    assert peers.job("a peer", job) is None
    (message,) = messages
    assert message.startswith("a peer is left out: ModuleNotFoundError")
    assert "a_library_that_is_not_installed" in message
    assert peers.job("another", lambda: Job(len, 2.0)) is None  # it fails when it runs
    assert peers.job("a third", lambda: Job(range, 2.0)).items_per_call == 2.0


@pytest.mark.usefixtures("short_rounds")
def test_without_a_peer_the_packages_own_speed_is_measured_alone(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)  # importing it fails
    messages = []
    row = next(dynamics.rows(Peers(messages.append)))
    assert (row.job, row.peer) == ("one evaluation, N = 2", "")
    assert row.ours_per_s > 0.0
    assert math.isnan(row.peer_per_s)
    assert messages[0].startswith("MuJoCo is left out: ModuleNotFoundError")


def test_mujocos_chain_moves_like_the_packages_own():
    mujoco = pytest.importorskip("mujoco")
    model, data = dynamics.mujoco_chain(3)
    for _ in range(100):
        mujoco.mj_step(model, data)
    path = simulate(Chain.uniform(3), np.pi / 4, 0.0, [0.0, 1.0])
    np.testing.assert_allclose(np.cumsum(data.qpos), path.theta[-1], atol=1e-6)


def test_every_method_keeps_the_energy_at_its_tightest_tolerance():
    measured = list(accuracy.rows(Peers(print), n=3, duration=1.0))
    assert {"npend_gym, dop853", "npend_gym, rk4"} <= {run.method for run in measured}
    tightest = {run.method: run.energy_error for run in measured}  # the last of each method
    for method, error in tightest.items():
        assert error < (1e-5 if "MuJoCo" in method else 1e-8), method


@pytest.mark.long
def test_the_suite_of_chaos_measures_the_symmetry_of_the_flow():
    rows = list(chaos.rows(Peers(print), duration=300.0, rods=2))
    assert [row.job[:3] for row in rows] == ["lar", "all", "all", "the", "non"]
    assert all(row.ours_per_s > 0.0 for row in rows)
    assert float(rows[3].note.split()[-2]) < 1e-6  # sum less divergence


@pytest.mark.long
@pytest.mark.usefixtures("short_rounds")
@pytest.mark.parametrize(
    "suite",
    [dynamics, environments, episodes, pytest.param(derivatives, marks=pytest.mark.nightly)],
)
def test_suites_compare_positive_rates(suite, monkeypatch):
    monkeypatch.setattr(episodes, "MANY", 64)
    monkeypatch.setattr(episodes, "LANES", 8)
    rows = suite.rows(Peers(print))
    first = [next(rows) for _ in range(3)]
    assert all(row.ours_per_s > 0.0 and row.ratio > 0.0 for row in first if row.peer)


@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="two threads that spin need two cores")
@pytest.mark.long
def test_one_system_has_one_solution_from_one_end_from_both_and_on_two_threads(tmp_path):
    source = Path(peers.__file__).with_name("twisted.c")
    subprocess.run(
        ["gcc", "-O2", "-Wall", "-Werror", "-pthread", source, "-o", tmp_path / "a"], check=True
    )
    done = subprocess.run([tmp_path / "a", "2"], check=True, capture_output=True, text=True)
    rows = [line.split(", ") for line in done.stdout.splitlines()[1:]]
    assert [int(row[0]) for row in rows] == [10, 30, 100, 300, 1000, 10_000, 100_000]
    assert all(float(row[-1]) < 1e-12 for row in rows)


def test_the_command_prints_every_row_and_writes_it_with_the_machine_that_made_it(
    monkeypatch, tmp_path, capsys
):
    rows = [Row("a job", "a peer", 6.0, 2.0), Row("another", "", 5.0, math.nan, "a note")]
    monkeypatch.setattr(dynamics, "rows", lambda _peers: iter(rows))
    assert main(["--only", "dynamics", "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "3.00 x  a peer" in printed
    assert "a note" in printed
    with (tmp_path / "dynamics.csv").open() as file:
        written = list(csv.DictReader(file))
    assert [row["job"] for row in written] == ["a job", "another"]
    assert float(written[0]["ratio"]) == 3.0
    assert all("npend_gym" in row["made_by"] for row in written)
    assert main(["--only", "dynamics", "--json"]) == 0  # alone on the output, null without a peer
    captured = capsys.readouterr()
    table = json.loads(captured.out)["dynamics"]
    assert [(row["job"], row["ratio"]) for row in table] == [("a job", 3.0), ("another", None)]
    assert "a peer" in captured.err


def test_rows_measured_before_ctrl_c_are_kept(monkeypatch, tmp_path, capsys):
    def rows(peers):
        del peers
        yield Row("a job", "", 6.0, math.nan)
        raise KeyboardInterrupt

    monkeypatch.setattr(dynamics, "rows", rows)
    assert main(["--only", "dynamics", "--out", str(tmp_path)]) == 130
    assert (tmp_path / "dynamics.csv").exists()
    assert "interrupted" in capsys.readouterr().err
