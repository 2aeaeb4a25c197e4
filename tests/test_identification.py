"""A chain from measured motion: made-up motion with known parameters, and measured pendulums."""

import json
import math
import warnings
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import least_squares

from npend_gym import Cart, Chain, Signal, identify, simulate, theory
from npend_gym.identification import prediction_rmse, read_motion
from npend_gym.identification.least_squares import solve
from npend_gym.identification.motion import check_motion
from npend_gym.identification.moving_pivot import with_position
from npend_gym.identification.parameters import (
    QUANTITIES,
    new_model,
    possible_masses,
    values_of,
)
from npend_gym.identification.shooting import Shooting
from npend_gym.identification.stages import Stages
from npend_gym.physics import accelerations

pytestmark = pytest.mark.long  # kernels of their own take long to compile

DATA = Path(__file__).parent.parent / "examples" / "data"
TRUE = Chain(
    [0.1, 0.15], [0.2, 0.25], damping=[1e-4, 1e-4], quadratic_drag=[1e-3, 1e-3],
    centres=[0.1, 0.12], inertias=[4e-4, 1e-3], friction=[4e-4, 2e-4],
)  # fmt: skip
KNOWN = Chain([0.1, 0.15], [0.2, 0.25], centres=[0.1, 0.12])
NOISE = 1e-3  # rad


def recorded(chain, pieces, *, seconds=1.5, rate=60.0, torque=None, seed=0, turned=1.2):
    """Recordings of a chain from rest, (times, theta, piece), with noise; made by DOP853."""
    rng = np.random.default_rng(seed)
    times = np.arange(0.0, seconds, 1.0 / rate)
    columns = [], [], []
    for piece in range(pieces):
        start = rng.uniform(-turned, turned, chain.n)
        theta = simulate(chain, start, 0.0, times, torque=torque).theta
        columns[0].append(times)
        columns[1].append(theta + NOISE * rng.normal(size=theta.shape))
        columns[2].append(np.full(times.size, piece))
    return tuple(np.concatenate(column) for column in columns)


def noisy(theta, noise=NOISE):
    return theta + noise * np.random.default_rng(0).normal(size=np.shape(theta))


def truth(result, chain):
    values = values_of(chain)
    places = ((name.rstrip("0123456789"), name[-1]) for name in result.names)
    return np.array([values[QUANTITIES.index(kind), int(k) if k.isdigit() else 0]
                     for kind, k in places])  # fmt: skip


def deviations(result, chain):
    """How far fitted values are from the true ones, in standard errors; 0 at a bound."""
    spread = np.where(result.standard_errors > 0.0, result.standard_errors, np.inf)
    return (result.values - truth(result, chain)) / spread


def test_the_true_values_lie_within_their_standard_errors():
    times, theta, piece = recorded(TRUE, 6)
    result = identify(times, theta, piece=piece, chain=KNOWN)
    assert np.abs(deviations(result, TRUE)).max() < 4.0
    assert result.names[:3] == ("inertia0", "inertia1", "lift1")
    assert np.all(result.standard_errors[:3] < 2e-3 * result.values[:3])
    assert result.held_out_rmse == pytest.approx(NOISE, rel=0.15)
    assert result.fitted_rmse == pytest.approx(NOISE, rel=0.15)
    assert result.given_rmse > 20.0 * NOISE
    assert np.all(np.abs(np.linalg.eigvalsh(result.correlation) - 1.0) <= result.values.size)
    assert result.chain.centres == pytest.approx(TRUE.centres, abs=5e-4)
    assert result.chain.inertias == pytest.approx(TRUE.inertias, rel=0.02)


@pytest.mark.nightly
def test_standard_errors_cover_errors_that_last_and_white_noise_alike():
    """Noise of an AR(1) process that lasts for a fifth of a recording, and white noise."""
    for memory, least in ((0.0, 0.55), (0.9, 0.55)):
        scaled = []
        for seed in range(12):
            times, theta, piece = recorded(TRUE, 8, seed=seed)
            if memory:
                rng = np.random.default_rng(seed + 100)
                noise = NOISE * rng.normal(size=theta.shape)
                for k in range(1, len(noise)):
                    noise[k] += memory * noise[k - 1]
                theta += noise
            scaled.append(deviations(identify(times, theta, piece=piece, chain=KNOWN), TRUE))
        within = np.mean(np.abs(scaled) < 1.0), np.mean(np.abs(scaled) < 2.0)
        assert within[0] > least, (memory, within)
        assert within[1] > 0.9, (memory, within)
        assert (0.5 if memory else 0.6) < np.sqrt(np.mean(np.square(scaled))) < 1.4


@pytest.mark.nightly
@pytest.mark.filterwarnings("ignore:standard errors are large", "ignore:the fit found")
def test_two_recordings_of_one_robot_agree_within_their_standard_errors():
    found = []
    for name in ("realaigym_c1_small.csv", "realaigym_c1.csv"):
        motion = read_motion(DATA / name)
        given = {"torque": motion.torque, "chain": "realaigym C.1", "segment": 1.0}
        found.append(identify(motion.times, motion.theta, **given))
    spread = np.hypot(found[0].standard_errors, found[1].standard_errors)
    assert np.all(spread > 0.0)  # also of values that ended at their bound
    assert np.abs((found[0].values - found[1].values) / spread).max() < 3.0


def test_little_data_and_the_drag_of_a_barn_door_bring_warnings():
    motion = read_motion(DATA / "realaigym_c1_small.csv")
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        identify(motion.times, motion.theta, motion.torque, chain="realaigym C.1", segment=1.0)
    texts = [str(one.message) for one in told]
    assert any("segments, whose errors last long, must tell 11 values" in text for text in texts)
    assert any("quadratic_drag[1] = " in text and "N s^2/m^2, more than" in text for text in texts)


