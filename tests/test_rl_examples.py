"""Every training script runs for a short time, and `npend evaluate` takes what it writes."""

import csv
import errno
import importlib
import inspect
import json
import re
import runpy
import shutil

import gymnasium as gym
import numpy as np
import pytest
from scripts import run_python, run_script
from test_examples import ROOT

from npend_gym import _files
from npend_gym.rl import Policy

EXAMPLES = ROOT / "examples"


@pytest.fixture
def script(tmp_path):
    """A function that runs a script of `examples/` in `tmp_path` and returns its output."""
    return lambda name, *arguments: run_script(EXAMPLES / name, *arguments, cwd=tmp_path)


def successes_in(text):
    return re.search(r"success  (\d+)/(\d+) = \S+, 95 % confidence", text).groups()


def test_evaluate_films_a_policy(script, tmp_path):
    pytest.importorskip("pygame")
    arguments = ["--episodes", 5, "--video", "a.gif", "--seconds", 0.5]
    printed = script("evaluate.py", "--pretrained", "swingup-1", *arguments)
    assert successes_in(printed)[1] == "5"
    assert (tmp_path / "a.gif").read_bytes()[:6] == b"GIF89a"


@pytest.mark.parametrize(
    ("keywords", "action"),
    [
        ({"torque_levels": 3}, [2]),
        ({"mode": "transition", "goal_env": True, "reward_type": "sparse"}, [[1.0]]),
    ],
)
def test_evaluate_films_discrete_actions_and_environments_with_goals(keywords, action, tmp_path):
    imageio, seen = pytest.importorskip("imageio.v3"), []
    pytest.importorskip("pygame")

    def act(shown, _):
        seen.append(np.shape(shown["observation"] if "goal_env" in keywords else shown))
        return action

    film = runpy.run_path(str(EXAMPLES / "evaluate.py"))["film"]
    film(act, {"n": 1} | keywords, 0, 0.25, tmp_path / "a.gif")
    assert len(imageio.imread(tmp_path / "a.gif")) == 6
    assert set(seen) == {(1, 2)}


@pytest.mark.long
def test_train_sb3_trains_resumes_and_writes_a_policy_and_its_card(script, tmp_path):
    pytest.importorskip("stable_baselines3")
    pytest.importorskip("yaml")
    script("train_sb3.py", "swingup-1", "--steps", 4096, "--out", "a")
    script("train_sb3.py", "swingup-1", "--steps", 8192, "--out", "a", "--resume")
    card = (tmp_path / "a" / "README.md").read_text()
    assert "for 8192 steps" in card
    assert json.loads(re.search(r"```json\n(.*?)```", card, re.DOTALL)[1])["episodes"] == 100
    assert list((tmp_path / "a" / "tensorboard").rglob("events*"))
    record = Policy.load(tmp_path / "a" / "policy.safetensors").provenance
    assert record["training"]["steps"] == 8192
    printed = script("evaluate.py", "--run", "a", "--episodes", 5)
    assert successes_in(printed)[1] == "5"


@pytest.mark.long
def test_a_checkpoint_of_train_sb3_keeps_the_statistics_of_observations(tmp_path):
    pytest.importorskip("stable_baselines3")
    yaml = pytest.importorskip("yaml")
    import torch
    from train_sb3 import load_run, make_model, state_of

    from npend_gym.rl.evaluation.models import as_controller

    text = (EXAMPLES / "configs" / "balance-2.yml").read_text()
    model = make_model(yaml.safe_load(text), seed=0)
    model.learn(4096)
    (tmp_path / "config.yml").write_text(text)
    torch.save(state_of(model), tmp_path / "best.pth")
    again, _ = load_run(tmp_path)
    venv = model.get_vec_normalize_env().venv
    observation, config = venv.reset(), venv.venv.unwrapped.config
    start = {"time": np.zeros(len(observation))}
    actions = as_controller(model, config)(observation, start)
    assert again.num_timesteps == 4096
    np.testing.assert_array_equal(as_controller(again, config)(observation, start), actions)
    statistics = model.get_vec_normalize_env().obs_rms
    scaled = (observation - statistics.mean) / np.sqrt(statistics.var + 1e-8)
    bare = model.predict(scaled.clip(-10.0, 10.0).astype(np.float32), deterministic=True)[0]
    np.testing.assert_allclose(actions, bare, atol=1e-5)


