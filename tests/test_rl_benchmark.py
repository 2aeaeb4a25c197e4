"""The benchmark: what is played, what is written, what is compared, and what a check finds."""

import csv
import hashlib
import json
from collections import Counter

import gymnasium as gym
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from npend_gym import rl
from npend_gym.cli import main
from npend_gym.envs.registration import TASKS
from npend_gym.rl.benchmarking import play
from npend_gym.rl.benchmarking.readers import read_models, simulated, small_swings

FEW = 3  # episodes


def still(observation, info):  # noqa: ARG001
    return np.zeros((len(observation), 1))


@pytest.fixture(scope="module")
def shipped():
    policies = {name: rl.Policy.pretrained(name) for name in ("swingup-1", "balance-1-cart")}
    return policies, rl.benchmark(policies, name="shipped", episodes=FEW)


# -- the protocol -----------------------------------------------------------------------------


def test_suites_name_public_ids_with_their_default_observation_and_episode():
    assert {name: len(suite) for name, suite in rl.SUITES.items()} == {
        "core": 8, "hard": 10, "release": 5,
    }  # fmt: skip
    for suite in rl.SUITES.values():
        for task in suite.values():
            assert task.env_id in TASKS
            setting = rl.setting_of(task.env)
            assert setting.config.observation == "scaled"
            assert setting.keywords.keys().isdisjoint({"observation", "max_episode_steps", "dt"})
    (name,) = {task.env_id for task in rl.SUITES["release"].values()}
    controlled = {task.env_id for task in rl.SUITES["core"].values()}
    theirs = {"npend/DMAcrobot-v1", "npend/PufferDoublePendulum-v1"}  # tasks of other packages
    assert controlled | {name} == set(TASKS) - theirs  # every id of our own is in a suite


def test_the_episodes_are_those_of_evaluate_with_the_seeds_of_evaluations(shipped):
    policies, found = shipped
    env = {"id": "npend/CartPole-v1", "observation": "sincos"}
    expected = rl.evaluate(policies["balance-1-cart"], env, episodes=FEW, seed=rl.HELD_OUT)
    columns = found.episodes["balance-1-cart"]
    assert columns["return"].tolist() == expected.returns.tolist()
    assert columns["score"].tolist() == expected.success.tolist()


def test_a_score_of_the_suite_counts_what_was_not_run_as_nothing(shipped):
    _, found = shipped
    assert len(found.not_run) == 6
    assert found.score == pytest.approx(2 / 8)
    assert not found.complete  # three episodes are fewer than 100
    assert "not run: swingup-2" in repr(found)


def test_one_function_plays_all_tasks_and_none_is_easy():
    found = rl.benchmark(still, episodes=FEW)
    assert not found.not_run
    assert found.score < 0.2


def test_a_model_sees_what_the_ids_show():
    seen = Counter()

    def looking(observation, info):  # noqa: ARG001
        seen[observation.shape] += 1
        return np.zeros((len(observation), 1))

    rl.benchmark({"swingup-2": looking}, episodes=FEW)
    (shape,) = seen
    assert shape == (FEW, *gym.make("npend/SwingUp-v1").observation_space.shape)


@pytest.mark.parametrize(
    ("model", "keywords", "message"),
    [
        ({"swingup-7": still}, {}, "model must be for tasks of the suite 'core'"),
        ({}, {}, "model must be for tasks"),
        (still, {"suite": "easy"}, "suite must be one of core, hard, release"),
        (still, {"episodes": 101}, "episodes must be between 1 and 100"),
        (still, {"run": -1}, "run must be between 0"),
        ({"balance-2": still}, {"name": "a/b"}, "name must have 1 to 60 letters"),
        ({"balance-2": 3}, {}, "model must fit the task balance-2: model must be callable"),
        (rl.Policy.pretrained("balance-1"), {}, "give a mapping from tasks to their models"),
    ],
)
def test_what_cannot_be_played_is_refused_by_name(model, keywords, message):
    with pytest.raises((ValueError, TypeError), match=message):
        rl.benchmark(model, **{"episodes": 1} | keywords)