def test_gaps_outliers_whole_turns_and_uneven_times_do_no_harm():
    rng = np.random.default_rng(1)
    times, theta, piece = recorded(TRUE, 6, rate=120.0)
    bad = rng.random(theta.shape) < 0.02
    theta[bad] += rng.choice([-1.0, 1.0], bad.sum()) * rng.uniform(0.2, 1.5, bad.sum())
    theta = np.mod(theta + 3.0, 2.0 * np.pi) - 3.0
    kept = (rng.random(times.size) > 0.2) & ~((times > 0.6) & (times < 0.75))
    result = identify(times[kept], theta[kept], piece=piece[kept], chain=KNOWN)
    assert np.abs(deviations(result, TRUE)).max() < 4.0
    assert result.clean_rmse == pytest.approx(NOISE, rel=0.15)
    assert result.outliers.sum() == pytest.approx(bad[kept].sum(), abs=3)
    assert len(result.segments) == 12  # each piece has a gap


def test_segments_of_a_chaotic_motion_stay_so_short_that_errors_are_known():
    chain = Chain.uniform(2)
    times = np.arange(0.0, 12.0, 0.02)
    theta = noisy(simulate(chain, [2.5, 2.8], 0.0, times).theta)
    known, fit = Chain.uniform(2, mass=2.0), ["inertia", "lift"]
    result = identify(times, theta, chain=known, fit=fit, segment=6.0)
    assert np.abs(result.values / 2.0 - truth(result, chain)).max() < 1e-3
    assert np.abs(result.values / 2.0 - truth(result, chain))[0] < 4.0 * result.standard_errors[0]
    assert max(one["end"] - one["start"] for one in result.segments) < 6.0
    assert result.held_out_rmse == pytest.approx(NOISE, rel=0.15)


@pytest.mark.filterwarnings("ignore:theta reaches")
def test_a_chain_that_turns_over_for_long_is_fitted():
    true = Chain([1.0, 0.5], [0.5, 0.4], damping=0.002)
    times = np.arange(0.0, 40.0, 0.01)
    theta = noisy(simulate(true, [1.0, 1.5], [12.0, 14.0], times).theta)
    fit = ["inertia", "lift", "damping"]
    found = identify(times, theta, chain=Chain([1.0, 0.55], [0.5, 0.4]), fit=fit)
    assert found.values == pytest.approx(0.775 / 0.75 * truth(found, true), rel=1e-3)  # by lift0
    assert found.held_out_rmse == pytest.approx(NOISE, rel=0.1)


@pytest.mark.filterwarnings("ignore:theta reaches")
def test_turns_do_not_hide_that_a_chain_moves_otherwise_than_the_data():
    times = np.arange(0.0, 10.0, 0.01)
    theta = noisy(simulate(Chain.uniform(1), 0.0, 12.0, times).theta, 0.3)
    with pytest.warns(UserWarning, match="by 0.31 rad where angles vary by 3.1 rad"):
        identify(times, theta, chain=Chain.uniform(1), fit=["damping"])


@pytest.mark.filterwarnings("ignore:standard errors are large")
def test_a_chain_that_moves_otherwise_than_the_data_brings_a_warning():
    times = np.arange(0.0, 3.0, 0.02)
    theta = simulate(Chain.uniform(2), [0.8, 0.1], 0.0, times).theta
    with pytest.warns(UserWarning, match="moves otherwise than the data, by .* check lengths"):
        identify(times, theta[:, ::-1], chain=Chain.uniform(2), held_out=0.0)


@pytest.mark.parametrize("n", [1, 2])
def test_angles_from_upright_end_with_an_error_that_says_so(n):
    times = np.arange(0.0, 6.0, 0.01)
    theta = simulate(Chain.uniform(n), 1.2, 0.0, times).theta
    with pytest.raises(ValueError, match="times better if they were from where it stands upright"):
        identify(times, theta - np.pi, chain=Chain.uniform(n), held_out=0.0)


def test_angles_from_an_axis_that_points_sideways_end_with_an_error_that_says_so():
    times = np.arange(0.0, 6.0, 0.01)
    theta = simulate(Chain.uniform(1), 0.8, 0.0, times).theta
    for turn, way in ((0.5 * np.pi, "subtract"), (-0.5 * np.pi, "add")):
        with pytest.raises(ValueError, match=f"from an axis that points sideways.*: {way} np.pi"):
            identify(times, theta + turn, chain=Chain.uniform(1), held_out=0.0)


@pytest.mark.parametrize("lengths", [[0.7], [0.4, 0.3]])
def test_a_camera_that_is_not_level_biases_no_value(lengths):
    times, n = np.arange(0.0, 20.0, 0.02), len(lengths)
    true, tilt = Chain([0.5] * n, lengths, damping=0.004), 0.03
    theta = noisy(simulate(true, 0.3, 0.0, times).theta) + tilt
    with pytest.warns(UserWarning, match="the angles are off by 0.0[23]"):
        found = identify(times, theta, chain=Chain([0.5] * n, lengths))
    level = identify(times, theta - tilt, chain=Chain([0.5] * n, lengths))  # without a warning
    assert not level.offsets.any()
    assert found.offsets == pytest.approx([tilt] * n, abs=1e-3)
    inertia = values_of(true)[0]
    assert values_of(found.chain)[0] == pytest.approx(inertia, rel=3e-3)


@pytest.mark.parametrize("amplitude", [0.3, 1.0])
@pytest.mark.parametrize("term", [{}, {"damping": 0.0083}, {"friction": 0.002},
                                  {"quadratic_drag": 0.02}])  # fmt: skip
