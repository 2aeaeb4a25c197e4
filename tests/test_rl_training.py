"""What every trainer promises: which episodes it sees, and that it uses what it is given."""

import hashlib
import json
import os
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from scripts import run_python

from npend_gym import Chain, identify, simulate
from npend_gym.envs import EnvConfig
from npend_gym.envs.episodes import Episodes
from npend_gym.rl import HELD_OUT, Policy, episode_seeds, evaluate
from npend_gym.rl.controllers.tracking import Tracking

torch = pytest.importorskip("torch")

from npend_gym.cli import main  # noqa: E402
from npend_gym.rl.training import imitation, shac, trainer, trainer_names  # noqa: E402
from npend_gym.rl.training.short_horizons import Collector, TensorTask  # noqa: E402
from npend_gym.rl.training.tasks import env_around, env_of_task, evaluation_env  # noqa: E402

VALIDATION = 900_000


def play_with_shac(seed):
    settings = shac.settings_of("swingup-1", seed=seed, num_envs=3, hidden=4)
    config = EnvConfig(**settings.env)
    Collector(config, TensorTask(config, settings.gamma, settings.obs_scale), settings)


class Idle:
    """An expert that never acts."""

    chains = pairs = ()

    def begin(self, which, round_):
        pass

    def tracking(self, info):
        lanes = len(info["time"])
        return Tracking(*(np.zeros((lanes, 1)),) * 2, np.zeros(lanes), np.ones((lanes, 1)))


def play_with_imitation(seed):
    settings = imitation.settings_of("swingup-3", seed=seed, seconds=0.05, standing=0, hidden=4)
    dagger = imitation.DAgger(settings, Idle())
    for round_ in (0, 1, settings.rounds):
        dagger.play(round_)
    dagger.lanes.close()


PLAYS = {"shac": play_with_shac, "imitation": play_with_imitation}


def seeds_played(play, seed, monkeypatch):
    """Return the seeds that lanes are given, each time, while a trainer plays."""
    played, give = list[list[int]](), Episodes.seed

    def watched(episodes, seed, mask):
        give(episodes, seed, mask)
        played.append([episodes.seeds.values[lane] for lane in np.flatnonzero(mask)])

    with monkeypatch.context() as patch:
        patch.setattr(Episodes, "seed", watched)
        play(seed)
    return played


@pytest.mark.parametrize("seed", [8, 9, 10, 900, 999, 1000, 2**31 - 1])
@pytest.mark.parametrize("name", PLAYS)
def test_no_seed_trains_in_episodes_that_choose_or_judge(name, seed, monkeypatch):
    played = seeds_played(PLAYS[name], seed, monkeypatch)
    assert played
    for lane in np.ravel(played).tolist():
        assert not VALIDATION <= lane < HELD_OUT + 10**6


@pytest.mark.parametrize("use", ["training", "evaluation"])
@pytest.mark.parametrize(
    ("name", "value", "error"),
    [
        ("run", "a", TypeError), ("run", -1, ValueError), ("spacing", 0, ValueError),
        ("spacing", -3, ValueError), ("spacing", 2.5, TypeError),
    ],
)  # fmt: skip
def test_seeds_of_every_use_are_refused_by_the_name_of_the_argument(use, name, value, error):
    with pytest.raises(error, match=f"{name} must be .*, got '?{value}"):
        episode_seeds(use, 10, **{name: value})


def test_trainings_of_different_seeds_see_different_episodes(monkeypatch):
    for play in PLAYS.values():
        seen = [
            set(np.ravel(seeds_played(play, seed, monkeypatch)).tolist())
            for seed in (0, 1, 8, 9, 10, 1000)
        ]
        assert len(set.union(*seen)) == sum(map(len, seen))


def test_small_seeds_train_in_the_episodes_of_the_policies_that_ship(monkeypatch):
    first = {
        name: [lanes[0] for lanes in seeds_played(play, 2, monkeypatch)]
        for name, play in PLAYS.items()
    }
    assert first == {"shac": [2000], "imitation": [200_000, 200_512, 200_000 + 10 * 512]}


@pytest.mark.parametrize("mode", ["swingup", "balance"])
@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_a_task_on_a_cart_is_the_registered_cart_in_its_mode(n, mode):
    names = {1: "CartPole", 2: "CartDoublePole", 3: "CartTriplePole", 4: "CartTriplePole"}
    more = {"chain": Chain.dm_control("cartpole", 4).as_dict()} if n == 4 else {}
    keywords = {"mode": mode, "observation": "sincos"} | more
    registered = gym.make(f"npend/{names[n]}-v1", **keywords).unwrapped.config
    config = EnvConfig(**env_of_task(f"{mode}-{n}-cart"))
    for name in ("rail", "max_force", "dt", "cart_mass", "rail_damping", "observation_space"):
        assert getattr(config, name) == getattr(registered, name)
    assert config.chain.as_dict() == registered.chain.as_dict()
    assert config.mode.name == registered.mode.name


