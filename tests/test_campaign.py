"""Campaigns: every release once, the same bits however it is shared out, nothing lost."""

import contextlib
import json
import os
import random
import signal
import subprocess
import sys
import time
from functools import partial
from types import SimpleNamespace

import deadly
import kill_campaign
import numpy as np
import psutil
import pytest
from campaign_tables import completed, digests, part_of, read_part, read_table

from npend_gym import Chain, _progress, pseudo_periods
from npend_gym._files import part_digest
from npend_gym.cli import main
from npend_gym.experiments import BusyError, Campaign, CampaignPlan
from npend_gym.experiments.campaign import engine
from npend_gym.experiments.campaign.plan_file import read_plan_file
from npend_gym.experiments.campaign.tasks import digest_of
from npend_gym.experiments.studies.release_estimate import duration, estimate
from npend_gym.experiments.studies.release_plan import BOBS, RELEASES
from npend_gym.experiments.studies.release_tables import measure_task

SMALL = CampaignPlan(n=[2, 3], amplitude=[0.3, 0.7], trials=50, seed=4, batch=16)


def contents(out):
    """Return the bytes of all tables by their paths."""
    return {path.relative_to(out): path.read_bytes() for path in out.rglob("*.parquet")}


def done(status):
    """Return the ids of the tasks that are done."""
    return [f"{index:07d}" for index in np.flatnonzero(status.done)]


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    out = tmp_path_factory.mktemp("undisturbed")
    completed(SMALL, out)
    return out


# The plan


