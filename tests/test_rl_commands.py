"""`npend train` and `npend evaluate`, and the trainers and controllers that they call."""

import csv
import hashlib
import json
import re
import sys
from dataclasses import asdict

import gymnasium as gym
import numpy as np
import pytest
from interrupt import Interrupt

from npend_gym import Chain
from npend_gym.cli import main
from npend_gym.rl import PRETRAINED, Policy, evaluate, pretrained_names, robustness
from npend_gym.rl.controllers.references import CONTROLLERS, reference_controller
from npend_gym.rl.training.tasks import env_of_task


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """The folder into which a command has trained swingup-1, too short a time for success."""
    pytest.importorskip("torch")
    out = tmp_path_factory.mktemp("trained")
    arguments = ["--seed", "3", "--set", "total_timesteps=960", "--env", "spread=0.001"]
    assert main(["train", "swingup-1", *arguments, "--out", str(out)]) == 1
    return out


def test_train_writes_a_policy_its_learning_curve_and_what_made_it(trained):
    policy = Policy.load(trained / "swingup-1.safetensors")
    assert [weight.shape for weight in policy.weights] == [(64, 3), (64, 64), (1, 64)]
    assert policy.env == env_of_task("swingup-1") | {"spread": 0.001}
    about = policy.provenance
    assert (about["trained_by"], about["training"]["steps"]) == ("shac", 960)
    assert (about["seed"], about["arguments"]["total_timesteps"]) == (3, 960)
    assert about["evaluation"] == evaluate(policy, policy.env).as_row()
    with (trained / "swingup-1.csv").open() as file:
        assert [int(row["steps"]) for row in csv.DictReader(file)] == [320, 640, 960]


def test_a_training_with_discrete_actions_is_judged_with_them(tmp_path, monkeypatch):
    imitation = pytest.importorskip("npend_gym.rl.training.imitation")
    policy = Policy.pretrained("swingup-1")
    monkeypatch.setattr(imitation, "train", lambda *_: (policy, [{"steps": 1}]))
    arguments = ["--algorithm", "imitation", "--env", "torque_levels=3", "--out", str(tmp_path)]
    assert main(["train", "swingup-1", *arguments]) == 0
    judged = Policy.load(tmp_path / "swingup-1.safetensors").provenance["evaluation"]
    assert judged == evaluate(policy, policy.env | {"torque_levels": 3}).as_row()
    assert judged != evaluate(policy, policy.env).as_row()


@pytest.mark.long
def test_evaluate_tells_what_evaluate_and_robustness_return(trained, tmp_path, capsys):
    path = trained / "swingup-1.safetensors"
    options = ["--episodes", "5", "--seed", "7", "--env", "max_torque=6.0"]
    arguments = [*options, "--robust", "--json", "--out", str(tmp_path)]
    assert main(["evaluate", str(path), *arguments]) == 0
    told = json.loads(capsys.readouterr().out)
    policy = Policy.load(path)
    keywords = policy.env | {"max_torque": 6.0}
    assert told["evaluation"] == evaluate(policy, keywords, episodes=5, seed=7).as_row()
    assert told["robustness"] == robustness(policy, keywords, seed=7).as_dict()
    assert told["provenance"]["arguments"]["env"]["max_torque"] == 6.0
    named = {"name": "swingup-1"} | told["robustness"]
    assert json.loads((tmp_path / "robustness.json").read_text()) == named
    assert (tmp_path / "robustness.png").read_bytes()[:4] == b"\x89PNG"
    written = json.loads((tmp_path / "evaluation.json").read_text())
    assert written["evaluation"]["episodes"] == 5
    assert "robustness" not in written


def test_evaluate_takes_controllers_by_name(capsys):
    arguments = ["--controller", "LQR", "--task", "balance-2", "--episodes", "10"]
    assert main(["evaluate", *arguments, "--env", "max_episode_steps=300"]) == 0
    assert "success  10/10 = 100.0%" in capsys.readouterr().out


def test_evaluate_makes_a_controller_for_the_environment_of_the_id(capsys):
    arguments = ["--controller", "LQR", "--task", "balance-3", "--env", "base=cart"]
    arguments += ["--env-id", "npend/CartTriplePole-v1", "--episodes", "20"]
    assert main(["evaluate", *arguments]) == 0
    assert "success  20/20" in capsys.readouterr().out


