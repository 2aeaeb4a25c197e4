"""Every training script runs for a short time, and `npend evaluate` takes what it writes."""

import csv
import errno
import importlib
import inspect
import json
import os
import re
import shutil

import gymnasium as gym
import numpy as np
import pytest
from scripts import run_python, run_script
from test_examples import ROOT

from npend_gym import rl
from npend_gym.rl import Policy
from npend_gym.rl.evaluation import episodes
from npend_gym.rl.training.tasks import env_of_task

EXAMPLES = ROOT / "examples"


@pytest.fixture
def script(tmp_path):
    """A function that runs a script of `examples/` in `tmp_path` and returns its output."""
    return lambda name, *arguments: run_script(EXAMPLES / name, *arguments, cwd=tmp_path)


@pytest.fixture
def call(monkeypatch):
    """A function that calls `main` of a script with arguments of the command line."""

    def run(script, *arguments):
        monkeypatch.setattr("sys.argv", [f"{script.__name__}.py", *map(str, arguments)])
        script.main()

    return run


def imported(script, *libraries):
    """Return a script as a module, where the libraries that it needs are installed."""
    for library in libraries:
        pytest.importorskip(library)
    return importlib.import_module(script)


@pytest.fixture
def train_sb3():
    return imported("train_sb3", "stable_baselines3", "yaml")


@pytest.fixture
def algorithms():
    return imported("algorithms", "torch")


def config_of(name):
    """Return what a file of `examples/configs/` holds."""
    yaml = pytest.importorskip("yaml")
    return yaml.safe_load((EXAMPLES / "configs" / f"{name}.yml").read_text())


TINY = {
    "env_kwargs": {"n": 1, "max_episode_steps": 20}, "n_envs": 2, "n_timesteps": 96,
    "policy": "MlpPolicy", "n_steps": 16, "batch_size": 32, "n_epochs": 1,
}  # fmt: skip


def tiny_config(env_id="npend/Balance-v1", **changes):
    """Return the settings of a training that takes a second."""
    return {"algo": "ppo", env_id: TINY | changes}


def write_config(path, *arguments, **changes):
    path.write_text(json.dumps(tiny_config(*arguments, **changes)))  # which YAML reads too


def successes_in(text):
    return re.search(r"success  (\d+)/(\d+) = \S+, 95 % confidence", text).groups()


def test_evaluate_films_a_policy(script, tmp_path):
    pytest.importorskip("pygame")
    arguments = ["--episodes", 5, "--steps", 30, "--video", "a.gif", "--seconds", 0.5]
    printed = script("evaluate.py", "--pretrained", "swingup-1", *arguments)
    assert "'max_episode_steps': 30" in printed
    assert successes_in(printed) == ("0", "5")
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

    imported("evaluate").film(act, {"n": 1} | keywords, 0, 0.25, tmp_path / "a.gif")
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


@pytest.mark.nightly
@pytest.mark.long
def test_train_sb3_balances_two_rods_with_the_settings_of_its_file(script, tmp_path):
    script("train_sb3.py", "balance-2", "--seed", 1, "--out", "a")
    card = (tmp_path / "a" / "README.md").read_text()
    assert json.loads(re.search(r"```json\n(.*?)```", card, re.DOTALL)[1])["return"] > 990.0


@pytest.mark.long
def test_train_sb3_finds_every_algorithm_by_its_name_in_small_letters(train_sb3):
    theirs = pytest.importorskip("sb3_contrib")
    for known in (theirs.CrossQ, theirs.TQC, theirs.RecurrentPPO):
        assert train_sb3.algorithm(known.__name__.lower()) is known


