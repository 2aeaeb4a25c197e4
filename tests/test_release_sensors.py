"""Releases measured by a sensor, against what errors do to the zeros of known signals."""

import json

import numpy as np
import pytest
from scipy.special import ellipk, ellipkinc

from npend_gym import Chain, physics, pseudo_periods, simulate
from npend_gym.cli import main
from npend_gym.experiments import ReleaseExperiment, measure, run_release
from npend_gym.experiments.sensing import crossings, signals
from npend_gym.report import release_tables
from npend_gym.report.release_page import command

A, G = 0.6, 9.81  # rad, m/s^2


def sensed(n=1, **keywords):
    plan = ReleaseExperiment(n_values=[n], trials=1, spread=0.0, **{"amplitude": A} | keywords)
    return measure(plan, *plan.runs()[0])


@pytest.mark.parametrize("definition", ["bob", "link", "com"])
def test_samples_of_an_ideal_sensor_approach_the_exact_instants(definition):
    exact = pseudo_periods(Chain.uniform(5), A, definition=definition)
    for interval in (0.02, 0.01, 0.005, 0.0025):  # a line between samples errs by u'' dt^2 / 8 u'
        away = np.abs(sensed(5, definition=definition, sensor_interval=interval).periods - exact)
        assert away.max() < 3.0 * interval**2


@pytest.mark.parametrize("start", [0.5, -0.5])
@pytest.mark.parametrize(
    ("definition", "chain"),
    [
        ("height", Chain.uniform(5)),
        ("height", Chain([1.0, 1.0], [1.0, 1.0], centres=[-0.5, 1.0], inertias=[1.0, 0.0])),
        ("com", Chain([1.0], [1.0], centres=[-0.5], inertias=[0.1])),
    ],
    ids=["heights", "a bob that first rises", "a centre of mass opposite to the angle"],
)
def test_samples_are_read_on_the_side_of_the_exact_reading(definition, chain, start):
    exact = pseudo_periods(chain, start, definition=definition)
    run = sensed(
        chain.n, chain=chain, amplitude=start, definition=definition, sensor_interval=0.002
    )
    np.testing.assert_allclose(run.periods, exact, atol=1e-5)


def test_an_offset_moves_zeros_alternately_and_no_full_swing():
    # u = -sin(w t) + b: the zeros of -sin move by -d, +d, -d, ... with sin(w d) = b
    w, b = 3.0, 0.05
    times = np.arange(0.0, 12.0, 1e-3)
    found = np.array(crossings(times, -np.sin(w * times) + b, 1e-6))
    d = np.arcsin(b) / w
    expected = np.pi / w * np.arange(1, 12) + d * np.tile([-1.0, 1.0], 6)[:11]
    line = 1.1 * b * w * 1e-3**2 / 8.0  # u'' dt^2 / 8 u', as above, and terms of higher order
    np.testing.assert_allclose(found[1:12, 0], expected, rtol=0.0, atol=line)  # 0: b alone
    halves = np.diff(found[1:12, 0])
    np.testing.assert_allclose(halves[::2] - np.pi / w, 2.0 * d, rtol=0.0, atol=2.0 * line)
    np.testing.assert_allclose(halves[1::2] - np.pi / w, -2.0 * d, rtol=0.0, atol=2.0 * line)
    np.testing.assert_allclose(halves[:-1] + halves[1:], 2.0 * np.pi / w, rtol=0.0, atol=2.0 * line)
    np.testing.assert_array_equal(found[1:12, 1], np.tile([1.0, -1.0], 6)[:11])


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_pseudo_period_of_a_gyroscope_is_late_by_its_offset_over_the_acceleration(side):
    exact = 4.0 / np.sqrt(G) * ellipk(np.sin(A / 2.0) ** 2)
    keywords = {"amplitude": side * A, "definition": "link", "sensor_interval": 1e-3}
    for offset, scale in ((0.01, 1.0), (0.01, 1.05), (-0.02, 0.9)):
        run = sensed(**keywords, sensor_offset=offset, sensor_scale=scale)
        late = side * offset / scale / (G * np.sin(A))  # it turns where the angle is the first
        assert run.periods[0] - exact == pytest.approx(late, rel=1e-4)
        assert run.com == pytest.approx(exact, rel=1e-9)  # no gyroscope measures it
    alone = sensed(**keywords, sensor_scale=1.1).periods[0]
    assert alone == pytest.approx(exact, abs=1e-8)  # no scale moves a zero


