"""Learning curves on the tasks of the benchmark: the runs, what is kept of them, the tables."""

import importlib
import json

import gymnasium as gym
import numpy as np
import pytest

from npend_gym import rl

pytest.importorskip("sb3_contrib")
pytest.importorskip("yaml")

TINY = {
    "PPO": {"algo": "ppo", "policy": "MlpPolicy", "n_envs": 4, "n_steps": 16, "batch_size": 32},
    "ARS": {"algo": "ars", "policy": "LinearPolicy", "n_envs": 4, "n_delta": 2},
    "CrossQ": {"algo": "crossq", "policy": "MlpPolicy", "learning_starts": 20, "batch_size": 8},
    "SHAC": {"algo": "shac", "num_envs": 4, "updates": 1, "memory": 400},
    "imitation": {
        "algo": "imitation",
        "guesses": 1,
        "seconds": 1.0,
        "num_envs": 8,
        "first_updates": 9,
        "updates": 2,
    },
}


@pytest.fixture
def curves(monkeypatch, tmp_path):
    """The script, with little training and its files in `tmp_path`."""
    script = importlib.import_module("side_by_side")
    for name, value in (("SETTINGS", TINY), ("EPISODES", 3), ("EVALUATIONS", 2)):
        monkeypatch.setattr(script, name, value)

    def run(*arguments):
        places = "--out", tmp_path / "curves", "--models", tmp_path / "models"
        monkeypatch.setattr("sys.argv", ["side_by_side.py", *map(str, (*arguments, *places))])
        script.main()

    monkeypatch.setattr(script, "call", run, raising=False)
    return script


def test_settings_were_chosen_on_tasks_that_are_in_no_suite(curves):
    in_suites = [task.env for suite in rl.SUITES.values() for task in suite.values()]
    for env in curves.TUNING.values():
        assert env not in in_suites
        assert rl.setting_of(env).config.observation == "scaled"
    assert [*curves.CORE.values()] == [task.env for task in rl.SUITES["core"].values()]


@pytest.mark.long
@pytest.mark.parametrize(
    ("algorithm", "steps"),
    [("PPO", 256), ("ARS", 400), ("CrossQ", 48), ("SHAC", 160), ("imitation", 5_440)],
)
def test_a_curve_ends_with_what_the_last_policy_does_on_the_public_id(
    algorithm, steps, curves, tmp_path
):
    curves.call("--algorithms", algorithm, "--tasks", "balance-2", "--seeds", 3, "--steps", steps)
    (file,) = (tmp_path / "curves").iterdir()
    run = json.loads(file.read_text())
    assert file.name == f"balance-2-{algorithm}-3.json"
    assert (run["total_steps"], run["settings"]["algo"]) == (steps, TINY[algorithm]["algo"])
    assert steps / 2 <= run["steps"][0] < run["steps"][1]
    # a trainer that updates by whole rounds takes up to one more or one less
    assert run["steps"][1] == pytest.approx(steps, rel=0.5)
    assert 0.0 < run["seconds"][0] <= run["seconds"][1]
    (file,) = (tmp_path / "models" / algorithm / "3").iterdir()
    assert file.stem == "balance-2"
    env = {"id": "npend/Balance-v1", "n": 2} | (
        {"observation": "sincos"} if algorithm in ("SHAC", "imitation") else {}
    )
    model = rl.read_model(file, env, algorithm=algorithm, trust=True)
    found = rl.evaluate(model, env, episodes=3, seed=rl.VALIDATION)
    assert run["success"][-1] == found.success_rate
    assert run["return"][-1] == pytest.approx(found.returns.mean(), abs=0.02)
    held_out = rl.evaluate(model, env, episodes=100).returns
    error = held_out.std(ddof=1) / 10.0
    assert run["held_out"] == pytest.approx([held_out.mean(), error], abs=0.02)


@pytest.mark.long
def test_an_interrupted_run_leaves_no_file_and_finished_runs_are_not_trained_again(
    curves, tmp_path, monkeypatch
):
    trained, train = [], curves.train

    def watched(algorithm, task, seed, *rest):
        trained.append(seed)
        if len(trained) == 2:
            monkeypatch.setattr(curves.Curve, "add", interrupted)
        return train(algorithm, task, seed, *rest)

    def interrupted(*_arguments, **_options):
        raise KeyboardInterrupt

    arguments = "--algorithms", "ARS", "--tasks", "balance-2", "--seeds", 0, 1, 2, "--steps"
    add = curves.Curve.add
    monkeypatch.setattr(curves, "train", watched)
    with pytest.raises(KeyboardInterrupt):
        curves.call(*arguments, 200)
    folder = tmp_path / "curves"
    assert [file.name for file in folder.iterdir()] == ["balance-2-ARS-0.json"]
    first = (folder / "balance-2-ARS-0.json").read_bytes()
    monkeypatch.setattr(curves.Curve, "add", add)
    curves.call(*arguments, 200)
    assert trained == [0, 1, 1, 2]
    assert (folder / "balance-2-ARS-0.json").read_bytes() == first
    curves.call(*arguments, 100)  # there are longer ones
    assert trained == [0, 1, 1, 2]
    curves.call("--algorithms", "ARS", "--tasks", "balance-2", "--seeds", 2, "--steps", 300)
    assert trained == [0, 1, 1, 2, 2]