def test_a_checkpoint_of_train_sb3_keeps_the_statistics_of_observations(train_sb3, tmp_path):
    import torch

    from npend_gym.rl.evaluation.models import as_controller

    config = config_of("balance-2")
    config["npend/Balance-v1"]["normalize"] = {"norm_obs": True, "norm_reward": False}
    model = train_sb3.make_model(config, seed=0)
    model.learn(4096)
    (tmp_path / "config.yml").write_text(json.dumps(config))
    torch.save(train_sb3.state_of(model), tmp_path / "best.pth")
    again, _ = train_sb3.load_run(tmp_path)
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


def test_a_resumed_run_of_train_sb3_keeps_the_best_weights(train_sb3, call, tmp_path, monkeypatch):
    """The settings of the resumed run are those in its own folder."""
    import torch

    scores = iter([0.2, 0.9, 0.5, 0.4, *[0.3] * 9])

    def scored(*_arguments, **_options):
        return {"success": next(scores), "return": 0.0, "motor_work": 0.0}

    def train(path, *arguments):
        call(train_sb3, path, "--out", tmp_path / "a", "--every", 32, *arguments)
        return [
            torch.load(tmp_path / "a" / f"{name}.pth", weights_only=True)["steps"]
            for name in ("best", "last")
        ]

    monkeypatch.setattr(train_sb3, "score_of", scored)
    write_config(tmp_path / "tiny.yml")
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
    train_sb3, call, tmp_path, monkeypatch, capsys
):
    import torch

    def run(name, *arguments):
        call(train_sb3, tmp_path / f"{name}.yml", "--out", tmp_path / "a", *arguments)

    def refusal(*arguments):
        with pytest.raises(SystemExit):
            run(*arguments)
        return capsys.readouterr().err

    def fails(_state, path):
        path.write_bytes(b"a half")
        raise OSError(errno.ENOSPC, "the disk is full")

    score = {"success": 0.5, "return": 0.0, "motor_work": 0.0}
    monkeypatch.setattr(train_sb3, "score_of", lambda *_arguments, **_options: score)
    write_config(tmp_path / "tiny.yml")
    write_config(tmp_path / "other.yml", "npend/SwingUp-v1")
    assert "--resume needs the checkpoint" in refusal("tiny", "--resume")
    assert not (tmp_path / "a").exists()
    run("tiny")
    kept = ["best.pth", "config.yml", "last.pth"]
    before = [(tmp_path / "a" / name).read_bytes() for name in kept]
    assert "continue its run with --resume" in refusal("tiny")
    assert "other.yml differs from" in refusal("other", "--resume")
    assert "needs the seed of the run, 0; got 1" in refusal("tiny", "--resume", "--seed", 1)
    score["success"] = 0.6
    monkeypatch.setattr(torch, "save", fails)
    with pytest.raises(OSError, match="the disk is full"):
        run("tiny", "--resume", "--steps", 160)
    assert [(tmp_path / "a" / name).read_bytes() for name in kept] == before


