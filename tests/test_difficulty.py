"""Harder episodes by options, by curricula; chains of several lengths for one network."""

import json
import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.spaces import Box
from gymnasium.vector import SyncVectorEnv
from gymnasium.wrappers import FrameStackObservation, RescaleAction
from gymnasium.wrappers.vector import TransformObservation

from npend_gym import NPendulumEnv, NPendulumVectorEnv
from npend_gym.envs import Curriculum, JoinedVectorEnv, PadRods, VectorCurriculum, VectorPadRods
from npend_gym.rl import evaluate, setting_of

# (of the environment, by options, what else it is made with)
SETTINGS = {
    "max_torque": (9.0, 4.0, {}),
    "max_force": (9.0, 4.0, {"base": "cart"}),
    "action_delay": (2.5, 1.5, {}),
    "motor_lag": (0.1, 0.05, {}),
    "torque_noise": (1.0, 0.3, {}),
    "torque_ripple": (1.0, 0.3, {}),
    "push_rate": (9.0, 4.0, {"push_force": 3.0}),
    "push_force": (3.0, 1.0, {"push_rate": 9.0}),
    "angle_noise": (0.2, 0.1, {}),
    "velocity_noise": (0.2, 0.1, {}),
    "angle_resolution": (0.2, 0.1, {}),
    "velocity_resolution": (0.2, 0.1, {}),
    "observation_delay": (2.5, 1.5, {}),
    "amplitude": (0.7, -0.3, {"mode": "calm"}),
    "spread": (0.05, 0.8, {}),
}


