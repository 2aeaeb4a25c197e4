"""The tasks by name: what Gymnasium's registry says of them, and that policies solve them."""

import csv
import json
import re
from functools import partial
from pathlib import Path

import gymnasium as gym
import numpy as np
import public_ids
import pytest
from gymnasium.envs.registration import EnvSpec

from npend_gym import Chain
from npend_gym.chain import as_chain
from npend_gym.envs import EnvConfig, NPendulumEnv, NPendulumVectorEnv, SwingUp
from npend_gym.envs.keywords import DEFAULTS
from npend_gym.envs.modes import find_mode
from npend_gym.envs.registration import ENV_ID, MAX_EPISODE_STEPS, TASKS
from npend_gym.export.engines import MUJOCO_ID
from npend_gym.rl import Policy, evaluate, lqr

PAGES = Path(__file__).parents[1] / "docs" / "tasks"
N_5 = {"chain": Chain.uniform(5).as_dict()}  # poles on a cart have a chain of their own
# Tasks whose threshold a controller reaches; those of the others are reached by a policy
CONTROLLED = {
    "npend/CartPole-v1": lqr,
    "npend/CartDoublePole-v1": lqr,
    "npend/CartTriplePole-v1": partial(lqr, action_weight=20.0),
}


def page_of(env_id):
    name = env_id.split("/")[1].removesuffix("-v1")
    if name.startswith("Cart"):
        return "carts.md"  # which has a column for each of its tasks
    return re.sub("(?<=[a-z])(?=[A-Z])|(?<=M)(?=A)", "_", name).lower() + ".md"


def test_the_registry_lists_the_tasks_under_one_heading():
    listed = gym.pprint_registry(disable_print=True)
    heading = listed.index("===== npend =====")
    assert all(env_id in listed[heading:] for env_id in TASKS)
    ours = {env_id for env_id in gym.registry if env_id.startswith("npend/")}
    assert ours - {MUJOCO_ID} == set(TASKS)  # `in_mujoco` registers that one
    assert all(gym.spec(env_id).max_episode_steps for env_id in [ENV_ID, *TASKS])


@pytest.mark.parametrize("env_id", TASKS)
def test_a_task_is_made_by_name_alone_singly_and_in_one_vector(env_id):
    env, envs = gym.make(f"npend_gym:{env_id}"), gym.make_vec(env_id, num_envs=3)
    assert type(env.unwrapped) is NPendulumEnv
    assert type(envs) is NPendulumVectorEnv
    for config in (env.unwrapped.config, envs.config):
        assert config.n == as_chain(TASKS[env_id].keywords.get("chain", "acrobot")).n
        assert config.mode.name == find_mode(TASKS[env_id].keywords["mode"]).name
    observation, _ = env.reset(seed=5)
    assert np.array_equal(envs.reset(seed=4)[0][1], observation)
    assert gym.make(env_id, **N_5).unwrapped.config.n == 5


@pytest.mark.parametrize("env_id", TASKS)
def test_the_spec_of_a_task_survives_json(env_id):
    for spec in (gym.spec(env_id), gym.make(env_id, **N_5, max_episode_steps=7).spec):
        assert EnvSpec.from_json(spec.to_json()) == spec
    again = gym.make(EnvSpec.from_json(spec.to_json()))
    assert (again.unwrapped.config.n, again.spec.max_episode_steps) == (5, 7)


def solution_of(env_id):
    """Return a model for a task, its environment, and the mean return of random actions."""
    if env_id in CONTROLLED:
        rng = np.random.default_rng(0)
        drawn = evaluate(lambda o, _: rng.uniform(-1.0, 1.0, (len(o), 1)), env_id, episodes=100)
        return CONTROLLED[env_id](gym.make(env_id).unwrapped.config), env_id, drawn.returns.mean()
    task = f"{TASKS[env_id].keywords['mode']}-2"
    policy = Policy.pretrained(task)
    assert EnvConfig(**policy.env).n == gym.make(env_id).unwrapped.config.n
    with (PAGES.parent / "results" / "learning.csv").open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["task"] == task]
    (chance,) = (float(row["return"]) for row in rows if row["agent"] == "random")
    return policy, policy.env | {"id": env_id}, chance