def test_poles_start_no_further_away_than_the_force_on_their_cart_can_hold():
    tasks = "balance-4-cart", "balance-5-cart", "transition-3-cart"
    spreads = [EnvConfig(**env_of_task(task)).spread for task in tasks]
    assert spreads == [0.002, 0.0005, 0.005]


def test_words_at_the_end_of_a_task_combine():
    robust = env_of_task("swingup-2-robust")["randomize"]
    for robot in ("swingup-2-acrobot", "balance-3-cart"):
        assert env_of_task(f"{robot}-robust") == env_of_task(robot) | {"randomize": robust}
    for rule in ("recovery", "hardware"):
        assert env_of_task(f"swingup-2-pendubot-{rule}") == env_of_task("swingup-2-pendubot")
    for word in ("smooth", "performance"):
        own = env_of_task(f"swingup-2-acrobot-{word}")
        assert own == env_of_task("swingup-2-acrobot") | {"dt": 0.002}


def test_episodes_of_short_steps_are_long_enough_to_succeed():
    smooth, usual = env_of_task("swingup-2-acrobot-smooth"), env_of_task("swingup-2")
    assert evaluation_env(smooth) == smooth | {"max_episode_steps": 5000}
    assert evaluation_env(usual | {"max_episode_steps": 7}) == usual


@pytest.mark.parametrize(
    "task",
    [
        "swingup-0-cart", "swingup-x-cart", "swing-1-cart", "calm-1-rail", "calm-1-cart-x",
        "swingup-02", "swingup-\u0662", "swingup-2-pendubot-acrobot", "swingup-2-cart-pendubot",
        "swingup-2-robust-acrobot", "swingup-2-robust-robust", "swingup-2-",
    ],
)  # fmt: skip
def test_what_names_no_task_on_a_cart_is_refused(task):
    with pytest.raises(ValueError, match="must be"):
        EnvConfig(**env_of_task(task))


@pytest.mark.parametrize("algorithm", [shac, imitation])
def test_settings_take_another_environment_and_refuse_what_names_no_task(algorithm):
    assert algorithm.settings_of("swingup-1", env={"n": 3}).env == {"n": 3}
    for task in ("swingup-0", 3):
        with pytest.raises(ValueError, match=f"task must be .* at least one rod, got '?{task}"):
            algorithm.settings_of(task)


ONE_ROD = {"n": 1, "mode": "swingup", "observation": "sincos"}
FEW = {"seconds": 3.0, "guesses": 1, "num_envs": 8, "rounds": 2, "updates": 4, "first_updates": 4}
SHORT = {
    "shac": (shac, shac.settings_of("swingup-2", total_timesteps=640)),
    "imitation": (imitation, imitation.Settings(ONE_ROD, **FEW)),
}


def digest_of_training(name):
    """Return a digest of the weights that a short training gives."""
    algorithm, settings = SHORT[name]
    policy, _ = algorithm.train(settings)
    return hashlib.sha256(b"".join(w.tobytes() for w in policy.weights)).hexdigest()


@pytest.mark.skipif(os.cpu_count() == 1, reason="one core has one thread in any case")
@pytest.mark.long
@pytest.mark.parametrize("name", SHORT)
def test_one_seed_gives_the_same_policy_with_any_number_of_threads(name):
    threads, one = {"OMP_NUM_THREADS": str(os.cpu_count())}, torch.get_num_threads()
    code = f"from test_rl_training import digest_of_training; print(digest_of_training({name!r}))"
    found = run_python("-c", code, cwd=Path(__file__).parent, env=os.environ | threads)
    torch.set_num_threads(1)
    try:
        assert found == digest_of_training(name) + "\n"
    finally:
        torch.set_num_threads(one)


def test_a_training_leaves_the_threads_of_the_program_as_they_were():
    before = torch.get_num_threads()
    torch.set_num_threads(before + 1)
    try:
        play_with_shac(0)
        assert torch.get_num_threads() == before + 1
        with pytest.raises(ValueError, match="shac does not use torque_levels"):
            shac.train(shac.Settings(env={"n": 1, "observation": "sincos", "torque_levels": 3}))
        assert torch.get_num_threads() == before + 1
    finally:
        torch.set_num_threads(before)


def test_a_model_is_judged_by_one_thread_of_pytorch():
    before, seen = torch.get_num_threads(), set()

    def model(_observation, info):
        seen.add(torch.get_num_threads())
        return np.zeros((info["time"].size, 1))

    torch.set_num_threads(before + 1)
    try:
        evaluate(model, {"n": 1, "mode": "calm", "max_episode_steps": 2}, episodes=2)
        assert (seen, torch.get_num_threads()) == ({1}, before + 1)
    finally:
        torch.set_num_threads(before)


@pytest.mark.long
def test_shac_takes_the_substeps_that_it_is_given():
    small = {"num_envs": 4, "total_timesteps": 80, "updates": 1}
    settings = shac.settings_of("swingup-2", **small)
    policies = [
        shac.train(replace(settings, env=settings.env | {"substeps": substeps}))[0]
        for substeps in (1, 8)
    ]
    assert any(
        (one != other).any() for one, other in zip(*(p.weights for p in policies), strict=True)
    )


