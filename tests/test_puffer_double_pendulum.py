"""The double pendulum of PufferLib, by the formulas of its source."""

import gymnasium as gym
import numpy as np
import pytest

from npend_gym.envs import steps_held

ENV_ID = "npend/PufferDoublePendulum-v1"
PUSHES = np.array([0, 1, 2, 2])


def their_reward(info, action):
    """PufferLib 4.0, `upright_reward` with `balance_bonus_weight` 0.5; angles from the upright."""
    theta, omega = np.angle(-np.exp(1j * info["theta"])), info["omega"]
    x, height = info["cart_position"], 0.5 * (1.0 + np.cos(theta).mean(axis=1))
    slow = 0.6 + 0.4 * np.exp(-np.log(10.0) * (omega / 5.0) ** 2).min(axis=1)
    centred = 0.5 * (1.0 + np.exp(-np.log(10.0) * (x / 2.0) ** 2))
    control = 0.2 * (4.0 + np.maximum(0.0, 1.0 - (action - 1.0) ** 2))
    away = (theta**2).mean(axis=1) / 0.3**2 + (omega**2).mean(axis=1) + (x / 2.0) ** 2
    return 0.5 * height * centred * control * slow + 0.5 * np.exp(-away)


def is_held(info):
    height = 0.5 * (1.0 - np.cos(info["theta"]).mean(axis=1))
    slow = (abs(info["omega"]) < 1.5).all(axis=1) & (abs(info["cart_velocity"]) < 1.0)
    return (height > 0.9) & slow


def states(size):
    """Return options of `reset`: half near the upright, half anywhere."""
    rng = np.random.default_rng(0)
    near, anywhere = rng.random((size, 1)) < 0.5, rng.normal(0.0, 9.0, (size, 2))
    return {
        "theta": np.where(near, np.pi + rng.normal(0.0, 0.3, (size, 2)), anywhere),
        "omega": np.where(near, 1.0, 5.0) * rng.normal(size=(size, 2)),
        "cart_position": rng.uniform(-4.0, 4.0, size),
        "cart_velocity": rng.normal(size=size),
    }  # fmt: skip


@pytest.mark.parametrize("reward_type", ["dense", "sparse"])
def test_rewards_and_steps_held_are_those_of_the_source(reward_type):
    envs = gym.make_vec(ENV_ID, num_envs=400, reward_type=reward_type)
    envs.reset(seed=0, options=states(400))
    actions = np.tile(PUSHES, 100)
    _, reward, terminated, _, info = envs.step(actions)
    assert not terminated.any()
    held = is_held(info)
    np.testing.assert_array_equal(info["success"], held)
    assert 20 < held.sum() < 380
    expected = held if reward_type == "sparse" else their_reward(info, actions)
    np.testing.assert_allclose(reward, expected, rtol=0, atol=1e-13)


def test_a_single_environment_has_the_bits_of_a_vector_environment():
    envs, env = gym.make_vec(ENV_ID, num_envs=4), gym.make(ENV_ID)
    for k, options in enumerate(zip(*states(4).values(), strict=True)):
        named = dict(zip(states(4), options, strict=True))
        env.reset(seed=0, options=named)
        envs.reset(seed=0, options=states(4))
        assert env.step(PUSHES[k])[1] == envs.step(PUSHES)[1][k]


def test_accelerations_are_those_of_the_source():
    envs = gym.make_vec(ENV_ID, num_envs=4, dt=1e-6)
    _, before = envs.reset(seed=0, options=states(4))
    *_, after = envs.step(PUSHES)
    m, l, g = 0.1, 0.5, 9.8
    for k, push in enumerate(PUSHES):
        (t1, t2), (w1, w2) = np.pi - before["theta"][k], -before["omega"][k]  # clockwise, as theirs
        a, b, c = 2.0 * m * l * np.cos(t1), m * l * np.cos(t2), m * l * l * np.cos(t1 - t2)
        matrix = [[1.2, a, b], [a, 2.0 * m * l * l, c], [b, c, m * l * l]]
        turning = m * l * l * np.sin(t1 - t2)
        right = [
            10.0 * (push - 1) + 2.0 * m * l * np.sin(t1) * w1**2 + m * l * np.sin(t2) * w2**2,
            2.0 * m * g * l * np.sin(t1) - turning * w2**2,
            m * g * l * np.sin(t2) + turning * w1**2,
        ]
        velocity, omega = (after[x][k] - before[x][k] for x in ("cart_velocity", "omega"))
        found = np.append(velocity, -omega) / 1e-6
        np.testing.assert_allclose(found, np.linalg.solve(matrix, right), rtol=1e-3, atol=1e-3)


def test_episodes_start_hanging_within_the_ranges_of_the_source():
    envs = gym.make_vec(ENV_ID, num_envs=2000)
    _, info = envs.reset(seed=0)
    ranges = {"theta": 0.08, "omega": 0.04, "cart_position": 0.04, "cart_velocity": 0.04}
    for name, width in ranges.items():
        assert abs(info[name]).max() <= width
        assert abs(info[name]).max() > 0.99 * width
        assert abs(np.mean(info[name])) < 0.05 * width


def test_an_episode_ends_where_the_cart_leaves_the_rail_or_after_600_steps():
    env = gym.make(ENV_ID)
    env.reset(seed=0)
    outcomes = [env.step(1)[2:4] for _ in range(600)]
    assert outcomes[-1] == (False, True)
    assert outcomes[-2] == (False, False)
    env.reset(seed=0, options={"cart_position": 4.999, "cart_velocity": 1.0})
    assert env.step(1)[2]


@pytest.mark.parametrize(
    ("successes", "held"),
    [([], 0), ([0, 0], 0), ([1, 1, 0, 1], 2), ([0, 1, 0, 1, 1, 1], 3), (np.ones(600), 600)],
)
def test_steps_held_is_the_longest_run(successes, held):
    assert steps_held(successes) == held


@pytest.mark.long
def test_tensors_have_the_same_rewards_and_their_gradient():
    torch = pytest.importorskip("torch")
    from npend_gym.torch import DifferentiableVectorEnv

    keywords = gym.spec(ENV_ID).kwargs | {"torque_levels": None}
    env, plain = (
        DifferentiableVectorEnv(6, **keywords),
        gym.make_vec(ENV_ID, num_envs=6, torque_levels=None),
    )
    for each in (env, plain):
        each.reset(seed=0, options=states(6))
    action = torch.full((6, 1), 0.4, dtype=torch.float64, requires_grad=True)
    reward = env.step(action)[1]
    np.testing.assert_allclose(reward.detach(), plain.step(np.full((6, 1), 0.4))[1], atol=1e-14)
    reward.sum().backward()
    total = []
    for moved in (1e-4, -1e-4):
        plain.reset(seed=0, options=states(6))
        total.append(plain.step(np.full((6, 1), 0.4 + moved))[1])
    slopes = (total[0] - total[1]) / 2e-4
    np.testing.assert_allclose(action.grad[:, 0], slopes, rtol=1e-4, atol=1e-9)
