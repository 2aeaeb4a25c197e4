"""Other packages' own checks, of every environment that is registered."""

import sys

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from scripts import run_script
from test_examples import ROOT

import npend_gym  # noqa: F401 - registers the environments
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


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", [("expert", "--n", 3), ("medium",), ("random",), ("release",)])
def test_episodes_of_a_minari_dataset_are_played_again_to_the_last_bit(kind, tmp_path, monkeypatch):
    minari = pytest.importorskip("minari")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    script = ROOT / "examples" / "make_dataset.py"
    printed = run_script(script, *kind, "--episodes", 3, "--seed", 5, cwd=tmp_path)
    dataset = minari.load_dataset(printed.split(":")[0])
    env = dataset.recover_environment()
    for seed, episode in enumerate(dataset, 5):
        shown, rewards = [env.reset(seed=seed)[0]], []
        for action in episode.actions:
            observation, reward, *ends, _ = env.step(action)
            shown.append(observation)
            rewards.append(reward)
        assert ends == [episode.terminations[-1], episode.truncations[-1]] == [False, True]
        np.testing.assert_array_equal(shown, episode.observations)
        np.testing.assert_array_equal(rewards, episode.rewards)


def test_the_script_of_data_sets_shows_its_help_without_minari(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "minari", None)
    with pytest.raises(SystemExit) as ends:
        run_script(ROOT / "examples" / "make_dataset.py", "--help", cwd=tmp_path)
    assert ends.value.code == 0


@pytest.mark.filterwarnings("ignore")
def test_data_sets_that_exist_or_cannot_be_cloned_are_refused(tmp_path, monkeypatch, capsys):
    pytest.importorskip("minari")
    pytest.importorskip("torch")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    make = ROOT / "examples" / "make_dataset.py", "release", "--episodes"
    run_script(*make, 2, cwd=tmp_path)
    clone = ROOT / "examples" / "clone_behaviour.py"
    for script, message in (
        ((*make, 10**9), "`minari delete npend/release-2/free-v0` removes it"),
        ((clone, "npend/release-2/free-v0"), "actions must be continuous, got Discrete"),
        ((clone, "npend/none-v0"), "choose from"),
    ):
        with pytest.raises(SystemExit):
            run_script(*script, cwd=tmp_path)
        assert message in capsys.readouterr().err


@pytest.mark.long
@pytest.mark.filterwarnings("ignore")
def test_a_data_set_of_transitions_keeps_its_plans(tmp_path, monkeypatch):
    minari = pytest.importorskip("minari")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "sets"))
    script = ROOT / "examples" / "make_dataset.py"
    arguments = ["transitions", "--n", 1, "--episodes", 2, "--plans", "new/plans.npz"]
    printed = run_script(script, *arguments, cwd=tmp_path)
    minari.delete_dataset("npend/transition-1/plans-v0")
    written = (tmp_path / "new" / "plans.npz").stat().st_mtime_ns
    assert run_script(script, *arguments, cwd=tmp_path) == printed  # by the same plans
    assert (tmp_path / "new" / "plans.npz").stat().st_mtime_ns == written


@pytest.mark.filterwarnings("ignore")
def test_behaviour_is_cloned_from_a_minari_dataset(tmp_path, monkeypatch):
    minari = pytest.importorskip("minari")
    pytest.importorskip("torch")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    examples = ROOT / "examples"
    returns = {}
    for kind in ("random", "medium"):
        run_script(examples / "make_dataset.py", kind, "--episodes", 30, cwd=tmp_path)
        dataset = minari.load_dataset(f"npend/swingup-2/{kind}-v0")
        printed = run_script(examples / "clone_behaviour.py", dataset.id, 20, cwd=tmp_path)
        returns[kind] = float(printed.split("return ")[1])
    assert returns["medium"] > 300.0 > returns["random"]
    assert Policy.load(tmp_path / "cloned.safetensors").env["n"] == 2
