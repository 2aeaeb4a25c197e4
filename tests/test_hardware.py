"""Sensors and motors that are not ideal, against SciPy, NumPy's own Philox, and finer steps."""

from unittest.mock import Mock

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from lanes import actions_for, assert_same, run
from oracle import box_muller, numpys_philox, trajectory
from scipy import signal

from npend_gym._streams import Purpose
from npend_gym.envs import EnvConfig, NPendulumEnv, NPendulumVectorEnv, SwingUp

pytestmark = pytest.mark.long  # kernels of their own take long to compile

EVERYTHING = {
    "angle_noise": 0.01, "velocity_noise": 0.05, "angle_resolution": 2.0 * np.pi / 4096,
    "velocity_resolution": 0.01, "observation_delay": 1.5, "action_delay": 1.25,
    "motor_lag": 0.03, "torque_noise": 0.3, "torque_ripple": 0.2, "push_rate": 2.0,
    "push_force": 3.0,
}  # fmt: skip
# A wheel, whose angular velocity is the integral of the torque
WHEEL = {"n": 1, "gravity": 0.0, "max_torque": 2.0, "dt": 0.05}
HANGING = {"theta": 0.0, "omega": 0.0}


class Effort(SwingUp):
    """Rewards the mean squared action, to show it."""

    def reward(self, quantities):
        return quantities.mean_squared_action


def commands(steps, seed=0):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (steps, 1))


def drive(actions, *, options=HANGING, **keywords):
    """Return angles and angular velocities after each step, (T, n), and the last energy error."""
    env = NPendulumEnv(**keywords)
    env.reset(seed=0, options=options)
    infos = [env.step(action)[-1] for action in actions]
    theta, omega = (np.array([info[key] for info in infos]) for key in ("theta", "omega"))
    return theta, omega, infos[-1]["energy_error"]


def stream(seed, step, purpose, count):
    """Return the first numbers in [0, 1) of a stream of NumPy's generator."""
    return np.random.Generator(numpys_philox(seed, step, purpose)).random(count)


def normals(seed, step, purpose, count):
    """Return the cosines and the sines of `count` pairs of Box and Muller, (2, count)."""
    return np.array(box_muller(*stream(seed, step, purpose, 2 * count).reshape(count, 2).T))


# -- motors ---------------------------------------------------------------------------------


@pytest.mark.parametrize("lag", [0.004, 0.05, 3.0])
@pytest.mark.parametrize("substeps", [1, 5])
def test_a_motor_with_lag_answers_as_scipys_first_order_system(lag, substeps):
    actions, dt = commands(30), WHEEL["dt"]
    _, omega, error = drive(actions, motor_lag=lag, substeps=substeps, **WHEEL)
    # the integral of the torque: 2 / (s (lag s + 1)), its input held over each step
    system = signal.cont2discrete(signal.tf2ss([2.0], [lag, 1.0, 0.0]), dt, "zoh")
    held = np.concatenate([actions, [[0.0]]])
    _, expected, _ = signal.dlsim((*system[:4], dt), held)
    np.testing.assert_allclose(omega[:, 0], expected[1:, 0], rtol=1e-11, atol=1e-12)
    assert abs(error) < 1e-12


@pytest.mark.parametrize("delay", [0.0, 0.3, 1.0, 2.75])
def test_an_action_acts_as_much_later_as_its_delay_says(delay):
    actions, dt = commands(20), WHEEL["dt"]
    _, omega, _ = drive(actions, action_delay=delay, **WHEEL)
    ends = dt * np.arange(1, 21)
    acted = np.clip(ends[:, None] - dt * (np.arange(20) + delay), 0.0, dt)  # for how long, each
    np.testing.assert_allclose(omega[:, 0], 2.0 * acted @ actions[:, 0], atol=1e-13)


def test_motors_with_lag_delay_and_ripple_converge_to_the_exact_motion():
    lag, delay, ripple, cycles = 0.04, 0.6, 1.5, 7
    actions, dt = commands(10, seed=3), 0.05
    config = EnvConfig(n=2, actuated=(1,))
    limit, times = config.max_torque, dt * np.arange(1, 11)
    starts = dt * (np.arange(10) + delay)
    # the lagged action, exactly, in steps of the command
    level, come = 0.0, [0.0]
    for k in range(9):
        level = actions[k, 0] + (level - actions[k, 0]) * np.exp(-dt / lag)
        come.append(level)

    def torque(t, theta):
        k = np.searchsorted(starts, t, side="right") - 1
        y = actions[k, 0] + (come[k] - actions[k, 0]) * np.exp(-(t - starts[k]) / lag)
        cogging = ripple * np.sin(cycles * (theta[1] - theta[0]))
        return np.array([0.0, (limit * y if k >= 0 else 0.0) + cogging])

    breaks = starts[starts < times[-1]]
    exact = trajectory(config.chain, 0.4, 0.0, [0.0, *times], torque, breaks=breaks)[0][1:]
    keywords = {
        "n": 2, "actuated": (1,), "motor_lag": lag, "action_delay": delay,
        "torque_ripple": ripple, "ripple_cycles": cycles,
    }  # fmt: skip
    error = {}
    for substeps in (10, 20, 40):
        found = drive(actions, options={"theta": 0.4, "omega": 0.0}, substeps=substeps, **keywords)
        error[substeps] = np.abs(found[0] - exact).max()
        assert abs(found[2]) < 1e-6
    assert error[10] < 1e-2
    assert 3.0 < error[10] / error[20] < 5.0
    assert 3.0 < error[20] / error[40] < 5.0


