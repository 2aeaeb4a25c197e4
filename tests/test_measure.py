"""One pendulum measured: against its chain's own constants, through Python and `npend measure`."""

import json

import numpy as np
import pytest

from npend_gym import Chain, simulate
from npend_gym.cli import main
from npend_gym.identification import measure_swings, read_motion
from npend_gym.identification.motion import check_motion

LENGTH, RADIUS, GRAVITY, DECAY = 0.5, 0.02, 9.8123, 0.02
INERTIA = 0.1 * (LENGTH**2 + 0.4 * RADIUS**2)  # of a ball of 0.1 kg, about the pivot
PERIOD = 2.0 * np.pi * np.sqrt(INERTIA / (0.1 * LENGTH * GRAVITY))
BALL = Chain([0.1], [LENGTH], inertias=[0.4 * 0.1 * RADIUS**2], gravity=GRAVITY,
             damping=2.0 * INERTIA * DECAY, centres=[LENGTH])  # fmt: skip


def recorded(amplitude, seed=0, rate=60.0, seconds=40.0, noise=3e-3):
    times = np.arange(0.0, seconds, 1.0 / rate)
    theta = simulate(BALL, amplitude, 0.0, times).theta
    theta += 0.03 + noise * np.random.default_rng(seed).normal(size=theta.shape)
    return times, theta


@pytest.mark.parametrize("amplitude", [0.1, 0.5, 1.2, 1.8])
def test_gravity_decay_and_q_are_those_of_the_ball_within_their_errors(amplitude):
    motion = check_motion(*recorded(amplitude))
    found = measure_swings(motion, length=LENGTH, length_error=5e-4, radius=RADIUS)
    assert abs(found.small_period / PERIOD - 1.0) < 4.0 * found.small_period_error / PERIOD + 2e-5
    assert found.small_period_error < 1e-4
    assert found.gravity == pytest.approx(GRAVITY, abs=3e-3)
    assert found.gravity_error == pytest.approx(GRAVITY * 5e-4 / LENGTH, rel=0.1)
    assert found.centre == pytest.approx(0.03, abs=5e-3)
    if amplitude < 1.0:  # the law of larger swings decays more slowly than their energy says
        assert abs(found.decay - DECAY) < 4.0 * found.decay_error + 0.02 * DECAY
        assert found.quality == pytest.approx(np.pi / DECAY / PERIOD, rel=0.03)
    by_gravity = measure_swings(motion, gravity=GRAVITY, radius=RADIUS)
    assert by_gravity.length == pytest.approx(LENGTH, rel=3e-4)


def test_standard_errors_of_the_period_cover_the_truth():
    scaled = []
    for seed in range(20):
        found = measure_swings(check_motion(*recorded(0.5, seed)))
        scaled.append((found.small_period - PERIOD) / found.small_period_error)
    assert 0.5 < np.sqrt(np.mean(np.square(scaled))) < 1.6


def test_several_recordings_count_together():
    runs = [recorded(amplitude, seconds=15.0) for amplitude in (0.3, 0.8)]
    times, theta = (np.concatenate([run[k] for run in runs]) for k in (0, 1))
    found = measure_swings(check_motion(times, theta, piece=np.repeat([0, 1], times.size // 2)))
    assert found.amplitudes.max() > 0.7
    assert found.amplitudes.min() < 0.3
    assert abs(found.small_period - PERIOD) < 4.0 * found.small_period_error + 2e-5


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"length": 0.5, "gravity": 9.8}, "gravity must be left out with length"),
        ({"length": -1.0}, "length must be greater than zero"),
        ({"radius": -1.0}, "radius must"),
        ({"length": 0.5, "radius": 20.0}, "radius must be less than"),
        ({"gravity": 9.8, "radius": 20.0}, "radius must be less than"),
        ({"radius": 0.02}, "radius must be left out without length or gravity"),
        ({"gravity": 9.8, "length_error": 0.001}, "length_error must be left out without length"),
    ],
)
def test_bad_arguments_are_refused_by_name(given, message):
    with pytest.raises(ValueError, match=message):
        measure_swings(check_motion(*recorded(0.5, seconds=8.0)), **given)


def test_two_links_turns_and_too_few_swings_are_refused():
    times, theta = recorded(0.5, seconds=4.0)
    with pytest.raises(ValueError, match="of one pendulum without a motor, got 2 links"):
        measure_swings(check_motion(times, np.hstack([theta, theta])))
    for angles in (theta[:150], 3.0 * times[:, None]):
        with pytest.raises(ValueError, match="motion must have 4 whole swings at least"):
            measure_swings(check_motion(times[: len(angles)], angles))


def test_the_command_measures_an_export_and_draws_one_figure(tmp_path, capsys):
    times, theta = recorded(0.6)
    bob = np.column_stack([times, LENGTH * np.sin(theta), -LENGTH * np.cos(theta)])
    rows = ["\t".join(f"{cell:.6f}" for cell in row) for row in bob.tolist()]
    rows[9] = rows[9].split("\t")[0] + "\t\t"
    path, out = tmp_path / "tracker.txt", tmp_path / "results"
    path.write_text("\tmass A\nt\tx\ty\t\n" + "\n".join(rows))
    given = [str(path), "--length", str(LENGTH), "--radius", str(RADIUS)]
    assert main(["measure", *given, "--out", str(out)]) == 0
    shown = capsys.readouterr()
    assert "acceleration of gravity" in shown.out
    assert "npend measure: tracker.txt: recognised as Tracker; times are 't', in sec" in shown.err
    written = {each.name for each in out.iterdir()}
    assert written == {"measure.json", "swings.csv", "swings.png", "manifest.json"}
    assert main(["measure", *given, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["gravity"] == pytest.approx(GRAVITY, rel=1e-3)
    assert found == json.loads((out / "measure.json").read_text())


def test_a_measured_file_is_read_the_same_by_python(tmp_path):
    path = tmp_path / "swing.csv"
    rows = np.column_stack(recorded(0.6))
    np.savetxt(path, rows, delimiter=",", header="time,theta0", comments="")
    assert measure_swings(read_motion(path)).small_period == pytest.approx(PERIOD, rel=1e-4)


@pytest.mark.parametrize(
    ("amplitude", "size", "way"),
    [
        (0.045, 180.0 / np.pi, "as if the angles were degrees: give --degrees"),
        (0.9, np.pi / 180.0, "as if the angles were radians: give no --degrees"),
    ],
)
def test_periods_show_that_angles_are_in_another_unit_than_was_said(amplitude, size, way):
    times, theta = recorded(amplitude, seconds=60.0, noise=1e-4)
    with pytest.warns(UserWarning, match=way):
        measure_swings(check_motion(times, theta * size))
    measure_swings(check_motion(times, theta))  # without a warning


def test_a_gravity_that_is_not_the_earths_brings_a_warning_with_its_reasons():
    motion = check_motion(*recorded(0.5))
    with pytest.warns(
        UserWarning, match=r"3\.92\d m/s\^2 follows from the length 0\.2 m.*by 1\.58"
    ):
        measure_swings(motion, length=0.2)


def test_a_swing_of_minutes_brings_the_question_whether_times_are_in_seconds():
    times, theta = recorded(0.5)
    with pytest.warns(UserWarning, match=r"a swing lasts 1.42e\+03 s: are times in seconds"):
        measure_swings(check_motion(1000.0 * times, theta))