@pytest.mark.parametrize(
    ("env_id", "mode"), [("evil:npend/Balance-v1", "balance"), ("npend/Balance-v1", "evil:Mode")]
)
def test_a_run_of_train_sb3_imports_what_its_file_names_only_when_trusted(
    env_id, mode, train_sb3, tmp_path
):
    path = tmp_path / "config.yml"
    write_config(path, env_id, env_kwargs=TINY["env_kwargs"] | {"mode": mode})
    with pytest.raises(ValueError, match=r"names 'evil:.*', which is imported only with --trust"):
        train_sb3.load_run(tmp_path)
    with pytest.raises((ImportError, ValueError), match="evil"):  # it tries to
        train_sb3.load_run(tmp_path, trust=True)
    write_config(path, "npend_gym:npend/Balance-v1")
    with pytest.raises(FileNotFoundError, match=r"best\.pth"):  # it has come so far
        train_sb3.load_run(tmp_path)


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
        ("campaign", "psutil", ["--rounds", "0"]),
        ("value_iteration", "torch", ["--updates", "0"]),
    ],
)
def test_scripts_refuse_no_steps_and_do_not_take_the_default(
    script, library, arguments, call, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit):
        call(imported(script, library), *arguments)
    assert "must be at least 1" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("script", "library", "arguments", "message"),
    [
        ("evaluate", "torch", ["--pretrained", "swingup-1", "--task", "calm-2"], "--task is for"),
        ("evaluate", "torch", ["--run", "a", "--env-id", "b"], "--env-id is not for --run"),
        ("transitions", "torch", ["2", "--policy", "a", "--plans", "b"], "not allowed with"),
        ("side_by_side", "sb3_contrib", ["--steps", "9"], "--steps must be at least 40, got 9"),
        ("train_many_n", "stable_baselines3", ["--steps", "9"], "--steps must be at least 4096"),
        ("train_many_n", "stable_baselines3", ["--episodes", "0"], "--episodes must be at least 1"),
        ("soak", "psutil", ["steps", "--steps", "4"], "steps needs at least 5, got 4"),
        ("evaluate_engines", "scipy", ["--derivatives", "--engine", "heyoka", "--case", "long"],
         "there are no derivatives of heyoka, long"),
    ],
)  # fmt: skip
def test_scripts_refuse_options_that_would_do_nothing(
    script, library, arguments, message, call, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit):
        call(imported(script, library), *arguments)
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("script", "arguments"),
    [("evaluate", ["--pretrained", "swingup-1", "--video"]), ("value_iteration", ["--out"])],
)
def test_scripts_check_the_name_of_their_file_before_any_work(script, arguments, call, tmp_path):
    with pytest.raises(ValueError, match="must be a file that ends in"):
        call(imported(script, "torch"), *arguments, tmp_path / "a.txt")


def test_transitions_judges_a_policy_in_its_own_environment(call, tmp_path, monkeypatch, capsys):
    import transitions

    def rollout(_controller, envs, *_):
        judged.append(envs.unwrapped.config)
        assert (tmp_path / "new").is_dir()  # before any work
        return []

    env, judged = {"n": 1, "mode": "transition", "lengths": 0.5, "max_torque": 20.0}, []
    observed = transitions.setting_of(env).config.observed
    path = tmp_path / "a.safetensors"
    zeros = np.zeros((1, observed), np.float32)
    Policy(np.ones(observed, np.float32), [zeros], [np.zeros(1, np.float32)], env).save(path)
    monkeypatch.setattr(episodes, "rollout", rollout)
    call(transitions, 1, "--policy", path, "--csv", tmp_path / "new" / "table.csv")
    assert [config.chain.lengths.tolist() for config in judged] == [[0.5]] * 2
    assert (tmp_path / "new" / "table.csv").exists()
    for arguments, mode in ([2, "--policy", path], "transition"), (
        [1, "--pretrained", "swingup-1"], "swingup"
    ):  # fmt: skip
        with pytest.raises(SystemExit):
            call(transitions, *arguments)
        assert f'got "{mode}" with n=1' in capsys.readouterr().err
    assert len(judged) == 2


def test_transitions_counts_an_episode_that_ends_early_as_it_ended(monkeypatch):
    import transitions

    def rollout(*_):
        for running, time in ((True, 1.0), (False, 2.0)):  # then the next episode has begun
            succeeds = np.full(transitions.EPISODES, not running)
            info = still | {"success": succeeds, "time": np.full(succeeds.size, time)}
            yield ~succeeds, still, np.zeros(succeeds.size), info

    columns = np.zeros((transitions.EPISODES, 1))
    still = {"theta": columns, "omega": columns}
    still |= {"cart_position": columns[:, 0], "cart_velocity": columns[:, 0]}

    monkeypatch.setattr(episodes, "rollout", rollout)
    rows = transitions.evaluated_pairs(
        lambda *_: None, {"n": 1, "mode": "transition", "base": "cart"}
    )
    assert [row["success"] for row in rows] == [0, 0]