def test_a_push_is_the_horizontal_force_at_the_tip_that_was_drawn():
    dt, force, steps = 0.01, 8.0, 20
    keywords = {"n": 2, "mode": "passive", "push_rate": 50.0, "push_force": force, "dt": dt}
    env = NPendulumEnv(**keywords)
    env.reset(seed=5, options={"theta": 0.3, "omega": 0.0})
    theta = np.array([env.step(0)[-1]["theta"] for _ in range(steps)])
    u = np.array([stream(5, k, Purpose.PUSH, 2) for k in range(steps)])
    pushes = np.where(u[:, 0] < 50.0 * dt, force * (2.0 * u[:, 1] - 1.0), 0.0)
    assert 5 < np.count_nonzero(pushes) < 15

    def torque(t, theta):
        lever = env.config.chain.lengths * np.cos(theta)
        return pushes[min(int(t / dt), steps - 1)] * np.cumsum(lever[::-1])[::-1]

    times = dt * np.arange(steps + 1)
    exact, _ = trajectory(env.config.chain, 0.3, 0.0, times, torque, breaks=times)
    np.testing.assert_allclose(theta, exact[1:], atol=2e-5)


def test_torque_noise_is_that_of_the_stream_and_acts_for_a_step():
    _, omega, _ = drive(np.zeros((8, 1)), torque_noise=0.7, **WHEEL)
    torque = [0.7 * normals(0, k, Purpose.MOTOR, 1)[0, 0] for k in range(8)]
    np.testing.assert_allclose(omega[:, 0], WHEEL["dt"] * np.cumsum(torque), rtol=1e-12)


@pytest.mark.parametrize(
    ("chain", "steps", "bound"),
    [
        ({"n": 3, "actuated": (0, 2)}, 200, 2e-4),
        ({"chain": "realaigym C.1", "actuated": (0, 1)}, 15, 1e-3),
    ],
    ids=["bobs", "links"],
)
def test_the_work_of_lag_noise_ripple_and_pushes_is_counted(chain, steps, bound):
    env = NPendulumVectorEnv(64, **chain, **EVERYTHING)
    env.reset(seed=0)
    for action in actions_for(env, steps):
        info = env.step(action)[-1]
    assert np.abs(info["energy_error"]).max() < bound
    assert np.abs(info["energy"]).min() > 0.0


def test_the_mean_squared_action_is_that_of_the_clipped_command():
    env = NPendulumEnv(mode=Effort(), **EVERYTHING)
    env.reset(seed=0)
    for action in (0.5, -3.0, 0.0):
        assert env.step(np.array([action]))[1] == min(1.0, action * action)


# -- sensors --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("motors", "error"), [(10**6, ValueError), (-1, ValueError), (1.0, TypeError)]
)
def test_noise_is_kept_to_motors_that_there_are(motors, error):
    envs = NPendulumVectorEnv(2, n=2, actuated=(0, 1), torque_noise=0.3)
    with pytest.raises(error, match="motors must be"):
        envs.set_noisy_motors(motors)


@pytest.mark.parametrize("observation", ["angles", "sincos"])
def test_a_delay_in_whole_steps_shows_what_was_shown_without(observation):
    keywords = {"n": 2, "mode": "swingup", "observation": observation}
    prompt, late = NPendulumEnv(**keywords), NPendulumEnv(observation_delay=3, **keywords)
    shown = [[env.reset(seed=1)[0]] for env in (prompt, late)]
    for action in commands(12):
        for env, each in zip((prompt, late), shown, strict=True):
            each.append(env.step(action)[0])
    np.testing.assert_array_equal(shown[1][3:], shown[0][:-3])
    np.testing.assert_array_equal(shown[1][:3], [shown[0][0]] * 3)