TINY = {
    "env_kwargs": {"n": 1, "max_episode_steps": 20}, "n_envs": 2, "n_timesteps": 96,
    "policy": "MlpPolicy", "n_steps": 16, "batch_size": 32, "n_epochs": 1,
}  # fmt: skip


def test_a_resumed_run_of_train_sb3_keeps_the_best_weights(tmp_path, monkeypatch):
    """The settings of the resumed run are those in its own folder."""
    pytest.importorskip("stable_baselines3")
    yaml = pytest.importorskip("yaml")
    import torch
    import train_sb3

    scores = iter([0.2, 0.9, 0.5, 0.4, *[0.3] * 9])

    def scored(*_arguments, **_options):
        return {"success": next(scores), "return": 0.0, "motor_work": 0.0}

    def train(path, *arguments):
        given = ["train_sb3.py", path, "--out", tmp_path / "a", "--every", 32, *arguments]
        monkeypatch.setattr("sys.argv", [*map(str, given)])
        train_sb3.main()
        return [
            torch.load(tmp_path / "a" / f"{name}.pth", weights_only=True)["steps"]
            for name in ("best", "last")
        ]

    monkeypatch.setattr(train_sb3, "score_of", scored)
    (tmp_path / "tiny.yml").write_text(yaml.safe_dump({"algo": "ppo", "npend/Balance-v1": TINY}))
    assert train(tmp_path / "tiny.yml") == [32, 96]
    assert len([*scores]) == 8
    scores = iter([0.3] * 4)
    state = torch.load(tmp_path / "a" / "last.pth", weights_only=True)
    torch.save(state | {"seconds": 1000.0}, tmp_path / "a" / "last.pth")
    assert train(tmp_path / "a" / "config.yml", "--steps", 160, "--resume") == [32, 160]
    assert len([*scores]) == 1  # it evaluates after 128 and 160 steps, and the best weights
    policy = Policy.load(tmp_path / "a" / "policy.safetensors")
    assert 1000.0 < policy.provenance["training"]["seconds"] < 1100.0


def test_train_sb3_leaves_an_earlier_run_as_it_is_where_it_refuses_or_fails(
    tmp_path, monkeypatch, capsys
):
    pytest.importorskip("stable_baselines3")
    yaml = pytest.importorskip("yaml")
    import torch
    import train_sb3

    def run(name, *arguments):
        given = ["train_sb3.py", tmp_path / f"{name}.yml", "--out", tmp_path / "a", *arguments]
        monkeypatch.setattr("sys.argv", [*map(str, given)])
        train_sb3.main()

    def refusal(*arguments):
        with pytest.raises(SystemExit):
            run(*arguments)
        return capsys.readouterr().err

    def fails(_state, path):
        path.write_bytes(b"a half")
        raise OSError(errno.ENOSPC, "the disk is full")

    score = {"success": 0.5, "return": 0.0, "motor_work": 0.0}
    monkeypatch.setattr(train_sb3, "score_of", lambda *_arguments, **_options: score)
    for name, task in (("tiny", "Balance"), ("other", "SwingUp")):
        config = {"algo": "ppo", f"npend/{task}-v1": TINY}
        (tmp_path / f"{name}.yml").write_text(yaml.safe_dump(config))
    assert "--resume needs the checkpoint" in refusal("tiny", "--resume")
    assert not (tmp_path / "a").exists()
    run("tiny")
    kept = ["best.pth", "config.yml", "last.pth"]
    before = [(tmp_path / "a" / name).read_bytes() for name in kept]
    assert "continue its run with --resume" in refusal("tiny")
    assert "other.yml differs from" in refusal("other", "--resume")
    score["success"] = 0.6
    monkeypatch.setattr(torch, "save", fails)
    with pytest.raises(OSError, match="the disk is full"):
        run("tiny", "--resume", "--steps", 160)
    assert [(tmp_path / "a" / name).read_bytes() for name in kept] == before