def test_candidates_of_ars_have_the_returns_of_episodes_played_alone(curves):
    torch = importlib.import_module("torch")
    env = {"id": "npend/Balance-v1", "n": 2}
    section = TINY["ARS"] | {"n_timesteps": 1, "env_kwargs": {"n": 2, "max_episode_steps": 40}}
    del section["algo"]
    model = curves.make_model({"algo": "ars", env["id"]: section}, seed=0)
    model.env.seed(11)
    weights = torch.from_numpy(np.random.default_rng(0).normal(size=(4, 6)).astype(np.float32))
    callback = curves.Calls(curves.Curve(env, 10**9))
    callback.init_callback(model)
    found = curves.returns_of(model, weights, callback)
    expected, steps = [], 0
    alone = gym.make(env["id"], n=2, max_episode_steps=40)
    for k, own in enumerate(weights.numpy()):
        observation, _ = alone.reset(seed=11 + k)
        total, ended = 0.0, False
        while not ended:
            action = np.clip([own @ observation], -1.0, 1.0)
            observation, reward, terminated, truncated, _ = alone.step(action)
            total, ended, steps = total + reward, terminated or truncated, steps + 1
        expected.append(total)
    assert found.numpy() == pytest.approx(expected, rel=1e-4)
    assert model.num_timesteps == steps < 4 * 40


def keep(folder, algorithm, seed, rows, task="swingup-1", total=1000):
    """Write the file of a run with rows of (steps, seconds, return, success)."""
    columns = dict(
        zip(("steps", "seconds", "return", "success"), zip(*rows, strict=True), strict=True)
    )
    about = {"algorithm": algorithm, "task": task, "seed": seed, "total_steps": total}
    (folder / f"{task}-{algorithm}-{seed}.json").write_text(json.dumps(about | columns))


def cells(table):
    return [[cell.strip() for cell in line.split("|")[1:-1]] for line in table.splitlines()]


def test_tables_have_interquartile_means_and_medians_over_seeds(curves, tmp_path):
    for seed, (middle, last) in enumerate([(0.5, 0.7), (0.95, 0.8), (0.95, 0.9), (1.0, 1.0)]):
        at = 500 + 10 * seed, 5.0 + seed
        keep(tmp_path, "PPO", seed, [(*at, 10.0, middle), (1000, 20.0, 100.0 * seed, last)])
    for seed in range(4):  # one of four reaches 95 %
        keep(tmp_path, "ARS", seed, [(100, 1.0, 10.0, 0.95 * (seed == 2))], total=100)
    keep(tmp_path, "PPO", 0, [(9, 1.0, 1.0, 1.0)], task="balance-1")
    found = curves.groups(tmp_path)
    head, _, ppo, ars = cells(curves.results(found))
    # the middle half of 0.7, 0.8, 0.9, 1; the first seed never reaches 95 %, so the median of
    # 510, 520, 530 and infinity counts
    interval = ppo[4].removeprefix("85 % (").removesuffix(")").split(" to ")
    assert 70 <= int(interval[0]) < 85 < int(interval[1]) <= 100
    assert ppo[:4] == ["swingup-1", "PPO", "1 000", "4"]
    assert ppo[5:] == ["150", "3 of 4", "525", "8 s"]
    assert ars[:4] == ["swingup-1", "ARS", "100", "4"]
    assert ars[6:] == ["1 of 4", "-", "-"]
    assert len(head) == len(ppo) == 9
    (_, _, fast, slow) = cells(curves.costs(found))
    # 8 tasks, 5 seeds, a million steps: at 50 and at 100 steps a second
    assert fast == ["PPO", "swingup-1", "50", f"{40e6 / 50 / 3600:.2g}"]
    assert slow == ["ARS", "swingup-1", "100", f"{40e6 / 100 / 3600:.2g}"]
    tried = cells(curves.tuning(curves.groups(tmp_path, curves.TUNING)))
    assert tried[2:] == [["balance-1", "PPO", "1 000", "100 %", "1", "1 s"]]


def test_runs_of_other_lengths_have_a_row_of_their_own(curves, tmp_path):
    keep(tmp_path, "PPO", 0, [(50, 1.0, 1.0, 1.0)], total=50)
    keep(tmp_path, "PPO", 1, [(1000, 9.0, 1.0, 1.0)])
    rows = cells(curves.results(curves.groups(tmp_path)))[2:]
    assert [row[2:4] for row in rows] == [["50", "1"], ["1 000", "1"]]


@pytest.mark.long
def test_the_pages_have_the_tables_that_the_files_make(tmp_path, monkeypatch):
    script = importlib.import_module("side_by_side")
    notes = script.PAGE.parent
    monkeypatch.setattr(script, "PAGE", tmp_path / script.PAGE.name)
    monkeypatch.setattr(script, "draw", lambda *_: None)
    names = script.PAGE.name, "learning.md"
    for name in names:
        (tmp_path / name).write_text((notes / name).read_text("utf-8"), "utf-8")
    script.publish(script.FILES)
    for name in names:
        made, page = ((folder / name).read_text("utf-8") for folder in (tmp_path, notes))
        assert made == page, "python benchmarks/side_by_side.py --publish"


@pytest.mark.long
def test_the_picture_has_a_row_for_each_task(curves, tmp_path):
    image = pytest.importorskip("matplotlib.image")
    for task, algorithm in (("swingup-1", "PPO"), ("swingup-1", "ARS"), ("swingup-2", "ARS")):
        for seed in range(2):
            rows = [(9 + seed, 1.0, 0.1, 0.2 * seed), (1000, 2.0, 5.0, 1.0)]
            keep(tmp_path, algorithm, seed, rows, task=task)
    found = curves.groups(tmp_path)
    one = {key: runs for key, runs in found.items() if key[0] == "swingup-1"}
    heights = []
    for name, own in (("one", one), ("two", found)):
        curves.draw(own, tmp_path / f"{name}.png")
        heights.append(len(image.imread(tmp_path / f"{name}.png")))
    assert heights[1] - heights[0] == 260  # of a row, 2.6 inches