# -- the release: predictions of a motion ------------------------------------------------------


def test_a_prediction_is_valid_up_to_its_first_error():
    def wrong_after(seconds):
        def predict(chain, theta, omega, times):
            found = simulated(chain, theta, omega, times)
            return found + 0.11 * (times > seconds)[:, None]

        return predict

    for seconds in (0.0, 2.5, 10.0):
        found = rl.benchmark({"release-2": wrong_after(seconds)}, "release", episodes=FEW)
        assert found.scores["release-2"] == pytest.approx(seconds / 10.0, abs=1e-9)
        assert found.episodes["release-2"]["return"] == pytest.approx(seconds, abs=1e-9)


def test_an_integrator_of_scipy_predicts_the_release_of_one_pendulum():
    def pendulum(chain, theta, omega, times):
        rate = chain.gravity / chain.lengths[0]
        slope = lambda t, y: [y[1], -rate * np.sin(y[0])]  # noqa: ARG005, E731
        starts = zip(theta[:, 0], omega[:, 0], strict=True)
        span = times[0], times[-1]
        solved = [solve_ivp(slope, span, start, t_eval=times, rtol=1e-9) for start in starts]
        return np.stack([each.y[:1].T for each in solved])

    found = rl.benchmark({"release-1": pendulum}, "release", episodes=2)
    assert found.scores["release-1"] == 1.0


def test_small_swings_are_predicted_by_the_normal_modes():
    chain = rl.setting_of({"id": "npend/Release-v1", "n": 3}).config.chain
    theta, times = np.full((1, 3), 1e-4), np.linspace(0.0, 5.0, 50)
    omega = np.array([[1e-4, 0.0, -1e-4]])
    expected = simulated(chain, theta, omega, times)
    np.testing.assert_allclose(small_swings(chain, theta, omega, times), expected, atol=1e-9)


def test_predictions_of_another_shape_are_refused():
    for wrong in (lambda *_: np.zeros(3), 3):
        with pytest.raises((ValueError, TypeError), match="model must fit the task release-1"):
            rl.benchmark({"release-1": wrong}, "release", episodes=1)


# -- files ------------------------------------------------------------------------------------


def test_what_is_written_is_read_back_to_the_last_bit(shipped, tmp_path):
    _, found = shipped
    paths = found.write(tmp_path)
    assert [path.name for path in paths] == ["shipped-core-0.json", "shipped-core-0.csv"]
    (again,) = rl.read_benchmarks([tmp_path])
    assert again.as_dict() == found.as_dict()
    for task, columns in found.episodes.items():
        for name, values in columns.items():
            np.testing.assert_array_equal(again.episodes[task][name], values)
    said = json.loads(paths[0].read_text())
    assert said["sha256_of_episodes"] == hashlib.sha256(paths[1].read_bytes()).hexdigest()
    assert "numpy" in said["made_by"]
    with paths[1].open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * FEW
    assert {row["seed"] for row in rows} == {str(rl.HELD_OUT + k) for k in range(FEW)}


def forge(path, change):
    said = json.loads(path.read_text())
    change(said)
    path.write_text(json.dumps(said))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda said: said.update(score=1.0), "score do not"),
        (lambda said: said["tasks"]["swingup-1"].update(score=0.5), "tasks do not"),
        (lambda said: said["tasks"]["swingup-1"]["env"].update(n=2), "tasks do not"),
        (lambda said: said.update(not_run=[]), "not_run do not"),
        (lambda said: said.update(complete=True), "complete do not"),
        (lambda said: said.update(format="mine"), "its format must be"),
        (lambda said: said.update(suite="easy"), "suite must be one of"),
        (lambda said: said.update(name="../x"), "name must have"),
        (lambda said: said.pop("model"), "it lacks 'model'"),
        (lambda said: said.update(model=3), "model and about must be objects"),
        (lambda said: said.update(made_by=[9.9]), "made_by a text"),
        (lambda said: said["about"].update(env_steps="many"), "env_steps must be an integer"),
        (lambda said: said["about"].update(by="a | b"), "by must be a text"),
    ],
)
def test_a_file_whose_numbers_do_not_follow_from_its_episodes_is_refused(
    change, message, shipped, tmp_path
):
    path, _ = shipped[1].write(tmp_path)
    forge(path, change)
    with pytest.raises(ValueError, match=message):
        rl.read_benchmarks([path])