@pytest.mark.parametrize(
    ("env_id", "mode"), [("evil:npend/Balance-v1", "balance"), ("npend/Balance-v1", "evil:Mode")]
)
def test_a_run_of_train_sb3_imports_what_its_file_names_only_when_trusted(env_id, mode, tmp_path):
    pytest.importorskip("stable_baselines3")
    yaml = pytest.importorskip("yaml")
    from train_sb3 import load_run

    def write(env_id, mode):
        settings = TINY | {"env_kwargs": TINY["env_kwargs"] | {"mode": mode}}
        (tmp_path / "config.yml").write_text(yaml.safe_dump({"algo": "ppo", env_id: settings}))

    write(env_id, mode)
    with pytest.raises(ValueError, match=r"names 'evil:.*', which is imported only with --trust"):
        load_run(tmp_path)
    with pytest.raises((ImportError, ValueError), match="evil"):  # it tries to
        load_run(tmp_path, trust=True)
    write("npend_gym:npend/Balance-v1", "balance")
    with pytest.raises(FileNotFoundError, match=r"best\.pth"):  # it has come so far
        load_run(tmp_path)


@pytest.mark.filterwarnings("ignore")  # those of torchrl itself
@pytest.mark.parametrize(
    ("script", "library", "arguments"),
    [
        ("train_sb3", "stable_baselines3", ["swingup-1", "--steps", "0"]),
        ("evaluate", "torch", ["--pretrained", "swingup-1", "--steps", "0"]),
        ("evolution_strategies", "torch", ["calm-5", "--updates", "0"]),
        pytest.param(
            "train_torchrl", "torchrl", ["swingup-1", "--steps", "0"], marks=pytest.mark.long
        ),
        ("learning", "stable_baselines3", ["--rounds", "0"]),
    ],
)
def test_scripts_refuse_no_steps_and_do_not_take_the_default(
    script, library, arguments, tmp_path, monkeypatch, capsys
):
    pytest.importorskip(library)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", [f"{script}.py", *arguments])
    with pytest.raises(SystemExit):
        importlib.import_module(script).main()
    assert "must be at least 1" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_transitions_judges_a_policy_in_its_own_environment(tmp_path, monkeypatch, capsys):
    import transitions

    def main(*arguments):
        monkeypatch.setattr("sys.argv", ["transitions.py", *map(str, arguments)])
        transitions.main()

    def rollout(_controller, envs, *_):
        judged.append(envs.unwrapped.config)
        assert (tmp_path / "new").is_dir()  # before any work
        return []

    env, judged = {"n": 1, "mode": "transition", "lengths": 0.5, "max_torque": 20.0}, []
    observed = transitions.setting_of(env).config.observed
    path = tmp_path / "a.safetensors"
    zeros = np.zeros((1, observed), np.float32)
    Policy(np.ones(observed, np.float32), [zeros], [np.zeros(1, np.float32)], env).save(path)
    monkeypatch.setattr(transitions, "rollout", rollout)
    main(1, "--policy", path, "--csv", tmp_path / "new" / "table.csv")
    assert [config.chain.lengths.tolist() for config in judged] == [[0.5]] * 2
    assert (tmp_path / "new" / "table.csv").exists()
    for arguments, mode in ([2, "--policy", path], "transition"), (
        [1, "--pretrained", "swingup-1"], "swingup"
    ):  # fmt: skip
        with pytest.raises(SystemExit):
            main(*arguments)
        assert f'got "{mode}" with n=1' in capsys.readouterr().err
    assert len(judged) == 2


@pytest.mark.parametrize(
    ("env_id", "normalize"),
    [("Balance", True), ("Balance", "dict(norm_obs=False)"), ("Transition", True)],
)
def test_a_checkpoint_of_train_sb3_keeps_the_statistics_of_returns(env_id, normalize, tmp_path):
    pytest.importorskip("stable_baselines3")
    import torch
    from train_sb3 import make_model, restore, state_of

    own = {"goal_env": True, "reward_type": "sparse"} if env_id == "Transition" else {}
    settings = TINY | {"normalize": normalize, "env_kwargs": TINY["env_kwargs"] | own}
    settings["policy"] = "MultiInputPolicy" if own else "MlpPolicy"
    config = {"algo": "ppo", f"npend/{env_id}-v1": settings}
    models = [make_model(config, seed) for seed in (0, 1)]
    models[0].learn(32)
    torch.save(state_of(models[0]), tmp_path / "last.pth")
    restore(models[1], tmp_path / "last.pth")
    states = [state_of(model) for model in models]
    assert repr(states[1]) == repr(states[0])
    assert states[0]["returns"]["count"] > 32