@pytest.mark.parametrize("lengths", [[0.7], [0.4, 0.3]])
def test_of_damping_friction_and_drag_those_are_fitted_that_there_are(lengths, term, amplitude):
    n, times = len(lengths), np.arange(0.0, 20.0, 0.02)
    true = Chain([0.5] * n, lengths, **term)
    theta = noisy(simulate(true, amplitude, 0.0, times).theta)
    found = identify(times, theta, chain=Chain([0.5] * n, lengths))
    resisting = {name[:-1] for name in found.names} - {"inertia", "lift"}
    assert resisting == set(term)
    assert np.abs(deviations(found, true)).max() < 4.0
    left = {"damping", "friction", "quadratic_drag"} - set(term)
    assert {sentence.partition(":")[0] for sentence in found.left_out} == left
    assert all(getattr(found.chain, name).max(initial=0.0) == 0.0 for name in left)
    for name in term:
        assert np.all(found.chain_errors[name] < 0.5 * getattr(true, name))


def test_terms_that_the_user_names_are_all_fitted():
    times = np.arange(0.0, 20.0, 0.02)
    theta = noisy(simulate(Chain([0.5], [0.7], damping=0.0083), 0.3, 0.0, times).theta)
    named = ["inertia", "damping", "friction", "quadratic_drag"]
    found = identify(times, theta, chain=Chain([0.5], [0.7]), fit=named)
    assert found.names == ("inertia0", "damping0", "friction0", "quadratic_drag0")
    assert found.left_out == ()


@pytest.mark.parametrize("known", ["damping", "friction", "quadratic_drag"])
def test_a_term_that_was_given_rightly_stays_and_tells_the_others_apart(known):
    """Swings up to 0.2 rad hardly tell three terms apart."""
    true = {"damping": 0.004, "friction": 0.004, "quadratic_drag": 0.02}
    times, bob = np.arange(0.0, 20.0, 0.02), Chain([0.5], [0.7], **true)
    theta = noisy(simulate(bob, 0.2, 0.0, times).theta)
    found = identify(times, theta, chain=Chain([0.5], [0.7], **{known: true[known]}))
    assert [one.partition(";")[0] for one in found.left_out] == [f"{known}: as given"]
    assert getattr(found.chain, known) == pytest.approx([true[known]])
    assert np.abs(deviations(found, bob)).max() < 3.0
    assert np.all(found.standard_errors < 0.15 * found.values)


def test_what_is_held_out_is_chosen_after_segments_became_shorter():
    times = np.arange(0.0, 2.0, 0.01)
    theta = simulate(Chain([0.05, 0.005], [0.09, 0.07]), [-3.11, -3.05], 0.0, times).theta
    theta += 0.01 * np.random.default_rng(0).normal(size=theta.shape)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", "theta reaches")
        found = identify(times, theta, chain=Chain([0.03, 0.002], [0.09, 0.07]))
    assert [one["held_out"] for one in found.segments] == [False] * 6 + [True] * 2
    assert found.held_out_rmse == pytest.approx(0.01, rel=0.15)
    fitted, held = ({(one["start"], one["end"]) for one in found.segments if one["held_out"] == h}
                    for h in (False, True))  # fmt: skip
    assert all(end < a or start > b for start, end in held for a, b in fitted)


@pytest.mark.parametrize("start", [(1, 1), (-1, -1), (1, -1)])
@pytest.mark.parametrize(
    ("true", "known"),
    [
        (Chain([0.05, 0.005], [0.09, 0.07]), Chain([0.03, 0.002], [0.09, 0.07])),
        (Chain.rods([0.1, 0.06], [0.2, 0.15]), Chain([0.1, 0.06], [0.2, 0.15], centres=0.1)),
        (Chain([0.05, 0.0068], [0.091, 0.07]), Chain(1.0, [0.091, 0.07])),
    ],
)  # fmt: skip
def test_a_first_stage_that_is_lost_is_shortened_and_explained_by_no_other_meaning(
    true, known, start
):
    times, released = np.arange(0.0, 2.0, 0.01), np.pi - np.array(start) * [0.001, 0.002]
    theta = simulate(true, released, 0.0, times).theta
    for seed in (1, 3):
        noise = 0.015 * np.random.default_rng(seed).normal(size=theta.shape)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.filterwarnings("ignore", "standard errors are large|theta reaches")
            found = identify(times, theta + noise, chain=known, fit=["inertia", "lift"])
        scale = known.lift[0] / true.lift[0]
        errors = (found.values - scale * truth(found, true)) / found.standard_errors
        assert np.abs(errors).max() < 4.0
        assert found.held_out_rmse < 0.025


@pytest.mark.parametrize("n", [1, 2, 3])
def test_small_periods_are_those_of_the_normal_modes_within_their_errors(n):
    true = Chain.rods([0.5] * n, [0.4] * n)
    times = np.arange(0.0, 10.0, 0.02)
    theta = noisy(simulate(true, 0.5 + 0.3 * np.arange(n), 0.0, times).theta)
    known = Chain([0.5] * n, [0.4] * n, centres=[0.2] * n)
    found = identify(times, theta, chain=known, fit=["inertia", "lift"])
    periods = 2.0 * np.pi / theory.normal_modes(true)[0]
    assert np.abs((found.small_periods - periods) / found.small_period_errors).max() < 4.0
    assert np.all(found.small_period_errors < 2e-3 * periods)
    assert found.equivalent_lengths == pytest.approx(9.81 * (periods / 2.0 / np.pi) ** 2, rel=0.01)
    assert n > 1 or found.equivalent_lengths == pytest.approx([2.0 / 3.0 * 0.4], rel=1e-3)


