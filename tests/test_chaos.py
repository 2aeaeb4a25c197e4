"""Chaos: exponents, MEGNO, sections and periodic orbits, each against an independent truth."""

import json

import numpy as np
import oracle
import pytest
from interrupt import Interrupt
from scipy.integrate import simpson

from npend_gym import Chain, Event, Signal, chaos, pseudo_periods, simulate
from npend_gym.chaos.variations import record
from npend_gym.experiments import FlipMap
from npend_gym.physics import linearise


def test_exponents_without_damping_come_in_pairs_and_add_up_to_zero_at_any_time(uneven):
    found = chaos.lyapunov_spectrum(uneven, 2.0, [0.3, -1.0, 0.5, 0.0][: uneven.n], duration=8.0)
    assert found.exponents[0] > 0.3
    assert np.abs(found.history.sum(axis=1)).max() < 1e-6
    assert np.abs(found.exponents + found.exponents[::-1]).max() < 1e-3
    assert found.times[-1] == 8.0
    np.testing.assert_array_equal(np.sort(found.history[-1])[::-1], found.exponents)


@pytest.mark.parametrize("damping", [0.05, 30.0])
def test_exponents_of_a_damped_chain_add_up_to_the_mean_divergence_of_its_flow(damping):
    chain, duration = Chain([1.0, 0.5], [1.0, 0.7], damping=[damping, 0.5 * damping]), 4.0
    found = chaos.lyapunov_spectrum(chain, 2.0, 0.0, duration=duration)
    path = simulate(chain, 2.0, 0.0, np.linspace(0.0, duration, 4001), rtol=1e-12, atol=1e-14)
    above, below = chain.damping
    torques = np.array([[above + below, -below], [-below, below]])  # D of the torques -D omega
    divergence = [
        -np.trace(np.linalg.solve(oracle.mass_matrix(chain.masses, chain.lengths, theta), torques))
        for theta in path.theta
    ]
    mean = simpson(divergence, x=path.times) / duration
    assert found.exponents.sum() == pytest.approx(mean, abs=1e-6)


def test_exponents_upright_and_hanging_are_the_growth_rates_of_the_linear_equations():
    chain = Chain.uniform(2)
    found = chaos.lyapunov_spectrum(chain, np.pi, 0.0, duration=4.0, samples=2)
    rates = np.sort(np.linalg.eigvals(linearise(chain, np.pi).A).real)[::-1]
    sums = found.history * found.times[:, None]
    late = (sums[1] - sums[0]) / np.diff(found.times)  # after the vectors have turned
    np.testing.assert_allclose(late, rates, atol=1e-3)
    damped = Chain.uniform(1, damping=10.0)  # x'' + 10 x' + 9.81 x = 0
    slow, fast = np.sort(np.roots([1.0, 10.0, 9.81]))[::-1]
    hanging = chaos.lyapunov_spectrum(damped, 0.0, 0.0, duration=200.0).exponents
    np.testing.assert_allclose(hanging, [slow, fast], atol=0.01)


def test_instants_of_a_history_increase_however_many_are_wanted():
    chain = Chain.uniform(2)
    few, many = (
        chaos.lyapunov_spectrum(chain, 2.0, duration=5.0, samples=n, count=2) for n in (3, 900)
    )
    assert few.times.size == 3
    assert np.all(np.diff(many.times) > 0.0)
    assert many.times[-1] == 5.0
    np.testing.assert_array_equal(many.exponents, few.exponents)
    np.testing.assert_array_equal(many.history[np.isin(many.times, few.times)], few.history)


def test_a_signal_of_the_duration_is_long_enough_and_stands_in_the_record():
    chain, times = Chain.uniform(2), np.linspace(0.0, 40.0, 401)
    swayed = np.column_stack([np.sin(3.0 * times), 0.0 * times])
    short = Signal(times, swayed, "linear")
    longer = Signal(np.append(times, 41.0), np.vstack([swayed, swayed[-1:]]), "linear")
    found, other = (
        chaos.megno(chain, 0.5, duration=40.0, pivot_acceleration=each) for each in (short, longer)
    )
    assert found.times[-1] == 40.0
    assert found.value == other.value
    assert found.provenance["arguments"]["pivot_acceleration"] == "401 samples, linear"
    for measure in (chaos.megno, chaos.lyapunov_spectrum, chaos.poincare_section):
        made = measure(chain, 0.5, duration=20.0, pivot_acceleration=np.array([1, 0])).provenance
        assert json.loads(json.dumps(made))["arguments"]["pivot_acceleration"] == [1.0, 0.0]
    by_function = record(chain, np.zeros(4), pivot_acceleration=np.sin)["arguments"]
    assert by_function["pivot_acceleration"] == "function sin"
    assert "pivot_acceleration" not in record(chain, np.zeros(4))["arguments"]