def test_train_sb3_reads_settings_as_rl_zoo_writes_them():
    pytest.importorskip("stable_baselines3")
    from train_sb3 import make_model

    settings = TINY | {
        "normalize": "{'norm_obs': True, 'norm_reward': False}", "clip_range": "lin_0.2",
        "policy_kwargs": "dict(ortho_init=False, net_arch=dict(pi=[8], vf=[16]))",
    }  # fmt: skip
    model = make_model({"algo": "ppo", "npend/Balance-v1": settings}, seed=0)
    venv = model.get_vec_normalize_env()
    assert (venv.norm_obs, venv.norm_reward) == (True, False)
    assert model.policy_kwargs == {"ortho_init": False, "net_arch": {"pi": [8], "vf": [16]}}
    assert [model.clip_range(left) for left in (1.0, 0.5)] == [0.2, 0.1]
    assert model.learning_rate == 3e-4  # the default
    settings["policy_kwargs"] = "dict(activation_fn=nn.ReLU)"
    with pytest.raises(ValueError, match=r"policy_kwargs must have numbers.*nn\.ReLU"):
        make_model({"algo": "ppo", "npend/Balance-v1": settings}, seed=0)


@pytest.mark.long
@pytest.mark.filterwarnings("ignore")  # those of torchrl itself
@pytest.mark.parametrize("task", ["transition-1", "balance-1-cart"])
def test_train_torchrl_takes_tasks_with_goals_and_with_a_cart(task):
    pytest.importorskip("torchrl")
    from train_torchrl import make_env, obs_scale, settings_of

    settings = settings_of(task, num_envs=2)
    observation = make_env(settings).reset()["observation"]
    assert obs_scale(settings).shape == observation.shape[1:]
    assert obs_scale(settings)[:3].tolist() == [1.0, 1.0, 5.0]


CONFIGS = sorted(path.stem for path in (EXAMPLES / "configs").glob("*.yml"))


@pytest.mark.parametrize("config", CONFIGS)
def test_rl_zoo_trains_what_the_config_is_named_after(config):
    """Read the file as rl_zoo3.exp_manager does: by the id, `env_kwargs` within the section."""
    yaml = pytest.importorskip("yaml")
    sb3 = pytest.importorskip("stable_baselines3")
    sb3_contrib = pytest.importorskip("sb3_contrib")
    by_id = yaml.safe_load((EXAMPLES / "configs" / f"{config}.yml").read_text())
    algo = by_id.pop("algo")  # in RL Zoo an argument of the command line
    ((env_id, hyperparams),) = by_id.items()
    env = gym.spec(env_id).make(**hyperparams.pop("env_kwargs", {}))
    mode, n = config.split("-")[:2]
    assert (env.unwrapped.config.mode.name, env.unwrapped.config.n) == (mode, int(n))
    assert env.spec.max_episode_steps <= 500
    assert set(hyperparams.pop("normalize", {})) <= {"norm_obs", "norm_reward"}
    assert hyperparams.pop("n_envs", 1) > 1
    assert int(hyperparams.pop("n_timesteps")) >= 10_000
    if isinstance(hyperparams["learning_rate"], str):
        kind, initial = hyperparams["learning_rate"].split("_")
        assert kind == "lin"
        assert float(initial) > 0.0
    model_class = getattr(sb3, algo.upper(), None) or getattr(sb3_contrib, algo.upper())
    assert set(hyperparams) < set(inspect.signature(model_class).parameters)


@pytest.mark.parametrize("task", ["swingup-1-robust", "calm-2-robust"])
def test_the_configs_of_robust_policies_draw_the_chains_of_the_task(task):
    yaml = pytest.importorskip("yaml")
    pytest.importorskip("torch")
    from npend_gym.rl.training.tasks import env_of_task

    by_id = yaml.safe_load((EXAMPLES / "configs" / f"{task}.yml").read_text())
    env = env_of_task(task)
    shown = next(value for key, value in by_id.items() if key != "algo")["env_kwargs"]
    assert shown.pop("max_episode_steps") <= 400
    assert shown == {name: env[name] for name in ("n", "randomize")}


