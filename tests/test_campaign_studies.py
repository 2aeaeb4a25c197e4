"""Campaigns of any study: rows that say what they are, shards, kills, Slurm, merges."""

import json
import os
import random
import shlex
import signal
import subprocess
import sys
import time
import tracemalloc
from itertools import product
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.dataset as ds
import pyarrow.parquet as pq
import pytest
from campaign_tables import completed

from npend_gym import Chain, chaos, identification, rl
from npend_gym.cli import main
from npend_gym.experiments import BusyError, Campaign, CampaignPlan, SweepPlan, analyse
from npend_gym.experiments.campaign.merge import merge, read_status
from npend_gym.experiments.campaign.sweep import as_table, plan_of

DATA = Path(__file__).parent.parent / "examples" / "data"
LAB = """
import functools
import time
import numpy as np

def swing(*, seed, gain, mass=1.0, wait=0.0):
    time.sleep(wait)
    rng = np.random.default_rng([seed, int(10 * gain)])
    return [{"step": k, "value": float(mass * gain * rng.normal())} for k in range(3)]

doubled = functools.partial(swing, mass=2.0)

def clock(*, seed):
    return {"now": time.perf_counter()}

def sometimes(*, seed):
    if seed == 2:
        raise ArithmeticError("two")
    return {"value": None if seed == 0 else 0.5 * seed}
"""