def test_a_delay_in_fractions_of_a_step_shows_the_motion_between_two_steps():
    error = []
    for dt in (0.1, 0.05):
        late = NPendulumEnv(n=2, mode="passive", dt=dt, observation_delay=0.5)
        fine = NPendulumEnv(n=2, mode="passive", dt=0.5 * dt)
        start = {"theta": 0.8, "omega": 0.0}
        for env in (late, fine):
            env.reset(seed=0, options=start)
        wrong = []
        for _ in range(int(1.0 / dt)):
            true, shown = fine.step(0)[0], late.step(0)[0]
            fine.step(0)
            wrong.append(np.abs(true - shown).reshape(2, 2).max(axis=1))
        error.append(np.max(wrong, axis=0))
    assert np.all(error[0] < [2e-3, 2e-2])
    # a cubic: the angle of fourth order, its rate of fourth in the middle, as symmetry has it
    assert np.all(error[1] < error[0] / 8.0)


@pytest.mark.parametrize("count", [1, 5])
def test_after_a_state_is_set_a_late_sensor_shows_it_until_it_is_old_enough(count):
    late, fresh = (
        NPendulumVectorEnv(count, n=1, mode="swingup", observation_delay=2.5) for _ in range(2)
    )
    late.reset(seed=0)
    fresh.reset(seed=0, options={"theta": 3.0, "omega": 4.0})
    idle = np.zeros((count, 1))
    for _ in range(9):
        late.step(idle)
    late.state = [[3.0, 4.0]] * count
    kept = late.get_state()
    expected = [fresh.step(idle)[0] for _ in range(6)]
    np.testing.assert_array_equal([late.step(idle)[0] for _ in range(6)], expected)
    late.set_state(kept)
    np.testing.assert_array_equal([late.step(idle)[0] for _ in range(6)], expected)


def test_noise_is_that_of_the_stream():
    env = NPendulumVectorEnv(64, n=3, angle_noise=0.02, velocity_noise=0.5)
    env.reset(seed=10)
    for step, action in enumerate(actions_for(env, 4), start=1):
        observation, *_, info = env.step(action)
        noise = observation - np.hstack([info["theta"], info["omega"]])
        expected = [normals(10 + k, step, Purpose.SENSOR, 3).ravel() for k in range(64)]
        shown = noise / np.repeat([0.02, 0.5], 3)
        np.testing.assert_allclose(shown, expected, atol=1e-4)  # float32 shows it


def test_what_is_measured_is_the_nearest_multiple_of_the_resolution():
    fine, coarse = 2.0 * np.pi / 60.0, 0.25
    env = NPendulumVectorEnv(50, n=2, angle_resolution=fine, velocity_resolution=coarse)
    env.reset(seed=0)
    for action in actions_for(env, 60):
        observation, *_, info = env.step(action)
        assert env.observation_space.contains(observation)
        steps = observation / np.repeat([fine, coarse], 2)
        np.testing.assert_allclose(steps, np.round(steps), atol=1e-4)
        off = observation - np.hstack([info["theta"], info["omega"]])
        off[:, :2] = np.angle(np.exp(1j * off[:, :2]))
        assert np.all(np.abs(off) <= 0.5001 * np.repeat([fine, coarse], 2))
    between = np.tile([0.125, 0.375], (50, 1))  # of two that are as near, the even one is shown
    observation, _ = env.reset(options={"theta": 0.0, "omega": between})
    np.testing.assert_array_equal(observation[:, 2:], np.tile([0.0, 0.5], (50, 1)))


def test_info_reward_and_end_know_nothing_of_the_sensors():
    sensors = ("angle_noise", "velocity_noise", "observation_delay", "angle_resolution")
    settings = {key: EVERYTHING[key] for key in sensors}
    env, ideal = (NPendulumVectorEnv(5, mode="balance", **k) for k in (settings, {}))
    actions = actions_for(env, 60)
    for shown, expected in zip(run(env, actions), run(ideal, actions), strict=True):
        assert not np.array_equal(shown[0], expected[0])
        assert_same(shown[1:], expected[1:])


# -- the promises of all lanes ----------------------------------------------------------------


def test_noise_leaves_the_starts_of_a_seed_as_they_are():
    for mode in ("swingup", "calm"):
        noisy, plain = (NPendulumEnv(mode=mode, **k) for k in (EVERYTHING, {}))
        assert_same(noisy.reset(seed=4)[1], plain.reset(seed=4)[1])


def test_the_longest_delays_work():
    env = NPendulumEnv(n=1, observation_delay=100, action_delay=100)
    first, _ = env.reset(seed=0)
    for k in range(100):
        np.testing.assert_array_equal(env.step([1.0])[0], first, str(k))
    assert not np.array_equal(env.step([1.0])[0], first)