def test_torques_tell_the_scale_and_free_swings_do_not():
    times, theta, piece = recorded(TRUE, 4, torque=[0.02, -0.01])
    driven = identify(times, theta, np.tile([0.02, -0.01], (times.size, 1)), piece=piece,
                      chain=Chain([0.2, 0.3], [0.2, 0.25]), fit=["inertia", "lift", "friction"],
                      held_out=0.0)  # fmt: skip
    assert driven.values[:4] == pytest.approx(truth(driven, TRUE)[:4], rel=0.02)
    assert not any(sentence.startswith("the scale") for sentence in driven.undetermined)
    assert math.isnan(driven.held_out_rmse)
    times, theta, piece = recorded(TRUE, 4)
    free = identify(times, theta, piece=piece, chain=Chain([0.2, 0.3], [0.2, 0.25]))
    scale = 0.2 * 0.5 / values_of(TRUE)[1, 0]
    assert free.values[:3] == pytest.approx(scale * truth(free, TRUE)[:3], rel=0.02)
    assert any(sentence.startswith("the scale: free swings") for sentence in free.undetermined)
    assert any(sentence.startswith("masses: ") for sentence in free.undetermined)
    assert any("lengths" in sentence for sentence in free.undetermined)


@pytest.mark.parametrize(
    ("kind", "every", "seconds", "size", "drive", "error"),
    [
        # a mean over several rows made the inertia 6 % too small
        ("linear", 0.01, 20.0, 6.0, 12.0, 1e-4),
        ("previous", 0.01, 20.0, 6.0, 12.0, 5e-3),
        ("linear", 0.05, 40.0, 2.0, 2.0, 2e-5),
        ("linear", 0.1, 40.0, 2.0, 2.0, 2e-5),
    ],
)
def test_torques_that_change_fast_or_between_far_rows_bias_no_value(
    kind, every, seconds, size, drive, error
):
    true, times = Chain([1.0], [0.8], inertias=[0.1], damping=0.05), np.arange(0.0, seconds, every)
    torque = size * np.sin(drive * times)[:, None]
    driven = simulate(true, 0.3, 0.0, times, torque=Signal(times, torque, kind))
    if kind == "previous":  # measured as a mean of two rows
        torque = 0.5 * (torque + np.vstack([torque[:1], torque[:-1]]))
    fit = ["inertia", "lift", "damping"]
    found = identify(times, driven.theta, torque, chain=Chain([1.0], [0.8]), fit=fit)
    assert found.values == pytest.approx(truth(found, true), rel=error)


def test_torques_of_a_fast_recording_count_beside_a_longer_slow_one():
    true, rows, columns = Chain([1.0], [0.8], damping=0.05), (401, 201), []
    for count, step, size, drive in ((401, 0.1, 0.2, 2.0), (201, 0.01, 20.0, 25.0)):
        times = step * np.arange(count)
        torque = size * np.sin(drive * times)[:, None]
        driven = simulate(true, 0.3, 0.0, times, torque=Signal(times, torque, "linear"))
        columns.append((times, driven.theta, torque))
    data = [np.concatenate(each) for each in zip(*columns, strict=True)]
    given = {"piece": np.repeat([0, 1], rows), "chain": Chain([1.0], [0.8]), "held_out": 0.0}
    found = identify(*data, fit=["inertia", "lift", "damping"], **given)
    assert found.values == pytest.approx(truth(found, true), rel=3e-3)


@pytest.mark.parametrize("n", [1, 2])
def test_a_chain_on_a_measured_cart_is_fitted_with_that_motion_given(n, tmp_path):
    """The cart is heavy or light: its mass, and the force on it, do not matter."""
    times, lengths = np.arange(0.0, 12.0, 0.01), [0.3, 0.25][:n]
    push = Signal(times, 2.0 * np.sin(4.0 * times), "linear")
    for mass in (0.5, 3.0):
        true = Chain([0.2, 0.1][:n], lengths, damping=[2e-4, 1e-4][:n], base=Cart(mass))
        moved = simulate(true, 0.3, 0.0, times, force=push)
        position = moved.position + 1e-4 * np.random.default_rng(1).normal(size=times.size)
        given = {"chain": Chain([0.2, 0.1][:n], lengths), "fit": ["inertia", "lift", "damping"]}
        found = identify(times, noisy(moved.theta), position=position, **given)
        hung = Chain(true.masses, true.lengths, damping=true.damping)
        assert np.abs(deviations(found, hung)).max() < 4.0
        assert np.all(found.standard_errors[:n] < 1e-3 * found.values[:n])
        assert found.held_out_rmse == pytest.approx(NOISE, rel=0.15)
        rmse = prediction_rmse(times, noisy(moved.theta), chain=hung, position=position)
        assert rmse == pytest.approx(NOISE, rel=0.15)
    rows = np.column_stack([times, moved.theta, position])
    names = ["time", *(f"theta{k}" for k in range(n)), "position"]
    np.savetxt(tmp_path / "cart.csv", rows, delimiter=",", header=",".join(names), comments="")
    read = read_motion(tmp_path / "cart.csv")
    expected = np.gradient(np.gradient(moved.position, times), times)[20:-20]
    assert read.position == pytest.approx(position)
    assert read.acceleration[20:-20] == pytest.approx(expected, abs=0.1 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("amplitude", "frequency", "interval", "noise"),
    [(0.01, 20.0, 0.002, 0.0), (0.01, 8.0, 0.004, 2e-4), (0.2, 0.5, 0.01, 1e-3)],
)
def test_a_pivot_may_move_faster_than_the_chain_swings(amplitude, frequency, interval, noise):
    times = np.arange(0.0, 8.0, interval)
    rate, swing = 2.0 * np.pi * frequency, 0.5 * np.cos(4.4 * times) * np.exp(-0.02 * times)
    drawn = np.random.default_rng(0).normal(size=times.size)
    places = amplitude * np.sin(rate * times) + noise * drawn
    found = with_position(check_motion(times, swing), places).acceleration
    expected = -(rate**2) * amplitude * np.sin(rate * times)
    assert np.std(found - expected) < (0.3 if noise else 1e-3) * np.std(expected)