@pytest.mark.parametrize("definition", ["bob", "link", "com"])
def test_a_sensor_in_another_unit_finds_the_same_pseudo_periods(definition):
    volts, millivolts = (
        sensed(20, definition=definition, sensor_interval=0.01, sensor_scale=scale).periods
        for scale in (2.0**-20, 1.0)
    )
    np.testing.assert_allclose(volts, millivolts, rtol=1e-12)


def test_the_centre_of_mass_is_late_by_the_offset_over_its_acceleration():
    chain = Chain.uniform(4)
    exact = pseudo_periods(chain, A, definition="com")[0]
    motion = simulate(chain, A, 0.0, [0.0, exact])
    theta, omega = motion.theta[-1], motion.omega[-1]
    force = -physics.tensions(chain, theta, omega)[0] * np.sin(theta[0])  # of the pivot
    run = sensed(4, definition="com", sensor_interval=1e-3, sensor_offset=0.01)
    assert run.com - exact == pytest.approx(-0.01 / (force / 4.0), rel=1e-2)
    np.testing.assert_array_equal(run.periods, run.com)


def test_a_scale_moves_the_return_to_a_height():
    # with s (1 - cos theta) = 1 - cos A the pendulum seems to be back, on the other side
    scale = 1.2
    back = np.arccos(1.0 - (1.0 - np.cos(A)) / scale)
    k = np.sin(A / 2.0)
    phi = np.arcsin(np.sin(back / 2.0) / k)
    expected = (ellipk(k**2) + ellipkinc(phi, k**2)) / np.sqrt(G)
    run = sensed(definition="height", sensor_interval=1e-3, sensor_scale=scale)
    assert run.periods[0] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("chain", "rest"),
    [
        pytest.param(
            Chain([1.0, 1.0], [1.0, 1.0], stiffness=60.0, axial_damping=0.5),
            0.0,
            marks=pytest.mark.long,
        ),
        (Chain([1.0], [1.0], centres=[-0.5], inertias=0.1), np.pi),
    ],
    ids=["springs", "a link that rests upright"],
)
def test_a_scale_is_that_of_the_height_above_rest(chain, rest):
    times = 1e-3 * np.arange(4000.0)
    height = simulate(chain, A, 0.0, times).positions()[..., 1]
    ways = np.sign(height[0] - height[9])  # a bob that first rises is back on its way down
    resting = simulate(chain, rest, 0.0, [0.0, 1.0]).positions()[-1, :, 1]
    shown = 1.2 * (height - resting) + resting - height[0]
    back = [
        next(t for t, way in crossings(times, one, 1e-9) if way == wanted)
        for one, wanted in zip(shown.T, ways, strict=True)
    ]
    keywords = {"definition": "height", "sensor_interval": 1e-3, "sensor_scale": 1.2}
    run = sensed(chain.n, chain=chain, duration=3.999, **keywords)
    np.testing.assert_allclose(run.periods, back, rtol=1e-9)


@pytest.mark.long
def test_noise_scatters_the_period_as_a_line_through_the_samples_does():
    # m samples within +- 5 s of the zero, one every dt on the slope a, give s / (a sqrt(m))
    noise, interval, trials = 0.05, 0.002, 400
    plan = ReleaseExperiment(
        n_values=[1], trials=trials, amplitude=A, spread=0.0, definition="link",
        sensor_interval=interval, sensor_noise=noise,
    )  # fmt: skip
    periods = np.array([run.periods[0] for run in run_release(plan)])
    expected = np.sqrt(noise * interval / (10.0 * G * np.sin(A)))
    assert np.std(periods) == pytest.approx(expected, rel=0.15)
    exact = 4.0 / np.sqrt(G) * ellipk(np.sin(A / 2.0) ** 2)
    assert abs(periods.mean() - exact) < 3.0 * expected / np.sqrt(trials)