@pytest.mark.parametrize(
    ("env_id", "normalize"),
    [("Balance", True), ("Balance", "dict(norm_obs=False)"), ("Transition", True)],
)
def test_a_checkpoint_of_train_sb3_keeps_the_statistics_of_returns(
    env_id, normalize, train_sb3, tmp_path
):
    import torch

    own = {"goal_env": True, "reward_type": "sparse"} if env_id == "Transition" else {}
    settings = {"normalize": normalize, "env_kwargs": TINY["env_kwargs"] | own}
    settings["policy"] = "MultiInputPolicy" if own else "MlpPolicy"
    config = tiny_config(f"npend/{env_id}-v1", **settings)
    models = [train_sb3.make_model(config, seed) for seed in (0, 1)]
    models[0].learn(32)
    torch.save(train_sb3.state_of(models[0]), tmp_path / "last.pth")
    train_sb3.restore(models[1], tmp_path / "last.pth")
    states = [train_sb3.state_of(model) for model in models]
    assert repr(states[1]) == repr(states[0])
    assert states[0]["returns"]["count"] > 32


def test_train_sb3_reads_settings_as_rl_zoo_writes_them(train_sb3):
    settings = {
        "normalize": "{'norm_obs': True, 'norm_reward': False}", "clip_range": "lin_0.2",
        "policy_kwargs": "dict(ortho_init=False, net_arch=dict(pi=[8], vf=[16]))",
    }  # fmt: skip
    model = train_sb3.make_model(tiny_config(**settings), seed=0)
    venv = model.get_vec_normalize_env()
    assert (venv.norm_obs, venv.norm_reward) == (True, False)
    assert model.policy_kwargs == {"ortho_init": False, "net_arch": {"pi": [8], "vf": [16]}}
    assert [model.clip_range(left) for left in (1.0, 0.5, -0.1)] == [0.2, 0.1, 0.0]
    assert model.learning_rate == 3e-4  # the default
    settings["policy_kwargs"] = "dict(activation_fn=nn.ReLU)"
    with pytest.raises(ValueError, match=r"policy_kwargs must have numbers.*nn\.ReLU"):
        train_sb3.make_model(tiny_config(**settings), seed=0)
    with pytest.raises(ValueError, match="algo must be in"):
        train_sb3.make_model(tiny_config() | {"algo": "nonsense"}, seed=0)
    for wrong in (None, "a text", {"algo": "ppo"}, {"npend/Balance-v1": TINY},
                  {"algo": "ppo", "npend/Balance-v1": {"policy": "MlpPolicy"}}):  # fmt: skip
        with pytest.raises(ValueError, match=r"must have a line `algo`, and one section"):
            train_sb3.make_model(wrong, seed=0)


@pytest.mark.long
@pytest.mark.filterwarnings("ignore")  # those of torchrl itself
@pytest.mark.parametrize("task", ["transition-1", "balance-1-cart"])
def test_train_torchrl_takes_tasks_with_goals_and_with_a_cart(task):
    script = imported("train_torchrl", "torchrl")
    settings = script.settings_of(task, num_envs=2)
    observation = script.make_env(settings).reset()["observation"]
    assert script.obs_scale(settings).shape == observation.shape[1:]
    assert script.obs_scale(settings)[:3].tolist() == [1.0, 1.0, 5.0]


CONFIGS = sorted(path.stem for path in (EXAMPLES / "configs").glob("*.yml"))