def test_positions_of_another_number_are_refused():
    times = np.arange(40) / 40.0
    for position, message in ((np.zeros(3), "a number for each of the 40"), (np.nan, "be finite")):
        with pytest.raises(ValueError, match=f"position must .*{message}|position must {message}"):
            identify(times, np.sin(9.0 * times), chain=Chain(1.0, 1.0), position=position)


def test_a_swing_that_dies_out_long_before_the_end_is_fitted():
    true = Chain([1.0], [0.8], damping=0.8)
    times = np.arange(0.0, 30.0, 0.002)
    theta = noisy(simulate(true, 0.7, 0.0, times).theta)
    found = identify(times, theta, chain=true, fit=["inertia", "damping"])
    assert np.abs(deviations(found, true)).max() < 4.0
    assert np.all(found.standard_errors < 1e-3 * found.values)


def test_recordings_at_different_rates_are_all_fitted():
    fast, slow = np.arange(0.0, 3.0, 0.002), np.arange(0.0, 9.0, 0.05)
    theta = [simulate(TRUE, start, 0.0, t).theta for start, t in ((0.7, fast), (1.0, slow))]
    piece = np.repeat([4, 7], [fast.size, slow.size])
    found = identify(np.r_[fast, slow], np.vstack(theta), piece=piece, chain=TRUE, fit=["inertia"])
    assert {one["piece"] for one in found.segments} == {4, 7}
    assert np.all(np.isfinite(found.residuals))
    assert found.values == pytest.approx(truth(found, TRUE), rel=1e-4)


@pytest.mark.parametrize("centre", [-0.38 * 0.57 / 0.75, -0.28878])
def test_a_chain_with_a_balanced_link_may_swing_as_it_does(centre):
    """Rounding, or the last digit of a measured centre, leaves a lift of almost nothing."""
    chain = Chain([0.75, 0.57], [0.38, 0.4], centres=[centre, 0.2], inertias=[0.02, 0.001])
    times = np.arange(0.0, 6.0, 0.01)
    theta = simulate(chain, [0.5, 1.0], 0.0, times).theta
    assert prediction_rmse(times, theta, chain=chain) < 1e-4


def test_the_inertia_of_a_balanced_rod_sets_the_scale_of_its_free_turning():
    rod = Chain([1.0], [0.8], centres=[0.0], inertias=[0.1], damping=0.05)
    times = np.arange(0.0, 4.0, 0.01)
    theta = noisy(5.0 * 0.1 / 0.05 * -np.expm1(-0.05 / 0.1 * times))  # J omega' = -d omega
    known = Chain([1.0], [0.8], centres=[0.0], inertias=[0.1])
    found = identify(times, theta, chain=known, fit=["inertia", "lift", "damping"], segment=1.0)
    assert found.names == ("damping0",)
    assert abs(deviations(found, rod)[0]) < 4.0
    assert "inertia0 of the given chain was kept" in found.undetermined[0]
    assert identify(times, theta, np.ones(400), chain=known, segment=1.0).names[0] == "inertia0"


def test_the_lift_of_a_balanced_wheel_that_a_motor_drives_is_known_to_be_zero_but_for_noise():
    wheel = Chain([1.0], [0.3], centres=0.0, inertias=0.01, damping=0.003, friction=0.002)
    times = np.arange(0.0, 6.0, 0.02)
    torque = 0.02 * np.sin(2.0 * times)[:, None]
    theta = simulate(wheel, 0.0, 0.0, times, torque=Signal(times, torque, "linear")).theta
    theta = noisy(theta, 1e-5)
    known = Chain([1.0], [0.3], centres=0.01, inertias=0.01)
    found = identify(times, theta, torque, chain=known, held_out=0.0)
    lift = found.names.index("lift0")
    assert 1e-10 < found.standard_errors[lift] < 1e-6
    assert np.abs(deviations(found, wheel)).max() < 4.0
    assert not any(sentence.startswith("lift0") for sentence in found.undetermined)


def test_parameters_that_the_data_do_not_determine_have_no_standard_error():
    """Of one link they determine damping + drag length^2 alone."""
    chain = Chain([1.0], [0.3], damping=0.003, drag=0.02)
    times = np.arange(0.0, 6.0, 0.02)
    theta = noisy(simulate(chain, 1.0, 0.0, times).theta)
    found = identify(times, theta, chain=chain, fit=["inertia", "damping", "drag"], held_out=0.0)
    both = found.chain.damping + found.chain.drag * 0.3**2
    assert both == pytest.approx(0.003 + 0.02 * 0.3**2, rel=0.01)
    errors = found.chain_errors
    assert {name for name in errors if np.isnan(errors[name]).any()} == {"damping", "drag"}
    assert 0.0 < errors["inertias"][0] < 1e-3
    assert found.as_dict()["chain_standard_errors"]["drag"] == [None]


def test_a_chain_that_cannot_be_simulated_has_an_infinite_error(monkeypatch):
    times, theta, piece = recorded(TRUE, 4)
    monkeypatch.setattr(Stages, "judge", lambda *_: None)
    found = identify(times, theta, piece=piece, chain=KNOWN, fit=["inertia"])
    assert found.given_rmse == found.held_out_rmse == math.inf
    assert math.isfinite(found.fitted_rmse)
    plain = json.loads(json.dumps(found.as_dict(), allow_nan=False))
    assert plain["given_rmse"] is plain["held_out_rmse"] is None
    lost = [one for one in found.segments if one["held_out"]]
    assert [(one["rmse"], one["given_rmse"]) for one in lost] == [(math.inf, math.inf)]
    with pytest.warns(UserWarning, match="held_out leaves out nothing: there is one segment"):
        alone = identify(times[:90], theta[:90], chain=TRUE, fit=["inertia"])
    assert math.isnan(alone.given_rmse)


