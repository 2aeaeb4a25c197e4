"""How far each rod may lean: `max_tilt`, beyond which an episode of a balance is over."""

import math

import gymnasium as gym
import numpy as np
import pytest

from npend_gym.envs import Balance, EnvConfig, SwingUp
from npend_gym.envs.registration import TASKS

LIMIT = math.radians(36.0)
# one rod beside the limit, above and below, the tip being above half the length in all
ANGLES = math.pi + np.array(
    [[0, 0, 0.6], [0, 0, 0.65], [0.62, 0, 0], [0, -0.65, 0], [0, 0, 1.7], [0, 0, 2 * math.pi]]
)


class Own(Balance):
    """A balance of one's own, which Python judges."""


def make(mode, **keywords):
    return gym.make_vec("NPendulum-v0", num_envs=len(ANGLES), n=3, mode=mode, **keywords)


def leaning(theta):
    """Return in which lanes a rod is beyond the limit, by its wrapped angle from the upright."""
    return np.any(np.abs(np.remainder(theta, 2 * math.pi) - math.pi) > LIMIT, axis=1)


@pytest.mark.parametrize("mode", ["balance", Own()], ids=["compiled", "own"])
@pytest.mark.parametrize("reward_type", ["dense", "sparse"])
def test_an_episode_ends_where_one_rod_leans_by_more_than_its_limit(mode, reward_type):
    kinds = [
        make(mode, max_tilt=tilt, dt=0.001, reward_type=reward_type, autoreset_mode="DISABLED")
        for tilt in (LIMIT, None)
    ]
    for envs in kinds:
        info = envs.reset(seed=0, options={"theta": ANGLES, "omega": 0.0})[1]
        down = leaning(ANGLES) if envs is kinds[0] else np.zeros(len(ANGLES), np.bool_)
        np.testing.assert_array_equal(info["success"], ~down)
    (_, limited, ended, _, info), (_, free, goes_on, _, _) = (
        envs.step(np.zeros((len(ANGLES), 1))) for envs in kinds
    )
    assert ended.tolist() == leaning(info["theta"]).tolist() == [0, 1, 0, 1, 1, 0]
    assert not goes_on.any()
    np.testing.assert_array_equal(info["success"], ~ended)
    np.testing.assert_array_equal(
        limited, np.where(ended, 0.0, 1.0) if "sp" in reward_type else free
    )


def test_a_single_environment_ends_as_a_lane_does():
    env = gym.make("NPendulum-v0", n=3, mode="balance", max_tilt=LIMIT)
    for angles in ANGLES:
        env.reset(seed=0, options={"theta": angles, "omega": 0.0})
        _, _, terminated, _, info = env.step(np.zeros(1))
        assert terminated == leaning(info["theta"][None])[0]
        assert info["success"] == (not terminated)


@pytest.mark.parametrize("mode", ["balance", Own()], ids=["compiled", "own"])
def test_the_environment_of_tensors_has_the_same_limit(mode):
    torch = pytest.importorskip("torch")
    from npend_gym.torch import DifferentiableVectorEnv

    keywords = {"n": 3, "mode": mode, "max_tilt": LIMIT}
    env = DifferentiableVectorEnv(len(ANGLES), autoreset_mode="DISABLED", **keywords)
    env.reset(seed=0, options={"theta": ANGLES, "omega": 0.0})
    _, _, terminated, _, info = env.step(torch.zeros(len(ANGLES), 1, dtype=torch.float64))
    np.testing.assert_array_equal(terminated, leaning(info["theta"].numpy()))
    np.testing.assert_array_equal(info["success"], ~terminated)
    assert 0 < terminated.sum() < len(ANGLES)


def test_the_poles_on_carts_have_the_limits_of_the_field():
    limits = {env_id: EnvConfig(**task.keywords).max_tilt for env_id, task in TASKS.items()}
    theirs = gym.make("CartPole-v1").unwrapped.theta_threshold_radians
    assert limits.pop("npend/CartPole-v1") == pytest.approx(theirs, rel=1e-15)
    assert limits.pop("npend/CartDoublePole-v1") == LIMIT
    assert limits.pop("npend/CartTriplePole-v1") == LIMIT
    assert set(limits.values()) == {None}
    env = gym.make("npend/CartTriplePole-v1")  # the tip is at 0.62 of the length
    env.reset(seed=0, options={"theta": math.pi + np.array([0.0, 0.0, 1.7]), "omega": 0.0})
    assert env.step(np.zeros(1))[2]


def test_other_modes_do_not_end_where_a_rod_hangs():
    env = gym.make("npend/CartTriplePole-v1", mode="swingup")
    env.reset(seed=0)
    assert not env.step(np.zeros(1))[2]

    class Limited(SwingUp):
        limits_tilt = True

    env = gym.make("NPendulum-v0", mode=Limited(), n=1, max_tilt=3.0)
    env.reset(seed=0, options={"theta": 0.1, "omega": 0.0})
    assert env.step(np.zeros(1))[2]


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"max_tilt": 36.0}, r"max_tilt must be at most pi \[rad\], got 36: .*math.radians"),
        ({"max_tilt": 0.0}, "max_tilt must be greater than zero"),
        ({"max_tilt": 0.1, "spread": 0.2}, "spread must be less than max_tilt, 0.1 rad"),
    ],
)
def test_a_limit_that_cannot_be_is_refused(changed, message):
    with pytest.raises(ValueError, match=message):
        EnvConfig(mode="balance", **changed)
