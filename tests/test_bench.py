"""`npend bench`: that it measures what it says, never how fast."""

import csv
import json
import math
import time

import numpy as np
import pytest

from npend_gym import Chain, bench, simulate
from npend_gym.bench import accuracy, dynamics, environments, timing
from npend_gym.bench.timing import Job, Row
from npend_gym.cli import main
from npend_gym.report import bench as report


@pytest.fixture
def hurried(monkeypatch):
    monkeypatch.setattr(timing, "SECONDS", 1e-4)


def test_of_two_jobs_the_one_that_does_twice_the_work_in_the_time_has_twice_the_rate():
    def wait(calls):
        end = time.process_time() + 1e-4 * calls
        while time.process_time() < end:
            pass

    best = timing.rates({"one": Job(wait), "two": Job(wait, units=2.0)}, rounds=2)
    assert best["one"] == pytest.approx(1e4, rel=0.3)
    assert best["two"] == pytest.approx(2.0 * best["one"], rel=0.3)


@pytest.mark.usefixtures("hurried")
def test_calls_come_in_whole_multiples():
    taken = []
    timing.rates({"": Job(taken.append, multiple=7)}, rounds=3)
    assert [calls % 7 for calls in taken[-3:]] == [0, 0, 0]


def test_mujocos_chain_moves_as_ours_does():
    mujoco = pytest.importorskip("mujoco")
    model, data = dynamics.mujoco_chain(3)
    for _ in range(100):
        mujoco.mj_step(model, data)
    path = simulate(Chain.uniform(3), np.pi / 4, 0.0, [0.0, 1.0])
    np.testing.assert_allclose(np.cumsum(data.qpos), path.theta[-1], atol=1e-6)


def test_every_method_solves_the_papers_job_as_well_as_it_is_told():
    points = list(accuracy.rows(n=3, duration=1.0))
    assert {"npend_gym, dop853", "npend_gym, rk4"} <= {point.method for point in points}
    tightest = {point.method: point.energy_error for point in points}  # the last one
    for method, error in tightest.items():
        assert error < (1e-5 if "MuJoCo" in method else 1e-8), method


@pytest.mark.usefixtures("hurried")
@pytest.mark.parametrize("suite", ["dynamics", "environments"])
def test_suites_compare_positive_rates(suite):
    rows = {"dynamics": dynamics, "environments": environments}[suite].rows()
    first = [next(rows) for _ in range(3)]
    assert all(row.ours_per_s > 0.0 and row.ratio > 0.0 for row in first if row.peer)


def test_the_command_prints_every_row_and_writes_it_with_what_made_it(
    monkeypatch, tmp_path, capsys
):
    rows = [Row("a job", "a peer", 6.0, 2.0), Row("another", "", 5.0, math.nan, "a note")]
    monkeypatch.setattr(dynamics, "rows", lambda: iter(rows))
    assert main(["bench", "--only", "dynamics", "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "3.00 x  a peer" in printed
    assert "a note" in printed
    with (tmp_path / "dynamics.csv").open() as file:
        written = list(csv.DictReader(file))
    assert [row["job"] for row in written] == ["a job", "another"]
    assert float(written[0]["ratio"]) == 3.0
    assert all("npend_gym" in row["made_by"] for row in written)


def test_json_is_all_that_is_printed_to_the_output_and_has_null_where_there_is_no_peer(
    monkeypatch, capsys
):
    rows = [Row("a job", "a peer", 6.0, 2.0), Row("another", "", 5.0, math.nan)]
    monkeypatch.setattr(dynamics, "rows", lambda: iter(rows))
    assert main(["bench", "--only", "dynamics", "--json"]) == 0
    captured = capsys.readouterr()
    table = json.loads(captured.out)["dynamics"]
    assert [(row["job"], row["ratio"]) for row in table] == [("a job", 3.0), ("another", None)]
    assert "a peer" in captured.err


def test_what_was_measured_before_ctrl_c_is_kept(monkeypatch, tmp_path, capsys):
    def rows():
        yield Row("a job", "", 6.0, math.nan)
        raise KeyboardInterrupt

    monkeypatch.setattr(dynamics, "rows", rows)
    assert main(["bench", "--only", "dynamics", "--out", str(tmp_path)]) == 130
    assert (tmp_path / "dynamics.csv").exists()
    assert "interrupted" in capsys.readouterr().err


def test_the_work_precision_diagram_has_a_line_for_each_method(tmp_path):
    points = [
        accuracy.Point(f"method {k}", f"{j}", 10.0**-j, 10.0 ** -(j + k))
        for k in range(3)
        for j in range(3)
    ]
    written = report.write("accuracy", points, tmp_path, figures=True)
    assert [path.name for path in written] == ["accuracy.csv", "accuracy.png", "accuracy.pdf"]
    from npend_gym.report.bench_figure import work_precision

    axes = work_precision(points).axes[0]
    assert [line.get_label() for line in axes.lines] == ["method 0", "method 1", "method 2"]


def test_every_suite_can_be_chosen():
    assert bench.SUITES == ("dynamics", "environments", "accuracy")