def test_numpy_scalars_and_iterators_are_arguments_and_ready_for_json():
    times, theta, piece = recorded(TRUE, 4)
    given = {"piece": piece, "chain": KNOWN, "fit": iter(["inertia"]), "segment": np.int64(1)}
    found = identify(times, theta, **given)
    arguments = json.loads(json.dumps(found.as_dict()))["provenance"]["arguments"]
    assert (arguments["fit"], arguments["segment"]) == (["inertia"], 1.0)


def test_the_armature_of_a_geared_motor_and_the_zero_of_encoders_are_found():
    motor = Chain([0.1, 0.15], [0.2, 0.25], centres=[0.1, 0.12], inertias=[4e-4, 1e-3],
                  armature=[0.0, 2e-3], gear=[6.0, -6.0])  # fmt: skip
    times, theta, piece = recorded(motor, 4)
    known = Chain([0.1, 0.15], [0.2, 0.25], centres=[0.1, 0.12], gear=[6.0, -6.0])
    result = identify(times, theta + np.array([0.02, -0.01]), piece=piece, chain=known,
                      fit=["inertia", "lift", "armature", "offset"])  # fmt: skip
    assert np.abs(deviations(result, motor)[:4]).max() < 4.0
    assert result.chain.armature[1] == pytest.approx(2e-3, rel=0.05)
    assert result.offsets == pytest.approx([0.02, -0.01], abs=5e-4)


def test_offsets_alone_are_found_where_everything_else_is_known():
    times, theta, piece = recorded(TRUE, 2)
    result = identify(
        times, theta + np.array([0.02, -0.01]), piece=piece, chain=TRUE, fit=["offset"]
    )
    assert result.names == ("offset0", "offset1")
    assert result.offsets == pytest.approx([0.02, -0.01], abs=5e-4)


ONE = {"masses": [0.1], "lengths": [0.2], "centres": [0.15], "inertias": [3e-4]}
TWO = {"masses": [0.1, 0.15], "lengths": [0.2, 0.25]}
BODIES = TWO | {"centres": [0.1, 0.12]}
WHOLE = ["inertia", "lift", "damping", "gravity"]


@pytest.mark.parametrize("gravity", [9.79, 1.62])
@pytest.mark.parametrize(
    ("true", "known", "fit"),
    [
        (ONE | {"damping": 1e-4}, ONE, ["damping", "gravity"]),
        (BODIES | {"inertias": [4e-4, 1e-3], "damping": 1e-4}, BODIES, WHOLE),
        (TWO | {"drag": 2e-3, "damping": 1e-4}, TWO | {"drag": 2e-3}, WHOLE),
        (TWO | {"armature": [0.0, 2e-3], "gear": [6.0, -6.0]}, TWO | {"gear": [6.0, -6.0]},
         ["inertia", "lift", "armature", "gravity"]),
    ],
)  # fmt: skip
def test_gravity_of_another_planet_is_found_from_that_of_the_earth(true, known, fit, gravity):
    true, slower = Chain(**true, gravity=gravity), math.sqrt(9.81 / gravity)
    times, theta, piece = recorded(true, 4, seconds=1.5 * slower)
    result = identify(times, theta, piece=piece, chain=Chain(**known), fit=fit)
    assert np.abs(deviations(result, true)).max() < 4.0
    assert result.names[-1] == "gravity"
    assert result.chain.gravity == pytest.approx(gravity, rel=0.01)
    assert result.chain_errors["gravity"] == result.standard_errors[-1] < 0.003 * gravity
    small = 2.0 * np.pi / theory.normal_modes(true)[0]
    assert result.small_periods == pytest.approx(small, rel=2e-3)


@pytest.mark.parametrize("n", [1, 2])
def test_gravity_is_found_beside_all_others_where_torques_act_or_the_pivot_moves(n):
    """Of one link torques leave the product with its lift open, a moving pivot nothing."""
    times = np.arange(0.0, 12.0, 0.01)
    given = {"masses": [0.2, 0.1][:n], "lengths": [0.3, 0.25][:n]}
    push = Signal(times, 2.0 * np.sin(4.0 * times), "linear")
    moved = simulate(Chain(**given, gravity=3.7, base=Cart(3.0)), 0.3, 0.0, times, force=push)
    torque = np.zeros((times.size, n))
    torque[:, 0] = 0.05 * np.sin(3.0 * times)
    driven = simulate(
        Chain(**given, gravity=3.7), 0.3, 0.0, times, torque=Signal(times, torque, "linear")
    )
    known = Chain(given["masses"], given["lengths"], inertias=1e-3 * np.ones(n))
    for motion, more, fit in (
        (moved, {"position": moved.position}, ["inertia", "lift", "gravity"]),
        (driven, {"torque": torque}, ["inertia", *["lift"] * (n > 1), "gravity"]),
    ):
        found = identify(times, noisy(motion.theta), chain=known, fit=fit, **more)
        assert np.abs(deviations(found, Chain(**given, gravity=3.7))).max() < 4.0
        assert found.standard_errors[-1] < 0.02