def test_every_release_of_every_cell_is_in_one_task():
    plan = CampaignPlan(n=[2, 5], masses=[1.0, 2.0], definition=["bob", "link"], trials=7, batch=10)
    tasks = list(plan.tasks())
    assert [k for task in tasks for k in range(task.first, task.last)] == list(range(8 * 7))
    assert len({task.id for task in tasks}) == len(tasks) == plan.task_count
    assert {plan.cell(task.first // 7)["n"] for task in tasks if plan.n_of(task) == 5} == {5}
    cells = [tuple(plan.cell(k).values()) for k in range(plan.cells)]
    assert len(set(cells)) == 8


def test_numpy_integers_of_a_plan_do_not_overflow_and_are_kept_in_the_folder(tmp_path):
    plan = CampaignPlan(
        n=np.array([2, 3]), trials=np.uint8(200), batch=np.uint8(100), seed=np.int64(7)
    )
    assert plan == CampaignPlan(n=[2, 3], trials=200, batch=100, seed=7)
    assert (plan.releases, plan.task_count) == (400, 4)
    with Campaign(plan, tmp_path):
        assert Campaign(None, tmp_path).plan == plan


def test_a_plan_that_is_too_large_for_its_file_is_refused_before_the_folder_is_made(tmp_path):
    masses = np.random.default_rng(0).uniform(1.0, 2.0, (200, 1000)).tolist()
    with pytest.raises(ValueError, match=r"plan\.json must have at most 10000000 bytes, got 1"):
        Campaign(CampaignPlan(n=1000, masses=masses), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_plan_equals_the_plan_that_is_made_from_its_dict():
    plan = CampaignPlan(n=range(2, 4), masses=[1, [1, 2.5]][:1], amplitude=np.array([0.1, 0.2]))
    again = CampaignPlan(**json.loads(json.dumps(plan.as_dict())))
    assert again == plan
    assert again.digest == plan.digest
    assert CampaignPlan(n=3, masses=[[1, 2, 3]]).as_dict()["masses"] == [[1.0, 2.0, 3.0]]


@pytest.mark.parametrize(
    ("values", "error", "message"),
    [
        ({"n": []}, ValueError, "n must name at least one value"),
        ({"n": 2.5}, TypeError, "n must be an integer"),
        ({"n": "2"}, TypeError, "n must be an integer"),
        ({"n": [2, 2]}, ValueError, "n must name each value once, got 2 twice"),
        ({"n": [2, 3], "masses": [[1, 2]]}, ValueError, "masses must be one number or 3 of them"),
        ({"n": 2, "masses": [[[1, 2]]]}, ValueError, r"of masses must .* got shape \(1, 2\)"),
        ({"masses": [1.0, 0.0]}, ValueError, "masses must be greater than zero"),
        ({"amplitude": [0.1, 0.0]}, ValueError, "amplitude must not be 0"),
        ({"amplitude": [0.1, 3.0], "spread": [0.0, 0.2]}, ValueError, "must stay within pi"),
        ({"amplitude": "1e-3"}, TypeError, "amplitude must be a real number"),
        ({"gravity": [9.81, np.nan]}, ValueError, "gravity must be finite"),
        ({"gravity": [9.81, -1.0]}, ValueError, "gravity must be zero or more"),
        ({"damping": -1.0}, ValueError, "damping must be zero or more"),
        ({"definition": ["bob", "eye"]}, ValueError, "definition must be one of"),
        ({"trials": 0}, ValueError, "trials must be between"),
        ({"batch": 0}, ValueError, "batch must be between"),
        ({"seed": -1}, ValueError, "seed must be between"),
        ({"duration": 0.0}, ValueError, "duration must be greater"),
        ({"colour": 1}, ValueError, "a plan has the names n, masses"),
        ({"n": range(1, 1001), "gravity": np.arange(1, 1101) * 0.01}, ValueError, "cells"),
        ({"trials": 10**12}, ValueError, "trials must be so few, or batch so large"),
        ({"n": list(range(1, 1_000_001))}, ValueError, "n must name at most 10000 values, got 1"),
        ({"n": range(1, 10**15)}, ValueError, "n must name at most 10000 values"),
        ({"amplitude": np.linspace(0.1, 1.0, 1_000_000)}, ValueError, "must name at most 10000"),
        (
            {"n": range(1, 201), "gravity": np.linspace(1.0, 9.0, 100)},
            ValueError, "the number of chains",
        ),
        ({"gravity": 1e30}, ValueError, r"gravity must be 0 or such that sqrt\(l/g\)"),
        ({"gravity": 1e-30}, ValueError, "gravity must be 0 or such that"),
        ({"lengths": 1e-29}, ValueError, "gravity must be 0 or such that"),
    ],
)  # fmt: skip
def test_bad_plans_and_those_of_absurd_size_are_refused_by_name_at_once(values, error, message):
    began = time.process_time()
    with pytest.raises(error, match=message):
        CampaignPlan.from_dict(values)
    assert time.process_time() - began < 1.0


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("plan.toml", "n = [2, 3]\namplitude = [0.3, 0.7]\ntrials = 50\nseed = 4\nbatch = 16\n"),
        ("plan.yaml", "n: [2, 3]\namplitude: [0.3, 0.7]\ntrials: 50\nseed: 4\nbatch: 16\n"),
        ("plan.json", json.dumps(SMALL.as_dict())),
    ],
)
def test_a_plan_can_be_a_file(name, text, tmp_path):
    (tmp_path / name).write_text(text)
    assert CampaignPlan.from_dict(read_plan_file(tmp_path / name)) == SMALL


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("plan.txt", "", "must end in .toml"),
        ("plan.toml", "n = [", "cannot be read"),
        ("plan.yaml", "n: [", "cannot be read"),
        ("plan.yaml", "- 1", "must hold names and values"),
        ("plan.yaml", "!!python/object/apply:os.getcwd []", "cannot be read"),
        ("plan.json", "[" * 100_000, "cannot be read"),
        ("plan.json", '{"n": 2, "n": 3}', "it names 'n' twice"),
        ("plan.yaml", "n: 2\nn: 3", "it names 'n' twice"),
        ("gone.toml", None, "No such file"),
    ],
)
def test_a_bad_plan_file_is_refused(name, text, message, tmp_path):
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(ValueError, match=message):
        read_plan_file(tmp_path / name)


