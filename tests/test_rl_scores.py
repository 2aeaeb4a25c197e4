"""RealAIGym's scores: of a swing-up, and of the time up between knock-downs."""

import csv
import sys
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest

import npend_gym
from npend_gym import Chain
from npend_gym.envs import EnvConfig, SwingUp
from npend_gym.rl import HELD_OUT, Policy, evaluate, lqr, performance, recovery, robustness
from npend_gym.rl.controllers.references import reference_controller
from npend_gym.rl.evaluation.performance import _most
from npend_gym.rl.evaluation.recovery import RULES, KnockDowns, Turner, _divided
from npend_gym.rl.evaluation.rollouts import rollout

pytestmark = pytest.mark.long  # kernels of links take long to compile

RESULTS = Path(__file__).parents[1] / "benchmarks" / "results" / "realaigym.csv"
STRONG = {"n": 2, "mode": "swingup", "actuated": (0, 1), "max_torque": 60.0, "dt": 0.02}


def trajectory(controller, keywords, seconds):
    """Return times, joint angles, joint velocities, torques and tip heights of one episode."""
    env = gym.make("NPendulum-v0", **keywords)
    config = env.unwrapped.config
    observation, info = env.reset(seed=HELD_OUT)
    rows = []
    for _ in range(round(seconds / config.dt)):
        batch = {key: np.asarray(value)[None] for key, value in info.items()}
        action = np.clip(controller(observation[None], batch)[0], -1.0, 1.0)
        rows.append((info, config.max_torque * action))
        observation, _, _, _, info = env.step(action)
    rows.append((info, rows[-1][1]))  # their last torque is not used
    infos, torques = zip(*rows, strict=True)
    joints = [np.diff([i[key] for i in infos], axis=1, prepend=0.0) for key in ("theta", "omega")]
    return (
        np.array([i["time"] for i in infos]), *joints, np.array(torques),
        np.array([i["tip_height"] for i in infos]),
    )  # fmt: skip


def test_the_criteria_are_those_of_their_definitions():
    controller = lqr(EnvConfig(**STRONG), action_weight=10.0)
    found = performance(controller, STRONG, episodes=1, seconds=4.0)
    t, q, v, u, tip = trajectory(controller, STRONG, 4.0)
    dt = np.diff(t)[:, None]
    down = np.flatnonzero(tip <= 0.9 * 2.0)
    expected = {
        "success": 1.0,
        "swing_up_time": t[down[-1] + 1],
        "energy": np.abs(np.diff(q, axis=0) * u[:-1]).sum(),
        "max_torque": np.abs(u).max(),
        "integrated_torque": (np.abs(u[:-1]) * dt).sum(),
        "torque_cost": (u[:-1] ** 2 * dt).sum(),
        "smoothness": np.std(np.diff(np.repeat(u[:-1], 10, axis=0), axis=0), axis=0).sum(),
        "velocity_cost": (v[:-1] ** 2 * dt).sum(),
    }
    for name, value in expected.items():
        assert getattr(found, name)[0] == pytest.approx(value, rel=1e-6), name
    most = _most(EnvConfig(**STRONG))
    costs = [np.tanh(np.pi * expected[name] / most[name]) for name in most]
    assert found.score[0] == pytest.approx(1.0 - sum(costs) / 5.0)


def test_their_robot_is_judged_by_their_constants_and_a_similar_chain_alike():
    robot = Chain.realaigym("C.1", motors=False)
    most = _most(EnvConfig(chain=robot))
    assert most == pytest.approx(
        {"swing_up_time": 20.0, "energy": 60.0, "torque_cost": 20.0, "smoothness": 0.1,
         "velocity_cost": 400.0}
    )  # fmt: skip
    larger = Chain(
        robot.masses, 4.0 * robot.lengths, centres=4.0 * robot.centres,
        inertias=16.0 * robot.inertias,
    )  # fmt: skip
    # four times the size: half as fast, four times the torques; all in the same proportions
    small = {"chain": robot, "mode": "swingup", "actuated": (0, 1), "max_torque": 10.0, "dt": 0.01}
    large = small | {"chain": larger, "max_torque": 40.0, "dt": 0.02}
    scores = [
        performance(lqr(EnvConfig(**k), action_weight=1.0), k, episodes=3, seconds=s)
        for k, s in ((small, 3.0), (large, 6.0))
    ]
    assert scores[0].success.all()
    np.testing.assert_allclose(scores[1].swing_up_time, 2.0 * scores[0].swing_up_time, rtol=0.05)
    np.testing.assert_allclose(scores[1].energy, 4.0 * scores[0].energy, rtol=0.05)