def test_gravity_that_a_recorded_pendulum_shows_is_that_of_the_earth():
    """Within the error of its published lengths: 0.5 mm of 17.3 cm are 0.3 %."""
    motion = read_motion(DATA / "multiarm_double.csv")
    chain = Chain.from_dict(Chain.multiarm(2).as_dict() | {"gravity": 5.0})
    fit = ["inertia", "lift", "damping", "friction", "quadratic_drag", "gravity"]
    result = identify(motion.times, motion.theta, piece=motion.piece, chain=chain, fit=fit)
    assert result.chain.gravity == pytest.approx(9.81, abs=0.05)
    assert result.held_out_rmse < 1.2e-3
    assert any(one.startswith("gravity: its standard error") for one in result.undetermined)


@pytest.mark.parametrize(
    ("known", "fit", "given", "message"),
    [
        (ONE, ["inertia", "gravity"], {}, '"gravity" beside "inertia".*only their ratio'),
        (ONE, ["armature", "gravity"], {}, '"gravity" beside "armature"'),
        (ONE, ["lift", "gravity"], {"torque": np.ones(40)}, '"lift".*only their product'),
        (TWO, ["length", "lift", "gravity"], {}, '"gravity" beside "length".*move the pivot'),
        (ONE | {"gravity": 0.0}, ["gravity"], {}, "gravity of the chain must be above 0"),
    ],
)
def test_gravity_beside_what_cannot_be_distinguished_from_it_is_refused(known, fit, given, message):
    times, chain = np.arange(40) / 40.0, Chain(**known)
    theta = np.sin(9.0 * times)[:, None] * np.ones(chain.n)
    with pytest.raises(ValueError, match=message):
        identify(times, theta, chain=chain, fit=fit, **given)


def test_the_measured_double_pendulum_is_predicted_better_than_with_its_published_parameters():
    motion = read_motion(DATA / "multiarm_double.csv")
    result = identify(motion.times, motion.theta, piece=motion.piece, chain="multiarm 2")
    assert result.held_out_rmse < 1.6e-3
    assert result.given_rmse > 1.5 * result.held_out_rmse
    assert max(one["end"] - one["start"] for one in result.segments) > 2.6
    assert result.held_out_rmse == pytest.approx(
        math.sqrt(np.mean(result.residuals[result.held_out] ** 2))
    )
    held = result.held_out
    unseen = {"times": motion.times[held], "theta": motion.theta[held], "piece": motion.piece[held]}
    for chain, error in ((result.chain, result.held_out_rmse), ("multiarm 2", result.given_rmse)):
        assert prediction_rmse(**unseen, chain=chain) == pytest.approx(error, rel=1e-3)
    plain = json.loads(json.dumps(result.as_dict(), allow_nan=False))
    assert Chain.from_dict(plain["chain"]) == result.chain
    assert plain["provenance"]["arguments"]["chain"] == Chain.multiarm(2).as_dict()


# some chains hardly move, others turn over again and again: both are warned of
@pytest.mark.nightly
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_inertias_lengths_and_damping_of_three_links_lie_within_three_standard_errors():
    """Of 10 recordings of 5 s at 50 Hz with 0.01 rad of noise; the torques, which are known, tell
    the scale of masses. Masses of bobs are lift0^2 / inertia0 and so on, lift0 / m the length.
    """
    true = Chain([0.4, 0.3, 0.2], [0.5, 0.4, 0.3], damping=[0.02, 0.01, 0.005])
    times, torque, close = np.arange(0.0, 5.0, 0.02), [0.5, -0.2, 0.1], 0
    for seed in range(10):
        rng = np.random.default_rng(seed)
        known = Chain(
            true.masses * rng.uniform(0.8, 1.25, 3), true.lengths * rng.uniform(0.9, 1.1, 3)
        )
        theta = simulate(true, rng.uniform(-1.5, 1.5, 3), 0.0, times, torque=torque).theta
        theta += 0.01 * rng.normal(size=theta.shape)
        result = identify(times, theta, np.tile(torque, (times.size, 1)), chain=known,
                          fit=["inertia", "lift", "damping", "length"], held_out=0.0)  # fmt: skip
        assert result.values.size == 11
        assert np.all(result.standard_errors[result.values > 0.0] > 0.0)
        errors = result.standard_errors[:6] / result.values[:6]
        assert errors.max() < 0.05  # they say something
        close += np.abs(deviations(result, true)).max() < 3.0
    assert close >= 9


@pytest.mark.filterwarnings("ignore:standard errors are large")
def test_the_measured_driven_pendulum_is_predicted_better_than_with_its_published_parameters():
    motion = read_motion(DATA / "realaigym_c1.csv")
    result = identify(motion.times, motion.theta, motion.torque, chain="realaigym C.1", segment=1.0)
    assert result.held_out_rmse < 0.04
    assert result.held_out_rmse < 0.8 * result.given_rmse
    armature = result.values[result.names.index("armature1")]
    assert armature == pytest.approx(Chain.realaigym("C.1").armature[1], rel=0.3)


def test_simulated_segments_and_their_derivatives_are_those_of_an_adaptive_integrator():
    times = np.sort(np.random.default_rng(0).uniform(0.0, 0.6, 40))
    torque = np.array([0.02, -0.03])
    motion = check_motion(times, np.zeros((40, 2)), np.tile(torque, (40, 1)))
    fit = ["inertia", "lift", "damping", "quadratic_drag", "gravity"]
    model = new_model(TRUE, fit, driven=True)
    shooting = Shooting(model, motion, [slice(0, 40)], 0.0005, 0.0)
    fitted, states = model.pack(values_of(TRUE)), np.array([[0.8, -0.3, 1.0, 2.0]])

    def angles(fitted, state):
        chain = model.chain_of(model.unpack(fitted))
        return simulate(chain, state[:2], state[2:], times, torque=torque).theta.ravel()

    simulated = shooting.simulate(fitted, states)
    by_fitted, by_state = simulated.linearise()
    assert simulated.residuals[0] == pytest.approx(angles(fitted, states[0]), abs=1e-6)
    steps = 2e-4 * np.append(model.scale(values_of(TRUE)), np.ones(4))
    both = np.append(fitted, states)
    slopes = np.concatenate([by_fitted, by_state], axis=2)[0]
    for k, step in enumerate(steps):
        above, below = (both + sign * step * np.eye(both.size)[k] for sign in (1.0, -1.0))
        change = angles(above[:-4], above[-4:]) - angles(below[:-4], below[-4:])
        assert slopes[:, k] * step == pytest.approx(0.5 * change, rel=1e-3, abs=1e-3 * step)