@pytest.mark.long
def test_an_estimate_is_what_a_campaign_takes_within_a_factor(tmp_path):
    plan = CampaignPlan(n=[2, 20], amplitude=[0.3, 0.7], trials=200)
    estimate(plan)  # compiles
    measure_task(plan, list(plan.tasks())[-1])
    began = time.process_time()
    campaign, _ = completed(plan, tmp_path, backend="threading")
    taken = time.process_time() - began
    expected = estimate(plan)
    assert expected.text(1).startswith(f"4 cells, 800 releases in {plan.task_count} tasks: about")
    size = sum(path.stat().st_size for path in campaign.out.rglob("*.parquet"))
    assert 0.5 < expected.size / size < 2.0
    assert 0.25 < expected.seconds / taken < 4.0


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.5, "0.5 s"), (200.0, "3.33 min"), (1e5, "27.8 h"), (1e9, "31.7 years")]
)
def test_times_have_a_unit_that_people_count_in(seconds, text):
    assert duration(seconds) == text


def test_an_estimate_is_of_cells_of_every_kind_and_of_springs_themselves(monkeypatch):
    now, timed = [0.0], []

    def costly(chain, theta, definition, **_options):
        timed.append(chain.n)
        now[0] += len(theta) * {"bob": 1.0, "height": 9.0}[definition]

    module = "npend_gym.experiments.studies.release_estimate"
    monkeypatch.setattr(f"{module}.time", SimpleNamespace(process_time=lambda: now[0]))
    monkeypatch.setattr(f"{module}.pseudo_periods", costly)
    plan = CampaignPlan(n=5, definition=["bob", "height"], trials=10)
    assert estimate(plan).seconds == pytest.approx(10 * (1.0 + 9.0))
    for stiffness, rods in ((None, 20), (1e4, 30)):
        estimate(CampaignPlan(chain=Chain.uniform(30, stiffness=stiffness), trials=10))
        assert timed[-1] == rods


def test_a_dry_run_tells_what_it_would_take_and_writes_nothing(tmp_path, capsys):
    out = tmp_path / "out"
    arguments = ["--n", "2", "--trials", "1000000000", "--batch", "100000", "--workers", "4"]
    assert main(["campaign", "--out", str(out), *arguments, "--dry-run"]) == 0
    text = capsys.readouterr().out
    assert text.startswith("1 cells, 1000000000 releases in 10000 tasks: about ")
    assert " with 4 worker(s), and " in text
    assert not out.exists()


# The draws