def test_a_chain_that_falls_again_or_never_rises_scores_nothing():
    idle = performance(lambda seen, _: np.zeros((len(seen), 2)), STRONG, episodes=2, seconds=1.0)
    assert not idle.success.any()
    assert idle.score.tolist() == [0.0, 0.0]
    assert idle.swing_up_time.tolist() == [1.0, 1.0]


def test_without_knock_downs_the_chain_is_up_from_its_swing_up_on():
    controller = lqr(EnvConfig(**STRONG), action_weight=10.0)
    swung = performance(controller, STRONG, episodes=3, seconds=6.0)
    up = recovery(controller, STRONG, episodes=3, seconds=6.0, resets=0)
    # the swing-up time is known to a step of the environment, of 0.02 s
    np.testing.assert_allclose(up.uptime * 6.0, 6.01 - swung.swing_up_time, atol=0.011)


@pytest.mark.parametrize(
    ("name", "least"),
    [
        ("swingup-2-pendubot-smooth", 0.682),  # the best that is published, as is the next
        ("swingup-2-acrobot-smooth", 0.655),
        ("swingup-2-acrobot-performance", 0.7),
    ],
)
def test_policies_with_smooth_torques_are_ahead_of_the_best_published_performance(name, least):
    policy = Policy.pretrained(name)
    found = performance(policy, policy.env)
    assert found.success.all()
    assert found.score.mean() > least


@pytest.mark.long
@pytest.mark.nightly
@pytest.mark.parametrize(
    ("name", "robust", "up"),
    [("swingup-2-pendubot", 0.913, 0.799), ("swingup-2-acrobot", 0.751, 0.658)],
)
def test_smooth_policies_are_ahead_in_the_other_published_scores_too(name, robust, up):
    policy = Policy.pretrained(f"{name}-smooth")
    assert robustness(policy, policy.env).score > robust
    assert recovery(policy, policy.env, episodes=10).score > up


@pytest.mark.long
@pytest.mark.nightly
@pytest.mark.parametrize(("robot", "least"), [("pendubot", 0.721), ("acrobot", 0.65)])
def test_policies_below_the_limits_of_speed_are_up_longer_by_the_rule_of_the_robot(robot, least):
    usual, slow = (Policy.pretrained(f"swingup-2-{robot}{word}") for word in ("", "-hardware"))
    up, more = (recovery(p, p.env, episodes=10, rule="hardware").score for p in (usual, slow))
    assert more > max(up, least)


def test_knock_downs_cost_time_and_a_chain_that_never_rises_is_never_up():
    controller = lqr(EnvConfig(**STRONG), action_weight=10.0)
    up = recovery(controller, STRONG, episodes=3, seconds=20.0, resets=5)
    calm = recovery(controller, STRONG, episodes=3, seconds=20.0, resets=0)
    assert np.all(up.uptime < calm.uptime)
    assert up.score > 0.5
    idle = recovery(lambda seen, _: np.zeros((len(seen), 2)), STRONG, episodes=2, seconds=1.0)
    assert idle.score == 0.0


def test_knock_downs_come_as_often_and_as_long_as_asked_for():
    knocks = KnockDowns(EnvConfig(**STRONG), 0.002, 30_000, 40, RULES["simulation"], seed=0)
    still = {"theta": np.zeros((40, 2)), "omega": np.zeros((40, 2))}
    acts = np.array([~knocks(k, still)[1] for k in range(30_000)])
    begins = np.diff(acts.astype(int), axis=0) == 1
    assert begins.sum(axis=0).tolist() == [15] * 40
    assert set(acts.sum(axis=0).tolist()) <= set(range(15 * 100 - 15, 15 * 100 + 16))
    for lane in range(40):
        regular = 60.0 / 16.0 * np.arange(1, 16)
        assert np.all(np.abs(0.002 * np.flatnonzero(begins[:, lane]) - regular) <= 1.002)