def episode(env, steps=6, options=None, seed=3):
    """Return the observations of an episode under changing actions."""
    shown, shape = [env.reset(seed=seed, options=options)[0]], env.action_space.shape
    return [*shown, *(env.step(np.full(shape, 0.9 * (-1.0) ** (k // 2)))[0] for k in range(steps))]


@pytest.mark.parametrize(
    "name",
    [pytest.param(k, marks=[pytest.mark.long] * ("delay" in k or "lag" in k)) for k in SETTINGS],
)
def test_an_episode_with_an_option_is_that_of_an_environment_made_with_it(name):
    high, low, more = SETTINGS[name]
    env = NPendulumEnv(n=2, **more, **{name: high})
    made = episode(NPendulumEnv(n=2, **more, **{name: low}))
    assert np.array_equal(episode(env, options={name: low}), made)
    as_before = episode(env)  # the option was of one episode
    assert np.array_equal(as_before, episode(NPendulumEnv(n=2, **more, **{name: high})))
    assert not np.array_equal(as_before, made)


@pytest.mark.parametrize("name", [k for k in SETTINGS if k not in ("spread", "amplitude")])
def test_an_error_of_an_episode_is_gone_in_the_next_that_has_none(name):
    high, _, more = SETTINGS[name]
    env = NPendulumEnv(n=2, **more, **{name: high})
    none = {name: 0.0}
    expected = episode(env, options=none)
    episode(env)
    assert np.array_equal(episode(env, options=none), expected)
    state = env.get_state()
    other = NPendulumEnv(n=2, **more, **{name: high})
    episode(other)
    other.set_state(state)
    assert np.array_equal(other.step(np.ones(1))[0], env.step(np.ones(1))[0])


def test_a_delay_of_an_episode_is_whole_where_that_of_the_environment_is():
    env = NPendulumEnv(n=1, action_delay=2.0)
    with pytest.raises(ValueError, match=r"action_delay'\] must be whole steps.*=2.5"):
        env.reset(options={"action_delay": 0.5})
    for more in ({}, {"motor_lag": 0.1}):
        made = NPendulumEnv(n=1, action_delay=2.5 - len(more), **more)
        assert np.array_equal(
            episode(made, options={"action_delay": 0.5}),
            episode(NPendulumEnv(n=1, action_delay=0.5, **more)),
        )


@pytest.mark.parametrize(
    "name", ["max_torque", "spread", pytest.param("angle_noise", marks=pytest.mark.long)]
)
def test_sub_environments_have_options_of_their_own(name):
    high, low, _ = SETTINGS[name]
    high, low = max(high, low), min(high, low)
    envs = NPendulumVectorEnv(3, n=2, **{name: high})
    shown = np.array(episode(envs, options={name: [high, low, high]}))
    for k, value in enumerate((high, low, high)):
        assert np.array_equal(shown[:, k], episode(NPendulumEnv(n=2, **{name: value}), seed=3 + k))


@pytest.mark.long
def test_tensors_have_the_starts_and_torques_of_the_options():
    torch = pytest.importorskip("torch")
    from npend_gym.torch import DifferentiableVectorEnv

    options = {"spread": 0.7, "max_torque": [2.0, 5.0]}
    envs, tensors = NPendulumVectorEnv(2, n=2), DifferentiableVectorEnv(2, n=2)
    shown = np.array(episode(envs, options=options))
    tensors.reset(seed=3, options=options)
    for k in range(6):
        action = torch.full((2, 1), 0.9 * (-1.0) ** (k // 2), dtype=torch.float64)
        observation = tensors.step(action)[0]
    assert np.allclose(observation, shown[-1], atol=1e-6)
    tensors.set_options({"spread": 0.0, "max_torque": 1.0})
    assert not tensors.reset()[0].any()
    envs.reset(options={"spread": 0.0, "max_torque": 1.0})
    moved = envs.step(np.ones((2, 1)))[0]
    assert np.allclose(tensors.step(torch.ones_like(action))[0], moved, atol=1e-6)


def test_a_mode_of_the_users_own_starts_with_the_options():
    from npend_gym.envs import SwingUp

    class Mine(SwingUp):
        def start(self, rng, n, amplitude, spread):  # noqa: ARG002
            return np.full(n, amplitude), np.full(n, spread)

    _, info = NPendulumEnv(n=2, mode=Mine()).reset(options={"amplitude": 0.4, "spread": 0.3})
    assert info["theta"].tolist() == [0.4, 0.4]
    assert info["omega"].tolist() == [0.3, 0.3]


@pytest.mark.parametrize("mode", ["NEXT_STEP", "SAME_STEP", "DISABLED"])
def test_options_of_later_episodes_leave_those_that_run_alone(mode):
    envs = NPendulumVectorEnv(2, n=1, max_episode_steps=2, autoreset_mode=mode, max_torque=3.0)
    one = np.ones((2, 1))

    def torques():
        *_, info = envs.step(one)
        if mode == "DISABLED" and envs.unwrapped._done.all():
            envs.reset(options=None)
        return info.get("final_info", info)["torque"][:, 0].tolist()

    envs.reset(seed=0)
    envs.set_options({"max_torque": 1.0, "reset_mask": np.array([True, False])})
    resting = [[0.0, 0.0]] if mode == "NEXT_STEP" else []
    expected = [[3.0, 3.0], [3.0, 3.0], *resting, *[[1.0, 3.0]] * 2, *resting, *[[1.0, 3.0]] * 2]
    assert [torques() for _ in expected] == expected
    envs = pickle.loads(pickle.dumps(envs))
    envs.set_options(None)
    assert [3.0, 3.0] in [torques() for _ in range(4)]


def test_a_draw_of_the_start_is_within_its_range_and_is_overridden_by_options():
    randomize = {"spread": {"low": 0.0, "high": 2.0}, "amplitude": (0.5, 1.5)}
    envs = NPendulumVectorEnv(500, n=1, mode="calm", amplitude=1.0, spread=0.0, randomize=randomize)
    _, info = envs.reset(seed=0)
    assert envs.config.context_names == ("spread", "amplitude")
    spread, amplitude = info["context"].T
    rest = (info["theta"][:, 0] - amplitude) / spread
    assert np.allclose([rest.min(), rest.max()], [0.0, 1.0], atol=0.05)
    assert np.allclose([amplitude.min(), amplitude.max()], [0.5, 1.5], atol=0.02)
    _, info = envs.reset(options={"spread": 0.0, "amplitude": 0.25})
    assert np.all(info["theta"] == 0.25)
    assert np.all(info["context"] == [0.0, 0.25])


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"angle_noise": 0.3}, "angle_noise'] must be at most 0.2, the largest .* is made for"),
        ({"max_torque": -1.0}, "max_torque'] must be zero or more"),
        ({"spread": 4.0}, "spread must be at most pi"),
        ({"max_force": 1.0}, "options must be among"),
        ({"cart_mass": 1.0}, "options must be among"),
    ],
)
def test_settings_beyond_their_rule_are_refused(options, says):
    env = NPendulumEnv(angle_noise=0.2)
    env.reset(seed=0)
    for call in (env.set_options, lambda given: env.reset(options=given)):
        with pytest.raises(ValueError, match=says):
            call(options)
    with pytest.raises(RuntimeError, match=r"call reset\(\) before set_options"):
        NPendulumEnv().set_options({})


LEVELS = [{"spread": 0.0}, {"theta": 2.4, "max_torque": 0.0}]  # the second must fall


def balancing(count=None, **keywords):
    keywords |= {"n": 1, "max_episode_steps": 40}
    if count is None:
        return gym.make("npend/Balance-v1", **keywords)
    return gym.make_vec("npend/Balance-v1", num_envs=count, **keywords)


def test_the_level_rises_when_enough_of_the_last_episodes_succeed_and_stays_where_they_fail():
    env = Curriculum(balancing(), LEVELS, threshold=1.0, episodes=2)
    seen = []
    for _ in range(6):
        _, info = env.reset(seed=1)
        done, level = False, info["level"]
        while not done:
            *_, terminated, truncated, info = env.step(np.zeros(1))
            done = terminated or truncated
        seen.append((level, info["level"], info["success"], [*env.outcomes]))
    assert [level for level, *_ in seen] == [0, 0, 1, 1, 1, 1]
    assert [level for _, level, *_ in seen] == [0, 0, 1, 1, 1, 1]
    assert [success for *_, success, _ in seen] == [True, True, False, False, False, False]
    assert seen[1][-1] == []
    assert seen[-1][-1] == [False, False]
    kept = json.loads(json.dumps(env.state_dict()))
    other = Curriculum(balancing(), LEVELS, threshold=1.0, episodes=2)
    other.load_state_dict(kept)
    assert other.state_dict() == env.state_dict() == {"level": 1, "outcomes": [False, False]}
    assert np.array_equal(other.reset(seed=1)[0], env.reset(seed=1)[0])
    assert env.reset(seed=1, options={"theta": 3.0})[1]["theta"] == 3.0
    assert abs(env.reset()[1]["theta"][0] - np.pi) > 0.03  # and after that those of the level


@pytest.mark.parametrize("mode", ["NEXT_STEP", "SAME_STEP", "DISABLED"])
def test_the_episodes_of_a_level_alone_count_in_a_vector_environment(mode):
    envs = VectorCurriculum(balancing(3, autoreset_mode=mode), LEVELS, threshold=1.0, episodes=2)
    _, info = envs.reset(seed=0, options={"theta": [[np.pi], [np.pi], [2.8]]})
    assert info["level"].tolist() == [0, 0, 0]
    ends, still = [], np.zeros((3, 1))
    for _ in range(400):
        *_, terminated, truncated, info = envs.step(still)
        done = terminated | truncated
        last = info.get("final_info", info)
        ends += [(k, int(last["level"][k]), bool(last["success"][k])) for k in np.flatnonzero(done)]
        if mode == "DISABLED" and done.any():
            _, info = envs.reset(options={"reset_mask": done})
            assert info["_level"].tolist() == done.tolist()
    of = {k: [level for lane, level, _ in ends if lane == k] for k in range(3)}
    assert envs.level == 1
    assert all(success == (level == 0) for k, level, success in ends if (k, level) != (2, 0))
    # Two stand for 40 steps. SAME_STEP begins their next episodes before their success counts
    begin = 2 if mode == "SAME_STEP" else 1
    assert of[0][: begin + 1] == of[1][: begin + 1] == [0] * begin + [1]
    assert of[2][0] == 0
    assert all(levels == sorted(levels) and levels[-1] == 1 for levels in of.values())
    assert [*envs.outcomes] == [False, False]


def test_stable_baselines3_has_the_levels_of_a_curriculum():
    pytest.importorskip("stable_baselines3")
    from npend_gym.rl import SB3VecEnv

    envs = balancing(2, autoreset_mode="SAME_STEP")
    envs = VectorCurriculum(envs, LEVELS, threshold=1.0, episodes=2)
    venv, still = SB3VecEnv(envs, info_keys=("level",)), np.zeros((2, 1))
    venv.reset()
    seen = [[info["level"] for info in venv.step(still)[-1]] for _ in range(100)]
    assert seen[0] == [0, 0]
    assert seen[-1] == [1, 1]


def test_curricula_say_what_is_wrong():
    env = balancing()
    for levels in ([], {"spread": 0.1}, "easy"):
        with pytest.raises(TypeError, match="levels must be a list of options of reset"):
            Curriculum(env, levels)
    with pytest.raises(ValueError, match="spread'] must be zero or more"):
        Curriculum(env, [{"spread": -1.0}])
    with pytest.raises(ValueError, match="threshold must be at most 1"):
        Curriculum(env, LEVELS, threshold=80)
    with pytest.raises(TypeError, match="env must be an environment of N-pendulums for Curric"):
        Curriculum(gym.make("CartPole-v1"), LEVELS)
    with pytest.raises(ValueError, match=r"the level of state must be .* 1"):
        Curriculum(env, LEVELS).load_state_dict({"level": 2, "outcomes": []})
    for state, error, message in (
        ({}, ValueError, "state must have level and outcomes, as state_dict returns them"),
        (None, ValueError, "state must have level and outcomes"),
        ({"level": 1, "outcomes": 5}, TypeError, "the outcomes of state must be a list"),
        ({"level": 1, "outcomes": [5]}, TypeError, "each of the outcomes of state must be True or"),
    ):
        wrapper = Curriculum(env, LEVELS)
        with pytest.raises(error, match=message):
            wrapper.load_state_dict(state)
        assert wrapper.state_dict() == {"level": 0, "outcomes": []}
    with pytest.raises(ValueError, match="options must leave out 'persist'"):
        Curriculum(env, LEVELS).reset(options={"lengths": 2.0, "persist": True})


def test_a_curriculum_is_evaluated_in_the_environment_as_made():
    envs = VectorCurriculum(balancing(2), LEVELS)
    still = evaluate(lambda observation, _: np.zeros((len(observation), 1)), envs, episodes=4)
    plain = evaluate(
        lambda observation, _: np.zeros((len(observation), 1)), balancing(2), episodes=4
    )
    assert still.returns.tolist() == plain.returns.tolist()


CHAINS = {
    "angles": {"n": 2},
    "positions alone": {"n": 2, "observation": "sincos", "observe_velocities": False},
    "a cart": {"n": 2, "base": "cart", "observation": "scaled", "actuated": (1,)},
    "goals": {"n": 2, "mode": "transition", "observation": "sincos"},
    "context": {
        "n": 2, "observe_context": True, "randomize": {"masses": (0.5, 2.0), "gravity": (0.5, 1.0)}
    },
}  # fmt: skip


@pytest.mark.parametrize("case", CHAINS)
def test_padded_observations_have_each_entry_of_a_rod_at_its_place(case):
    keywords = CHAINS[case]
    bare, env = NPendulumEnv(**keywords), PadRods(NPendulumEnv(**keywords), 4)
    longest = NPendulumEnv(**keywords | {"n": 4})
    own, (shown, _) = bare.reset(seed=0)[0], env.reset(seed=0)
    assert shown[-4:].tolist() == [1.0, 1.0, 0.0, 0.0]
    # bounds say which entries belong together in the environment with the most rods
    assert np.array_equal(env.observation_space.high[:-4], longest.observation_space.high)
    assert shown.dtype == np.float32
    numbered = 1.0 + np.arange(own.size, dtype=np.float32)
    padded = env._padding.padded(numbered)[:-4]
    assert padded[padded > 0.0].tolist() == numbered.tolist()
    groups = env._padding.space.high.size - 4
    of_rods = [k for k in range(groups) if k not in env._padding.columns]
    assert len(of_rods) == groups - own.size
    assert not padded[of_rods].any()
    for _ in range(3):
        observation, *_ = env.step(env.action_space.sample())
        assert observation in env.observation_space
    envs = VectorPadRods(NPendulumVectorEnv(3, **keywords), 4)
    assert np.array_equal(envs.reset(seed=0)[0][0], shown)
    assert envs.single_observation_space == env.observation_space


def test_padded_actions_reach_the_motors_that_there_are():
    env = PadRods(NPendulumEnv(n=2, actuated=(1, 0), max_torque=2.0), 3, actuated=(0, 1, 2))
    env.reset(seed=0)
    assert env.action_space.shape == (3,)
    *_, info = env.step(np.array([0.25, 0.5, 0.75]))
    assert info["torque"].tolist() == [1.0, 0.5]  # of joint 1, then of joint 0
    envs = NPendulumVectorEnv(2, n=1, base="cart", max_force=1.0)
    envs = VectorPadRods(envs, 2, actuated=(0, 1))
    envs.reset(seed=0)
    *_, info = envs.step(np.array([[0.25, 0.5, 0.75], [-0.25, 0.5, 0.75]]))
    assert info["torque"].tolist() == [[0.25], [-0.25]]
    env = PadRods(NPendulumEnv(n=1, torque_levels=3), 2)
    env.reset(seed=0)
    env.step(2)
    for keywords in ({"torque_levels": 3}, {"actuated": (1,)}):
        with pytest.raises(ValueError, match="actuated must name all joints with a motor"):
            PadRods(NPendulumEnv(n=2, **keywords), 2, actuated=(0,))
    with pytest.raises(ValueError, match="n_max must be at least the number of rods, 2, got 1"):
        PadRods(NPendulumEnv(n=2), 1)
    for inner, pad in (
        (NPendulumEnv(n=1), PadRods),
        (gym.make_vec("npend/SwingUp-v1", num_envs=2, n=1), VectorPadRods),
    ):
        with pytest.raises(ValueError, match="env must have observations of the shape"):
            pad(pad(inner, 2), 3)


def test_a_mask_that_is_none_resets_all_at_the_present_level():
    envs = gym.make_vec("npend/Balance-v1", num_envs=2, n=1)
    envs = VectorCurriculum(envs, [{"spread": 0.02}, {"spread": 0.1}])
    envs.load_state_dict({"level": 1, "outcomes": []})
    assert envs.reset(seed=0, options={"reset_mask": None})[1]["level"].tolist() == [1, 1]


def test_padded_spaces_are_those_of_the_wrappers_below():
    ends = np.float32(-10.0), np.float32(10.0)
    env = PadRods(RescaleAction(NPendulumEnv(n=1, max_torque=2.0), *ends), 2)
    assert env.action_space.high.tolist() == [10.0]
    env.reset(seed=0)
    assert env.step(env.action_space.high)[-1]["torque"].tolist() == [2.0]
    with pytest.raises(ValueError, match="actuated must be left out where a wrapper has changed"):
        PadRods(env.env, 2, actuated=(0, 1))
    with pytest.raises(ValueError, match=r"observations of the shape \(2,\), got \(3, 2\)"):
        PadRods(FrameStackObservation(NPendulumEnv(n=1), 3), 2)
    spaces = Box(-1.0, 1.0, (2, 2)), Box(-1.0, 1.0, (2,))
    envs = TransformObservation(NPendulumVectorEnv(2, n=1), np.tanh, *spaces)
    assert VectorPadRods(envs, 2).single_observation_space.high.tolist() == [1.0] * 6


def joined(mode, lengths=(1, 3), steps=3, count=2):
    return JoinedVectorEnv([
        VectorPadRods(
            gym.make_vec("npend/SwingUp-v1", num_envs=count, n=n, max_episode_steps=steps,
                         autoreset_mode=mode), 3,
        )
        for n in lengths
    ])  # fmt: skip


@pytest.mark.parametrize("mode", ["NEXT_STEP", "SAME_STEP", "DISABLED"])
def test_joined_environments_have_the_episodes_of_each(mode):
    envs = joined(mode)
    shown, info = envs.reset(seed=5)
    actions = np.linspace(-1.0, 1.0, 4)[:, None]
    each = [joined(mode, lengths=(n,)) for n in (1, 3)]
    parts = [one.reset(seed=5 + 2 * k) for k, one in enumerate(each)]
    assert info["theta"].shape == (4, 3)
    for _ in range(7):
        assert np.array_equal(shown, np.concatenate([one for one, _ in parts]))
        assert not info["theta"][:2, 1:].any()
        if mode == "DISABLED" and info["time"][0] > 0.14:
            mask = np.array([False, False, True, True])
            shown, info = envs.reset(options={"reset_mask": mask})
            parts[1] = each[1].reset()
            assert info["_time"].tolist() == mask.tolist()
            assert np.array_equal(shown, np.concatenate([one for one, _ in parts]))
            break
        shown, reward, _, truncated, info = envs.step(actions)
        results = [one.step(actions[2 * k : 2 * k + 2]) for k, one in enumerate(each)]
        parts = [(result[0], result[-1]) for result in results]
        assert np.array_equal(reward, np.concatenate([result[1] for result in results]))
        if "final_obs" in info:
            assert truncated.all()
            last = np.concatenate([result[-1]["final_obs"] for result in results])
            assert np.array_equal(np.stack([*info["final_obs"]]), np.stack([*last]))
            assert info["final_info"]["theta"].shape == (4, 3)


def test_joined_environments_must_fit_each_other():
    envs = [gym.make_vec("npend/SwingUp-v1", num_envs=2, n=n) for n in (1, 2)]
    with pytest.raises(ValueError, match="envs must have equal spaces"):
        JoinedVectorEnv(envs)
    with pytest.raises(ValueError, match="envs must have at least one"):
        JoinedVectorEnv([])
    with pytest.raises(ValueError, match="envs must be different environments, got one twice"):
        JoinedVectorEnv([VectorPadRods(envs[0], 2) for _ in range(2)])
    with pytest.raises(TypeError, match="envs must be a list such as"):
        JoinedVectorEnv(None)
    envs = [joined(mode, lengths=(1,)) for mode in ("SAME_STEP", "DISABLED")]
    with pytest.raises(ValueError, match="envs must have one autoreset mode"):
        JoinedVectorEnv(envs)
    goals = {"n": 1, "mode": "transition", "goal_env": True, "reward_type": "sparse"}
    with pytest.raises(ValueError, match="envs must observe arrays: leave out goal_env"):
        JoinedVectorEnv([NPendulumVectorEnv(2, **goals)])
    with pytest.raises(TypeError, match="envs must be vector environments, got <TimeLimit"):
        JoinedVectorEnv([gym.make("npend/SwingUp-v1")])


def test_environments_of_several_kinds_side_by_side_are_no_setting_of_an_evaluation():
    heavier = SyncVectorEnv([lambda m=m: NPendulumEnv(n=1, masses=m) for m in (1.0, 5.0)])
    for envs, names in ((joined("NEXT_STEP"), "'chain'"), (heavier, "'chain'")):
        with pytest.raises(ValueError, match=f"env must have sub-environments that .*{names}"):
            setting_of(envs)
    alike = SyncVectorEnv([lambda: NPendulumEnv(n=1, masses=5.0) for _ in range(2)])
    assert setting_of(alike).config.chain.masses.tolist() == [5.0]


def test_an_action_that_is_not_finite_steps_none_of_the_joined_environments():
    envs = joined("NEXT_STEP")
    envs.reset(seed=0)
    with pytest.raises(ValueError, match="action must be finite"):
        envs.step([[0.0]] * 3 + [[np.nan]])
    assert envs.step([[0.0]] * 4)[-1]["time"] == pytest.approx([0.05] * 4)


class Telling(gym.Env):
    """An environment whose info has a number."""

    observation_space, action_space = Box(-1.0, 1.0), Box(-1.0, 1.0)

    def __init__(self, number):
        self.number = number

    def reset(self, **_):
        return self.observation_space.sample(), {"number": self.number}


def test_infos_of_several_types_keep_their_numbers_in_joined_environments():
    envs = [SyncVectorEnv([lambda number=number: Telling(number)]) for number in (1, 2.5)]
    assert JoinedVectorEnv(envs).reset()[1]["number"].tolist() == [1.0, 2.5]


def test_wrong_seeds_masks_and_actions_of_joined_environments_are_of_all_of_them():
    envs = joined("DISABLED")
    assert np.array_equal(envs.reset(seed=np.int64(5))[0], joined("DISABLED").reset(seed=5)[0])
    mask = {"reset_mask": np.array([True, False])}
    half = {"reset_mask": np.array([False, False, True, False])}
    for message, call in (
        ("must be all True in the first reset", lambda: joined("DISABLED").reset(options=half)),
        ("each of the 4 sub-environments, got 3", lambda: envs.reset(seed=[1, 2, 3])),
        ("seed must be an integer, got 'a'", lambda: envs.reset(seed="a")),
        (r"reset_mask'\] must have the shape \(4,\)", lambda: envs.reset(options=mask)),
        (r"each of the 4 sub-environments, got the shape \(3, 1\)", lambda: envs.step([[0.0]] * 3)),
    ):
        with pytest.raises((ValueError, TypeError), match=message):
            call()


def test_an_action_of_padded_rods_has_an_entry_for_each_joint_of_actuated():
    env = PadRods(gym.make("npend/Balance-v1", n=1), n_max=3, actuated=(0, 1, 2))
    envs = VectorPadRods(gym.make_vec("npend/Balance-v1", num_envs=2, n=1), 3, actuated=(0, 1, 2))
    for each, wrong in ((env, 0.0), (env, [0.0, 0.0]), (envs, 0.0), (envs, [[0.0, 0.0]] * 2)):
        each.reset(seed=0)
        with pytest.raises(ValueError, match="action must have 3 entries"):
            each.step(wrong)