@pytest.mark.parametrize(
    "env_id", [env_id for env_id, task in TASKS.items() if task.reward_threshold is not None]
)
def test_a_model_reaches_the_threshold_of_its_task_and_chance_does_not(env_id):
    threshold = gym.spec(env_id).reward_threshold
    model, env, chance = solution_of(env_id)
    mean = evaluate(model, env, episodes=100).returns.mean()
    assert threshold < mean < 1.1 * threshold
    assert chance < 0.25 * threshold
    text = " ".join((PAGES / page_of(env_id)).read_text(encoding="utf-8").split())
    assert f"mean return of {mean:.1f} over 100 episodes" in text
    assert f"random actions have {chance:.0f}." in text


@pytest.mark.parametrize("make", [gym.make, partial(gym.make_vec, num_envs=2)])
def test_the_threshold_of_a_task_is_left_out_where_keywords_make_another_task(make):
    def threshold(**keywords):
        return make("npend/SwingUp-v1", **keywords).unwrapped.spec.reward_threshold

    same = {"n": 2}, {"difficulty": "easy"}, {"observation": "sincos"}, {"masses": [1.0, 1.0]}
    assert {threshold(**keywords) for keywords in same} == {900.0}
    others = (
        {"n": 1}, {"difficulty": "medium"}, {"reward_type": "sparse"}, {"dt": 0.02},
        {"masses": [1.0, 2.0]}, {"angle_noise": 0.01}, {"mode": "balance"}, {"torque_levels": 3},
        {"randomize": {"masses": [0.9, 1.1]}},
    )  # fmt: skip
    assert {threshold(**keywords) for keywords in others} == {None}
    if make is not gym.make:  # which leaves the length of episodes to a wrapper
        assert threshold(max_episode_steps=300) is None


# -- what an id is --------------------------------------------------------------------------


def test_no_public_id_is_without_a_record_of_what_it_is():
    assert set(json.loads(public_ids.FILE.read_text("utf-8"))) >= set(TASKS)


@pytest.mark.parametrize("env_id", TASKS)
def test_the_rewards_starts_and_observations_of_an_id_stay_as_they_are_or_it_gets_a_new_version(
    env_id,
):
    known = json.loads(public_ids.FILE.read_text("utf-8"))[env_id]
    found = public_ids.described(env_id)
    assert found.keys() == known.keys()
    for key, value in known.items():
        if not isinstance(value, dict):
            assert found[key] == value, key
            continue
        assert found[key]["terminated"] == value["terminated"]
        for name in ("observations", "rewards"):
            np.testing.assert_allclose(found[key][name], value[name], atol=2e-5, err_msg=key)


@pytest.mark.parametrize(
    "change",
    [
        {"reward_type": "sparse"},
        {"spread": 0.06},
        {"max_torque": 14.0},
        {"damping": 0.01},
        {"observation": "sincos"},
    ],
)
def test_another_reward_start_motor_chain_or_observation_is_another_id(change, monkeypatch):
    make = gym.make
    monkeypatch.setattr(gym, "make", lambda env_id: make(env_id, **change))
    with pytest.raises(AssertionError):
        test_the_rewards_starts_and_observations_of_an_id_stay_as_they_are_or_it_gets_a_new_version(
            "npend/SwingUp-v1"
        )


@pytest.mark.parametrize(
    ("name", "value"), [("hold", 4.0), ("achieved", lambda _, given: given.height > 0.95)]
)
def test_another_success_is_another_id(name, value, monkeypatch):
    monkeypatch.setattr(SwingUp, name, value)
    with pytest.raises(AssertionError, match="success"):
        test_the_rewards_starts_and_observations_of_an_id_stay_as_they_are_or_it_gets_a_new_version(
            "npend/SwingUp-v1"
        )


# -- the ladder of torque limits ------------------------------------------------------------


@pytest.mark.parametrize(
    ("difficulty", "fraction"),
    [("easy", 0.5), ("medium", 0.2), ("hard", 0.1), (0.03, 0.03), (1, 1.0)],
)
def test_difficulty_is_the_torque_limit_over_the_torque_that_holds_the_chain_level(
    difficulty, fraction
):
    masses, lengths, g = np.array([1.0, 0.5, 0.25]), np.array([1.0, 0.4, 0.2]), 3.7
    level = g * (masses * np.cumsum(lengths)).sum()  # each bob at its distance from the pivot
    for mode in ("swingup", "balance", "calm"):
        config = EnvConfig(
            n=3, mode=mode, masses=masses, lengths=lengths, gravity=g, difficulty=difficulty
        )
        assert config.max_torque == pytest.approx(fraction * level, rel=1e-14)