def test_numpy_scalars_are_arguments_and_ready_for_json():
    chain, rtol = Chain.uniform(2), np.float32(1e-9)
    whole = {"count": np.int64(2), "samples": np.int64(5)}
    made = [
        chaos.lyapunov_spectrum(chain, 0.5, duration=np.int64(2), **whole, rtol=rtol),
        chaos.megno(chain, 0.5, duration=np.int64(20), rtol=rtol),
        chaos.poincare_section(chain, 0.5, duration=np.int64(9), direction=np.int64(1), rtol=rtol),
    ]
    written = [json.loads(json.dumps(each.provenance))["arguments"] for each in made]
    assert (written[0]["count"], written[0]["samples"], written[2]["direction"]) == (2, 5, 1)
    plain = {"width": 1.0, "duration": 2.0, "gravity": 9.0, "rtol": 2.0**-30}
    plan = FlipMap(size=np.int64(6), **{k: np.float32(v) for k, v in plain.items()})
    assert json.loads(json.dumps(plan.as_dict())).items() >= (plain | {"size": 6}).items()


def test_some_of_the_exponents_are_the_first_of_all():
    chain = Chain.uniform(3)
    some = chaos.lyapunov_spectrum(chain, 2.0, duration=3.0, count=2)
    whole = chaos.lyapunov_spectrum(chain, 2.0, duration=3.0)
    np.testing.assert_allclose(some.history, whole.history[:, :2], rtol=1e-7)
    assert some.provenance["arguments"]["count"] == 2


def test_the_largest_exponent_of_a_pendulum_upright_is_the_root_of_g_over_l():
    chain = Chain.uniform(1, length=0.5)
    found = chaos.largest_lyapunov(chain, np.pi, duration=8.0)
    assert found.exponent == pytest.approx(np.sqrt(9.81 / 0.5), rel=1e-5)
    assert found.chaotic


def test_order_has_no_exponent_and_a_megno_of_two_at_most():
    chain = Chain.uniform(1)
    found = chaos.largest_lyapunov(chain, 2.0, duration=500.0)
    assert not found.chaotic
    assert abs(found.exponent) < 3.0 * found.error < 0.03
    early, late = (chaos.megno(chain, 2.0, duration=t).value for t in (200.0, 2000.0))
    assert early < late < 2.0  # neighbours of a pendulum part linearly
    assert late == pytest.approx(2.0, abs=0.08)


def test_the_largest_exponent_its_error_and_megno_agree_in_chaos():
    chain = Chain.uniform(2)
    found = chaos.largest_lyapunov(chain, 2.0, duration=150.0)
    assert found.chaotic
    again = chaos.megno(chain, 2.0, duration=150.0)
    assert again.value > 50.0
    assert again.exponent == pytest.approx(found.exponent, abs=4.0 * found.error)


@pytest.mark.long
def test_the_error_of_the_largest_exponent_is_its_scatter():
    chain = Chain.uniform(2)
    runs = [chaos.largest_lyapunov(chain, [2.0, 2.0 + 1e-4 * k], duration=500.0) for k in range(12)]
    scatter = np.std([run.exponent for run in runs], ddof=1)
    assert 0.4 * scatter < np.mean([run.error for run in runs]) < 3.0 * scatter


@pytest.mark.long
@pytest.mark.parametrize("measure", [chaos.lyapunov_spectrum, chaos.megno, chaos.poincare_section])
def test_ctrl_c_ends_a_long_run_at_once(measure):
    chain = Chain.uniform(300)
    measure(Chain.uniform(2), 1.0, duration=20.0)  # compiled
    with pytest.raises(KeyboardInterrupt), Interrupt():
        measure(chain, 1.0, duration=1e4)


def test_progress_sees_every_part_of_the_motion_and_may_stop_it():
    seen = []

    def count(parts):
        for part in parts:
            seen.append(part)
            yield part

    chaos.megno(Chain.uniform(1), 1.0, duration=20.0, progress=count)
    assert len(seen) == 100
    seen.clear()
    chaos.lyapunov_spectrum(Chain.uniform(1), 1.0, duration=2.0, samples=7, progress=count)
    assert len(seen) == 7


@pytest.mark.parametrize(
    ("call", "error", "text"),
    [
        (lambda c: chaos.lyapunov_spectrum(c, 1.0, duration=1.0, count=5), ValueError,
         "count must be between 1 and 4, got 5"),
        (lambda c: chaos.lyapunov_spectrum(c, 1.0, duration=0.0), ValueError,
         "duration must be greater than zero, got 0.0"),
        (lambda c: chaos.lyapunov_spectrum(c, 1.0, duration=1.0, samples=0), ValueError, "samples"),
        (lambda _: chaos.lyapunov_spectrum(Chain.uniform(501), 1.0, duration=1.0), ValueError,
         "n must be between 1 and 500"),
        (lambda c: chaos.largest_lyapunov(c, 1.0, duration=-1.0), ValueError, "duration"),
        (lambda c: chaos.largest_lyapunov(c, 1.0, duration=0.1), ValueError,
         "duration must be at least"),
        (lambda c: chaos.largest_lyapunov(c, 1.0, duration=1e20), ValueError,
         "duration must be at most"),
        (lambda c: chaos.megno(c, [1.0, np.nan], duration=1.0), ValueError, "theta must be finite"),
        (lambda c: chaos.megno(c, [1.0] * 3, duration=1.0), ValueError, "theta must be one number"),
        (lambda c: chaos.tangent_growth(c, 2.0, duration=0.001), ValueError,
         "duration must be at least 0.03"),
        (lambda _: chaos.megno(2, 1.0, duration=1.0), TypeError, "chain"),
    ],
)  # fmt: skip
def test_bad_input_is_refused_by_name(call, error, text):
    with pytest.raises(error, match=text):
        call(Chain.uniform(2))


