"""Imitation of teachers that know what is wrong: their plans, the errors, and the student."""

import gymnasium as gym
import numpy as np
import pytest

from npend_gym import Chain
from npend_gym.envs import EnvConfig

pytestmark = pytest.mark.long  # plans take seconds

torch = pytest.importorskip("torch")

from npend_gym.rl import Policy, evaluate, planned_swing_up  # noqa: E402
from npend_gym.rl.training import robust_imitation  # noqa: E402
from npend_gym.rl.training.context_plans import ContextPlans, wrong_chains  # noqa: E402
from npend_gym.rl.training.demonstration import astray, plan_of, steadied  # noqa: E402
from npend_gym.rl.training.disturbed_lanes import ERRORS, DisturbedLanes  # noqa: E402

CONFIG = EnvConfig(n=2, mode="swingup")
CHAINS = [
    {"lengths": np.array([1.0, 1.2])},
    {"masses": np.array([0.8, 1.0])},
    {"damping": np.array([0.1, 0.0])},
]


@pytest.fixture(scope="module")
def plans():
    base = planned_swing_up(CONFIG, 4.0, tries=2, guess="mpc")
    found = ContextPlans(CONFIG, base, CHAINS)
    assert len(found) == 4
    return found


def test_the_plan_of_a_chain_is_a_motion_of_this_very_chain(plans):
    for which in range(4):
        chain = Chain(plans.masses[which], plans.lengths[which], damping=plans.damping[which])
        env = gym.make("NPendulum-v0", chain=chain, mode="swingup", max_torque=CONFIG.max_torque)
        _, info = env.reset(options={"theta": [0.0, 0.0], "omega": [0.0, 0.0]})
        phase = np.zeros(1, np.int64)
        for _ in range(plans.steps):
            states = np.concatenate([info["theta"], info["omega"]])[None]
            phase, told = plans.tracking(np.array([which]), phase, states)
            assert told.relative_cost[0] < 1e-3
            info = env.step(told.actions[0])[-1]
        assert info["tip_height"] > 0.999 * chain.total_length
        env.close()


def test_a_lane_that_is_late_is_near_the_state_of_the_plan_that_it_is_in(plans):
    which, states = np.zeros(5, np.int64), plans._states[0, 20:25]
    phase, told = plans.tracking(which, np.full(5, 22), states)
    np.testing.assert_array_equal(phase, np.arange(20, 25))
    np.testing.assert_allclose(told.actions, plans._actions[0, 20:25], atol=1e-12)
    turned = states.copy()
    turned[:, :2] = plans._states[0, -1, :2] + 2.0 * np.pi * np.arange(5)[:, None]
    turned[:, 2:] = 0.0
    phase, told = plans.tracking(which, np.full(5, plans.steps), turned)
    np.testing.assert_array_equal(phase, plans.steps)
    np.testing.assert_allclose(told.relative_cost, 0.0, atol=1e-12)


def test_wrong_chains_differ_in_one_rod_in_all_or_in_each():
    chains = wrong_chains(Chain.uniform(3), 0)
    whole = [
        {"masses": np.ones(3), "lengths": np.ones(3), "damping": np.zeros(3)} | c for c in chains
    ]
    changed = [sum(np.any(each[k] != (k != "damping")) for k in each) for each in whole]
    assert set(changed) == {1}
    lengths = np.array([each["lengths"] for each in whole])
    assert lengths.min() == 0.75
    assert lengths.max() == 1.25


def test_lanes_observe_as_the_environment_does(plans):
    lanes = DisturbedLanes(CONFIG, plans, 64, seed=0)
    late = np.flatnonzero((lanes._delay > 0.1) & (lanes._delay < 1.0) & (lanes._noise == 0.0))
    lane = int(late[0])
    which = lanes.which[lane]
    chain = Chain(plans.masses[which], plans.lengths[which], damping=plans.damping[which])
    env = gym.make(
        "NPendulum-v0", chain=chain, mode="swingup", observation="sincos",
        max_torque=CONFIG.max_torque, observation_delay=float(lanes._delay[lane]),
    )  # fmt: skip
    theta, omega = np.split(lanes.states[lane], 2)
    observation, _ = env.reset(options={"theta": theta, "omega": omega})
    lanes._torque_noise[lane] = lanes._lag[lane] = 0.0
    rng = np.random.default_rng(0)
    for _ in range(30):
        np.testing.assert_allclose(lanes.observe()[lane], observation, atol=1e-5)
        action = rng.uniform(-1.0, 1.0)
        lanes.step(np.full(64, action))
        observation = env.step(np.array([action]))[0]
    env.close()