@pytest.mark.parametrize(
    ("old", "new"),
    [("1000001", "1000000"), ("swingup-1", "swingup-9"), (",1.0,", ",1.5,"), (",1.0,", ",nan,"),
     ("task,", "tasks,"), (",1.0,", ",,"), (",1.0,", "," + 140_000 * "1" + ","), (",1.0,", ",\0,")],
)  # fmt: skip
def test_damaged_episodes_are_refused(old, new, shipped, tmp_path):
    path, table = shipped[1].write(tmp_path)
    table.write_text(table.read_text().replace(old, new, 1))
    with pytest.raises(ValueError, match="must be of npend benchmark: "):
        rl.read_benchmarks([path])


def test_more_episodes_than_the_protocol_has_are_refused(tmp_path):
    columns = {name: np.zeros(101) for name in ("score", "return", "settling_time", "motor_work")}
    record = {"model": {}, "about": {}, "made_by": ""}
    path, _ = rl.BenchmarkRun("a", "core", 0, {"balance-2": columns}, record).write(tmp_path)
    with pytest.raises(ValueError, match="at most 100 episodes of a task, got 101 of balance-2"):
        rl.read_benchmarks([path])


# -- the check --------------------------------------------------------------------------------


def forged(found, out):
    """Write a result with one better return, and all that follows from it: nothing contradicts."""
    episodes = {task: dict(columns) for task, columns in found.episodes.items()}
    better = episodes["swingup-1"]["return"] + np.array([0.0, 5.0, 0.0])
    episodes["swingup-1"]["return"] = better
    forgery = rl.BenchmarkRun(found.name, found.suite, found.run, episodes, found.record)
    return forgery.write(out)[0]


def test_a_check_plays_again_and_finds_the_forged_episode(shipped, tmp_path):
    policies, found = shipped
    assert rl.check_benchmark(found, policies).same_bits
    (read,) = rl.read_benchmarks([forged(found, tmp_path)])  # no reader can tell
    replay = rl.check_benchmark(read, policies)
    assert not replay.accepted
    assert replay.differing == {"swingup-1": [rl.HELD_OUT + 1]}
    assert rl.check_benchmark(read, policies, tolerance=0.5).accepted
    with pytest.raises(ValueError, match="tolerance must be below 1, a share of the episodes"):
        rl.check_benchmark(read, policies, tolerance=1.0)  # with which anything is accepted


def test_a_check_allows_for_rounding_where_hardly_any_work_is_done(shipped):
    policies, found = shipped
    for error, accepted in ((5e-7, True), (5e-5, False)):  # [J], of about 0.003 J
        episodes = {task: dict(columns) for task, columns in found.episodes.items()}
        episodes["balance-1-cart"]["motor_work"] = found.episodes["balance-1-cart"][
            "motor_work"
        ] + np.array([0.0, error, 0.0])
        other = rl.BenchmarkRun(found.name, found.suite, found.run, episodes, found.record)
        assert rl.check_benchmark(other, policies).accepted is accepted


def test_a_check_takes_the_models_of_the_result_alone(shipped):
    policies, found = shipped
    swapped = policies | {"swingup-1": rl.Policy.pretrained("swingup-1-robust")}
    assert not rl.check_benchmark(found, swapped).accepted
    assert "no model for balance-1-cart" in str(
        rl.check_benchmark(found, {"swingup-1": policies["swingup-1"]}).complaints
    )
    assert "SHA-256" in str(rl.check_benchmark(found, policies, sha256={"a": "b"}).complaints)


# -- the command ------------------------------------------------------------------------------


