"""Other observations, rewards and actions: scaled speeds, sparse rewards, discrete torques."""

import gymnasium as gym
import numpy as np
import pytest

from npend_gym.envs import EnvConfig, Mode
from npend_gym.envs.registration import ENV_ID, TASKS
from npend_gym.rl import evaluate
from npend_gym.rl.evaluation.rollouts import Observer

# -- observations without velocities --------------------------------------------------------

SEEN = {"randomize": {"masses": (0.8, 1.2)}, "observe_context": True}
IN_PART = {
    "angles": {"observation": "angles"},
    "scaled": {"observation": "scaled"},
    "cart": {"observation": "sincos", "base": "cart"} | SEEN,
    "sensors": {"observation": "sincos", "angle_noise": 0.1, "observation_delay": 1.5},
    "goals": {"observation": "angles", "mode": "transition"},
}


@pytest.mark.parametrize(
    "keywords",
    [
        # sensors have kernels of their own, which take long to compile
        pytest.param(keywords, id=name, marks=pytest.mark.long if name == "sensors" else ())
        for name, keywords in IN_PART.items()
    ],
)
def test_without_velocities_all_else_is_observed_as_with_them(keywords):
    n = 2
    angles = n if keywords["observation"] == "angles" else 2 * n
    velocities = [*range(angles, angles + n), *([angles + n + 1] if "base" in keywords else [])]
    whole, part = (
        gym.make_vec(ENV_ID, num_envs=3, n=n, observe_velocities=seen, **keywords)
        for seen in (True, False)
    )
    single = gym.make(ENV_ID, n=n, observe_velocities=False, **keywords)
    space, left = whole.single_observation_space, part.single_observation_space
    assert left.shape == single.observation_space.shape == (space.shape[0] - len(velocities),)
    np.testing.assert_array_equal(left.high, np.delete(space.high, velocities))
    shown, seen, alone = (env.reset(seed=4)[0] for env in (whole, part, single))
    for _ in range(4):
        np.testing.assert_array_equal(seen, np.delete(shown, velocities, axis=1))
        np.testing.assert_array_equal(seen[0], alone)
        actions = whole.action_space.sample()
        (shown, *rest), (seen, *others) = whole.step(actions), part.step(actions)
        alone = single.step(actions[0])[0]
        for expected, got in zip(rest[:3], others[:3], strict=True):
            np.testing.assert_array_equal(got, expected)
        np.testing.assert_array_equal(others[3]["omega"], rest[3]["omega"])


def test_a_controller_that_needs_velocities_says_so():
    config, seen = EnvConfig(observe_velocities=False), np.zeros((2, 10), np.float32)
    told = Observer(lambda _, info: info, config)(seen, {"time": np.zeros(2)})
    assert set(told) == {"time", "theta", "tip_height"}
    with pytest.raises(ValueError, match=r"observe_velocities must be True .*'omega'.* got False"):
        Observer(lambda _, info: info["omega"], config)(seen, {"time": np.zeros(2)})


# -- bounded observations -------------------------------------------------------------------


CHAIN = {"n": 3, "masses": [2.0, 0.5, 1.0], "lengths": [0.3, 1.0, 2.0], "gravity": 3.7}


@pytest.mark.parametrize("max_torque", [None, 300.0])
def test_the_scaled_observation_is_sincos_with_speeds_over_their_scale_clipped(max_torque):
    masses, lengths = np.array(CHAIN["masses"]), np.array(CHAIN["lengths"])
    lifted = 2.0 * CHAIN["gravity"] * (masses * np.cumsum(lengths)).sum()  # J, bob by bob
    scale = np.sqrt(2.0 * lifted / (masses * lengths**2))
    keywords = CHAIN | {"num_envs": 5, "max_torque": max_torque}
    plain = gym.make_vec(ENV_ID, observation="sincos", **keywords)
    scaled = gym.make_vec(ENV_ID, observation="scaled", **keywords)
    assert np.array_equal(plain.reset(seed=3)[0][:, :6], scaled.reset(seed=3)[0][:, :6])
    rng, clipped = np.random.default_rng(0), 0
    for _ in range(200):
        actions = rng.choice([-1.0, 1.0], (5, 1))
        (expected, *_), (observation, *_) = plain.step(actions), scaled.step(actions)
        expected[:, 6:] = np.clip(expected[:, 6:] / scale, -2.0, 2.0)
        np.testing.assert_allclose(observation, expected, rtol=3e-7, atol=0.0)
        clipped += (abs(observation[:, 6:]) == 2.0).sum()
    assert (clipped > 100) == (max_torque is not None)