def test_a_trial_chain_that_is_far_stiffer_than_the_given_one_is_refused():
    motion = check_motion(np.linspace(0.0, 0.2, 40), np.zeros((40, 2)))
    model = new_model(TRUE, ["friction"], driven=False)
    shooting = Shooting(model, motion, [slice(0, 40)], 0.01, 0.0)
    states = np.array([[0.8, -0.3, 1.0, 2.0]])
    assert shooting.simulate(np.full(2, 0.1), states) is not None
    assert shooting.simulate(np.full(2, 1e3), states) is None


def test_chains_of_equal_values_move_alike_whatever_their_masses():
    rng = np.random.default_rng(2)
    for _ in range(20):
        n = int(rng.integers(1, 5))
        real = Chain.rods(rng.uniform(0.1, 1.0, n), rng.uniform(0.2, 1.0, n))
        given = Chain(rng.uniform(0.01, 10.0, n), real.lengths)
        model = new_model(given, ["inertia"], driven=True)
        same = model.chain_of(values_of(real))
        assert np.all(same.inertias >= 0.0)
        state = rng.uniform(-3.0, 3.0, (2, n))
        assert accelerations(same, *state) == pytest.approx(
            accelerations(real, *state), rel=1e-9, abs=1e-8
        )


def test_masses_are_kept_where_they_are_possible_and_refused_where_none_is():
    rods = Chain.rods([0.5, 0.4], [0.3, 0.2])
    assert possible_masses(rods, values_of(rods)) == pytest.approx(rods.masses)
    long = Chain(rods.masses, 3.0 * rods.lengths)
    values = values_of(rods)
    values[QUANTITIES.index("length")] = long.lengths
    assert possible_masses(long, values) is None
    with pytest.raises(ValueError, match="lengths that fit the motion"):
        new_model(long, ["inertia"], driven=True).chain_of(values)


def test_the_solver_finds_what_scipys_least_squares_finds():
    rng = np.random.default_rng(3)
    x = np.linspace(0.0, 3.0, 30)
    own = np.array([[1.0], [2.0], [-1.5]])  # an amplitude for each segment, two common unknowns
    y = own * np.exp(-0.7 * x) + 0.3 * x + 0.01 * rng.normal(size=(3, 30))
    y[1, 4] += 3.0

    def residuals(p, s):
        return s * np.exp(-p[0] * x) + p[1] * x - y

    def evaluate(p, s):
        decay = np.exp(-p[0] * x)
        common = np.stack([-x * s * decay, np.tile(x, (3, 1))], axis=-1)
        slopes = common, np.tile(decay[:, None], (3, 1, 1))
        return SimpleNamespace(residuals=residuals(p, s), linearise=lambda: slopes)

    start = np.array([0.3, 0.0]), np.ones((3, 1))
    found = solve(evaluate, start, np.ones((3, 30)), np.full(2, -np.inf))
    c = 3.0 * 1.4826 * np.median(np.abs(found.residuals))
    expected = least_squares(
        lambda v: residuals(v[:2], v[2:, None]).ravel(), np.ones(5), loss="soft_l1", f_scale=c,
        xtol=1e-12, ftol=1e-12, gtol=1e-12,
    )  # fmt: skip
    assert np.append(found.fitted, found.states) == pytest.approx(expected.x, rel=1e-4)
    bounded = solve(evaluate, start, np.ones((3, 30)), np.array([0.75, 0.0]))
    assert bounded.fitted[0] == 0.75


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"times": "abc"}, "times must"),
        ({"times": math.nan}, "times must be finite, got nan in row 0"),
        ({"theta": np.zeros((39, 2))}, r"theta must have a row for each of the 40 instants"),
        ({"theta": np.full((40, 2), np.nan)}, r"theta must be finite.*gaps are allowed"),
        ({"theta": np.zeros((40, 2))}, "theta must move"),
        ({"theta": np.ma.masked_less(np.ones((40, 2)), 2.0)}, "theta must have no masked entries"),
        ({"torque": np.zeros((40, 3))}, r"torque must have the shape \(40, 2\)"),
        ({"piece": np.zeros(3)}, "piece must be 40 integers"),
        ({"piece": np.full(40, 2.0**60)}, r"piece must be 40 integers below 2\^53"),
        ({"segment": 0.4}, r"segment must be at least 0.5 s, the time of 20 rows, got 0.4"),
        ({"piece": np.arange(40) % 2}, "piece must number recordings whose rows stand together"),
        ({"chain": "nosuch"}, "chain must be an npend_gym.Chain"),
        ({"fit": []}, "fit must name something"),
        ({"fit": "damping"}, r'fit must be a list such as \["damping"\], got .damping.$'),
        ({"fit": 3}, "fit must be a list such as"),
    ],
)
def test_bad_arguments_are_refused_with_their_name_and_rule(changes, message):
    times = np.arange(40) / 40.0
    good = {"times": times, "theta": np.sin(9.0 * times)[:, None] * [1.0, 2.0], "chain": KNOWN}
    with pytest.raises((ValueError, TypeError), match=message):
        identify(**good | changes)