@pytest.mark.long
def test_the_command_plays_a_folder_of_runs_and_checks_what_it_wrote(tmp_path, capsys):
    for run, name in ((0, "balance-1-cart"), (3, "swingup-1")):
        folder = tmp_path / "models" / str(run)
        folder.mkdir(parents=True)
        rl.Policy.pretrained(name).save(folder / f"{name}.safetensors")
    options = ["--episodes", str(FEW), "--name", "mine", "--env-steps", "1000"]
    out = tmp_path / "out"
    models = str(tmp_path / "models")
    assert main(["benchmark", models, *options, "-o", str(out)]) == 0
    shown = capsys.readouterr()
    assert "mine, run 3: core, mean score 0.125" in shown.out
    assert "not run, and counted as 0: swingup-2" in shown.err
    assert json.loads((out / "mine-core-3.json").read_text())["about"] == {"env_steps": 1000}
    check = ["benchmark", models, "--check", str(out / "mine-core-3.json")]
    assert main(check) == 0
    shown = capsys.readouterr()
    assert "accepted, its episodes are the same to the last bit" in shown.out
    assert "fewer than 100 episodes of a task are not complete" in shown.err
    (found,) = rl.read_benchmarks([out / "mine-core-3.json"])
    forged(found, out)
    assert main(check) == 1
    assert f"1 of 3 episodes of swingup-1 differ, the first with the seed {rl.HELD_OUT + 1}" in (
        capsys.readouterr().err
    )


def test_the_command_imports_and_reads_nothing_that_a_result_names(tmp_path, capsys):
    source = {"from": f"{tmp_path}/evil.py:act"}
    (tmp_path / "evil.py").write_text("raise RuntimeError")
    path, _ = rl.benchmark({"balance-2": still}, name="e", episodes=1, source=source).write(
        tmp_path
    )
    with pytest.raises(SystemExit):
        main(["benchmark", "--check", str(path)])
    assert "model must be given with --check" in capsys.readouterr().err


@pytest.mark.long
def test_the_command_compares_files(shipped, tmp_path, capsys):
    _, found = shipped
    found.write(tmp_path)
    rl.benchmark(still, name="still", episodes=FEW).write(tmp_path)
    assert main(["benchmark", "--compare", str(tmp_path)]) == 0
    assert "still" in (shown := capsys.readouterr().out)
    assert "0.250" in shown  # of two of eight tasks
    options = ["--compare", str(tmp_path), "--tasks", "swingup-1,balance-1-cart"]
    assert main(["benchmark", *options]) == 0
    assert "1.000" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["benchmark", "--check", str(tmp_path)])
    assert "check must be a JSON file of one run" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["benchmark"])
    assert "give a model, --compare or --check" in capsys.readouterr().err


def test_a_result_is_written_before_it_is_compared(tmp_path, monkeypatch, refusal):
    monkeypatch.setattr("npend_gym.rl.benchmarking.suites.EPISODES", 2)
    rl.benchmark({"balance-2": still}, name="e", episodes=1).write(tmp_path)  # of one episode
    (tmp_path / "mine.py").write_text(
        "import numpy as np\ndef a(o, i): return np.ones((len(o), 1))"
    )
    options = ["--tasks", "balance-2", "--compare", str(tmp_path), "-o", str(tmp_path / "new")]
    assert "runs must have as many" in refusal("benchmark", f"{tmp_path}/mine.py:a", *options)
    assert len(rl.read_benchmarks([tmp_path / "new"])) == 1