# -- sparse rewards -------------------------------------------------------------------------


def height_and_kinetic_energy(info):
    """Both as in `Quantities`, of bobs of 1 kg on rods of 1 m, by sums over the bobs."""
    theta, omega = info["theta"], info["omega"]
    weights = np.arange(theta.shape[1], 0, -1)  # bobs that each rod carries
    height = ((1.0 - np.cos(theta)) * weights).sum(axis=1) / (2.0 * weights.sum())
    vx, vy = (np.cumsum(f(theta) * omega, axis=1) for f in (np.cos, np.sin))
    kinetic = 0.5 * (vx**2 + vy**2).sum(axis=1)
    return height, kinetic / (2.0 * 9.81 * weights.sum())


def goal_is_met(mode, info, start_energy):
    """What `achieved` of the mode says, from the info alone."""
    if mode == "balance":
        return info["tip_height"] >= 0.5 * info["theta"].shape[1]
    if mode == "calm":
        return info["energy"] < 0.01 * start_energy
    height, kinetic = height_and_kinetic_energy(info)
    return (height > 0.95) & (kinetic < 0.01) if mode == "swingup" else np.zeros(len(height), bool)


@pytest.mark.parametrize(("env_id", "theta", "omega"), [
    ("npend/SwingUp-v1", np.pi - 0.3, 0.8), ("npend/Balance-v1", np.pi - 0.4, 0.5),
    ("npend/Calm-v1", 0.2, 0.5), ("npend/Release-v1", np.pi, 0.1),
])  # fmt: skip
def test_a_sparse_reward_is_1_where_the_goal_is_met_and_0_elsewhere(env_id, theta, omega):
    mode = TASKS[env_id].keywords["mode"]
    keywords = {"reward_type": "sparse", "damping": 2.0, "max_episode_steps": None}
    envs = gym.make_vec(env_id, num_envs=9, autoreset_mode="DISABLED", **keywords)
    env = gym.make(env_id, **keywords)
    angles, speeds = np.full((9, 2), theta), np.full((9, 2), omega)
    angles += np.linspace(-0.3, 0.3, 9)[:, None]
    _, info = envs.reset(seed=0, options={"theta": angles, "omega": speeds})
    env.reset(seed=0, options={"theta": angles[2], "omega": speeds[2]})
    assert info["success"].tolist() == [mode == "balance"] * 9
    start_energy, met, over = info["energy"], [], False
    for _ in range(300):
        _, reward, terminated, _, info = envs.step(envs.action_space.sample() * 0)
        assert np.array_equal(reward, goal_is_met(mode, info, start_energy).astype(float))
        if mode in ("balance", "calm"):
            np.testing.assert_array_equal(info["success"], reward)
        met.append(reward)
        if not over:
            _, single, over, *_ = env.step(env.action_space.sample() * 0)
            assert type(single) is float
            assert single == reward[2]
        if terminated.any():
            envs.reset(options={"reset_mask": terminated, "theta": angles, "omega": speeds})
            start_energy = info["energy"]
    assert (0.0 < np.mean(met) < 1.0) == (mode != "passive")


def test_the_reward_of_a_mode_of_ones_own_can_be_sparse():
    class Low(Mode):
        dt = 0.05

        def start(self, rng, n, *_):
            return rng.uniform(-2.0, 2.0, n), np.zeros(n)

        def reward(self, quantities):
            return quantities.tip

        def achieved(self, quantities):
            return quantities.tip < -0.5

    env = gym.make(ENV_ID, mode=Low(), reward_type="sparse", max_torque=0.0)
    envs = gym.make_vec(ENV_ID, num_envs=3, mode=Low(), reward_type="sparse", max_torque=0.0)
    env.reset(seed=1)
    envs.reset(seed=0)
    rewards = []
    for _ in range(50):
        _, reward, _, _, info = env.step([0.0])
        assert reward == float(info["tip_height"] / 2.0 < -0.5)
        assert envs.step(np.zeros((3, 1)))[1][1] == reward
        rewards.append(reward)
    assert set(rewards) == {0.0, 1.0}


# -- discrete actions -----------------------------------------------------------------------

LEVELS = {"mode": "swingup", "torque_levels": 3}
PASSIVE = {"mode": "passive"}