@pytest.fixture
def lab(tmp_path, monkeypatch):
    """A folder with the module `lab`, which is the current one."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "lab.py").write_text(LAB)
    sys.modules.pop("lab", None)
    return tmp_path


def parts(out):
    """Return the bytes of all parts by their paths."""
    return {path.relative_to(out): path.read_bytes() for path in out.glob("*/*/*.parquet")}


def rows(out):
    return (
        ds.dataset(out / "rows").to_table().sort_by([("cell", "ascending"), ("seed", "ascending")])
    )


# Plans


def test_a_sweep_is_every_combination_with_every_seed_and_each_row_says_which(lab):
    plan = SweepPlan("lab:swing", {"gain": [1, 2.5], "mass": [1.0, 3.0]}, trials=3, seed=7, batch=4)
    assert (plan.cells, plan.size, plan.task_count) == (4, 12, 3)
    completed(plan, lab / "out")
    found = rows(lab / "out").to_pylist()
    assert len(found) == 4 * 3 * 3
    import lab as module

    expected = [
        {"cell": cell, "seed": seed, "gain": float(gain), "mass": mass, **row}
        for cell, (gain, mass) in enumerate(product([1, 2.5], [1.0, 3.0]))
        for seed in (7, 8, 9)
        for row in module.swing(seed=seed, gain=gain, mass=mass)
    ]
    assert found == expected
    assert json.loads((lab / "out" / "plan.json").read_text())["plan"]["study"] == "lab:swing"


def test_plans_that_differ_only_in_the_order_of_parameters_are_equal():
    one = SweepPlan("lyapunov", {"theta": np.array([1.0, 2.0]), "n": range(1, 3)})
    other = plan_of({"parameters": {"n": [1, 2], "theta": [1, 2.0]}, "study": "lyapunov"})
    assert one == other
    assert [one.cell(k) for k in range(4)] == [
        {"n": 1, "theta": 1.0}, {"n": 1, "theta": 2.0}, {"n": 2, "theta": 1.0},
        {"n": 2, "theta": 2.0},
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("values", "error", "message"),
    [
        ({"study": "dance"}, ValueError, "study must be release, evaluate, .* got 'dance'"),
        ({"study": "lab:nothing"}, ValueError, "can be imported: .*nothing"),
        ({"study": "nowhere:f"}, ValueError, "can be imported: No module named 'nowhere'"),
        ({"study": "lab:np"}, TypeError, "study must be a function"),
        ({"parameters": {"colour": 1}}, TypeError, "parameters must be those of lab:swing"),
        ({"parameters": {"gain": []}}, ValueError, "gain must name 1 to 10000 values, got 0"),
        ({"parameters": {"gain": [1, 1]}}, ValueError, "gain must name each value once"),
        ({"parameters": {"gain": float("nan")}}, ValueError, "gain must be numbers, texts"),
        ({"parameters": {"seed": 1}}, ValueError, "must not have seed"),
        ({"parameters": 3}, TypeError, "parameters must be names and values"),
        ({"n": 2}, ValueError, "a plan has the names study, parameters, trials"),
        ({"trials": 10**12}, ValueError, "trials must be so few, or batch so large"),
        ({"seed": -1}, ValueError, "seed must be between"),
    ],
)
def test_a_bad_sweep_is_refused_by_name_before_the_folder_is_made(values, error, message, lab):
    given = {"study": "lab:swing", "parameters": {"gain": 1}} | values
    with pytest.raises(error, match=message):
        Campaign(plan_of(given), lab / "out")
    assert not (lab / "out").exists()


@pytest.mark.parametrize(
    "result",
    [
        {"a": [1, 2], "b": ["x", "y"]},
        {"a": np.array([1, 2]), "b": ("x", "y")},
        [{"a": np.int64(1), "b": "x"}, {"a": 2, "b": "y"}],
        pa.table({"a": [1, 2], "b": ["x", "y"]}),
    ],
)
def test_a_study_may_return_columns_rows_or_a_table(result):
    assert as_table(result).to_pylist() == [{"a": 1, "b": "x"}, {"a": 2, "b": "y"}]


def test_what_is_no_table_is_an_error_of_the_task():
    assert as_table([{"a": 1}, {"b": 2}]).to_pylist() == [{"a": 1, "b": None}, {"a": None, "b": 2}]
    for result in (3, None, [1, 2], "text"):
        with pytest.raises(TypeError, match="a study must return columns by name"):
            as_table(result)


@pytest.mark.parametrize("study", ["lab:swing", "lab:doubled"])
def test_a_study_whose_file_has_changed_is_not_continued(study, lab):
    plan = SweepPlan(study, {"gain": [1, 2]}, trials=2)
    with Campaign(plan, lab / "out") as campaign:
        next(campaign.run("threading", 1))
    (lab / "lab.py").write_text(LAB.replace("range(3)", "range(4)"))
    with (
        pytest.raises(ValueError, match=f"the file of {study} has changed"),
        Campaign(None, lab / "out"),
    ):
        pass
    assert main(["campaign", "--status", str(lab / "out")]) == 1  # it can still be looked at


# Built-in studies


def one_row(study, parameters, out, **more):
    _, errors = completed(SweepPlan(study, parameters, **more), out)
    assert set(errors) == {""}
    return rows(out).to_pylist()


@pytest.mark.long
def test_a_sweep_of_evaluations_has_what_evaluate_returns(tmp_path):
    given = {"policy": "balance-2", "damping": [0.0, 0.1], "episodes": 2}
    found = one_row("evaluate", given, tmp_path, trials=2)
    policy = rl.Policy.pretrained("balance-2")
    for row, (damping, seed) in zip(found, product([0.0, 0.1], [0, 1]), strict=True):
        expected = rl.evaluate(
            policy, policy.env | {"damping": damping}, episodes=2, seed=rl.HELD_OUT + 2 * seed
        )
        assert (row["damping"], row["seed"]) == (damping, seed)
        assert row.items() >= expected.as_row().items()


def test_a_sweep_of_exponents_has_what_largest_lyapunov_returns(tmp_path):
    given = {"n": [1, 2], "theta": 2.0, "duration": 12.0}
    for row in one_row("lyapunov", given, tmp_path):
        found = chaos.largest_lyapunov(Chain.uniform(row["n"]), 2.0, duration=12.0)
        assert (row["exponent"], row["error"]) == (found.exponent, found.error)


@pytest.mark.long
@pytest.mark.nightly
def test_sweeps_of_robustness_identification_and_training_have_what_these_return(tmp_path):
    given = {"policy": "swingup-1", "values": 2, "repetitions": 1, "seconds": 5.0}
    found = one_row("robustness", given, tmp_path / "robust")
    policy = rl.Policy.pretrained("swingup-1")
    expected = rl.robustness(policy, policy.env, values=2, repetitions=1, seconds=5.0)
    for name, share in expected.survived.items():
        assert np.mean([r["survived"] for r in found if r["criterion"] == name]) == share

    file = str(DATA / "multiarm_double.csv")
    given = {"recording": file, "chain": "multiarm 2", "noise": [0.0, 0.01]}
    found = one_row("identify", given, tmp_path / "identify")
    motion = identification.read_motion(file)
    fitted = identification.identify(
        motion.times, motion.theta, motion.torque, chain="multiarm 2", piece=motion.piece
    )
    exact = {row["parameter"]: row["value"] for row in found if row["noise"] == 0.0}
    assert exact == dict(zip(fitted.names, fitted.values.tolist(), strict=True))
    assert any(r["value"] != exact.get(r["parameter"]) for r in found if r["noise"] > 0.0)

    given = {"task": "swingup-1", "total_timesteps": 1280, "episodes": 5}
    runs = [one_row("train", given, tmp_path / name, trials=1) for name in ("one", "two")]
    assert runs[0] == runs[1]
    assert runs[0][0]["steps"] > 0


# Failures, merges, the state of a folder


def test_a_failing_trial_is_named_and_null_in_one_part_does_not_hinder_the_merge(lab, capsys):
    plan = SweepPlan("lab:sometimes", trials=4)
    _, errors = completed(plan, lab / "out")
    assert [error for error in errors if error] == ["ArithmeticError: two"]
    assert main(["campaign", "--status", str(lab / "out")]) == 1
    printed = capsys.readouterr()
    assert "3 of 4 trials done, 1 task(s) failed" in printed.out
    assert "task 0000002 failed: ArithmeticError: two" in printed.err
    with pytest.raises(SystemExit):
        main(["campaign", "--merge", str(lab / "out")])
    assert "1 of 4 are missing" in capsys.readouterr().err
    (lab / "again").mkdir()
    completed(SweepPlan("lab:sometimes", trials=2), lab / "again")
    assert main(["campaign", "--merge", str(lab / "again")]) == 0
    assert pq.read_table(lab / "again" / "rows.parquet")["value"].to_pylist() == [None, 0.5]


def test_a_merge_has_all_rows_in_order_and_the_same_bytes_whatever_the_shards(lab):
    plan = SweepPlan("lab:swing", {"gain": [1, 2, 3]}, trials=5, batch=2)
    completed(plan, lab / "one")
    for k in (3, 1, 2):
        with Campaign(plan, lab / "three", shard=f"{k}/3") as campaign:
            assert len(list(campaign.run("threading", 1))) == 3 - (k == 3)
    assert parts(lab / "one") == parts(lab / "three")
    merged = []
    for out in (lab / "one", lab / "three"):
        assert main(["campaign", "--merge", str(out)]) == 0
        merged.append((out / "rows.parquet").read_bytes())
        manifest = json.loads((out / "manifest.json").read_text())
        assert manifest["complete"]
        assert list(manifest["sha256"]) == ["plan.json", "rows.parquet"]
    assert merged[0] == merged[1]
    assert pq.read_table(lab / "one" / "rows.parquet").equals(rows(lab / "one"))


def test_a_damaged_copy_beside_a_part_is_not_read(lab):
    plan = SweepPlan("lab:swing", {"gain": [1, 2]}, trials=3)
    completed(plan, lab / "out")
    part = min((lab / "out" / "rows" / "0000").iterdir())
    for folder in (part.parent, part.parent.with_name("0001")):
        folder.mkdir(exist_ok=True)
        copy = folder / f"{part.name[:8]}0123456789abcdef.parquet"
        copy.write_bytes(part.read_bytes()[:-1])
    assert [row["count"] for row in analyse(lab / "out").rows] == [9] * 4
    assert main(["campaign", "--merge", str(lab / "out")]) == 0
    assert pq.read_table(lab / "out" / "rows.parquet").num_rows == 18
    with Campaign(None, lab / "out") as campaign:
        assert (campaign.status.damaged, campaign.status.leftovers) == (1, 1)
    assert len(parts(lab / "out")) == 6


def test_the_number_of_pendulums_is_a_column_of_every_table_of_releases(tmp_path):
    plan = CampaignPlan(n=[2, 3], trials=3)
    completed(plan, tmp_path)
    for name, count in (("releases", [1, 1]), ("bobs", [2, 3])):
        for partitioning in (None, "hive"):
            table = ds.dataset(tmp_path / name, partitioning=partitioning).to_table()
            assert str(table.schema.field("n").type) == "int32"
            assert table["n"].to_pylist() == [2] * 3 * count[0] + [3] * 3 * count[1]
    merge(*read_status(tmp_path))
    assert pq.read_table(tmp_path / "bobs.parquet").num_rows == 15


def test_an_analysis_of_a_sweep_has_the_statistics_of_each_cell(lab, capsys):
    plan = SweepPlan("lab:swing", {"gain": [1, 2]}, trials=7, batch=3)
    completed(plan, lab / "out")
    table = rows(lab / "out").to_pylist()
    summary = analyse(lab / "out")
    assert [(row["gain"], row["column"]) for row in summary.rows] == [
        (1, "step"), (1, "value"), (2, "step"), (2, "value"),
    ]  # fmt: skip
    for row in summary.rows:
        values = [each[row["column"]] for each in table if each["cell"] == row["cell"]]
        assert (row["count"], row["min"], row["max"]) == (21, min(values), max(values))
        assert row["mean"] == pytest.approx(np.mean(values), rel=1e-12)
        assert row["sd"] == pytest.approx(np.std(values, ddof=1), rel=1e-12)
    assert main(["analyse", str(lab / "out")]) == 0
    assert "gain 2: value" in capsys.readouterr().out
    assert (lab / "out" / "analysis" / "summary.csv").exists()


def test_two_results_of_one_task_are_an_error_that_names_the_files(lab, monkeypatch):
    monkeypatch.setattr("filelock.FileLock.acquire", lambda *_, **__: None)  # two machines
    monkeypatch.setattr("filelock.FileLock.release", lambda *_, **__: None)
    plan = SweepPlan("lab:clock", trials=1)
    with Campaign(plan, lab / "out", shard="1/1") as one, Campaign(plan, lab / "out") as two:
        ((_, first),) = one.run("threading", 1)
        ((_, second),) = two.run("threading", 1)
    assert first == ""
    names = sorted(path.name for path in (lab / "out").glob("rows/*/*"))
    assert len(names) == 2
    assert "must return the same table whenever it runs" in second
    assert all(name in second for name in names)
    with Campaign(None, lab / "out") as campaign:
        assert [error for _, error in campaign.run("threading", 1)] == [second]


# Shards


@pytest.mark.parametrize("shard", ["0/3", "4/3", "1", "1/3/5", "a/b", "-1/2", "1/0", ""])
def test_a_shard_that_is_none_is_refused(shard, tmp_path):
    with pytest.raises(ValueError, match="shard must be k/n, k from 1 to n"):
        Campaign(CampaignPlan(n=1, trials=1), tmp_path, shard=shard)


def test_shards_are_at_work_side_by_side_but_no_share_or_folder_has_two_drivers(lab, monkeypatch):
    monkeypatch.setattr("npend_gym.experiments.campaign.campaign._PATIENCE", 0.1)
    plan = SweepPlan("lab:swing", {"gain": 1}, trials=4)
    with Campaign(plan, lab / "out", shard="1/2"), Campaign(plan, lab / "out", shard="2/2"):
        for shard in ("1/2", "2/2", "1/1"):
            with pytest.raises(BusyError), Campaign(plan, lab / "out", shard=shard):
                pass
    with Campaign(plan, lab / "out"), pytest.raises(BusyError):
        Campaign(plan, lab / "out", shard="1/2").__enter__()


def test_a_shard_leaves_the_files_of_others_alone_and_the_whole_folder_is_cleaned(lab):
    plan = SweepPlan("lab:swing", {"gain": 1}, trials=4)
    completed(plan, lab / "out")
    folder = lab / "out" / "rows" / "0000"
    half = folder / ".0000001-0123456789abcdef.parquet.abcd.part"
    half.write_bytes(b"half")
    first, second = sorted(folder.glob("000000[01]*"))
    for part in (first, second):
        part.write_bytes(part.read_bytes()[:-1])
    with Campaign(plan, lab / "out", shard="2/2") as campaign:
        assert campaign.status.named == [f"rows/0000/{second.name}"]
        assert (half.exists(), first.exists(), second.exists()) == (True, True, False)
    with Campaign(plan, lab / "out") as campaign:
        assert (campaign.status.damaged, campaign.status.leftovers) == (1, 1)
        assert not half.exists()


def test_a_shard_does_not_measure_again_what_another_driver_has_written_meanwhile(lab, monkeypatch):
    monkeypatch.setattr("filelock.FileLock.acquire", lambda *_, **__: None)
    monkeypatch.setattr("filelock.FileLock.release", lambda *_, **__: None)
    plan = SweepPlan("lab:swing", {"gain": 1}, trials=4)
    late = Campaign(plan, lab / "out", shard="1/2")
    with late:
        completed(plan, lab / "out")
        assert list(late.run("threading", 1)) == []
        assert late.status.count == 2


RUNNER = """
import sys
import filelock
filelock.FileLock.acquire = filelock.FileLock.release = lambda *_, **__: None  # nothing is shared
from npend_gym.cli import main
raise SystemExit(main(sys.argv[1:]))
"""


@pytest.mark.long
def test_eight_processes_with_kills_and_two_shards_twice_write_the_bytes_of_one(lab):
    plan = SweepPlan("lab:swing", {"gain": [1, 2, 3, 4], "wait": 0.01}, trials=40)
    completed(plan, lab / "one", backend="threading", count=4)
    with Campaign(plan, lab / "many"):
        pass
    around = os.environ | {"PYTHONPATH": os.pathsep.join([str(lab), *sys.path])}
    rng, command = random.Random(0), [sys.executable, "-c", RUNNER, "campaign", "-o", "many"]

    def start(k):
        line = [*command, "--workers", "1", "--shard", f"{k}/6"]
        with (lab / "log").open("a") as log:
            return k, subprocess.Popen(line, cwd=lab, env=around, stdout=log, stderr=log)

    running = [start(k) for k in (1, 1, 2, 2, 3, 4, 5, 6)]
    killed, deadline = 0, time.monotonic() + 100.0
    while running and time.monotonic() < deadline:
        time.sleep(rng.uniform(0.1, 0.8))
        written = len(parts(lab / "many"))
        alive = [each for each in running if each[1].poll() is None]
        assert all(process.returncode in (None, 0, -9) for _, process in running)
        if alive and killed < 4 and (written or rng.random() < 0.2):
            k, process = rng.choice(alive)
            process.kill()
            process.wait()
            killed += 1
            alive = [*(each for each in alive if each[1] is not process), start(k)]
        running = alive
    assert not running
    assert killed >= 3
    assert main(["campaign", "--status", str(lab / "many")]) == 0, (lab / "log").read_text()
    assert parts(lab / "many") == parts(lab / "one")


SBATCH = """#!/bin/sh
# Starts the tasks of an array as processes, and waits for them
range=$(sed -n 's/^#SBATCH --array=1-//p' "$1")
for k in $(seq 1 "$range"); do
  SLURM_ARRAY_TASK_ID=$k SLURM_ARRAY_TASK_COUNT=$range SLURM_CPUS_PER_TASK=1 bash "$1" &