def test_a_folder_that_is_the_current_one_gives_its_name(tmp_path, monkeypatch, capsys):
    rl.Policy.pretrained("balance-1-cart").save(tmp_path / "balance-1-cart.safetensors")
    monkeypatch.chdir(tmp_path)
    assert main(["benchmark", ".", "--episodes", "1"]) == 0
    assert f"{tmp_path.name}, run 0" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("random --tasks swingup-99", "tasks must be one of swingup-1"),
        ("random --compare . --episodes 3", "episodes must be 100 with --compare, got 3"),
        ("--compare . --suite hard", "must have results of the suite hard, got ['core']"),
        ("--compare . --out new", "--out must be left out without a model; got new"),
        ("--compare . --env-steps 9", "--env-steps must be left out without a model"),
        ("--check e-core-0.json --json", "--json must be left out with --check"),
        ("random --check e-core-0.json --compare .", "--compare must be left out with --check"),
        ("random --check e-core-0.json --suite hard", "--suite must be left out with --check"),
        ("random --check e-core-0.json --episodes 9", "--episodes must be left out with --check"),
        ("random --tolerance 0", "--tolerance must be left out without --check; got 0"),
        ("--compare . --trust", "--trust must be left out without a model"),
        ("--compare . --episodes 3", "--episodes must be left out without a model"),
        ("random --compare . --name e", "name must be another than those in ., which has the run"),
        ("f.py:few --tasks calm-2", "model must be for tasks of the suite 'core'"),
    ],
)
def test_options_that_the_command_would_not_use_are_refused_before_it_plays(
    options, message, tmp_path, monkeypatch, refusal
):
    rl.benchmark({"balance-2": still}, name="e", episodes=1).write(tmp_path)
    (tmp_path / "f.py").write_text("few = {'balance-2': None}\n")
    monkeypatch.chdir(tmp_path)
    assert message in refusal("benchmark", *options.split())
    assert not (tmp_path / "new").exists()


# -- statistics -------------------------------------------------------------------------------


def made_run(name, run, scores):
    tasks = [*rl.SUITES["core"]]
    zero = np.zeros(FEW)
    episodes = {
        task: {"score": np.full(FEW, score), "return": zero, "settling_time": zero,
               "motor_work": zero}
        for task, score in zip(tasks, scores, strict=True)
    }  # fmt: skip
    return rl.BenchmarkRun(name, "core", run, episodes, {})


@pytest.mark.long
def test_algorithms_of_several_runs_are_compared_by_runs():
    rng = np.random.default_rng(0)
    good, poor = rng.uniform(0.5, 1.0, (5, 8)), rng.uniform(0.0, 0.45, (4, 8))
    runs = [made_run("poor", k, row) for k, row in enumerate(poor)]
    runs += [made_run("good", k, row) for k, row in enumerate(good)]
    first, second = rl.compare_benchmarks(runs)
    assert (first["name"], first["runs"], first["over"]) == ("poor", 4, "runs")
    assert second["iqm"] == pytest.approx(rl.interquartile_mean(good))
    assert second["low"] < second["iqm"] < second["high"]
    assert second["improvement"] == 1.0
    assert first["improvement"] == 0.5
    assert second["profile"][2] == pytest.approx((good > 0.5).mean())
    assert rl.compare_benchmarks(runs, "good")[0]["improvement"] == 0.0
    first, second = rl.compare_benchmarks(runs, tasks=["balance-2", "calm-2"])
    assert (first["tasks"], second["mean"]) == (2, pytest.approx(good[:, 2:4].mean()))


def test_a_single_run_is_compared_by_its_episodes(shipped):
    row, *_ = rl.compare_benchmarks([shipped[1]])
    assert (row["over"], row["tasks"], row["mean"]) == ("episodes", 2, 0.25)


def test_the_mean_of_two_runs_lies_within_its_interval():
    runs = [made_run("a", 0, np.ones(8)), made_run("a", 1, [1, 1, 0, 0, 0, 0, 0, 0])]
    (row,) = rl.compare_benchmarks(runs)
    assert row["iqm"] == 0.75  # 10 of 16 scores are 1, and 6 of the middle 8
    assert row["low"] <= row["iqm"] <= row["high"]


def test_one_model_is_not_two_runs():
    source = {"from": "a", "sha256": {"swingup-1.zip": "0"}}
    runs = [
        rl.BenchmarkRun("a", "core", k, made_run("a", k, np.ones(8)).episodes, {"model": source})
        for k in (0, 1)
    ]
    with pytest.raises(ValueError, match="runs of a must each have their own models"):
        rl.compare_benchmarks(runs)