def test_what_is_wrong_is_wrong_alone_but_in_a_few_lanes(plans):
    lanes = DisturbedLanes(CONFIG, plans, 4000, seed=1)
    wrong = {
        "chain": lanes.which > 0, "velocity_noise": lanes._noise > 0.0,
        "torque_noise": lanes._torque_noise > 0.0, "motor_lag": lanes._lag > 0.0,
        "delay": lanes._delay > 0.0,
    }  # fmt: skip
    names = list(ERRORS)
    for name, where in wrong.items():
        alone = lanes.error == names.index(name)
        assert abs(alone.mean() - ERRORS[name]) < 0.03
        assert where[alone].mean() > 0.7  # the nominal chain is among those that are drawn
        assert not where[~alone & (lanes.error != names.index("several"))].any()
    assert lanes._noise.max() <= 0.5
    assert lanes._delay.max() == 1.0


def test_pulses_push_a_chain_that_hangs_and_nothing_else_does(plans):
    lanes = DisturbedLanes(CONFIG, plans, 256, seed=2)
    lanes._torque_noise[:] = 0.0
    for _ in range(100):
        lanes.step(np.zeros(256))
    pushed = lanes.error == list(ERRORS).index("pulses")
    moved = np.abs(lanes.states).max(axis=1) > 0.3  # starts within 0.05 rad and 0.05 rad/s
    assert moved[pushed].mean() > 0.5
    assert not moved[~pushed].any()


def test_levels_bound_the_errors_that_are_drawn(plans):
    lanes = DisturbedLanes(CONFIG, plans, 2000, seed=3)
    names = list(ERRORS)
    lanes.levels[names.index("velocity_noise")] = 0.2
    lanes.levels[names.index("delay")] = 0.5
    lanes.restart(np.ones(2000, np.bool_))
    assert 0.095 < lanes._noise.max() <= 0.1
    assert 0.7 < lanes._delay.max() <= 0.75
    assert lanes._torque_noise.max() > 0.15


def dagger_of(**changes):
    env = {"n": 1, "mode": "swingup", "observation": "sincos"}
    small = {"seconds": 3.0, "num_envs": 32, "hidden": 16, "plan_seed": 0, "wrong_chains": False}
    return robust_imitation.RobustDAgger(robust_imitation.Settings(env=env, **(small | changes)))


def test_errors_grow_with_which_more_than_half_of_the_episodes_stood(plans):
    lanes, names = DisturbedLanes(CONFIG, plans, 64, seed=4), list(ERRORS)
    lanes.levels[:] = 0.4
    noise, delay, lag = (names.index(name) for name in ("torque_noise", "delay", "motor_lag"))
    lanes.error[:] = [noise] * 12 + [delay] * 12 + [lag] * 11 + [names.index("chain")] * 29
    rows = np.arange(35)
    stood = (rows < 7) | (rows >= 19)  # 7 of 12 with noise, 5 with delays, all with a lag
    lanes.judge(rows, stood)
    lanes.grow()
    np.testing.assert_allclose(lanes.levels[[noise, delay, lag]], [0.5, 0.4, 0.4])
    assert lanes.judged[0, [noise, delay, lag]].tolist() == [0, 0, 11]  # too few
    for _ in range(6):
        lanes.judge(rows, stood)
        lanes.grow()
    np.testing.assert_allclose(lanes.levels[[noise, delay, lag]], [1.0, 0.4, 0.4 * 1.25**3])