done
wait
"""


@pytest.mark.long
@pytest.mark.skipif(os.name != "posix", reason="shell")
def test_an_array_job_of_slurm_does_the_whole_campaign(lab, capsys):
    line = "campaign --study lab:swing --set gain=[1,2] -t 6 --slurm --shards 3 -o"
    out = lab / "a folder's name"
    assert main([*line.split(), str(out)]) == 0
    (lab / "job.sh").write_text(capsys.readouterr().out)
    (lab / "sbatch").write_text(SBATCH)
    text = (lab / "job.sh").read_text()
    assert "#SBATCH --array=1-3\n" in text
    assert f"--merge {shlex.quote(str(out))}" in text
    for _ in range(2):  # sent again it does nothing
        done = subprocess.run(
            ["sh", "sbatch", "job.sh"], cwd=lab, capture_output=True, text=True, check=True,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        )  # fmt: skip
        assert done.stdout.count("4 of 4 tasks of shard") == 3, done.stderr
    assert main(["campaign", "--status", str(out)]) == 0


@pytest.mark.skipif(os.name != "posix", reason="shell")
def test_no_array_job_has_more_tasks_than_the_campaign(lab, capsys):
    line = ["campaign", "--study", "lab:swing", "--set", "gain=1", "-t", "2", "--slurm"]
    assert main([*line, "-o", str(lab / "out")]) == 0
    assert "#SBATCH --array=1-2\n" in capsys.readouterr().out
    assert sorted(path.name for path in (lab / "out").iterdir()) == [".lock", "plan.json"]


@pytest.mark.long
def test_the_memory_of_a_driver_does_not_grow_with_the_number_of_tasks(lab):
    peaks = {}
    for tasks in (10_000, 200_000):
        plan = SweepPlan("lab:swing", {"gain": 1}, trials=tasks)
        with Campaign(plan, lab / f"{tasks}") as campaign:
            tracemalloc.start()
            try:
                campaign._prepare()
                for task in campaign._left():
                    campaign.status.finish(task)
                peaks[tasks] = tracemalloc.get_traced_memory()[1]
            finally:
                tracemalloc.stop()
        assert campaign.status.trials == tasks
    assert peaks[200_000] - peaks[10_000] < 0.3e6  # a byte for each task


def test_sigterm_of_a_shard_keeps_what_is_done(lab, capsys, monkeypatch):
    plan = SweepPlan("lab:swing", {"gain": 1}, trials=6)
    from npend_gym.experiments.campaign import campaign as module

    def run_task(*given):
        if given[2].index == 4:
            signal.raise_signal(signal.SIGTERM)
        return done(*given)

    done = module.run_task
    monkeypatch.setattr(module, "run_task", run_task)
    line = ["campaign", "-o", str(lab / "out"), "--study", "lab:swing", "--set", "gain=1"]
    assert main([*line, "-t", "6", "--shard", "1/2", "--workers", "1"]) == 143
    assert "interrupted: what is done is kept" in capsys.readouterr().err
    assert len(parts(lab / "out")) == 2
    monkeypatch.undo()
    os.chdir(lab)
    completed(plan, lab / "out")