def test_evaluate_writes_which_policy_or_controller_it_judged(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "npend_gym.report.style", None)  # importing it fails
    short = ["--episodes", "2", "--env", "max_episode_steps=3", "--out", str(tmp_path)]

    def judged(*words):
        assert main(["evaluate", *words, *short]) == 0
        manifest = json.loads((tmp_path / "manifest.json").read_text())
        evaluation = json.loads((tmp_path / "evaluation.json").read_text())
        made = evaluation["provenance"]["arguments"]
        assert made == manifest["provenance"]["arguments"]
        return made, capsys.readouterr().err

    made, error = judged("swingup-1")
    digest = hashlib.sha256((PRETRAINED / "swingup-1.safetensors").read_bytes()).hexdigest()
    assert (made["policy"], made["sha256"]) == ("swingup-1", digest)
    assert "replaces" not in error
    assert "figures" not in error
    made, error = judged("--controller", "energy", "--task", "swingup-1")
    assert (made["controller"], made["task"]) == ("energy", "swingup-1")
    assert f"npend evaluate: replaces the results in {tmp_path}\n" in error


@pytest.mark.long
def test_evaluate_prints_the_scores(capsys):
    assert main(["evaluate", "swingup-1", "--episodes", "5", "--scores"]) == 0
    printed = capsys.readouterr().out
    assert "performance 0.58" in printed
    assert "recovery 0.9" in printed


@pytest.mark.parametrize(
    ("env_id", "setting", "solved"),
    [
        ("SwingUp", "observation=sincos", True), ("Balance", "observation=sincos", False),
        ("SwingUp", "max_episode_steps=300", False), ("SwingUp", "max_torque=14.0", False),
    ],
)  # fmt: skip
def test_the_threshold_of_an_id_is_printed_for_its_own_task_alone(env_id, setting, solved, capsys):
    arguments = ["--env-id", f"npend/{env_id}-v1", "--episodes", "2"]
    assert main(["evaluate", "swingup-2", *arguments, "--env", setting]) == 0
    assert ("solved from" in capsys.readouterr().out) == solved


def test_a_policy_that_never_succeeds_on_the_chain_of_a_file_is_told_why(tmp_path, capsys):
    (tmp_path / "fit.json").write_text('{"masses": [1.0], "lengths": [0.5]}')
    settings = f"chain={tmp_path / 'fit.json'}", "max_episode_steps=3"
    options = [word for one in settings for word in ("--env", one)]
    assert main(["evaluate", "swingup-1", "--episodes", "2", *options]) == 0
    told = "swingup-1 succeeds in no episode: --env gives it another chain, max_episode_steps than"
    assert told in capsys.readouterr().err


def test_an_interrupted_training_says_that_nothing_was_written(tmp_path, capsys):
    pytest.importorskip("torch")
    with Interrupt():
        assert main(["train", "swingup-2", "--out", str(tmp_path)]) == 130
    assert "nothing was written" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["evaluate", "swingup-1", "--env-id", "npend/Swingup-v1"], "--env-id must name .*SwingUp"),
        (["train", "swingup-1", "--algorithm", "ppo"], "one of .*'ppo': examples/train_sb3.py"),
    ],
)
def test_a_wrong_name_is_refused_in_one_line_with_what_is_likely_meant(words, said, refusal):
    assert re.search(said, refusal(*words))


def test_the_task_chooses_the_algorithm():
    pytest.importorskip("torch")
    from npend_gym.cli.train import _algorithm

    tasks = ("swingup-2", "calm-20", "swingup-3", "transition-2", "calm-5")
    assert [_algorithm(task, None) for task in tasks] == [
        "shac", "shac", "imitation", "imitation", "shac",
    ]  # fmt: skip
    assert _algorithm("swingup-2", "imitation") == "imitation"


@pytest.mark.long
def test_evolution_strategies_find_a_policy_that_calms_better_than_no_torque():
    from evolution_strategies import settings_of, train

    policy, curve = train(settings_of("calm-2", updates=20))
    assert [weight.shape for weight in policy.weights] == [(2, 6), (1, 2)]
    assert [row["steps"] for row in curve] == [640_000, 1_280_000]
    first, last = policy.weights
    idle = Policy(policy.scale, [0.0 * first, last], policy.biases)
    trained, untrained = (evaluate(each, policy.env, episodes=10) for each in (policy, idle))
    assert trained.returns.mean() > 2.0 * untrained.returns.mean()
    assert trained.success_rate == 1.0 > untrained.success_rate


def test_evolution_strategies_count_an_episode_until_it_is_terminated():
    from evolution_strategies import play, settings_of

    envs = gym.make_vec("NPendulum-v0", 2, **settings_of("balance-1").env)
    returns, success = play(envs, np.zeros((2, 1, 3)), np.ones((2, 1)), 600, seed=3)
    envs.reset(seed=[3, 3])
    expected, terminated = 0.0, np.zeros(2, bool)
    while not terminated.any():
        _, reward, terminated, *_ = envs.step(np.zeros((2, 1), np.float32))
        expected += reward[0]
    assert returns == pytest.approx(expected, rel=1e-12)
    assert not success.any()


