"""Controllers of chains with links, friction and rotors."""

import gymnasium as gym
import numpy as np
import pytest

from npend_gym import Chain
from npend_gym.envs import EnvConfig
from npend_gym.rl import evaluate, planned_swing_up
from npend_gym.rl.controllers import regulators

pytestmark = pytest.mark.long  # kernels of links take long to compile

ELBOW = {"chain": "realaigym C.1", "actuated": (1,), "max_torque": 6.0, "dt": 0.02}


@pytest.mark.parametrize(
    ("keywords", "seconds"),
    [
        (ELBOW, 3.0),
        (ELBOW | {"actuated": (0,)}, 3.0),
        ({"chain": "acrobot", "actuated": (1,)}, 8.0),
        ({"chain": "dm_control acrobot", "actuated": (1,)}, 8.0),
        ({"chain": "multiarm 3", "dt": 0.02}, 4.0),
    ],
)
def test_a_planned_trajectory_and_lqr_stand_links_up_in_held_out_episodes(keywords, seconds):
    tries = 1 if keywords is ELBOW else 4
    controller = planned_swing_up(EnvConfig(**keywords), seconds, tries=tries)
    steps = round((seconds + 8.0) / EnvConfig(**keywords).dt)
    evaluation = evaluate(controller, keywords | {"max_episode_steps": steps}, episodes=20)
    assert evaluation.success_rate == 1.0


def balanced(controller, spread):
    """Return how many of 100 starts within `spread` of upright stand after 8 s."""
    rng = np.random.default_rng(0)
    envs = gym.make_vec("NPendulum-v0", num_envs=100, **ELBOW)
    theta = np.pi + rng.uniform(-spread, spread, (100, 2))
    omega = rng.uniform(-5.0 * spread, 5.0 * spread, (100, 2))
    observation, info = envs.reset(seed=0, options={"theta": theta, "omega": omega})
    for _ in range(400):
        action = np.clip(controller(observation, info), -1.0, 1.0)
        observation, _, _, _, info = envs.step(action)
    return int(np.count_nonzero(info["success"]))


def test_lqr_takes_dry_friction_so_that_it_balances_from_farther_away(monkeypatch):
    config = EnvConfig(**ELBOW)
    regulator = regulators.lqr(config)
    assert balanced(regulator, 0.02) >= 95
    # instead as the damper that it is at rest, in all joints
    monkeypatch.setattr(regulators, "softened", lambda config, _: config.chain)
    assert balanced(regulator, 0.05) >= balanced(regulators.lqr(config), 0.05) + 30


WEAK = Chain(
    [0.45, 0.32], [0.30, 0.25], damping=[0.004, 0.003],
    centres=[0.16, 0.12], inertias=[0.0042, 0.0021], friction=[0.01, 0.008],
)  # fmt: skip


@pytest.mark.parametrize("joint", [0, 1])
def test_lqr_leaves_weak_friction_of_a_passive_joint_out_where_a_damper_needs_large_gains(joint):
    keywords = {"mode": "balance", "max_torque": 1.0, "dt": 0.01, "actuated": (joint,)}
    gains = [
        regulators.lqr(EnvConfig(chain=chain, **keywords)).gain
        for chain in (WEAK, Chain.from_dict(WEAK.as_dict() | {"friction": 0.0}))
    ]
    np.testing.assert_array_equal(*gains)
    assert np.abs(regulators.lqr(EnvConfig(**ELBOW)).gain).max() < 10.0  # strong friction holds
    weak = {"chain": WEAK, **keywords}
    regulator = regulators.StateFeedback(EnvConfig(**weak), np.pi, gains[0])
    evaluation = evaluate(regulator, weak, episodes=50)
    assert evaluation.success_rate >= (1.0 if joint == 0 else 0.8)


def test_friction_is_a_damper_as_strong_as_it_is_in_a_small_swing():
    chain = Chain.realaigym("C.1")
    config = EnvConfig(chain=chain, dt=1e-4)
    free = EnvConfig(
        chain=Chain.from_dict(chain.as_dict() | {"friction": 0.0}), dt=config.dt, max_torque=1.0
    )
    speed = 0.03 * np.sqrt(chain.gravity / chain.lengths.mean())  # of a swing of 0.03 rad
    u = speed / chain.friction_speed
    torque = chain.friction * u / np.sqrt(1.0 + u**2)
    with_friction, without = (regulators.discretise(each, 0.0)[0] for each in (config, free))
    # joint 1 alone turns at that speed: what friction adds to the change of omega in a step
    omega = np.array([0.0, 0.0, 0.0, speed])
    change = (with_friction - without) @ omega
    both = EnvConfig(
        chain=free.chain, dt=config.dt, max_torque=1.0, actuated=(0, 1), mode="balance"
    )
    push = regulators.discretise(both, 0.0)[1] @ np.array([0.0, -torque[1]])
    np.testing.assert_allclose(change, push, rtol=0.01, atol=1e-7)