@pytest.mark.long
def test_tangent_vectors_are_differences_of_neighbours():
    chain, start = Chain([1.0, 2.0], [1.0, 0.5]), np.array([1.5, -1.0, 0.5, 0.3])
    times = np.linspace(0.0, 1.0, 11)

    def motion(state):
        path = simulate(chain, state[:2], state[2:], times, rtol=1e-13, atol=1e-14)
        return np.concatenate([path.theta, path.omega], axis=1)

    vectors, found = np.eye(4), np.empty((11, 4, 4))
    for span, frames in chaos.tangents(chain, start[:2], start[2:], times, vectors, rtol=1e-13):
        found[span] = frames
    step = 1e-6
    for vector, e in enumerate(np.eye(4)):
        expected = (motion(start + step * e) - motion(start - step * e)) / (2 * step)
        error = np.abs(found[1:, vector] - expected[1:]).max()
        assert error <= 1e-8 * np.abs(expected).max()
    np.testing.assert_array_equal(vectors, found[-1])


def test_tangent_vectors_of_another_chain_are_refused():
    with pytest.raises(ValueError, match=r"vectors must be float64 of shape \(D, 4\), got"):
        chaos.tangents(Chain.uniform(2), 1.0, 0.0, [0.0, 1.0], np.eye(2))
    wild = Chain.uniform(5), 2.0, 0.0, [0.0, 500.0]
    with pytest.raises(FloatingPointError, match="beyond all bounds until t = "):
        list(chaos.tangents(*wild, np.eye(1, 10), steps=100_000))


def test_the_flow_keeps_volume_and_friction_does_not(uneven):
    assert abs(chaos.volume_change(uneven)) < 1e-7
    damped = Chain(uneven.masses, uneven.lengths, damping=0.5)
    assert chaos.volume_change(damped) < -0.5


def test_a_pivot_that_is_accelerated_is_another_gravity():
    # A. Einstein, Annalen der Physik 35 (1911), 898-908: in a frame so accelerated both are alike
    by_gravity, by_pivot = Chain.uniform(2, gravity=200.0), Chain.uniform(2, gravity=10.0)
    moved = {"pivot_acceleration": [0.0, 190.0]}
    assert chaos.megno(by_pivot, 0.0, duration=40.0, **moved).value < 0.1
    expected = chaos.lyapunov_spectrum(by_gravity, 0.0, duration=5.0).exponents
    found = chaos.lyapunov_spectrum(by_pivot, 0.0, duration=5.0, **moved).exponents
    np.testing.assert_allclose(found[[0, 1, -2, -1]], expected, atol=1e-4)
    free = Chain.uniform(2, gravity=0.0)
    times = pseudo_periods(free, 0.5, pivot_acceleration=[0.0, 9.81])
    np.testing.assert_allclose(
        times, pseudo_periods(Chain.uniform(2, gravity=9.81), 0.5), rtol=1e-9
    )
    slow = pseudo_periods(Chain.uniform(2), 0.5, pivot_acceleration=[0.0, -9.80])
    assert np.isfinite(slow).all()


def test_links_whose_weight_is_above_their_joint_flip_with_little_energy():
    chain = Chain([1.0, 1.0], [1.0, 1.0], centres=[1.0, -0.5], inertias=0.01)
    (found,) = chaos.flip_times(chain, [[0.0, 0.3]], duration=10.0)
    events = [Event("flip", rod=rod, terminal=True) for rod in (0, 1)]
    assert found == pytest.approx(
        simulate(chain, [0.0, 0.3], 0.0, [0.0, 10.0], events=events).times[-1]
    )


@pytest.mark.parametrize("bad", [[0.0, np.nan], ["a", "b"], [0.0, [1.0]], [1.0, 2.0, 3.0]])
def test_a_bad_acceleration_of_the_pivot_is_refused_by_its_name(bad):
    chain = Chain.uniform(2)
    for measure in (
        lambda: pseudo_periods(chain, 0.5, pivot_acceleration=bad),
        lambda: chaos.megno(chain, 1.0, duration=30.0, pivot_acceleration=bad),
        lambda: chaos.lyapunov_spectrum(chain, 1.0, duration=1.0, pivot_acceleration=bad),
    ):
        with pytest.raises((ValueError, TypeError), match="pivot_acceleration must"):
            measure()