@pytest.mark.parametrize("config", CONFIGS)
def test_rl_zoo_and_train_sb3_train_what_the_config_is_named_after(config, train_sb3):
    """Read the file as rl_zoo3.exp_manager does: by the id, `env_kwargs` within the section."""
    by_id = config_of(config)
    if by_id["algo"] == "tqc":
        pytest.importorskip("sb3_contrib")
    model = train_sb3.make_model(config_of(config), seed=0)
    assert isinstance(model, train_sb3.algorithm(by_id.pop("algo")))  # an argument in RL Zoo
    ((env_id, hyperparams),) = by_id.items()
    env = gym.spec(env_id).make(**hyperparams.pop("env_kwargs", {}))
    mode, n = config.split("-")[:2]
    assert (env.unwrapped.config.mode.name, env.unwrapped.config.n) == (mode, int(n))
    assert env.spec.max_episode_steps <= 500
    assert set(hyperparams.pop("normalize", {})) <= {"norm_obs", "norm_reward"}
    assert hyperparams.pop("n_envs", 1) == model.n_envs > 1
    assert int(hyperparams.pop("n_timesteps")) >= 10_000
    if isinstance(hyperparams["learning_rate"], str):
        kind, initial = hyperparams["learning_rate"].split("_")
        assert kind == "lin"
        assert float(initial) > 0.0
    assert set(hyperparams) < set(inspect.signature(type(model)).parameters)


@pytest.mark.parametrize("task", ["swingup-1-robust", "calm-2-robust"])
def test_the_configs_of_robust_policies_draw_the_chains_of_the_task(task):
    env = env_of_task(task)
    shown = next(value for key, value in config_of(task).items() if key != "algo")["env_kwargs"]
    assert shown.pop("max_episode_steps") <= 400
    assert shown == {name: env[name] for name in ("n", "randomize")}


def test_the_records_of_robust_policies_say_which_chains_they_were_shown():
    pytest.importorskip("torch")
    from npend_gym.rl.training.imitation_settings import ERRORS

    trained = Policy.pretrained("swingup-1-robust")
    assert trained.env["randomize"] == trained.provenance["arguments"]["env"]["randomize"]
    assert trained.env["randomize"] == env_of_task("swingup-1-robust")["randomize"]
    imitates = Policy.pretrained("calm-2-robust").provenance["arguments"]  # nominal chain in `env`
    assert imitates["errors"] == ERRORS


@pytest.mark.long
def test_results_trains_what_is_missing_and_writes_tables_and_curves(
    algorithms, call, tmp_path, monkeypatch
):
    monkeypatch.setitem(algorithms.shac.TASKS, "balance-1", {"total_timesteps": 960})
    arguments = ["--out", tmp_path, "--tasks", "balance-1", "--seeds", 0, 1]
    call(algorithms, *arguments)
    trained = {path: path.stat().st_mtime_ns for path in tmp_path.glob("*.safetensors")}
    call(algorithms, *arguments)
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


def test_recipes_are_run_once_for_each_seed_and_their_rates_published(call, tmp_path, monkeypatch):
    recipes = imported("recipes")
    blocks = "```python\nrng = default_rng(0)\n```\n\n```python\nplay(seed=0, n=0)\n```\n"
    (tmp_path / "page.md").write_text(f"# A page\n\n## Train\n\n{blocks}\n## Film\n\n{blocks}")
    code = recipes.code_of(f"{tmp_path}/page.md#Train", 5)
    assert code.endswith("\nrng = default_rng(5)\nplay(seed=5, n=0)\n")
    given = {"cheap": "echo 'success  9{seed}/100'", "dear": "npend train swingup-9 --seed {seed}"}
    monkeypatch.setattr(recipes, "RECIPES", given)
    monkeypatch.setattr(recipes, "CSV", tmp_path / "rows.csv")
    monkeypatch.setattr(recipes, "PAGE", tmp_path / "rates.md")
    (tmp_path / "rates.md").write_text(f"before\n\n{recipes.HEAD}| old |\n\nafter\n")
    arguments = ["--out", tmp_path / "runs", "--recipes", "cheap", "--seeds", 4, 6, "--publish"]
    call(recipes, *arguments)
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / "runs").iterdir()}
    call(recipes, *arguments)
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "runs").iterdir()} == kept
    assert len(kept) == 2
    text = (tmp_path / "rates.md").read_text()
    assert "/100'` | 1 of 2 | 94% | 0 s |\n" in text
    assert text.endswith("| `npend train swingup-9` | not run | | |\n\nafter\n")
    assert recipes.success_in("{'success': 0.98, 'return': 9}") == 0.98
    assert recipes.success_in("after 9 of 20: none\nbrought to rest: 20%") == 0.2
    assert recipes.success_in("64 of 64 stay up") == 1.0
    with pytest.raises(ValueError, match="must print its success"):
        recipes.success_in("nothing")