def test_runs_of_several_suites_are_not_compared():
    release = rl.benchmark({"release-1": simulated}, "release", name="a", episodes=1)
    with pytest.raises(ValueError, match="runs must be of one suite, got core, release"):
        rl.compare_benchmarks([made_run("a", 0, np.ones(8)), release])
    with pytest.raises(ValueError, match="runs of a must each have their own seed"):
        rl.compare_benchmarks(2 * [made_run("a", 0, np.ones(8))])
    columns = {name: np.zeros(9) for name in ("score", "return", "settling_time", "motor_work")}
    longer = [rl.BenchmarkRun("b", "core", k, {"calm-2": columns}, {}) for k in range(3)]
    with pytest.raises(
        ValueError, match=r"runs must have as many episodes in each task, got \[3, 9"
    ):
        rl.compare_benchmarks([made_run("a", 0, np.ones(8)), *longer])
    with pytest.raises(ValueError, match="runs must be of one suite, got none"):
        rl.compare_benchmarks([])


# -- models of others -------------------------------------------------------------------------


@pytest.mark.long
def test_a_module_of_torchrl_acts_by_its_most_likely_action():
    torch = pytest.importorskip("torch")
    modules = pytest.importorskip("torchrl.modules")
    from tensordict.nn import InteractionType, NormalParamExtractor, TensorDictModule

    net = torch.nn.Sequential(torch.nn.Linear(3, 2), NormalParamExtractor())
    inner = TensorDictModule(net, in_keys=["observation"], out_keys=["loc", "scale"])
    actor = modules.ProbabilisticActor(
        inner, in_keys=["loc", "scale"], distribution_class=modules.TanhNormal,
        default_interaction_type=InteractionType.RANDOM,
    )  # fmt: skip
    found = rl.benchmark({"swingup-1": actor}, episodes=FEW).episodes["swingup-1"]["return"]

    def mean(observation, info):  # noqa: ARG001
        with torch.no_grad():
            return torch.tanh(net(torch.as_tensor(observation))[0]).numpy()

    expected = rl.benchmark({"swingup-1": mean}, episodes=FEW).episodes["swingup-1"]["return"]
    np.testing.assert_allclose(found, expected, rtol=1e-4)


@pytest.mark.long
@pytest.mark.parametrize(("form", "suffix"), [("onnx", ".onnx"), ("torch", ".pt2")])
@pytest.mark.parametrize("name", ["swingup-1", "swingup-5"])  # which has a memory
def test_files_of_networks_play_as_the_policy_does(name, form, suffix, tmp_path):
    from npend_gym import export

    pytest.importorskip("torch" if form == "torch" else "onnxruntime")
    trust = form == "torch"
    if form == "torch" and name == "swingup-5":
        pytest.skip("a program with a memory takes more than observations")
    policy = rl.Policy.pretrained(name)
    write = export.to_onnx if form == "onnx" else export.to_torch
    write(policy, tmp_path / f"{name}{suffix}")
    suite = "hard" if name == "swingup-5" else "core"
    (run,) = read_models(str(tmp_path), suite, trust=trust).values()
    assert list(run.source["sha256"]) == [f"{name}{suffix}"]
    found = rl.benchmark(run.models, suite, episodes=FEW).episodes[name]["return"]
    expected = rl.benchmark({name: policy}, suite, episodes=FEW).episodes[name]["return"]
    np.testing.assert_allclose(found, expected, rtol=1e-2)


@pytest.mark.long
@pytest.mark.parametrize("normalised", [False, True])
def test_models_of_stable_baselines3_are_read_where_they_are_trusted(normalised, tmp_path):
    sb3 = pytest.importorskip("stable_baselines3")
    from stable_baselines3.common.vec_env import VecNormalize

    venv = rl.SB3VecEnv(gym.make_vec("npend/SwingUp-v1", num_envs=2, autoreset_mode="SAME_STEP"))
    if normalised:
        venv = VecNormalize(venv)
    model = sb3.PPO("MlpPolicy", venv, n_steps=8, batch_size=16, device="cpu", seed=0).learn(16)
    model.save(tmp_path / "swingup-2.zip")
    if normalised:
        venv.save(tmp_path / "swingup-2.pkl")
    with pytest.raises(ValueError, match="must be trusted"):
        read_models(str(tmp_path), "core", algorithm="PPO")
    with pytest.raises(ValueError, match="algorithm must be a class"):
        read_models(str(tmp_path), "core", algorithm="None", trust=True)
    (run,) = read_models(str(tmp_path), "core", algorithm="PPO", trust=True).values()
    assert len(run.source["sha256"]) == 1 + normalised
    found = rl.benchmark(run.models, episodes=FEW).episodes["swingup-2"]["return"]
    expected = rl.evaluate(model, "npend/SwingUp-v1", episodes=FEW).returns
    assert found.tolist() == expected.tolist()