def test_the_defaults_are_rungs_of_the_ladder():
    for mode, rung in (("swingup", "easy"), ("balance", "easy"), ("calm", "medium")):
        assert EnvConfig(mode=mode).max_torque == EnvConfig(mode=mode, difficulty=rung).max_torque


# -- the pages ------------------------------------------------------------------------------


def tables_of(page):
    """The tables of a page, each the list of its rows, a row the list of its cells."""
    blocks = re.findall(r"(?:^\|.*\n)+", (PAGES / page).read_text(encoding="utf-8"), re.MULTILINE)
    return [
        [[cell.strip(" `") for cell in row.strip("|\n").split("|")] for row in block.splitlines()]
        for block in blocks
    ]


@pytest.mark.parametrize("env_id", TASKS)
def test_the_page_of_a_task_repeats_what_the_environment_is(env_id):
    env, spec = gym.make(env_id).unwrapped, gym.spec(env_id)
    (heading, _, *facts), *others = tables_of(page_of(env_id))
    column = heading.index(env_id) or 1
    together = "Poles" in {row[0] for row in facts}
    spaces = str(env.observation_space.shape if together else env.observation_space)
    threshold = "-" if spec.reward_threshold is None else f"{spec.reward_threshold:g}"
    assert {row[0]: row[column] for row in facts} == {
        **({"Poles": str(env.config.n)} if together else {}),
        "Action space": str(env.action_space),
        "Observation space": spaces,
        "Step [s]": str(env.config.dt),
        "Steps of an episode": str(spec.max_episode_steps),
        "Solved from a mean return of": threshold,
    }
    (*actions, observations) = [table for table in others if table[0][0] in ("entry", "entries")]
    (arguments,) = [table for table in others if table[0][0] == "argument"]
    if actions:
        limit, unit = f"{env.config.action_limits[0]:.3f}", "N" if env.config.has_cart else "N m"
        assert actions[0][2][-1] == f"-{limit} to {limit} {unit}"
    low, high = env.observation_space.low, env.observation_space.high
    bounds = [(float(least), float(most)) for _, _, least, most in observations[2:]]
    entries = [entry for entry, *_ in observations[2:]]
    if not together:  # a row such as "0, 1" is of several entries with the same bounds
        rows = [entry.split(", ") for entry in entries]
        bounds = [each for each, row in zip(bounds, rows, strict=True) for _ in row]
        entries = [entry for row in rows for entry in row]
    if together:
        counts = [env.config.n if entry == "n" else int(entry) for entry in entries]
        bounds = [each for each, k in zip(bounds, counts, strict=True) for _ in range(k)]
    else:
        assert [int(entry) for entry in entries] == list(range(low.size))
    assert bounds == list(zip(low.tolist(), high.tolist(), strict=True))
    used = {name: getattr(env.config, name, None) for name in DEFAULTS}
    for name, *defaults, _ in arguments[2:]:
        value, default = used[name], defaults[column - 1]
        shown = "pi/4" if value == np.pi / 4 else f"{value:.5g}" if name != "difficulty" else "None"
        assert default == shown


def test_the_overview_lists_every_task_and_repeats_the_defaults():
    tasks, arguments, observations = tables_of("overview.md")
    default_of = {maker.strip("`"): name.strip('"') for name, *_, maker in observations[2:]}
    assert default_of["NPendulum-v0"] == DEFAULTS["observation"]
    assert {
        task.keywords["observation"] for env_id, task in TASKS.items() if "DMAcrobot" not in env_id
    } == {default_of["every `npend/..."]}
    pages = {re.search(r"\[`(.*)`\]\((.*)\)", row[0]).groups() for row in tasks[2:]}
    assert pages == {(env_id, page_of(env_id)) for env_id in TASKS}
    defaults = DEFAULTS | {
        "max_episode_steps": MAX_EPISODE_STEPS,
        "render_mode": None,
        "observation": TASKS["npend/SwingUp-v1"].keywords["observation"],
    }
    for name, default, _ in arguments[2:]:
        assert str(defaults[name]) == default.strip('"')
    for name, _, bounds, _ in observations[2:]:
        high = EnvConfig(n=1, observation=name.strip('"')).observation_space.high
        listed = [np.pi if bound == "pi" else float(bound) for bound in bounds.split(", ")]
        np.testing.assert_allclose(high, listed, rtol=1e-6)