def test_evolution_strategies_start_as_lqr_where_a_chain_is_long():
    from evolution_strategies import Search, play, settings_of

    settings = settings_of("calm-50")
    small = {"amplitude": 0.02, "spread": 0.0}  # rad: no unit is near its limit
    envs = gym.make_vec("NPendulum-v0", 2, **settings.env | small)
    search = Search(settings, envs.unwrapped.config)
    weights, limits = search.units(search.parameters)
    assert not weights[1].any()
    both = np.stack([weights, 0.0 * weights])
    play(envs, both, np.stack([limits, limits]), 900, seed=0)
    calmed, idle = envs.step(np.zeros((2, 1), np.float32))[4]["energy"]
    assert 0.0 < calmed < 0.2 * idle
    on_cart = settings_of("calm-40").env | {"base": "cart"}
    cart = gym.make_vec("NPendulum-v0", 1, **on_cart).unwrapped.config
    with pytest.raises(ValueError, match="n must be below 40 on a cart"):
        Search(settings, cart)


def test_the_script_repeats_the_settings_in_the_records_of_its_policies():
    from evolution_strategies import SCRIPT, settings_of

    records = {name: Policy.pretrained(name).provenance for name in pretrained_names()}
    by_script = {name: about for name, about in records.items() if about["trained_by"] == SCRIPT}
    assert "calm-20" in by_script
    for name, about in by_script.items():
        assert about["arguments"] == asdict(settings_of(name, seed=about["seed"]))


@pytest.mark.long
def test_imitation_teaches_the_planned_swing_up_to_a_policy_without_a_clock():
    pytest.importorskip("torch")
    from npend_gym.rl.training.imitation import settings_of, train

    quick = {"guesses": 2, "num_envs": 64, "rounds": 4, "hidden": 64}
    policy, curve = train(settings_of("swingup-1", **quick))
    assert len(curve) == 3  # two rounds choose the plan
    assert curve[-1]["distance"] < 0.1
    assert evaluate(policy, policy.env, episodes=20).success_rate > 0.9


def test_model_predictive_control_aims_at_what_the_task_asks_for():
    for mode, goal in (("swingup", np.pi), ("calm", 0.0)):
        controller = reference_controller("MPC", {"n": 1, "mode": mode})
        at_rest = {"theta": np.full((1, 1), goal), "omega": np.zeros((1, 1)), "time": np.zeros(1)}
        np.testing.assert_allclose(controller(None, at_rest), 0.0, atol=1e-12)


@pytest.mark.parametrize("n", [3, 4, 5])
def test_the_regulator_for_poles_on_a_cart_holds_nearly_all_starts_within_its_force(n):
    keywords = env_of_task(f"balance-{n}-cart")
    controller = reference_controller("LQR", keywords)
    assert evaluate(controller, keywords, episodes=100).success_rate > 0.95


def test_every_reference_controller_acts():
    for name in CONTROLLERS:
        keywords = {"n": 2, "mode": "calm" if name == "damping" else "swingup"}
        controller = reference_controller(name, keywords)
        state = {"theta": np.full((3, 2), 0.1), "omega": np.zeros((3, 2))}
        info = state | {"time": np.zeros(3), "energy": np.ones(3)}
        assert controller(np.zeros((3, 4)), info).shape == (3, 1)


def test_a_task_says_how_many_rods_are_trained(refusal, tmp_path):
    about = {"chain": Chain.uniform(2).as_dict(), "chain_standard_errors": {}}
    (tmp_path / "fit.json").write_text(json.dumps(about))
    message = refusal("train", "swingup-1", "--around", str(tmp_path / "fit.json"))
    assert "--around must be a fit of as many rods as TASK has, 1, got 2" in message
    assert "--env n must be left out" in refusal("train", "swingup-1", "--env", "n=2")


@pytest.mark.parametrize("command", ["evaluate", "export --to c --out {out}"])
@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("n=3", "--env n must be left out, --task balance-2 says it; got 3"),
        ("mode=calm", "--env mode must be left out, --task balance-2 says it; got 'calm'"),
        ("max_episode_steps=-1", "max_episode_steps must be between 1 and"),
    ],
)
def test_a_controller_is_for_the_task_that_is_named(command, setting, message, refusal, tmp_path):
    words = command.format(out=tmp_path / "a.h").split()
    controller = ["--controller", "LQR", "--task", "balance-2"]
    assert message in refusal(*words, *controller, "--env", setting)
    assert not list(tmp_path.iterdir())


def test_an_episode_has_the_steps_of_its_environment(refusal, tmp_path):
    message = refusal("simulate", "swingup-1", "--interval", "0.5")
    assert "--interval must be left out with a policy" in message
    table = tmp_path / "a.csv"
    assert main(["simulate", "swingup-1", "--duration", "3", "--csv", str(table)]) == 0
    assert len(table.read_text().splitlines()) == 62  # a head, the start, 60 steps