def test_noise_depends_on_seed_and_trial_and_not_on_the_window():
    keywords = {"sensor_interval": 0.01, "sensor_noise": 0.02}
    run = sensed(3, seed=4, **keywords)
    np.testing.assert_array_equal(sensed(3, seed=4, duration=9.0, **keywords).periods, run.periods)
    assert not np.any(sensed(3, seed=5, **keywords).periods == run.periods)
    plan = ReleaseExperiment(n_values=[3], trials=2, amplitude=A, spread=0.0, seed=3, **keywords)
    np.testing.assert_array_equal(run_release(plan)[1].periods, run.periods)


def test_nothing_completes_without_gravity_or_where_a_height_is_only_touched():
    assert np.isnan(sensed(2, gravity=0.0, sensor_interval=0.01).periods).all()
    assert np.isnan(sensed(definition="height", sensor_interval=0.002).periods[0])


@pytest.mark.parametrize(
    "chain",
    [Chain.rods([1, 2], [0.5, 0.8], [0.3, 0.0]), Chain([1.0, 2.0], [0.5, 0.8], stiffness=300.0)],
    ids=["links", "springs"],
)  # fmt: skip
def test_the_signal_of_the_centre_of_mass_is_the_rate_of_its_place(chain):
    times = 0.4 + 1e-4 * np.arange(-1.0, 2.0)
    motion = simulate(chain, 1.0, 0.0, np.concatenate([[0.0], times]))
    ends = motion.positions()[1:, :, 0]
    joints = np.concatenate([np.zeros((3, 1)), ends[:, :-1]], axis=1)
    places = joints + (ends - joints) * chain.centres / chain.lengths
    x = places @ chain.masses / chain.masses.sum()
    rate = (x[2] - x[0]) / 2e-4
    assert signals(motion, "com")[2, 0] == pytest.approx(rate, rel=1e-6)


def test_the_command_and_its_files_say_by_which_sensor_bobs_were_measured(tmp_path, capsys):
    options = ["--sensor-interval", "0.01", "--sensor-offset", "0.02", "--sensor-noise", "0.001"]
    base = ["release", "--n", "2", "--trials", "1", "--out", str(tmp_path)]
    assert main([*base, *options]) == 0
    shown = capsys.readouterr().out
    assert "sensor: a sample every 0.01 s, noise 0.001, offset 0.02, scale 1" in shown
    plan, runs = release_tables.read(tmp_path)
    assert plan.sensor == (0.01, 0.001, 0.02, 1.0)
    np.testing.assert_array_equal(measure(plan, *plan.runs()[0]).periods, runs[0].periods)
    assert "--sensor-offset 0.02" in command(plan)
    assert json.loads((tmp_path / "release.json").read_text())["sensor_interval"] == 0.01
    assert main(["release", "--n", "2", "--trials", "1"]) == 0
    assert "sensor" not in capsys.readouterr().out


BALANCED = Chain([1.0, 1.0], [1.0, 1.0], centres=[-1.0, 1.0], inertias=[0.1, 0.0])


@pytest.mark.parametrize(
    ("n", "change", "message"),
    [
        (1, {"sensor_offset": 0.1}, "sensor_interval must be given with sensor_noise"),
        (1, {"sensor_interval": -1.0}, "sensor_interval must be zero or more"),
        (1, {"sensor_interval": 0.1, "sensor_noise": -1.0}, "sensor_noise must be zero or more"),
        (
            1,
            {"sensor_interval": 0.1, "sensor_scale": 0.0},
            "sensor_scale must be greater than zero",
        ),
        (
            2,
            {"chain": BALANCED, "sensor_interval": 0.01},
            "duration must be given where .* balanced on its joint",
        ),
        (5, {"sensor_interval": 1e-7}, "at most 20000000 samples, got one of 5 bobs every 1e-07"),
    ],
)
def test_sensors_that_cannot_measure_are_refused(n, change, message):
    with pytest.raises(ValueError, match=message):
        sensed(n, **change)