class Interruptions:
    """When RealAIGym's controller takes over on the robot, by the words of the notes: 1 s each."""

    def __init__(self, planned):
        self.planned, self.last, self.since = list(planned), 0.0, None
        self.fast_at, self.numbers = -1.0, []

    def acts(self, now, joints, speeds):
        fast = max(np.abs(joints)) > 3.5 * np.pi or max(np.abs(speeds)) > 20.0
        self.fast_at = now if fast else self.fast_at
        if self.since is None and (fast or (self.planned and now >= self.planned[0] - 1e-9)):
            if fast:
                self.planned = [time + now - self.last for time in self.planned]
            self.last = now if fast else self.planned.pop(0)
            self.since = now
            self.numbers.append(now)
        elif self.since is not None:
            calm = now - self.fast_at > 0.019  # for ten steps
            self.since = None if calm and now - self.since > 1.0 - 1e-9 else self.since
        return self.since is not None


def test_on_the_robot_a_fast_joint_is_stopped_at_once_and_the_rest_waits():
    config = EnvConfig(chain=Chain.realaigym("C.1", motors=False), max_torque=6.0)
    knocks = KnockDowns(config, 0.002, 30_000, 1, RULES["hardware"], seed=0)
    expected, rng, angle = Interruptions(knocks._begins[0, :-1]), np.random.default_rng(1), 0.0
    for k in range(30_000):
        size = 25.0 if (k // 2500) % 5 == 1 else 8.0
        speeds = size * np.sin(0.004 * k + np.array([0.0, 1.0])) + rng.normal(0.0, 0.3, 2)
        angle = angle + 0.002 * speeds
        info = {"theta": np.cumsum(angle)[None], "omega": np.cumsum(speeds)[None]}
        torque, controller_acts = knocks(k, info)
        assert (not controller_acts[0]) == expected.acts(0.002 * k, angle, speeds), k
        assert np.abs(torque).max() <= 6.0
    assert knocks._begun[0] == len(expected.numbers) > knocks._regular[0] > 3  # some early


def test_the_motors_of_the_hardware_rule_are_weak():
    config = EnvConfig(chain=Chain.realaigym("C.1", motors=False), max_torque=6.0)
    turner = Turner(config, 1, 0.002, RULES["hardware"])
    hangs, acts = np.zeros((1, 2)), np.array([True])  # where gravity turns nothing
    # 2 N m/rad, at most 3 N m; 0.3 N m s/rad for steps of 0.001 s from the third call on
    for goal in ([1.0, -0.5], [1.0, 3.0]):
        torque = turner(np.array([goal]), hangs, acts)
        np.testing.assert_allclose(torque[0], np.clip(2.0 * np.array(goal), -3.0, 3.0))
    torque = turner(np.array([[1.1, 3.0]]), hangs, acts)
    np.testing.assert_allclose(torque[0], [min(6.0, 2.2 + 0.3 * 0.1 / 0.001), 3.0])


class PID:
    """RealAIGym's controller of one joint, by the words of docs/howto/robustness.md: 6 N m."""

    def __init__(self):
        self.errors = []

    def torque(self, goal, angle, gravity):
        self.errors.append(goal - angle)
        torque = 10.0 * self.errors[-1] + 0.1 * 0.001 * sum(self.errors)
        if len(self.errors) > 2:
            torque += 1.0 * (self.errors[-1] - self.errors[-2]) / 0.001
        return min(6.0, max(-6.0, min(6.0, max(-6.0, torque)) + gravity))


def test_motors_turn_joints_as_realaigyms_controller_does():
    chain = Chain.realaigym("C.1", motors=False)
    config = EnvConfig(chain=chain, max_torque=6.0)
    turner, joints, rng = Turner(config, 1, 0.002), [PID(), PID()], np.random.default_rng(0)
    seen = set()
    for goal in rng.uniform(-np.pi, np.pi, (3, 2)):
        theta = rng.uniform(-8.0, 8.0, 2)  # some have turned over
        for _ in range(100):
            theta = theta + 0.002 * rng.normal(0.0, 4.0, 2)
            weights = chain.gravity * chain.lift * np.sin(theta)
            gravity = weights.sum(), weights[1]
            angles = theta[0], theta[1] - theta[0]
            torque = turner(goal[None], theta[None], np.array([True]))[0]
            expected = [
                j.torque(*given) for j, *given in zip(joints, goal, angles, gravity, strict=True)
            ]
            np.testing.assert_allclose(torque, expected, rtol=1e-9, atol=1e-9)
            seen |= {abs(one) < 6.0 for one in expected}
        assert not turner(goal[None], theta[None] + 1.0, np.array([False])).any()  # nor remembered
    assert seen == {False, True}


def test_a_joint_that_has_turned_twice_is_turned_back_twice():
    turner = Turner(EnvConfig(n=1, max_torque=1.0), 2, 0.002)
    theta = np.array([[4.0 * np.pi], [-4.0 * np.pi]])
    torque = turner(np.array([[0.1], [-0.1]]), theta, np.array([True, True]))
    np.testing.assert_allclose(torque, [[-1.0], [1.0]], atol=1e-9)


@pytest.mark.nightly
def test_the_score_is_the_one_in_realaigyms_own_simulator():
    """Their simulator's scores are those that `benchmarks/realaigym.py` measured."""
    rows = list(csv.DictReader(RESULTS.read_text().splitlines()))
    for row in rows:
        if row["simulator"] == "RealAIGym" and row["controller"] != "plan":  # it takes minutes
            if row["score"] == "performance":
                continue
            rule = "hardware" if row["score"] == "hardware" else "simulation"
            if row["controller"] == "energy":
                env = Policy.pretrained("swingup-2-pendubot").env
                controller = reference_controller("energy", env)
            else:
                controller = Policy.pretrained(row["controller"])
                env = controller.env
            ours = recovery(controller, env, episodes=100, rule=rule).uptime
            error = np.hypot(ours.std(ddof=1) / 10.0, float(row["standard_error"]))
            assert abs(ours.mean() - float(row["mean"])) < 3.0 * error, row
            assert error < 0.015


def test_names_and_folder_are_checked_before_episodes_in_realaigyms_simulator(
    tmp_path, monkeypatch
):
    names = ("leaderboard", "GlobalPolicyTestingControllerV2", "model_parameters",
             "DoublePendulumPlant", "Simulator")  # fmt: skip
    theirs = SimpleNamespace(AbstractController=object, **dict.fromkeys(names))
    for module in (
        "analysis", "controller.abstract_controller",
        "controller.global_policy_testing_controller", "model.model_parameters", "model.plant",
        "simulation.simulation",
    ):  # fmt: skip
        monkeypatch.setitem(sys.modules, f"double_pendulum.{module}", theirs)
    import realaigym

    played, out = [], tmp_path / "new" / "scores.csv"
    monkeypatch.setattr(realaigym, "their_score", lambda *_: played.append(0.5) or 0.5)
    scores = SimpleNamespace(uptime=np.array([0.5]))
    monkeypatch.setattr(realaigym, "recovery", lambda *_, **__: scores)
    arguments = ["realaigym.py", "--episodes", "1", "--out", str(out), "energy"]
    monkeypatch.setattr("sys.argv", [*arguments, "enrgy"])
    with pytest.raises(ValueError, match=r"controller must be .*enrgy"):
        realaigym.main()
    assert not played
    monkeypatch.setattr("sys.argv", arguments)
    realaigym.main()
    assert len(out.read_text().splitlines()) == 3
    out.write_text(out.read_text().replace("energy", "other"))
    for _ in range(2):  # the rows of other controllers stay, its own are replaced
        realaigym.main()
        assert [line.split(",")[0] for line in out.read_text().splitlines()[1:]] == [
            "other", "other", "energy", "energy",
        ]  # fmt: skip


def test_delays_and_noise_of_a_controllers_environment_are_kept():
    config = EnvConfig(**STRONG, substeps=25, observation_delay=1.5, torque_noise=0.1)
    shorter = _divided(STRONG | {"max_episode_steps": 30}, config, 10)
    small = EnvConfig(**{k: v for k, v in shorter.items() if k != "max_episode_steps"})
    assert small.dt * small.observation_delay == pytest.approx(config.dt * config.observation_delay)
    # the noise of a long step is the mean of that of its short ones
    assert small.torque_noise / np.sqrt(10) == pytest.approx(config.torque_noise)
    assert (small.substeps, shorter["max_episode_steps"]) == (3, 300)


CART = {"n": 1, "mode": "balance", "base": "cart", "cart_mass": 1.0, "rail": 2.4}


def test_the_energy_on_a_cart_is_the_work_of_its_force():
    controller, episodes = lqr(EnvConfig(**CART)), 3
    found = performance(controller, CART, episodes=episodes, seconds=2.0)
    steps = CART | {"max_episode_steps": 100}
    work = evaluate(controller, steps, episodes=episodes).motor_work
    np.testing.assert_allclose(found.energy, work, rtol=1e-12)
    assert found.success.all()
    assert (found.score > 0.8).all()


def test_a_cart_that_balances_is_up_until_it_is_knocked_down():
    controller = lqr(EnvConfig(**CART))
    assert recovery(controller, CART, episodes=2, seconds=4.0, resets=0).score == 1.0
    assert 0.0 < recovery(controller, CART, episodes=2, seconds=4.0, resets=2).score < 0.9


def test_a_regulator_balances_with_few_torques():
    keywords = {"n": 1, "mode": "balance", "torque_levels": 31}
    found = evaluate(lqr(EnvConfig(**keywords)), keywords, episodes=5)
    assert found.success_rate == 1.0


class Standing(SwingUp):
    """Begins upright, where a policy of balance holds it."""

    name = "standing"

    def start(self, rng, n, amplitude, spread):
        del amplitude, spread
        return np.pi + rng.uniform(-0.02, 0.02, n), np.zeros(n)


def uptime(controller, keywords, seconds=10.0, episodes=20):
    """The fraction of the time for which the tip is up, in the environment itself."""
    config = EnvConfig(**keywords)
    envs = gym.make_vec("NPendulum-v0", num_envs=episodes, **keywords)
    observation, info = envs.reset(seed=HELD_OUT)
    up, steps = 0.0, round(seconds / config.dt)
    for _ in range(steps):
        observation, _, _, _, info = envs.step(np.clip(controller(observation, info), -1.0, 1.0))
        up += np.mean(info["tip_height"] > 0.9 * config.chain.total_length)
    return up / steps


@pytest.mark.parametrize("error", [{"torque_ripple": 2.0}, {"torque_noise": 3.0}])
def test_motors_that_only_stand_for_disturbances_are_exact(error):
    controller, keywords = lqr(EnvConfig(n=2)), {"n": 2, "mode": Standing()} | error
    found = recovery(controller, keywords, episodes=5, seconds=10.0, resets=0).score
    assert found == uptime(controller, keywords) == 1.0


def test_pushes_keep_their_impulse_in_recovery():
    controller = lqr(EnvConfig(n=2))
    keywords = {"n": 2, "mode": Standing(), "push_rate": 2.0, "push_force": 10.0}
    found = recovery(controller, keywords, episodes=20, seconds=10.0, resets=0).score
    assert found == pytest.approx(uptime(controller, keywords), abs=0.1)
    assert found < 0.8


def test_recovery_refuses_delays_that_it_cannot_keep_in_their_own_unit():
    policy = Policy.pretrained("swingup-1")
    with pytest.raises(
        ValueError, match=r"action_delay must be at most 4 steps of 0.05 s .* got 5"
    ):
        recovery(policy, policy.env | {"action_delay": 5.0}, episodes=1)


def test_an_episode_is_judged_alike_whatever_runs_beside_it():
    keywords = {"n": 1, "mode": "balance"}
    many, alone = (
        performance(lambda seen, _: np.zeros((len(seen), 1)), keywords, **chosen)
        for chosen in ({"episodes": 8}, {"episodes": 1})
    )
    for name in ("velocity_cost", "torque_cost", "energy", "score"):
        assert getattr(many, name)[0] == getattr(alone, name)[0]


def test_judges_choose_for_themselves_how_environments_are_run(monkeypatch):
    policy = Policy.pretrained("swingup-1")
    chosen = policy.env | {"autoreset_mode": "SAME_STEP", "num_envs": 3}
    assert evaluate(policy, chosen, episodes=5).success_rate == 1.0
    assert performance(policy, chosen, episodes=2).success.all()
    entry = {"vector_entry_point": "npend_gym:NPendulumVectorEnv", "max_episode_steps": 300}
    spec = gym.envs.registration.EnvSpec("Chosen-v0", kwargs=chosen, **entry)
    monkeypatch.setitem(gym.registry, "Chosen-v0", spec)
    for env in ("Chosen-v0", spec, "npend_gym:Chosen-v0"):
        assert evaluate(policy, env, episodes=5).success_rate == 1.0
    resets_at_once = partial(npend_gym.NPendulumVectorEnv, autoreset_mode="SAME_STEP")
    own = gym.envs.registration.EnvSpec("Own-v0", vector_entry_point=resets_at_once)
    monkeypatch.setitem(gym.registry, "Own-v0", own)
    with pytest.raises(ValueError, match=r"autoreset mode NEXT_STEP, got .*SAME_STEP"):
        evaluate(policy, policy.env | {"id": "Own-v0", "max_episode_steps": 300}, episodes=5)


def test_environments_are_closed_after_an_error_of_the_controller():
    envs = npend_gym.NPendulumVectorEnv(2, n=1)
    with pytest.raises(ZeroDivisionError):
        list(rollout(lambda *_: 1 / 0, envs, 0))
    assert envs.closed