def test_the_records_of_robust_policies_say_which_chains_they_were_shown():
    pytest.importorskip("torch")
    from npend_gym.rl.training.imitation_settings import ERRORS
    from npend_gym.rl.training.tasks import env_of_task

    trained = Policy.pretrained("swingup-1-robust")
    assert trained.env["randomize"] == trained.provenance["arguments"]["env"]["randomize"]
    assert trained.env["randomize"] == env_of_task("swingup-1-robust")["randomize"]
    imitates = Policy.pretrained("calm-2-robust").provenance["arguments"]  # nominal chain in `env`
    assert imitates["errors"] == ERRORS


@pytest.mark.parametrize("config", CONFIGS)
def test_every_config_makes_a_model(config):
    pytest.importorskip("stable_baselines3")
    yaml = pytest.importorskip("yaml")
    from train_sb3 import algorithm, make_model, section

    settings = yaml.safe_load((EXAMPLES / "configs" / f"{config}.yml").read_text())
    if settings["algo"] == "tqc":
        pytest.importorskip("sb3_contrib")
    model = make_model(settings, seed=0)
    assert isinstance(model, algorithm(settings["algo"]))
    assert model.n_envs == section(settings)[1]["n_envs"]
    with pytest.raises(ValueError, match="algo must be in"):
        algorithm("nonsense")


@pytest.mark.long
def test_evaluate_runs_as_a_script_with_a_controller(tmp_path):
    arguments = ["--controller", "LQR", "--task", "balance-2", "--episodes", 10, "--steps", 900]
    printed = run_python(EXAMPLES / "evaluate.py", *arguments, cwd=tmp_path)
    assert successes_in(printed) == ("10", "10")


@pytest.mark.long
def test_results_trains_what_is_missing_and_writes_tables_and_curves(tmp_path, monkeypatch):
    pytest.importorskip("torch")
    import algorithms

    monkeypatch.setitem(algorithms.shac.TASKS, "balance-1", {"total_timesteps": 960})
    arguments = ["--out", str(tmp_path), "--tasks", "balance-1", "--seeds", "0", "1"]
    monkeypatch.setattr("sys.argv", ["algorithms.py", *arguments])
    algorithms.main()
    trained = {path: path.stat().st_mtime_ns for path in tmp_path.glob("*.safetensors")}
    algorithms.main()
    assert {path: path.stat().st_mtime_ns for path in tmp_path.glob("*.safetensors")} == trained
    assert len(trained) == 2
    with (tmp_path / "results.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["agent"], row["seed"]) for row in rows] == [
        ("random", ""), ("LQR", ""), ("SHAC", "0"), ("SHAC", "1"),
    ]  # fmt: skip
    assert float(rows[1]["success"]) == 1.0 > float(rows[0]["success"])
    assert (tmp_path / "results.md").read_text().count("\n") == 3
    assert (tmp_path / "curves.png").stat().st_size > 10_000


def test_results_without_a_trained_policy_have_a_table_and_no_curves(tmp_path, monkeypatch):
    pytest.importorskip("torch")
    import algorithms

    row = {"task": "balance-1-cart", "agent": "LQR", "success": 1.0}
    monkeypatch.setattr(algorithms, "references", lambda _task: {"LQR": None})
    monkeypatch.setattr(algorithms, "evaluated", lambda *_: row)
    arguments = ["--tasks", "balance-1-cart", "--agents", "ES", "--out", str(tmp_path)]
    monkeypatch.setattr("sys.argv", ["algorithms.py", *arguments])
    algorithms.main()
    assert {path.name for path in tmp_path.iterdir()} == {"results.csv", "results.md"}


def test_results_of_an_unknown_task_are_refused_before_any_training(tmp_path, monkeypatch, capsys):
    pytest.importorskip("torch")
    import algorithms

    known = {task for trainer in algorithms.TRAINERS.values() for task in trainer.TASKS}
    for task in known | {*algorithms.tasks(), "balance-9"}:
        assert algorithms.task_name(task) == task
    trained = []
    monkeypatch.setattr(algorithms, "train_and_keep", lambda *run: trained.append(run))
    arguments = ["--tasks", "balance-1", "foo", "--out", str(tmp_path)]
    monkeypatch.setattr("sys.argv", ["algorithms.py", *arguments])
    with pytest.raises(SystemExit):
        algorithms.main()
    assert "'foo'" in capsys.readouterr().err
    assert not trained