def test_the_table_of_recipes_in_the_notes_is_that_of_the_recorded_runs():
    from recipes import CSV, PAGE, table

    with CSV.open() as file:
        assert table(list(csv.DictReader(file))) in PAGE.read_text("utf-8")


def test_results_without_a_trained_policy_have_a_table_and_no_curves(
    algorithms, call, tmp_path, monkeypatch
):
    row = {"task": "balance-1-cart", "agent": "LQR", "success": 1.0}
    monkeypatch.setattr(algorithms, "references", lambda _task: {"LQR": None})
    monkeypatch.setattr(algorithms, "evaluated", lambda *_: row)
    call(algorithms, "--tasks", "balance-1-cart", "--agents", "ES", "--out", tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"results.csv", "results.md"}


def test_results_of_an_unknown_task_are_refused_before_any_training(
    algorithms, call, tmp_path, monkeypatch, capsys
):
    known = {task for trainer in algorithms.TRAINERS.values() for task in trainer.TASKS}
    for task in known | {*algorithms.tasks(), "balance-9"}:
        assert algorithms.task_name(task) == task
    trained = []
    monkeypatch.setattr(algorithms, "train_and_keep", lambda *run: trained.append(run))
    with pytest.raises(SystemExit):
        call(algorithms, "--tasks", "balance-1", "foo", "--out", tmp_path)
    assert "'foo'" in capsys.readouterr().err
    assert not trained


def test_new_results_join_those_of_other_seeds_and_replace_their_own(algorithms, monkeypatch):
    def row(agent, seed, success):
        return {"task": "calm-2", "agent": agent, "seed": seed, "success": success}

    before = [row("random", None, 0.0), row("SHAC", 0, 0.1), row("SHAC", 1, 0.2)]
    monkeypatch.setattr(algorithms, "recorded", lambda _name: before)
    new = [row("SHAC", 1, 0.9), row("SHAC", 2, 0.8), row("random", "", 0.01)]
    found = [(each["agent"], each["success"]) for each in algorithms.merged(new, "learning")]
    assert found == [("random", 0.01), ("SHAC", 0.1), ("SHAC", 0.9), ("SHAC", 0.8)]


def test_the_policy_that_is_shipped_is_chosen_by_validation_episodes(
    algorithms, tmp_path, monkeypatch
):
    class Trained:
        def __init__(self, path):
            self.seed = int(path.stem[-1])
            self.provenance = {"evaluation": {"success": 1.0 - 0.5 * self.seed}}  # held out

        def save(self, path):
            path.write_text(str(self.seed))

    for name in ("publish_rows", "merged", "write_csv", "draw"):
        monkeypatch.setattr(algorithms, name, lambda *_: [])
    monkeypatch.setattr(algorithms, "pretrained_names", list)
    monkeypatch.setattr(algorithms, "PRETRAINED", tmp_path)
    monkeypatch.setattr(algorithms.Policy, "load", Trained)
    rows = [{"task": "calm-2", "agent": "SHAC", "seed": seed} for seed in (0, 1)]
    monkeypatch.setattr(algorithms, "score", lambda _, policy: (scores[policy.seed], 0.0, 0))
    for success in (0.9, 0.95):
        scores = [0.5, success]
        algorithms.publish(rows, [], tmp_path)
        assert [path.read_text() for path in tmp_path.iterdir()] == ["1"] * (success > 0.9)