SMOOTH = {"motor_lag": 0.0, "torque_ripple": 0.0, "action_delay": 1}  # constant over a step


@pytest.mark.parametrize("changed", [{}, SMOOTH])
def test_the_torque_in_the_info_is_what_turns_a_wheel_where_nothing_pushes(changed):
    keywords = WHEEL | EVERYTHING | changed | {"push_rate": 0.0, "push_force": 0.0}
    env = NPendulumEnv(**keywords)
    infos = [env.reset(seed=3, options=HANGING)[1]]
    infos += [env.step(action)[-1] for action in commands(40)]
    omega, torque = (np.array([info[k][0] for info in infos]) for k in ("omega", "torque"))
    assert torque[0] == 0.0
    np.testing.assert_allclose(torque[1:], np.diff(omega) / WHEEL["dt"], rtol=1e-9, atol=1e-9)
    assert env.reset()[1]["torque"].tolist() == [0.0]
    pushed = NPendulumEnv(**keywords | {"push_rate": 5.0, "push_force": 3.0, "torque_ripple": 0.0})
    still = NPendulumEnv(**keywords | {"torque_ripple": 0.0})
    for each in (pushed, still):
        each.reset(seed=3, options=HANGING)
    for action in commands(20):  # pushes turn the wheel, but the motor does not exert them
        shown, expected = (each.step(action)[-1] for each in (pushed, still))
        np.testing.assert_array_equal(shown["torque"], expected["torque"])
    assert shown["omega"] != expected["omega"]


def test_settings_of_zero_are_none():
    zero = dict.fromkeys(EVERYTHING, 0.0)
    ideal, plain = NPendulumEnv(**zero), NPendulumEnv()
    assert_same(ideal.reset(seed=0), plain.reset(seed=0))
    assert_same(ideal.step([0.5]), plain.step([0.5]))


def test_a_push_is_seen_in_the_pictures_of_four_tenths_of_a_second(monkeypatch):
    pytest.importorskip("pygame")
    painted = []
    monkeypatch.setattr("npend_gym.render.Painter.paint", lambda _, scene: painted.append(scene))
    keywords = {"n": 1, "push_rate": 2.0, "push_force": 5.0, "dt": 0.1}
    env = NPendulumEnv(**keywords, render_mode="rgb_array")
    env.reset(seed=0)
    since, seen = 99, set()
    for _ in range(60):
        env.step(np.zeros(1, np.float32))
        env.render()
        since = 0 if env._episodes.pushes()[0] != 0.0 else since + 1
        (scene,) = painted
        painted.clear()
        assert (scene.push != 0.0) == (since < 4)
        seen.add(scene.push != 0.0)
    assert seen == {True, False}


PUSHED = {"n": 1, "mode": "balance", "push_rate": 20.0, "push_force": 20.0, "render_size": 64}


@pytest.mark.parametrize("autoreset", list(AutoresetMode))
def test_the_pictures_of_a_lane_are_those_of_a_single_environment(autoreset):
    pytest.importorskip("pygame")
    keywords = PUSHED | {"render_mode": "rgb_array", "max_episode_steps": 3}
    both = [
        gym.make_vec("NPendulum-v0", 2, **how, **keywords)
        for how in (
            {"autoreset_mode": autoreset},
            {"vectorization_mode": "sync", "vector_kwargs": {"autoreset_mode": autoreset}},
        )
    ]
    for envs in both:
        envs.reset(seed=5)
    for t in range(60):
        actions = np.sin(np.array([[t], [2.0 * t]], np.float32))
        over, expected = (np.logical_or(*envs.step(actions)[2:4]) for envs in both)
        np.testing.assert_array_equal(over, expected)
        np.testing.assert_array_equal(*(envs.render() for envs in both))
        if over.any() and autoreset is AutoresetMode.DISABLED:
            for envs in both:
                envs.reset(options={"reset_mask": over})
            np.testing.assert_array_equal(*(envs.render() for envs in both))


def test_a_trace_begins_with_the_first_step_in_every_render_mode(monkeypatch):
    pytest.importorskip("pygame")
    scenes, picture = [], np.zeros((64, 64, 3), np.uint8)
    monkeypatch.setattr("npend_gym.envs.picture.Window", Mock)
    monkeypatch.setattr(
        "npend_gym.render.Painter.paint", lambda _, scene: scenes.append(scene) or picture
    )
    for mode in ("human", "rgb_array"):
        env = NPendulumEnv(**PUSHED, render_mode=mode)
        for call, points in ((env.reset, 0), (lambda: env.step([0.5]), 1)):  # noqa: B023
            call()
            env.render()
            assert len(scenes[-1].trace) == points