def test_new_results_join_those_of_other_seeds_and_replace_their_own(monkeypatch):
    pytest.importorskip("torch")
    import algorithms

    def row(agent, seed, success):
        return {"task": "calm-2", "agent": agent, "seed": seed, "success": success}

    before = [row("random", None, 0.0), row("SHAC", 0, 0.1), row("SHAC", 1, 0.2)]
    monkeypatch.setattr(algorithms, "recorded", lambda _name: before)
    new = [row("SHAC", 1, 0.9), row("SHAC", 2, 0.8), row("random", "", 0.01)]
    found = [(each["agent"], each["success"]) for each in algorithms.merged(new, "learning")]
    assert found == [("random", 0.01), ("SHAC", 0.1), ("SHAC", 0.9), ("SHAC", 0.8)]


@pytest.mark.long
def test_algorithms_side_by_side_have_a_row_for_each_run_and_a_picture(
    tmp_path, monkeypatch, capsys
):
    pytest.importorskip("sb3_contrib")
    pytest.importorskip("yaml")
    import side_by_side

    monkeypatch.setitem(side_by_side.shac.TASKS, "balance-1", {"total_timesteps": 960})
    monkeypatch.setattr(side_by_side, "CSV", tmp_path / "rows.csv")
    monkeypatch.setattr(side_by_side, "FIGURE", tmp_path / "rows.png")
    monkeypatch.setattr(side_by_side, "PAGE", tmp_path / "page.md")
    monkeypatch.setattr(side_by_side, "BUDGET", 1.0)
    (tmp_path / "page.md").write_text("before\n\n| algorithm | old |\n\nafter\n")
    agents = ["SHAC", "PPO tuned", "SAC default"]
    arguments = ["--tasks", "balance-1", "--seeds", "0", "--publish"]
    arguments += ["--out", str(tmp_path / "runs"), "--agents", *agents]
    monkeypatch.setattr("sys.argv", ["side_by_side.py", *arguments])
    side_by_side.main()
    first, written = capsys.readouterr().out, (tmp_path / "rows.csv").read_text()
    side_by_side.main()  # all is there: it trains nothing
    assert first.endswith(capsys.readouterr().out)
    assert (tmp_path / "rows.csv").read_text() == written
    rows = list(csv.DictReader(written.splitlines()))
    assert [row["agent"] for row in rows] == agents
    assert all(float(row["seconds"]) >= 1.0 for row in rows[1:])
    assert all(row["episodes"] == "100" for row in rows)
    assert (tmp_path / "rows.png").stat().st_size > 10_000
    page = (tmp_path / "page.md").read_text()
    assert page.startswith("before\n\n| algorithm | balance-1 | mean | interquartile mean |\n")
    assert page.endswith("|\n\nafter\n")
    assert page.count("\n| ") == 1 + len(side_by_side.AGENTS)


@pytest.mark.long
def test_runs_side_by_side_in_a_folder_have_one_budget_and_the_default_is_published(
    tmp_path, monkeypatch, capsys
):
    pytest.importorskip("sb3_contrib")
    pytest.importorskip("yaml")
    import side_by_side

    def run(*arguments):
        row = dict(zip((*side_by_side.KEY, "budget"), arguments, strict=True))
        return row | {"success": 1.0, "seconds": 2.0}

    def main(*arguments):
        chosen = ["--tasks", "balance-1", "--seeds", "0", "--agents", "SHAC", *arguments]
        monkeypatch.setattr("sys.argv", ["side_by_side.py", "--out", str(tmp_path), *chosen])
        side_by_side.main()

    monkeypatch.setattr(side_by_side, "run", run)
    main("--budget", "5")
    assert "| algorithm | balance-1 | mean |" in capsys.readouterr().out  # no rows of 300 s
    with pytest.raises(ValueError, match=r"balance-1-SHAC-0.json has .* 5 s, not 300 s: .* --out"):
        main("--tasks", "balance-2")
    with pytest.raises(SystemExit):
        main("--budget", "5", "--publish")
    assert "--publish needs --budget 300, got 5" in capsys.readouterr().err