@pytest.mark.long
def test_train_torchrl_writes_a_policy_that_can_be_evaluated(script, tmp_path):
    pytest.importorskip("torchrl")
    arguments = ["swingup-1", "--steps", 8192, "--out", "."]
    only = ("-W", "ignore", "-W", "error::FutureWarning")
    out = run_python(*only, EXAMPLES / "train_torchrl.py", *arguments, cwd=tmp_path)
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
def test_rllib_plays_the_same_episodes_in_native_and_in_single_environments():
    pytest.importorskip("ray.rllib")
    code = """
import ray, torch
from train_rllib import PPOConfig, TASK, TASK_ID
ray.init(num_cpus=1, include_dashboard=False, log_to_driver=False)
for mode in ("vector_entry_point", "sync"):
    config = PPOConfig().environment(TASK_ID, env_config=TASK)
    config.env_runners(num_env_runners=0, num_envs_per_env_runner=2, gym_env_vectorize_mode=mode)
    config.training(train_batch_size_per_learner=402, minibatch_size=201, num_epochs=1)
    algorithm = config.debugging(seed=0).build_algo()
    returns = [algorithm.train()["env_runners"]["episode_return_mean"] for _ in range(2)]
    print(type(algorithm.env_runner.env.unwrapped).__name__, *returns)
"""
    paths = os.environ | {"PYTHONPATH": f"{EXAMPLES}{os.pathsep}{EXAMPLES.parent}"}
    out = run_python("-W", "ignore", "-c", code, env=paths).splitlines()
    rows = dict(line.split(" ", 1) for line in out if "VectorEnv" in line)
    assert rows.keys() == {"NPendulumVectorEnv", "SyncVectorEnv"}
    assert rows["NPendulumVectorEnv"] == rows["SyncVectorEnv"]
    assert "nan" not in rows["SyncVectorEnv"]


@pytest.mark.long
@pytest.mark.parametrize("library", ["skrl", "tianshou"])
def test_ppo_of_another_library_brings_a_rod_to_rest(library, tmp_path):
    pytest.importorskip(library)
    out = run_python("-W", "ignore", EXAMPLES / f"train_{library}.py", cwd=tmp_path)
    assert out.splitlines()[-1] == "brought to rest: 100%"


@pytest.mark.long
def test_one_network_learns_chains_of_several_lengths(script):
    pytest.importorskip("stable_baselines3")
    printed = script("train_many_n.py", "--steps", 8192, "--episodes", 3)
    rows = re.findall(r"n = (\d): success (\d)/3", printed)
    assert [n for n, _ in rows] == ["1", "2", "3", "4"]
    assert printed.endswith(f"all: success {sum(int(met) for _, met in rows)}/12\n")


@pytest.mark.long
@pytest.mark.nightly
def test_imitation_learns_to_hold_two_poles_with_three_forces(script):
    printed = script("puffer_double_pendulum.py", "--rounds", 3, "--episodes", 20)
    found = re.search(r"(\d+\.\d) \+- \d+\.\d of 600 steps held", printed)
    assert float(found[1]) > 100.0  # 514 with 100 episodes; without learning none


@pytest.mark.long
def test_skrl_renders_the_native_environment_unless_it_is_headless(tmp_path):
    pytest.importorskip("skrl")
    pytest.importorskip("pygame")
    code = """
import gymnasium, npend_gym
from skrl.envs.wrappers.torch import wrap_env
envs = gymnasium.make_vec("npend/Calm-v1", num_envs=2, render_mode="rgb_array", render_size=40)
env = wrap_env(envs, wrapper="gymnasium")
env.reset()
print([picture.shape for picture in env.render()])
"""
    out = run_python("-W", "ignore", "-c", code, cwd=tmp_path)
    assert out == "[(40, 40, 3), (40, 40, 3)]\n"