def test_a_function_in_a_file_plays_and_what_is_no_model_is_refused(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text("import numpy as np\ndef act(o, info): return np.zeros((len(o), 1))\nN = {}\n")
    (run,) = read_models(f"{path}:act", "core").values()
    assert len(run.models) == 8
    assert run.source["sha256"] == {"mine.py": hashlib.sha256(path.read_bytes()).hexdigest()}
    assert rl.read_model("math:sin")(0.0) == 0.0
    for wrong, message in (
        (f"{path}:other", "model must be a name in"),
        (f"{tmp_path}/none.py:act", "model must be a file of Python"),
        (str(tmp_path / "none.onnx"), "model must be a file that ends in"),
        (str(tmp_path), "model must have a file for a task"),
        ("modes", "model must be one of pretrained, reference, random"),
    ):
        with pytest.raises(ValueError, match=message):
            read_models(wrong, "core")


@pytest.mark.parametrize("suffix", [".zip", ".pt2"])
def test_files_whose_loading_runs_code_must_be_trusted(suffix, tmp_path):
    (tmp_path / f"swingup-1{suffix}").write_bytes(b"")
    with pytest.raises(ValueError, match="must be trusted, because its pickles can run any code"):
        read_models(str(tmp_path), "core", algorithm="PPO")


def test_two_files_of_a_task_are_refused(tmp_path):
    for name in ("swingup-1.zip", "swingup-1.onnx", "swingup-1-x.zip"):
        (tmp_path / name).write_bytes(b"")
    with pytest.raises(
        ValueError, match=r"model must have one file for swingup-1, got .*\.onnx and"
    ):
        read_models(str(tmp_path), "core")


@pytest.mark.long
def test_models_of_another_kind_than_said_are_refused(tmp_path):
    sb3 = pytest.importorskip("stable_baselines3")
    import torch

    env = gym.make("npend/SwingUp-v1", n=1)
    sb3.PPO("MlpPolicy", env, n_steps=8, batch_size=8, device="cpu").save(tmp_path / "m.zip")
    (tmp_path / "m.pt2").write_text("x")
    for file, algorithm, message in (
        ("m.zip", "SAC", "m.zip must be a model of SAC, got AttributeError"),
        ("m.zip", "common", "algorithm must be a class of Stable-Baselines3"),
        ("m.pt2", None, "m.pt2 must be a network that its library reads, got BadZipFile"),
    ):
        with pytest.raises(ValueError, match=message):
            rl.read_model(tmp_path / file, algorithm=algorithm, trust=True)
    program = torch.export.export(torch.nn.Linear(3, 1), (torch.zeros(1, 3),))  # takes one row
    with pytest.raises(ValueError, match="a program must take any number of observations"):
        rl.benchmark({"swingup-1": program.module()}, episodes=2)


def test_random_actions_are_the_same_in_every_play():
    (run,) = read_models("random", "core").values()
    once = {"swingup-1": run.models["swingup-1"]}
    found = [rl.benchmark(once, episodes=FEW).episodes["swingup-1"]["return"] for _ in range(2)]
    assert found[0].tolist() == found[1].tolist()
    assert len(set(found[0].tolist())) == FEW


def test_the_motion_with_which_predictions_are_compared_is_finer_than_their_bound():
    config = rl.setting_of({"id": "npend/Release-v1", "n": 20}).config
    theta, times = np.full(20, np.pi / 4), np.linspace(0.0, 10.0, 101)
    from npend_gym.physics import simulate

    coarse, fine = (
        simulate(config.chain, theta, 0.0, times, rtol=rtol, atol=0.1 * rtol).theta
        for rtol in (10.0 * play.FINE[0], play.FINE[0])
    )
    assert abs(coarse - fine).max() < 1e-3 * play.VALID