def test_a_task_is_the_pseudo_periods_of_its_releases_one_by_one():
    plan = CampaignPlan(
        n=3, masses=[1.0, [1.0, 2.0, 0.5]], amplitude=[0.3, 0.9], trials=3, batch=100
    )
    (task,) = plan.tasks()
    starts, periods = measure_task(plan, task)
    for k, (start, found) in enumerate(zip(starts, periods, strict=True)):
        cell = plan.cell(k // 3)
        assert cell["amplitude"] <= start < cell["amplitude"] + cell["spread"]
        chain = Chain(np.ones(3) * cell["masses"], 1.0)
        np.testing.assert_array_equal(found, pseudo_periods(chain, start))


# The results


def test_tables_are_tidy_and_exact(undisturbed):
    tasks = list(SMALL.tasks())
    releases = read_table(undisturbed, RELEASES, tasks).to_pydict()
    bobs = read_table(undisturbed, BOBS, tasks).to_pydict()
    assert list(zip(releases["cell"], releases["trial"], strict=True)) == [
        (cell, trial) for cell in range(4) for trial in range(1, 51)
    ]
    assert len(bobs["bob"]) == 100 * 2 + 100 * 3
    periods = pseudo_periods(Chain.uniform(3), releases["start_rad"][110])
    place = [
        k for k, key in enumerate(zip(bobs["cell"], bobs["trial"], strict=True)) if key == (2, 11)
    ]
    assert [bobs["bob"][k] for k in place] == [1, 2, 3]
    assert [bobs["pseudo_period_s"][k] for k in place] == periods.tolist()
    assert releases["median_s"][110] == np.median(periods)
    assert releases["mean_s"][110] == pytest.approx(periods.mean(), rel=1e-15)
    assert releases["tip_s"][110] == periods[-1]


def test_bobs_that_do_not_complete_have_null_as_their_period(tmp_path):
    plan = CampaignPlan(n=[20], trials=3, duration=5.0)
    completed(plan, tmp_path)
    rows = read_table(tmp_path, RELEASES, list(plan.tasks())).to_pydict()
    bobs = read_table(tmp_path, BOBS, list(plan.tasks())).to_pydict()["pseudo_period_s"]
    for k in range(3):
        done = [period for period in bobs[20 * k : 20 * k + 20] if period is not None]
        assert 0 < rows["completed"][k] == len(done) < 20
        slowest = np.median(done + [np.inf] * (20 - len(done)))  # of those that did not complete
        assert rows["median_s"][k] == (slowest if len(done) > 10 else None)
    nothing = CampaignPlan(n=[2], gravity=0.0, trials=2)
    completed(nothing, tmp_path / "rest")
    rows = read_table(tmp_path / "rest", RELEASES, list(nothing.tasks())).to_pydict()
    assert rows["completed"] == [0, 0]
    assert rows["mean_s"] == rows["median_s"] == rows["tip_s"] == [None, None]


def test_the_folder_is_a_partitioned_data_set_with_its_provenance(undisturbed):
    import pyarrow.dataset as ds

    bobs = ds.dataset(undisturbed / BOBS).to_table()
    assert sorted(set(bobs["n"].to_pylist())) == [2, 3]
    assert len(bobs) == 500
    cells = read_part(undisturbed / "cells.parquet").to_pylist()
    assert [(c["n"], c["amplitude_rad"]) for c in cells] == [(2, 0.3), (2, 0.7), (3, 0.3), (3, 0.7)]
    part = part_of(undisturbed, RELEASES, next(SMALL.tasks()))
    releases = ds.dataset(undisturbed / RELEASES).to_table()
    found = {
        name: str(table.schema.field(name).type)
        for table in (bobs, releases)
        for name in table.column_names
    }
    whole = {"cell": "int64", "trial": "int64", "completed": "int32", "bob": "int32", "n": "int32"}
    assert {name: kind for name, kind in found.items() if kind != "double"} == whole
    assert (cells[0]["cell"], min(bobs["bob"].to_pylist()), min(bobs["trial"].to_pylist())) == (
        0,
        1,
        1,
    )
    record = json.loads(read_part(part).schema.metadata[b"npend_gym"])
    assert record["arguments"] == {
        "plan": SMALL.digest, "study": "release", "task": "0000000",
    }  # fmt: skip
    assert record["seed"] == 4


@pytest.mark.parametrize(
    ("batch", "workers"), [(7, {}), (1000, {}), (16, {"backend": "threading", "count": 2})]
)
def test_no_result_depends_on_the_batch_or_the_workers(batch, workers, undisturbed, tmp_path):
    plan = CampaignPlan(**(SMALL.as_dict() | {"batch": batch}))
    completed(plan, tmp_path, **workers)
    assert digests(plan, tmp_path) == digests(SMALL, undisturbed)


# Nothing lost, nothing done twice


def test_a_campaign_continues_where_it_stopped(undisturbed, tmp_path):
    with Campaign(SMALL, tmp_path) as campaign:
        running = campaign.run(count=1)
        before = [next(running)[0].id for _ in range(5)]
        running.close()
    again = Campaign(None, tmp_path)
    assert again.plan == SMALL
    with again as campaign:
        assert sorted(done(campaign.status)) == sorted(before)
        assert campaign.status.text() == ""
        after = [task.id for task, _ in campaign.run(count=1)]
    assert campaign.status.done.all()
    assert sorted(before + after) == sorted(task.id for task in SMALL.tasks())
    assert digests(SMALL, tmp_path) == digests(SMALL, undisturbed)


def test_damage_is_found_reported_and_repaired(undisturbed, tmp_path):
    completed(SMALL, tmp_path)
    truncated, flipped, gone, renamed = list(SMALL.tasks())[:4]
    damaged = [f"{BOBS}/0000/{part_of(tmp_path, BOBS, truncated).name}"]
    damaged.append(f"{RELEASES}/0000/{part_of(tmp_path, RELEASES, flipped).name}")
    part = part_of(tmp_path, BOBS, truncated)
    part.write_bytes(part.read_bytes()[:-20])
    part = part_of(tmp_path, RELEASES, flipped)
    data = bytearray(part.read_bytes())
    data[len(data) // 2] ^= 1
    part.write_bytes(data)
    part_of(tmp_path, BOBS, gone).unlink()
    part = part_of(tmp_path, BOBS, renamed)
    part.rename(part.with_name(part.name.replace(part.name[:7], "9999999")))
    (tmp_path / BOBS / "0000" / ".0000009.parquet.abcd.part").write_bytes(b"half")
    with Campaign(SMALL, tmp_path) as campaign:
        assert campaign.status.text() == (
            "found 2 part(s) damaged, 4 task(s) half done, 2 half-written or foreign file(s) "
            f"(damaged: {', '.join(damaged)}); what is missing is measured again"
        )
        assert len(list(campaign.run(count=1))) == 4
    assert contents(tmp_path) == contents(undisturbed)
    assert not list(tmp_path.rglob("*.part"))


def test_a_task_with_two_results_is_an_error_until_one_is_removed(undisturbed, tmp_path):
    import pyarrow.parquet as pq

    completed(SMALL, tmp_path)
    task = next(SMALL.tasks())
    part = part_of(tmp_path, RELEASES, task)
    pq.write_table(read_part(part), tmp_path / "other", compression="gzip")
    digest = part_digest(SMALL.digest, (tmp_path / "other").read_bytes())
    other = (tmp_path / "other").rename(part.with_name(f"{task.id}-{digest}.parquet"))
    for _ in range(2):
        with Campaign(SMALL, tmp_path) as campaign:
            ((failed, error),) = campaign.run(count=1)
        assert (failed, campaign.status.count) == (task, SMALL.task_count - 1)
        assert all(name in error for name in ("several results", part.name, other.name))
    other.unlink()
    with Campaign(SMALL, tmp_path) as campaign:
        assert campaign.status.done.all()
    assert digests(SMALL, tmp_path) == digests(SMALL, undisturbed)


def test_a_second_driver_on_a_folder_is_refused(tmp_path):
    with Campaign(SMALL, tmp_path), pytest.raises(BusyError, match="another driver is at work"):
        Campaign(None, tmp_path).__enter__()
    with Campaign(SMALL, tmp_path) as campaign:  # released
        assert not campaign.status.done.any()


def test_a_driver_made_before_another_with_another_plan_began_keeps_its_results(tmp_path):
    late = Campaign(CampaignPlan(n=[3], trials=5), tmp_path)
    completed(SMALL, tmp_path)
    before = contents(tmp_path)
    with pytest.raises(ValueError, match=r"holds another plan, with n = \[2, 3\] where"), late:
        pass
    assert contents(tmp_path) == before
    assert Campaign(None, tmp_path).plan == SMALL


def test_another_plan_or_version_is_refused(tmp_path, monkeypatch):
    completed(CampaignPlan(n=[2], trials=1), tmp_path)
    with pytest.raises(ValueError, match=r"another plan, with n = \[2\] where \[2, 3\] was given"):
        Campaign(SMALL, tmp_path)
    with pytest.raises(ValueError, match="there is no campaign"):
        Campaign(None, tmp_path / "nowhere")
    text = (tmp_path / "plan.json").read_text()
    (tmp_path / "plan.json").write_text(text.replace('"trials": 1', '"trials": 2'))
    with pytest.raises(ValueError, match="is damaged"):
        Campaign(None, tmp_path)
    (tmp_path / "plan.json").write_text(text)
    monkeypatch.setattr("npend_gym.experiments.campaign.status.__version__", "9.0")
    with pytest.raises(ValueError, match="another folder"):
        Campaign(None, tmp_path)


@pytest.mark.parametrize(
    "plans", [[{"chain": "acrobot"}, {"n": 2}], [{"n": 2}, {"chain": "acrobot"}]]
)
def test_a_plan_with_a_chain_and_one_without_are_told_apart(plans, tmp_path):
    held, asked = (CampaignPlan(trials=1, **values) for values in plans)
    with Campaign(held, tmp_path), pytest.raises(ValueError, match="another plan, with chain = "):
        Campaign(asked, tmp_path)


def test_equal_plans_have_one_digest_and_continue_in_one_folder(tmp_path):
    plan = CampaignPlan(n=2, trials=5, duration=10.0, damping=0.0)
    assert CampaignPlan(n=2, trials=5, duration=10, damping=-0.0).digest == plan.digest
    older = CampaignPlan(n=2, trials=5, duration=10.0)  # of a version that kept 10 as it was
    vars(older)["digest"] = digest_of(plan.as_dict() | {"duration": 10})
    made_before = Campaign(plan, tmp_path)
    completed(older, tmp_path)
    path = tmp_path / "plan.json"
    path.write_text(path.read_text().replace('"duration": 10.0', '"duration": 10'))
    before = contents(tmp_path)
    for campaign in (made_before, Campaign(plan, tmp_path), Campaign(None, tmp_path)):
        with campaign:
            assert campaign.status.count == 1
    assert contents(tmp_path) == before


def test_a_failing_task_is_recorded_and_the_others_continue(undisturbed, tmp_path, monkeypatch):
    def sometimes(chain, theta, **options):
        if chain.n == 3 and len(theta) == 16:
            raise ArithmeticError("no <b>step</b>")
        return pseudo_periods(chain, theta, **options)

    monkeypatch.setattr("npend_gym.experiments.studies.release_tables.pseudo_periods", sometimes)
    _, errors = completed(SMALL, tmp_path)
    failed = [error for error in errors if error]
    assert failed
    assert set(failed) == {"ArithmeticError: no <b>step</b>"}
    monkeypatch.undo()
    with Campaign(SMALL, tmp_path) as campaign:
        assert f"{len(failed)} failed task(s)" in campaign.status.text()
        assert len(list(campaign.run(count=1))) == len(failed)
    assert digests(SMALL, tmp_path) == digests(SMALL, undisturbed)


def test_a_cluster_that_cannot_be_reached_is_no_error_of_the_disk(tmp_path, monkeypatch):
    def unreachable(*_):
        raise ConnectionError("no cluster at that address")

    monkeypatch.setattr(engine, "_ray", unreachable)
    with (
        Campaign(SMALL, tmp_path) as campaign,
        pytest.raises(ConnectionError, match=r"^no cluster at that address$"),
    ):
        next(campaign.run("ray", address="10.0.0.1:6379"))


@pytest.mark.long
def test_a_task_that_kills_its_workers_is_given_up_and_the_others_are_done(monkeypatch):
    monkeypatch.setattr(engine, "_MAX_ATTEMPTS", 2)  # each costs new workers
    with engine.workers("loky", 2):
        done = dict(engine.run(deadly.the_sixth, range(12)))
    assert isinstance(done.pop(5), engine.WorkerLost)
    assert done == {k: k * k for k in range(12) if k != 5}


@pytest.mark.parametrize("times", [2, pytest.param(5, marks=pytest.mark.long)])
def test_workers_that_always_die_end_the_run(times, monkeypatch):
    assert engine._MAX_NO_PROGRESS == 5
    monkeypatch.setattr(engine, "_MAX_NO_PROGRESS", times)
    with (
        engine.workers("loky", 2),
        pytest.raises(engine.WorkersLostError, match=f"{times} times in a row"),
    ):
        list(engine.run(deadly.each, range(40)))


def test_no_more_workers_start_than_tasks_are_left(tmp_path):
    with Campaign(CampaignPlan(n=[1], trials=1), tmp_path) as campaign:
        assert len(list(campaign.run(count=5))) == 1
    assert len(kill_campaign.worker_processes(os.getpid())) == 2  # one would be this process
    for count, tasks, started in ((5, 3, 3), (3, 5, 3), (1, 5, 1), (5, 0, 2)):
        with engine.workers("threading", count, tasks=tasks):
            assert engine.joblib.Parallel().n_jobs == started


@pytest.mark.parametrize(
    ("backend", "number", "most"),
    [("loky", 1001, 1000), ("threading", 3_000_000_000, 1000), ("ray", 100_001, 100_000)],
)
def test_a_number_of_workers_that_no_machine_has_is_refused(
    backend, number, most, refusal, tmp_path
):
    line = ["campaign", "--out", str(tmp_path), "--n", "2", "--backend", backend, "--dry-run"]
    assert f"workers must be between 1 and {most}, got {number}" in refusal(
        *line, "--workers", str(number)
    )
    assert main([*line, "--workers", str(most)]) == 0


# A thread of loky may look for a task that the end of its pool has just taken away
@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_run_that_is_closed_early_warns_of_nothing():
    with engine.workers("loky", 2):
        results = engine.run(abs, range(100))
        next(results)
        results.close()


# Paths


def test_a_campaign_runs_only_while_it_holds_the_lock_of_its_folder(tmp_path):
    with pytest.raises(RuntimeError, match=r"needs the folder's lock: with Campaign\(plan, out\)"):
        next(Campaign(CampaignPlan(n=[2], trials=1), tmp_path).run())


def test_folders_may_have_any_name(tmp_path):
    real = tmp_path / "räume und zeichen ✓ #%'\""
    completed(CampaignPlan(n=[2], trials=2), real)
    link = tmp_path / "link"
    link.symlink_to(real, target_is_directory=True)
    with Campaign(None, link / ".." / "link") as campaign:
        assert campaign.out == real
        assert campaign.status.count == 1
        with pytest.raises(BusyError):
            Campaign(None, real).__enter__()
    loop = tmp_path / "loop"
    loop.symlink_to(loop)
    with pytest.raises(ValueError, match="out must be a"), Campaign(SMALL, loop):
        pass
    with pytest.raises(ValueError, match="out must be a"), Campaign(SMALL, "a\0b"):
        pass
    (tmp_path / "file").write_text("")
    with pytest.raises(ValueError, match=r"out must be a|cannot be read"):
        Campaign(SMALL, tmp_path / "file").__enter__()


# The command


def test_the_command_takes_a_file_and_options_and_resumes(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(_progress, "SECONDS", 0.0)
    (tmp_path / "plan.toml").write_text("n = [2]\ntrials = 7\n")
    out = str(tmp_path / "out")
    arguments = ["campaign", str(tmp_path / "plan.toml"), "--trials", "20", "--batch", "8"]
    assert main([*arguments, "--out", out, "--workers", "1"]) == 0
    printed = capsys.readouterr()
    assert "20 of 20 releases done" in printed.out
    assert printed.err == "8 of 20 releases, 0 failed\n16 of 20 releases, 0 failed\n"
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert manifest["complete"] is True
    assert manifest["provenance"]["arguments"]["trials"] == 20
    assert main(["campaign", "--out", out, "--workers", "1"]) == 0
    assert "20 releases done before" in capsys.readouterr().out


def started(out, line, output=subprocess.PIPE):
    """Start a campaign as a terminal does, which sends signals to its workers too."""
    command = [sys.executable, "-m", "npend_gym", "campaign", "--out", str(out), *line.split()]
    return subprocess.Popen(
        command, stdout=output, stderr=output, text=True, start_new_session=True
    )


def interrupted(process, number):
    """Send a signal to a campaign and its workers, and return what it printed."""
    os.killpg(process.pid, number)
    out, error = process.communicate(timeout=60)
    assert process.returncode == 128 + number, error
    assert "interrupted: what is done is kept" in error
    assert "Traceback" not in out + error
    return out


def wait_for_parts(out, count, process):
    deadline = time.monotonic() + 120.0
    while time.monotonic() < deadline and process.poll() is None:
        if kill_campaign.written(out) >= count:
            return
        time.sleep(0.02)
    raise AssertionError("nothing was written")


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_keeps_what_is_done_and_leaves_nothing_half_written(number, tmp_path):
    process = started(tmp_path, "--n 5 --trials 1000000 --batch 64 --workers 2")
    wait_for_parts(tmp_path, 200, process)  # both workers are at work
    assert " of 1000000 releases done" in interrupted(process, number)
    assert '"complete": false' in (tmp_path / "manifest.json").read_text()


@pytest.mark.long
@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_ctrl_c_while_the_workers_start_shows_no_traceback_and_ends_them(tmp_path):
    process = started(tmp_path, "--n 5,10 --trials 3000 --batch 100 --workers 2")
    workers = []
    while not any(each.cpu_times().user > 0.1 for each in workers):  # it imports modules
        assert process.poll() is None
        workers = kill_campaign.worker_processes(process.pid)
    interrupted(process, signal.SIGINT)
    assert psutil.wait_procs(workers, timeout=10.0)[1] == []


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_workers_block_the_signal_of_ctrl_c_from_their_start():
    block = partial(signal.pthread_sigmask, signal.SIG_BLOCK)
    before = block([])
    with engine.workers("loky", 2):
        blocked = [result for _, result in engine.run(block, [(), frozenset()])]
    assert [signal.SIGINT in each for each in blocked] == [True, True]
    assert block([]) == before


def test_sigterm_while_the_folder_is_checked_is_one_line_and_exit_code_143(
    tmp_path, monkeypatch, capsys
):
    def terminated(*_, **__):
        signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr("npend_gym.experiments.campaign.campaign.check_folder", terminated)
    assert main(["campaign", "--out", str(tmp_path), "--n", "2", "--trials", "1"]) == 143
    assert capsys.readouterr().err == "npend campaign: interrupted\n"
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


@pytest.mark.nightly
@pytest.mark.long
def test_a_campaign_whose_drivers_and_workers_are_killed_ends_with_the_same_bytes(
    monkeypatch, capsys
):
    monkeypatch.setattr(sys, "argv", ["kill_campaign.py", "--kills", "4", "--seed", "0"])
    assert kill_campaign.main() == 0, capsys.readouterr().out


def test_a_driver_that_gives_up_undisturbed_ends_the_campaigns_that_are_killed(
    tmp_path, monkeypatch
):
    happened = iter(["driver killed", "gave up", "gave up"])
    monkeypatch.setattr(kill_campaign, "start", lambda *_: None)
    monkeypatch.setattr(kill_campaign, "disturb", lambda *_: next(happened))
    (tmp_path / "out.log").touch()
    with pytest.raises(RuntimeError, match="gave up, though nothing was killed or damaged"):
        kill_campaign.run_campaign(
            tmp_path / "out", random.Random(0), {1: 1.0, 2: 1.0}, kill_campaign.Orphans()
        )
    assert not [*happened]


# Workers that have lost their driver


def test_a_campaign_leaves_nothing_but_its_files(undisturbed):
    assert sorted(path.name for path in undisturbed.iterdir()) == [
        ".lock", "bobs", "cells.parquet", "plan.json", "releases",
    ]  # fmt: skip


@pytest.mark.long
def test_workers_whose_driver_was_killed_end_and_spoil_nothing(undisturbed, tmp_path):
    line = "--n 2 --trials 1000000 --batch 16 --workers 2"
    process = started(tmp_path, line, subprocess.DEVNULL)
    wait_for_parts(tmp_path, 20, process)
    workers = kill_campaign.worker_processes(process.pid)
    below = psutil.Process(process.pid).children(recursive=True)
    assert len(workers) == 2
    workers[0].suspend()  # it is in the middle of something, and hears nothing for now
    process.kill()
    process.wait()
    try:
        assert psutil.wait_procs(workers[1:], timeout=10.0)[1] == []
        (tmp_path / "plan.json").unlink()
        completed(SMALL, tmp_path)  # another plan in the same folder
        with contextlib.suppress(psutil.NoSuchProcess):  # seen twice on a busy machine
            workers[0].resume()
        assert psutil.wait_procs(below, timeout=10.0)[1] == []  # helpers of the workers too
    finally:
        for each in below:
            with contextlib.suppress(psutil.NoSuchProcess):
                each.kill()
    with Campaign(SMALL, tmp_path) as campaign:
        assert campaign.status.damaged == 0
        assert campaign.status.leftovers <= 2  # parts that the worker was about to write
        assert campaign.status.count == SMALL.task_count
    assert contents(tmp_path) == contents(undisturbed)
