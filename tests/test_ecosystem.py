"""Other packages' own checks, of every environment that is registered."""

import sys

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from scripts import run_script
from test_examples import ROOT

import npend_gym  # noqa: F401 - registers the environments
from npend_gym.cli import main
from npend_gym.rl import Policy

IDS = [name for name, spec in gym.registry.items() if "npend_gym:" in str(spec.entry_point)]
every_id = pytest.mark.parametrize("env_id", IDS)


@every_id
def test_gymnasiums_checker_is_content_without_a_warning(env_id):
    check_env(gym.make(env_id).unwrapped, skip_render_check=True)


@every_id
def test_stable_baselines3_checker_is_content_without_a_warning(env_id):
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    env = gym.make(env_id).unwrapped
    if env_id == "NPendulum-v0":
        env = gym.make(env_id, observation="sincos").unwrapped  # of angles, bounds are far apart
    checker.check_env(env, warn=True)


@every_id
@pytest.mark.filterwarnings("ignore")  # TorchRL warns of itself
@pytest.mark.parametrize("autoreset", [None, "DISABLED", "SAME_STEP"])
def test_torchrl_spec_check_is_content_with_one_environment_and_with_many(env_id, autoreset):
    envs, utils = (pytest.importorskip(name) for name in ("torchrl.envs", "torchrl.envs.utils"))
    if autoreset is None:
        env = envs.GymEnv(env_id, device="cpu")
    else:
        vector = gym.make_vec(env_id, num_envs=3, autoreset_mode=autoreset)
        env = envs.GymWrapper(vector, device="cpu")
    utils.check_env_specs(env)


@every_id
@pytest.mark.filterwarnings("ignore")  # Minari names all that one may say of a dataset
def test_minari_recovers_the_environment_of_a_dataset(env_id, tmp_path, monkeypatch):
    minari = pytest.importorskip("minari")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    keywords = {"dt": 0.03, "max_episode_steps": 50}
    made = gym.make(env_id, **keywords)
    env = minari.DataCollector(made, record_infos=True, data_format="arrow")
    env.action_space.seed(0)
    shown = []
    for seed in range(2):
        shown.append([env.reset(seed=seed)[0]])
        over = False
        while not over and len(shown[-1]) <= 20:  # a balance may end sooner
            observation, _, over, _, _ = env.step(env.action_space.sample())
            shown[-1].append(observation)
    env.create_dataset("npend/random-v0")
    env.close()
    dataset = minari.load_dataset("npend/random-v0")
    again = dataset.recover_environment()
    assert again.spec == gym.make(env_id, **keywords).spec
    for seed, (episode, observations) in enumerate(zip(dataset, shown, strict=True)):
        replayed = [again.reset(seed=seed)[0]]
        replayed += [again.step(action)[0] for action in episode.actions]
        np.testing.assert_array_equal(episode.observations, observations)
        np.testing.assert_array_equal(replayed, observations)


def dataset_of(*words, capsys):
    """Return the id of the data set that `npend dataset` writes."""
    assert main(["dataset", *map(str, words)]) == 0
    return capsys.readouterr().out.split(":")[0]


KINDS = [
    ("swingup-3", "expert"), ("swingup-2", "medium"), ("balance-2", "random"),
    ("release-2", "free"), ("swingup-2", "robust"), ("balance-2-cart", "medium"),
    ("swingup-5", "expert"),
]  # fmt: skip


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(("task", "kind"), KINDS)
def test_episodes_of_a_minari_dataset_are_played_again_to_the_last_bit(
    task, kind, tmp_path, monkeypatch, capsys
):
    minari = pytest.importorskip("minari")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    name = dataset_of(task, "--kind", kind, "--episodes", 3, "--seed", 5, capsys=capsys)
    assert name == f"npend/{task}/{kind}-v0"
    dataset = minari.load_dataset(name)
    env = dataset.recover_environment()
    chains = set()
    kept = list(dataset.storage.get_episode_metadata(dataset.episode_indices))
    assert [each["seed"] for each in kept] == [5, 6, 7]
    for seed, episode in enumerate(dataset, 5):
        observation, info = env.reset(seed=seed)
        shown, rewards, states = [observation], [], [info]
        for action in episode.actions:
            observation, reward, *ends, info = env.step(action)
            shown.append(observation)
            rewards.append(reward)
            states.append(info)
        assert ends == [episode.terminations[-1], episode.truncations[-1]]
        assert any(ends)
        np.testing.assert_array_equal(shown, episode.observations)
        np.testing.assert_array_equal(rewards, episode.rewards)
        for key, values in episode.infos.items():
            np.testing.assert_array_equal([each[key] for each in states], values)
        assert {"theta", "omega", "success"} <= set(episode.infos)
        chains.add(str(episode.infos["context"][0]) if kind == "robust" else "")
    assert len(chains) == (3 if kind == "robust" else 1)
    card = dataset.storage.metadata["description"]
    assert f"Task {task} of npend_gym" in card
    assert "seeds 5 to 7" in card