def test_discrete_actions_are_the_torques_of_their_digits():
    assert EnvConfig(torque_levels=2).action_table.tolist() == [[-1.0], [1.0]]
    assert EnvConfig(torque_levels=5).action_table[:, 0].tolist() == [-1.0, -0.5, 0.0, 0.5, 1.0]
    config = EnvConfig(n=3, actuated=(0, 2), torque_levels=3)
    assert config.action_space == gym.spaces.Discrete(9)
    for action, row in enumerate(config.action_table.tolist()):
        first, second = divmod(action, 3)  # two digits to the base 3
        assert row == [first - 1.0, second - 1.0]


@pytest.mark.parametrize("actuated", [(0,), (0, 1)])
def test_a_discrete_action_has_the_effect_of_its_torques_to_the_last_bit(actuated):
    keywords = {"n": 2, "actuated": actuated}
    envs, continuous = (
        gym.make_vec("npend/Calm-v1", num_envs=3, **keywords, **more)
        for more in ({"torque_levels": 3}, {})
    )
    env = gym.make("npend/Calm-v1", torque_levels=3, **keywords)
    table = envs.config.action_table
    assert envs.action_space == gym.spaces.MultiDiscrete([len(table)] * 3)
    for each, seed in ((envs, 0), (continuous, 0), (env, 1)):
        each.reset(seed=seed)
    rng = np.random.default_rng(0)
    for _ in range(50):
        actions = rng.integers(len(table), size=3)
        observation, reward, *_ = envs.step(actions)
        same, equal, *_ = continuous.step(table[actions])
        assert np.array_equal(observation, same)
        assert np.array_equal(reward, equal)
        alone, lone, *_ = env.step(actions[1])
        assert np.array_equal(alone, observation[1])
        assert lone == reward[1]


@pytest.mark.parametrize(
    ("keywords", "action", "error", "message"),
    [
        (LEVELS, 3, ValueError, "action must be between 0 and 2, got 3"),
        (LEVELS, -1, ValueError, "action must be between 0 and 2, got -1"),
        (LEVELS, 0.5, TypeError, "action must hold integers, got 0.5"),
        (LEVELS, True, TypeError, "action must hold integers, got True"),
        (LEVELS, [1], ValueError, r"action must have the shape \(\), got \(1,\)"),
        (LEVELS, np.array([0.5]), TypeError, "action must hold integers"),
        (PASSIVE, 1, ValueError, "action must be 0"),
        (PASSIVE, 0.0, TypeError, "action must hold integers"),
    ],
)
def test_a_wrong_discrete_action_changes_nothing(keywords, action, error, message):
    env = gym.make(ENV_ID, **keywords).unwrapped
    env.reset(seed=0)
    with pytest.raises(error, match=message):
        env.step(action)
    for steps, good in enumerate((0, np.int64(0), np.array(0)), start=1):
        assert env.step(good)[4]["time"] == pytest.approx(steps * env.config.dt)


def test_dqn_of_stable_baselines3_trains_on_discrete_torques():
    sb3 = pytest.importorskip("stable_baselines3")
    from npend_gym.rl import SB3VecEnv

    keywords = {"n": 1, "torque_levels": 3, "max_episode_steps": 50}
    envs = gym.make_vec("npend/SwingUp-v1", num_envs=4, autoreset_mode="SAME_STEP", **keywords)
    model = sb3.DQN("MlpPolicy", SB3VecEnv(envs), learning_starts=40, seed=0, device="cpu")
    model.learn(200)
    assert model.q_net.q_net[-1].out_features == 3
    mean = evaluate(
        lambda observation, _: model.predict(observation, deterministic=True)[0],
        keywords | {"id": "npend/SwingUp-v1"},
        episodes=3,
    ).returns
    assert np.isfinite(mean).all()


@pytest.mark.parametrize(("n", "dt"), [(1, 20), (2, 20), (2, 5.0), (5, 10)])
def test_a_step_in_milliseconds_is_refused_where_motors_act(n, dt):
    most = np.pi * np.sqrt(n / 9.81)  # half the period of a pendulum as long as the chain
    for name in ("dt", "motor_lag"):
        rule = rf"{name} must be at most {most:.3g} s.* are {dt / 1000:g} s"
        with pytest.raises(ValueError, match=rule):
            gym.make("NPendulum-v0", n=n, **{name: dt})
    assert gym.make("NPendulum-v0", n=n, dt=0.99 * most).unwrapped.config.dt == 0.99 * most
    assert gym.make("NPendulum-v0", n=n, mode="passive", dt=dt).unwrapped.config.dt == dt