@pytest.mark.long
@pytest.mark.nightly
def test_results_renews_the_rows_that_need_no_training(algorithms, call, tmp_path, monkeypatch):
    for name in ("results.md", "results/learning.csv"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / "docs" / name, tmp_path / name)
    before = algorithms.recorded()
    monkeypatch.setattr(algorithms, "DOCS", tmp_path)
    for row in before:
        row["return"] = row["success"] = 0.5
    algorithms.write_csv(tmp_path / "results" / "learning.csv", before)
    call(algorithms, "--again", "--out", tmp_path, "--tasks", "balance-1")
    renewed = [row for row in algorithms.recorded() if row["return"] != 0.5]
    assert [(row["agent"], row["success"]) for row in renewed] == [
        ("random", 0.0), ("LQR", 1.0), ("SHAC", 1.0),
    ]  # fmt: skip
    assert len(algorithms.recorded()) == len(before)
    assert algorithms.table(algorithms.recorded()) in (tmp_path / "results.md").read_text()


@pytest.mark.long
def test_the_table_in_the_docs_is_that_of_the_recorded_results(algorithms):
    table = algorithms.table(algorithms.recorded())
    assert table in (ROOT / "docs" / "results.md").read_text(encoding="utf-8")


def test_the_table_of_robustness_in_the_docs_is_that_of_the_recorded_results():
    pytest.importorskip("torch")
    from algorithms import recorded
    from robustness import PAGE, TASKS, cases, success_of, table

    rows = recorded("robustness")
    assert table(rows) in PAGE.read_text(encoding="utf-8")
    success = success_of(rows)
    assert len(success) == 2 * sum(len(cases(int(task[-1]))) for task in TASKS)
    whole = [success[f"{task}-robust", "drawn from the whole range"] for task in TASKS]
    assert min(whole) >= 0.95


def test_unseen_errors_are_in_no_criterion_and_their_table_is_that_of_the_recorded_results():
    pytest.importorskip("torch")
    from algorithms import recorded
    from robustness import LONGER, NOMINAL, UNSEEN_PAGE, success_of, unseen_cases, unseen_table

    tried = {
        name for each in unseen_cases("swingup-2").values() for name in each.get("randomize", ())
    }
    config = rl.setting_of(Policy.pretrained("swingup-2").env).config
    for name, criterion in rl.CRITERIA.items():
        if isinstance(criterion, rl.Criterion):
            assert not tried & set(criterion.keywords(config, 0.01)), name
    # those of the chain that are zero there no criterion changes, but damping and friction
    for name in tried - {"gravity", "torque_ripple", "push_rate", "push_force"}:
        assert name not in ("damping", "friction")
        assert not getattr(config.chain, name).any()
    rows = recorded("unseen_errors")
    assert unseen_table(rows) in UNSEEN_PAGE.read_text(encoding="utf-8")
    success = success_of(rows)
    assert [*success] == [(name, case) for name in LONGER for case in unseen_cases("swingup-2")]
    assert all(success[name, NOMINAL] >= 0.95 for name in LONGER)


def test_errors_of_motor_and_sensors_act_between_policy_and_environment():
    pytest.importorskip("torch")
    from robustness import env_with

    env = {"n": 2, "mode": "swingup", "observation": "sincos", "max_episode_steps": 1}
    seen = []

    def model(observation, info):
        seen.append((observation, info["theta"]))
        return np.full((len(observation), 1), 0.6)

    step = 12.0**0.5 * 0.1  # 0.6 is rounded to two steps
    made = env_with(env, weaker=0.25, coarse=0.1, offset=0.3)
    given = rl.evaluate(model, made, episodes=1, seed=0).returns
    (observation, theta), *_ = seen
    assert observation[0, :2] == pytest.approx(np.sin(theta[0] + 0.3), abs=1e-6)
    assert observation[0, 2:4] == pytest.approx(np.cos(theta[0] + 0.3), abs=1e-6)

    def exact(observation, info):  # noqa: ARG001
        return np.full((len(observation), 1), 0.75 * 2 * step)

    assert given == pytest.approx(rl.evaluate(exact, env, episodes=1, seed=0).returns, rel=1e-9)