@pytest.mark.filterwarnings("ignore")
def test_data_sets_that_exist_or_cannot_be_made_or_cloned_are_refused(
    tmp_path, monkeypatch, capsys
):
    pytest.importorskip("minari")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    dataset_of("release-2", "--kind", "free", "--episodes", 2, capsys=capsys)
    for words, message in (
        (("release-2", "--kind", "free"), "`minari delete npend/release-2/free-v0` removes it"),
        (("release-2",), 'kind must be "free" for release-2'),
        (("swingup-2", "--kind", "free"), 'task must be like "release-5"'),
        (("swingup-9",), "task must be one of"),
        (("calm-1", "--kind", "robust"), "task must be one of calm-2"),
        (("swingup-2", "--seed", 900_000), "seed must be between 0 and 899900"),
        (("swingup-2", "--episodes", 900_001), "episodes must be between 1 and 900000"),
        (("calm-1", "--plans", "a.npz"), "plans must be left out but for the kind 'plans' of a"),
        (("calm-1", "--kind", "plans"), "task must be a swing-up or a transition for the kind"),
    ):
        with pytest.raises(SystemExit):
            main(["dataset", *map(str, words)])
        assert message in capsys.readouterr().err
    pytest.importorskip("torch")
    for data, message in (
        ("npend/release-2/free-v0", "actions must be continuous, got Discrete"),
        ("npend/none-v0", "choose from"),
    ):
        with pytest.raises(SystemExit):
            run_script(ROOT / "examples" / "clone_behaviour.py", data, cwd=tmp_path)
        assert message in capsys.readouterr().err


def test_data_sets_say_how_to_install_minari(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "minari", None)
    assert main(["dataset", "swingup-2"]) == 1
    assert 'pip install "minari[create]" pyarrow' in capsys.readouterr().err


@pytest.mark.long
@pytest.mark.filterwarnings("ignore")
def test_a_data_set_of_transitions_keeps_its_plans(tmp_path, monkeypatch, capsys):
    minari = pytest.importorskip("minari")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "sets"))
    plans = tmp_path / "new" / "plans.npz"
    words = ["dataset", "transition-1", "--kind", "plans", "--episodes", "2", "--plans", str(plans)]
    assert main(words) == 0
    printed = capsys.readouterr().out
    minari.delete_dataset("npend/transition-1/plans-v0")
    capsys.readouterr()
    written = plans.stat().st_mtime_ns
    assert main(words) == 0
    assert capsys.readouterr().out == printed  # by the same plans
    assert plans.stat().st_mtime_ns == written


@pytest.mark.filterwarnings("ignore")
def test_behaviour_is_cloned_from_a_minari_dataset(tmp_path, monkeypatch, capsys):
    minari = pytest.importorskip("minari")
    pytest.importorskip("torch")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    examples = ROOT / "examples"
    returns = {}
    for kind in ("random", "medium"):
        name = dataset_of("swingup-2", "--kind", kind, "--episodes", 30, capsys=capsys)
        dataset = minari.load_dataset(name)
        printed = run_script(examples / "clone_behaviour.py", dataset.id, 20, cwd=tmp_path)
        returns[kind] = float(printed.split("return ")[1])
    assert returns["medium"] > 300.0 > returns["random"]
    pytest.importorskip("torchrl")
    names = [f"npend/swingup-2/{kind}-v0" for kind in returns]
    printed = run_script(examples / "offline_iql.py", *names, "--updates", 100, cwd=tmp_path)
    rewards = [each.rewards.sum() for name in names for each in minari.load_dataset(name)]
    assert f"(data {np.mean(rewards):.0f}), success 0/100" in printed
    assert Policy.load(tmp_path / "offline.safetensors").weights[0].shape == (128, 6)
    assert Policy.load(tmp_path / "cloned.safetensors").env["n"] == 2