@pytest.mark.long
def test_a_policy_trained_with_chains_and_numbers_of_numpy_is_saved(tmp_path):
    env = {"chain": Chain.uniform(1), "mode": "swingup", "observation": "sincos"}
    env["max_torque"] = np.float32(5.0)
    numbers = {"total_timesteps": 80, "num_envs": 4, "updates": 1, "hidden": 4, "seed": 7}
    settings = shac.Settings(env, **{name: np.int64(number) for name, number in numbers.items()})
    policy, _ = shac.train(settings)
    policy.save(tmp_path / "a.safetensors")
    again = Policy.load(tmp_path / "a.safetensors")
    assert again == policy
    assert (again.provenance["seed"], again.provenance["arguments"]["hidden"]) == (7, 4)


def test_training_around_an_identified_chain_draws_within_two_standard_errors(tmp_path):
    chain = Chain([0.5, 0.4], [0.3, 0.25], centres=[0.2, 0.15], inertias=0.004, damping=0.001)
    errors = {"damping": [0.001, 0.0002], "inertias": [0.0, 0.0], "centres": [0.01, None]}
    about = {"chain": chain.as_dict(), "chain_standard_errors": errors}
    (tmp_path / "identification.json").write_text(json.dumps(about), encoding="utf-8")
    (tmp_path / "fit.json").write_text(json.dumps(chain.as_dict()), encoding="utf-8")
    env = env_around(tmp_path / "fit.json")
    assert env == env_around(tmp_path / "identification.json")
    assert env["chain"] == chain.as_dict()
    assert set(env["randomize"]) == {"damping", "centres"}
    assert env["randomize"]["damping"]["low"] == pytest.approx([0.0, 0.0006])
    assert env["randomize"]["centres"]["high"] == pytest.approx([0.22, 0.15])
    assert EnvConfig(mode="swingup", **env).n == 2
    about["chain_standard_errors"] = {"masses": [0.1, 0.3]}
    (tmp_path / "identification.json").write_text(json.dumps(about), encoding="utf-8")
    with pytest.raises(ValueError, match=r"masses too uncertain .*\[0.1, 0.3\]: the low end of m"):
        env_around(tmp_path / "fit.json")
    (tmp_path / "identification.json").unlink()
    with pytest.raises(ValueError, match=r"what npend identify --out wrote"):
        env_around(tmp_path / "fit.json")


@pytest.mark.long
def test_training_around_an_identified_chain_draws_nothing_that_the_data_leave_open(tmp_path):
    """One link does not tell damping from drag."""
    chain, times = Chain([1.0], [0.3], damping=0.003, drag=0.02), np.arange(0.0, 6.0, 0.02)
    theta = simulate(chain, 1.0, 0.0, times).theta
    theta += 1e-3 * np.random.default_rng(0).normal(size=theta.shape)
    found = identify(times, theta, chain=chain, fit=["inertia", "damping", "drag"], held_out=0.0)
    path = tmp_path / "identification.json"
    path.write_text(json.dumps(found.as_dict(), allow_nan=False), encoding="utf-8")
    assert set(env_around(path)["randomize"]) == {"inertias"}


OWN_TRAINER = """
from dataclasses import dataclass, field

import numpy as np

from npend_gym.rl import Policy

TASKS = {"balance-1": {"gain": 3.0}}


@dataclass(frozen=True)
class Settings:
    env: dict = field(default_factory=dict)
    seed: int = 0
    gain: float = 1.0
    rounds: int = 3


def settings_of(task, **changes):
    env = {"n": 1, "mode": "balance", "observation": "sincos"}
    return Settings(env=env, **(TASKS.get(task, {}) | changes))


def train(settings, progress=None, checkpoint=None):
    weights = {"rows": []}
    for round_ in checkpoint.rounds(weights, settings.rounds, progress, "round"):
        weights["rows"].append({"steps": round_})
    gain = np.array([[-settings.gain, 0.0, 0.0]], np.float32)
    policy = Policy(np.ones(3, np.float32), [gain], [np.zeros(1, np.float32)], env=settings.env)
    return policy, weights["rows"]
"""


def test_a_trainer_of_another_package_is_found_by_its_entry_point(tmp_path, monkeypatch, capsys):
    (tmp_path / "own_trainer.py").write_text(OWN_TRAINER, encoding="utf-8")
    about = tmp_path / "own_package-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: own-package\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[npend_gym.trainers]\nmine = own_trainer\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert trainer_names() == ["shac", "imitation", "mine"]
    out = tmp_path / "out"
    command = ["train", "balance-1", "--algorithm", "mine", "--set", "rounds=2", "--out", str(out)]
    assert main(command) == 1  # it does not balance
    told = capsys.readouterr()
    assert "balance-1 by mine, 2 steps" in told.out
    assert "the training failed: the policy succeeds in 0% of 100 episodes" in told.err
    policy = Policy.load(out / "balance-1.safetensors")
    assert policy.weights[0].tolist() == [[-3.0, 0.0, 0.0]]
    with pytest.raises(ValueError, match=r"algorithm must be one of shac, imitation, mine"):
        trainer("yours")