def test_the_student_is_the_mean_of_what_the_learner_was_lately():
    dagger = dagger_of(averaging=0.9)
    dagger.play(40, first=True)
    before = dagger.student[0].weight.clone()
    dagger.learn(20)
    left = (dagger.student[0].weight - dagger.learner[0].weight) / (
        before - dagger.learner[0].weight
    )
    assert torch.allclose(left, torch.full_like(left, 0.9**20), atol=1e-2)
    latest = dagger_of(averaging=0.0)
    latest.play(40, first=True)
    latest.learn(40)
    assert all(map(torch.equal, latest.student.parameters(), latest.learner.parameters()))


def test_a_policy_without_velocities_does_not_look_at_them():
    policy = dagger_of().policy({})
    angles, rng = np.tile([[0.6, 0.8]], (5, 1)), np.random.default_rng(0)
    policy.reset(5)
    for _ in range(3):
        speeds = rng.normal(size=(5, 1))
        actions = policy(np.hstack([angles, speeds]).astype(np.float32))
        np.testing.assert_allclose(actions, actions[:1].repeat(5, axis=0), atol=1e-6)
    moved = policy(np.hstack([angles[:, ::-1], speeds]).astype(np.float32))
    assert np.abs(moved - actions).min() > 1e-4


def test_the_way_of_a_policy_is_a_plan():
    config = EnvConfig(n=3, mode="swingup", observation="sincos")
    policy = Policy.pretrained("swingup-3")
    plan = plan_of(policy, config, 7.0)
    env = gym.make("NPendulum-v0", **policy.env)
    observation, info = env.reset(options={"theta": [0.0] * 3, "omega": [0.0] * 3})
    for state in plan.nominal.states[:-1]:
        np.testing.assert_allclose([*info["theta"], *info["omega"]], state, atol=1e-4)
        observation, *_, info = env.step(policy(observation))
    env.close()
    with pytest.raises(ValueError, match="must stand after 2 s"):
        plan_of(policy, config, 2.0)


def test_of_the_variants_of_a_plan_one_is_kept_from_which_noise_leads_less_astray():
    config = EnvConfig(n=3, mode="swingup")
    plan = planned_swing_up(config, 4.5, tries=1, seed=1)
    assert steadied(config, plan, 0, seed=0) is plan
    better = steadied(config, plan, 12, seed=0)
    assert astray(config, better) < astray(config, plan)
    again = steadied(config, plan, 12, seed=0)
    np.testing.assert_array_equal(better.gains, again.gains)
    goal = np.cos(better.nominal.states[-1, :3])
    np.testing.assert_allclose(goal, -1.0)
    assert np.abs(better.nominal.actions).max() < 0.9


def test_a_student_of_a_few_rounds_swings_one_rod_up():
    env = {"n": 1, "mode": "swingup", "observation": "sincos"}
    small = {"seconds": 3.0, "rounds": 12, "num_envs": 96, "hidden": 32, "updates": 200}
    settings = robust_imitation.Settings(env=env, plan_seed=0, wrong_chains=False, **small)
    policy, curve = robust_imitation.train(settings)
    assert policy.has_memory
    assert policy.env == env
    assert curve[-1]["success"] > curve[0]["success"]
    assert evaluate(policy, policy.env, episodes=20).success_rate > 0.9
    late = evaluate(policy, policy.env | {"observation_delay": 1.0}, episodes=20)
    assert late.success_rate > 0.5


def test_what_is_wrong_follows_from_the_task():
    with pytest.raises(ValueError, match="task must be a swing-up"):
        robust_imitation.settings_of("balance-3")
    four = robust_imitation.settings_of("swingup-4-robust")
    assert four.env["n"] == 4
    assert four.shares["delay"] > 0.0
    five = robust_imitation.settings_of("swingup-5")
    assert five.shares == {"nothing": 1.0}
    assert not five.wrong_chains
    settings = robust_imitation.settings_of("swingup-3-robust")
    assert settings.env == {"n": 3, "mode": "swingup", "observation": "sincos"}
    with pytest.raises(ValueError, match="one motor at the base"):
        robust_imitation.RobustDAgger(
            robust_imitation.Settings(env=settings.env | {"actuated": [1]})
        )


def test_an_episode_lasts_until_the_chain_has_stood():
    assert dagger_of().longest == 210
    assert dagger_of(seconds=8.0).longest == 160 + 60
