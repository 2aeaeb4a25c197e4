"""What counts as success, in time and in every lane."""

import math
from functools import partial

import gymnasium as gym
import numpy as np
import pytest

import npend_gym
from npend_gym.envs import Mode, SwingUp

STILL = np.zeros(1, np.float32)


def successes(env, steps, **options):
    """Return ``info["success"]`` from the reset on, the motor being off."""
    flags = [env.reset(seed=0, options=options)[1]["success"]]
    return flags + [env.step(STILL)[-1]["success"] for _ in range(steps)]


def test_swingup_succeeds_once_upright_and_slow_for_five_seconds_and_not_after_the_fall():
    # let go 1e-9 rad from upright it is 0.3 rad away after log(3e8) sqrt(l/g) = 6.2 s
    env = gym.make("NPendulum-v0", n=1)
    flags = successes(env, 130, theta=np.pi - 1e-9, omega=0.0)
    assert flags[:100] == [False] * 100  # up to 4.95 s
    assert flags[100:115] == [True] * 15
    assert not flags[130]
    assert env.reset()[1]["success"] is False


@pytest.mark.parametrize("dt", [0.03, 0.1])
def test_the_five_seconds_do_not_depend_on_the_time_step(dt):
    env = gym.make("NPendulum-v0", n=1, dt=dt)
    flags = successes(env, 200, theta=np.pi, omega=0.0)
    assert flags.index(True) == np.ceil(round(5.0 / dt, 9))


@pytest.mark.parametrize(
    ("theta", "omega", "expected"),
    [(np.pi, 0.0, True), (np.pi - 0.3, 0.0, True), (np.pi - 0.5, 0.0, False), (np.pi, 2.0, False)],
)
def test_upright_means_the_centre_of_mass_high_and_the_energy_of_motion_low(theta, omega, expected):
    # without gravity the start lasts; height is (1 - cos theta) / 2, kinetic omega^2 / (4 g / l)
    env = gym.make("NPendulum-v0", n=1)
    options = {"theta": theta, "omega": omega, "gravity": 0.0}
    if omega:
        assert omega**2 / (4.0 * 9.81) > 0.01
    else:
        assert bool((1.0 - np.cos(theta)) / 2.0 > 0.95) is expected
    assert successes(env, 100, **options)[-1] is expected


def test_passive_never_succeeds():
    env = gym.make("NPendulum-v0", n=1, mode="passive")
    env.reset(seed=0, options={"theta": 0.0})
    assert not any(env.step(0)[-1]["success"] for _ in range(1000))


class High(Mode):
    """A user's mode with a condition for failure but none for success."""

    hold = 0.5

    def start(self, rng, n, amplitude, spread):  # noqa: ARG002
        return np.full(n, 2.6), np.zeros(n)

    def reward(self, quantities):
        return quantities.height

    def failed(self, quantities):
        return quantities.height < 0.1


@pytest.mark.parametrize(
    "make", [gym.make, partial(gym.make_vec, num_envs=2, autoreset_mode="DISABLED")]
)
def test_a_users_mode_succeeds_while_it_has_not_failed(make):
    env = make("NPendulum-v0", n=1, mode=High())
    env.reset(seed=0)
    still = np.zeros(env.action_space.shape, np.float32)
    flags, ended = [], False
    while not ended:
        _, _, terminated, _, info = env.step(still)
        ended = np.all(terminated)
        flags.append(bool(np.all(info["success"])))
    assert flags == [False] * 9 + [True] * (len(flags) - 10) + [False]  # held from 0.5 s on
    assert len(flags) > 10


def test_every_lane_has_its_own_clock_and_a_reset_restarts_it():
    env, still = gym.make_vec("NPendulum-v0", num_envs=3, n=1), np.zeros((3, 1), np.float32)
    env.reset(seed=0, options={"theta": np.array([[np.pi], [0.0], [np.pi]]), "omega": 0.0})
    for _ in range(50):
        env.step(still)
    mask = np.array([True, False, False])
    info = env.reset(options={"reset_mask": mask, "theta": np.pi, "omega": 0.0})[1]
    assert info["_success"].tolist() == mask.tolist()
    flags = np.array([env.step(still)[-1]["success"] for _ in range(110)])
    assert flags.argmax(axis=0).tolist() == [99, 0, 49]  # 5 s after the start of each
    assert flags.any(axis=0).tolist() == [True, False, True]


@pytest.mark.parametrize("autoreset", ["NEXT_STEP", "SAME_STEP"])
def test_the_last_step_of_an_episode_tells_its_success(autoreset):
    env = gym.make_vec(
        "NPendulum-v0", num_envs=2, n=1, max_episode_steps=101, autoreset_mode=autoreset
    )
    env.reset(seed=0, options={"theta": np.array([[np.pi], [0.0]]), "omega": 0.0})
    still = np.zeros((2, 1), np.float32)
    for _ in range(101):
        _, _, _, truncated, info = env.step(still)
    assert truncated.all()
    last = info if autoreset == "NEXT_STEP" else info["final_info"]
    assert last["success"].tolist() == [True, False]
    after = env.step(still)[-1]["success"] if autoreset == "NEXT_STEP" else info["success"]
    assert after.tolist() == [False, False]