@pytest.mark.long
def test_runs_side_by_side_have_any_seed(tmp_path, monkeypatch):
    pytest.importorskip("sb3_contrib")
    pytest.importorskip("yaml")
    import side_by_side

    monkeypatch.setattr(side_by_side, "CSV", tmp_path / "rows.csv")
    for seed in (1000, 2):
        row = dict(zip((*side_by_side.KEY, "budget"), ("balance-1", "SHAC", seed, 5), strict=True))
        (tmp_path / f"{seed}.json").write_text(json.dumps(row))
    assert [row["seed"] for row in side_by_side.collected(tmp_path, 5.0)] == [2, 1000]


@pytest.mark.long
def test_a_run_side_by_side_whose_file_cannot_be_whole_leaves_none(tmp_path, monkeypatch):
    pytest.importorskip("sb3_contrib")
    pytest.importorskip("yaml")
    import side_by_side

    def replace(*_paths):
        raise OSError(errno.ENOSPC, "the disk is full")

    monkeypatch.setattr(side_by_side, "run", lambda *_: {"success": 1.0, "seconds": 2.0})
    monkeypatch.setattr(_files.disk, "replace", replace)
    monkeypatch.setattr("sys.argv", ["side_by_side.py", "--out", str(tmp_path)])
    with pytest.raises(OSError, match="the disk is full"):
        side_by_side.main()
    assert not list(tmp_path.iterdir())


@pytest.mark.long
def test_train_torchrl_writes_a_policy_that_can_be_evaluated(script, tmp_path):
    pytest.importorskip("torchrl")
    arguments = ["swingup-1", "--steps", 8192, "--out", "."]
    out = run_python("-W", "ignore", EXAMPLES / "train_torchrl.py", *arguments, cwd=tmp_path)
    assert "'steps': 8192, 'return': " in out
    policy = Policy.load(tmp_path / "swingup-1.safetensors")
    assert policy.scale.tolist() == [1.0, 1.0, 5.0]
    assert [weight.shape for weight in policy.weights] == [(64, 3), (64, 64), (1, 64)]
    assert successes_in(script("evaluate.py", "--policy", "swingup-1.safetensors"))[1] == "100"


def test_train_rllib_runs_one_iteration(tmp_path):
    pytest.importorskip("ray.rllib")
    arguments = ["--iterations", 1, "--runners", 1, "--batch", 512]
    out = run_python("-W", "ignore", EXAMPLES / "train_rllib.py", *arguments, cwd=tmp_path)
    assert "iteration 1: 512 steps" in out


@pytest.mark.long
def test_results_renews_the_rows_that_need_no_training(tmp_path, monkeypatch):
    pytest.importorskip("torch")
    import algorithms

    for name in ("results.md", "results/learning.csv"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / "docs" / name, tmp_path / name)
    before = algorithms.recorded()
    monkeypatch.setattr(algorithms, "DOCS", tmp_path)
    arguments = ["--again", "--out", str(tmp_path), "--tasks", "balance-1"]
    monkeypatch.setattr("sys.argv", ["algorithms.py", *arguments])
    for row in before:
        row["return"] = row["success"] = 0.5
    algorithms.write_csv(tmp_path / "results" / "learning.csv", before)
    algorithms.main()
    renewed = [row for row in algorithms.recorded() if row["return"] != 0.5]
    assert [(row["agent"], row["success"]) for row in renewed] == [
        ("random", 0.0), ("LQR", 1.0), ("SHAC", 1.0),
    ]  # fmt: skip
    assert len(algorithms.recorded()) == len(before)
    assert algorithms.table(algorithms.recorded()) in (tmp_path / "results.md").read_text()


@pytest.mark.long
def test_the_table_in_the_docs_is_that_of_the_recorded_results():
    pytest.importorskip("torch")
    from algorithms import recorded, table

    assert table(recorded()) in (ROOT / "docs" / "results.md").read_text(encoding="utf-8")


def test_the_table_of_robustness_in_the_docs_is_that_of_the_recorded_results():
    pytest.importorskip("torch")
    from robustness import PAGE, TASKS, cases, recorded, success_of, table

    rows = recorded()
    assert table(rows) in PAGE.read_text(encoding="utf-8")
    success = success_of(rows)
    assert len(success) == 2 * sum(len(cases(int(task[-1]))) for task in TASKS)
    whole = [success[f"{task}-robust", "drawn from the whole range"] for task in TASKS]
    assert min(whole) >= 0.95