class Branching(SwingUp):
    """A user's mode that takes arrays for numbers."""

    name = "branching"

    def __init__(self, method, use):
        self.method, self.use = method, use

    def reward(self, quantities):
        return float(self.use(quantities.tip)) if self.method == "reward" else 0.0

    def failed(self, quantities):
        return bool(self.use(quantities.tip)) if self.method == "failed" else False


@pytest.mark.parametrize("method", ["reward", "failed"])
@pytest.mark.parametrize("use", [lambda tip: 1 if tip > 2 else 0, lambda tip: math.sin(tip) > 2])
def test_a_mode_that_takes_arrays_for_numbers_is_told_what_to_write(method, use):
    single = gym.make("NPendulum-v0", n=1, mode=Branching(method, use))
    assert successes(single, 1)
    many = gym.make_vec("NPendulum-v0", num_envs=3, n=1, mode=Branching(method, use))
    pattern = rf"{method} of mode 'branching' must work on arrays: .* np.where"
    with pytest.raises((ValueError, TypeError), match=pattern):
        [many.reset(seed=0), many.step(np.zeros((3, 1)))]
    torch = pytest.importorskip("torch")
    from npend_gym.torch import DifferentiableVectorEnv

    env = DifferentiableVectorEnv(3, n=1, mode=Branching(method, use))
    with pytest.raises((ValueError, TypeError, RuntimeError), match=pattern):
        [env.reset(seed=0), env.step(torch.zeros((3, 1)))]


class Aimless(Mode):
    """A user's mode with a reward alone."""

    name = "aimless"

    def start(self, rng, n, amplitude, spread):  # noqa: ARG002
        return np.full(n, 0.1), np.zeros(n)

    def reward(self, quantities):
        return 0.5 * quantities.height


AIMLESS = {"id": "NPendulum-v0", "n": 1, "mode": Aimless(), "max_episode_steps": 5}


def test_a_mode_without_failed_and_achieved_has_no_success_in_any_environment():
    env = gym.make(**AIMLESS)
    keywords = {key: value for key, value in AIMLESS.items() if key != "id"}
    ours = npend_gym.NPendulumVectorEnv(2, autoreset_mode="SAME_STEP", **keywords)
    infos = [env.reset(seed=0)[1], env.step(STILL)[-1], ours.reset(seed=0)[1]]
    infos += [ours.step(np.zeros((2, 1)))[-1] for _ in range(5)]
    infos.append(infos[-1]["final_info"])
    for info in infos:
        assert "energy" in info
        assert not {"success", "_success"} & info.keys()


def test_tensors_and_stable_baselines_have_no_success_of_such_a_mode_either():
    torch = pytest.importorskip("torch")
    pytest.importorskip("stable_baselines3")
    from npend_gym.rl.adapter import SB3VecEnv
    from npend_gym.torch import DifferentiableVectorEnv

    keywords = {key: value for key, value in AIMLESS.items() if key != "id"}
    env = DifferentiableVectorEnv(2, autoreset_mode="SAME_STEP", **keywords)
    venv = SB3VecEnv(npend_gym.NPendulumVectorEnv(2, autoreset_mode="SAME_STEP", **keywords))
    assert "success" not in env.reset(seed=0)[1]
    venv.reset()
    for _ in range(5):
        info = env.step(torch.zeros(2, 1, dtype=torch.float64))[-1]
        last = venv.step(np.zeros((2, 1), np.float32))[-1]
    assert not {"success"} & (info.keys() | info["final_info"].keys())
    assert "terminal_observation" in last[0]
    assert not {"success", "is_success"} & last[0].keys()


def test_an_evaluation_says_that_such_a_mode_has_no_success():
    from npend_gym.report.robustness_report import evaluation_text
    from npend_gym.rl import evaluate, robustness

    found = evaluate(lambda seen, _: np.zeros((len(seen), 1)), AIMLESS, episodes=3)
    assert found.returns.min() > 0.0
    assert np.isnan([*found.success, *found.settling_time, found.success_rate]).all()
    assert np.isnan(found.success_interval).all()
    row = found.as_row()
    unknown = "success", "success_low", "success_high", "settling_time"
    assert [row[name] for name in unknown] == [None] * 4
    assert "neither achieved nor failed" in evaluation_text(row)
    with pytest.raises(ValueError, match="achieved of mode 'aimless' must be defined for robust"):
        robustness(lambda seen, _: np.zeros((len(seen), 1)), AIMLESS)


def test_a_sparse_reward_needs_a_success():
    with pytest.raises(ValueError, match=r"achieved of mode 'aimless' must be .*'sparse'"):
        gym.make(**AIMLESS, reward_type="sparse")
