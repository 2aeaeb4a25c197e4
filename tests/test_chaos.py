"""Chaos: exponents, MEGNO, sections and periodic orbits, each against an independent truth."""

import json

import numpy as np
import oracle
import pytest
from scipy.integrate import simpson, solve_ivp

from npend_gym import Cart, Chain, Event, Signal, chaos, pseudo_periods, simulate, theory
from npend_gym.chaos import ContinuationError, periodic_orbits
from npend_gym.chaos.variations import record
from npend_gym.experiments import FlipMap
from npend_gym.physics import linearise


@pytest.mark.long
def test_exponents_without_damping_come_in_pairs_and_add_up_to_zero_at_any_time(uneven):
    found = chaos.lyapunov_spectrum(uneven, 2.0, [0.3, -1.0, 0.5, 0.0][: uneven.n], duration=8.0)
    assert found.exponents[0] > 0.3
    assert np.abs(found.history.sum(axis=1)).max() < 1e-6
    assert np.abs(found.exponents + found.exponents[::-1]).max() < 1e-3
    assert found.times[-1] == 8.0
    np.testing.assert_array_equal(np.sort(found.history[-1])[::-1], found.exponents)


DAMPED = {"duration": 100.0}, {"atol": np.log(100.0) / 100.0}
DRY = {"duration": 20.0}, {"rtol": 0.1, "atol": 0.2}


@pytest.mark.parametrize(
    ("chain", "start", "options", "tolerance"),
    [
        (Chain.uniform(2, damping=0.3), 0.0, *DAMPED),
        (Chain.uniform(2, damping=0.3), 0.3, *DAMPED),
        (Chain.uniform(3, damping=0.5), 0.5, *DAMPED),
        pytest.param(Chain([1.0], [0.3], friction=1.0), 0.0, *DRY, marks=pytest.mark.long),
        pytest.param(
            Chain.realaigym("C.1"), 0.0, *DRY, marks=[pytest.mark.long, pytest.mark.nightly]
        ),
    ],
)
def test_exponents_of_a_chain_that_comes_to_rest_are_its_decay_rates(
    chain, start, options, tolerance
):
    rates = np.sort(np.linalg.eigvals(linearise(chain, 0.0).A).real)[::-1]
    found = chaos.lyapunov_spectrum(chain, start, **options).exponents
    np.testing.assert_allclose(found, rates, **tolerance)
    if start == 0.0:
        assert found.sum() == pytest.approx(rates.sum(), rel=1e-6)


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


@pytest.mark.long
@pytest.mark.parametrize("kind", ["cart", "springs"])
def test_no_exponent_depends_on_the_unit_of_length(kind):
    found = []
    for length in (1.0, 0.01):
        time = length**0.5
        parts = {"base": Cart(2.0)} if kind == "cart" else {"stiffness": 200.0 / length}
        chain = Chain([1.0, 1.0], [length, length], **parts)
        spectrum = chaos.lyapunov_spectrum(chain, [0.6, 0.4], duration=10.0 * time)
        found.append(spectrum.exponents * time)
    np.testing.assert_allclose(*found, atol=1e-6)


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


@pytest.mark.long
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


def test_tangent_vectors_that_grow_beyond_all_bounds_are_an_error():
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


@pytest.mark.long
def test_links_whose_weight_is_above_their_joint_flip_with_little_energy():
    chain = Chain([1.0, 1.0], [1.0, 1.0], centres=[1.0, -0.5], inertias=0.01)
    (found,) = chaos.flip_times(chain, [[0.0, 0.3]], duration=10.0)
    events = [Event("flip", rod=rod, terminal=True) for rod in (0, 1)]
    assert found == pytest.approx(
        simulate(chain, [0.0, 0.3], 0.0, [0.0, 10.0], events=events).times[-1]
    )


# -- periodic orbits: they close, and grow out of the normal modes with the multipliers of these ---


def test_orbits_of_a_pendulum_have_the_period_of_the_elliptic_integral():
    amplitudes = [0.1, 1.0, 3.0]
    for orbit, angle in zip(
        periodic_orbits(Chain.uniform(1, length=0.7), 0, amplitudes=amplitudes),
        amplitudes,
        strict=True,
    ):
        exact = theory.pendulum_period(angle, 0.7)
        assert orbit.period == pytest.approx(exact, rel=1e-11)
        assert orbit.amplitude == pytest.approx(angle, rel=1e-12)
        assert orbit.energy == pytest.approx(9.81 * 0.7 * (1.0 - np.cos(angle)), rel=1e-12)
        assert orbit.multipliers.size == 0
        assert orbit.stable


@pytest.mark.parametrize("mode", [0, 1, 2])
def test_small_orbits_are_the_normal_modes_and_have_their_multipliers(mode):
    chain = Chain([1.0, 0.5, 2.0], [1.0, 0.7, 0.4])
    frequencies, shapes = theory.normal_modes(chain)
    (orbit,) = periodic_orbits(chain, mode, amplitudes=[1e-3])
    period = 2.0 * np.pi / frequencies[mode]
    assert orbit.period == pytest.approx(period, rel=1e-5)
    np.testing.assert_allclose(orbit.theta, 1e-3 * shapes[:, mode], atol=1e-8)
    others = np.delete(frequencies, mode)
    turns = np.exp(1j * np.concatenate([others, -others]) * period)
    for multiplier in orbit.multipliers:
        assert np.abs(multiplier - turns).min() < 1e-4
    assert orbit.stable


def test_orbits_are_closed_also_by_scipy_on_the_dense_equations():
    chain = Chain.uniform(2)
    orbits = periodic_orbits(chain, 1, amplitudes=[np.pi / 4, 1.3])
    for orbit in orbits:
        assert orbit.closure < 1e-10
        theta, omega = oracle.trajectory(chain, orbit.theta, 0.0, [0.0, orbit.period])
        np.testing.assert_allclose(theta[-1], orbit.theta, atol=1e-8)
        np.testing.assert_allclose(omega[-1], 0.0, atol=1e-8)
        motion = orbit.motion(3)
        assert np.abs(motion.omega[[0, 1, 2]]).max() < 1e-10
        assert np.abs(motion.theta[1] - motion.theta[0]).max() > 0.5  # half the period is not all


def test_neighbours_leave_an_unstable_orbit_by_its_largest_multiplier():
    chain = Chain.uniform(2)
    stable, unstable = periodic_orbits(chain, 1, energies=[5.0, 25.0])
    assert stable.stable
    assert not unstable.stable
    assert [stable.energy, unstable.energy] == pytest.approx([5.0, 25.0], rel=1e-12)
    growth, shrinking = unstable.multipliers.real
    assert growth * shrinking == pytest.approx(1.0, rel=1e-6)
    change = np.array([1e-9, 0.0])  # after some periods along the direction that grows
    times = unstable.period * np.arange(6)
    near = simulate(chain, unstable.theta + change, 0.0, times, rtol=1e-13, atol=1e-15)
    distances = np.linalg.norm(near.theta - unstable.theta, axis=1)
    assert distances[4] / distances[3] == pytest.approx(growth, rel=0.01)


ARM = Chain(1.0, [1.0, 0.8], centres=[0.5, 0.4], inertias=0.1)


@pytest.mark.long
@pytest.mark.parametrize(
    ("chain", "modes", "largest"),
    [*((Chain.uniform(n), n, 2.0) for n in (2, 3, 4, 5)), (ARM, 1, 1.0)],
    ids=["2", "3", "4", "5", "links"],
)
def test_nonlinear_normal_modes_reach_one_or_two_radians_and_are_closed(chain, modes, largest):
    for mode in range(modes):
        for orbit in periodic_orbits(chain, mode, amplitudes=[np.pi / 4, largest]):
            assert orbit.closure < 1e-10
            assert orbit.provenance["arguments"]["mode"] == mode


@pytest.mark.long
def test_an_amplitude_in_the_gap_of_a_resonance_is_refused():
    with pytest.raises(ContinuationError, match=r"mode 0 has no orbit for 1.8 of amplitudes: it t"):
        periodic_orbits(Chain.uniform(5), 0, amplitudes=[0.5, 1.8])


# -- sections: where and when a rod passes an angle ------------------------------------------------


@pytest.mark.parametrize(("direction", "first"), [(1, 0.75), (-1, 0.25)])
def test_a_pendulum_passes_the_vertical_once_a_period(direction, first):
    period = theory.pendulum_period(1.0)
    found = chaos.poincare_section(
        Chain.uniform(1), 1.0, duration=5.0 * period, direction=direction
    )
    np.testing.assert_allclose(found.times, period * (first + np.arange(5)), atol=1e-9)
    np.testing.assert_allclose(found.theta, 0.0, atol=1e-12)
    speed = np.sqrt(2.0 * 9.81 * (1.0 - np.cos(1.0)))
    np.testing.assert_allclose(found.omega, direction * speed, atol=1e-8)


def test_a_whirling_pendulum_passes_an_angle_once_a_turn_and_stays_within_one():
    found = chaos.poincare_section(Chain.uniform(1), 0.0, 20.0, duration=3.0, angle=3.0)
    assert 8 <= found.times.size <= 10
    np.testing.assert_allclose(found.theta, 3.0, atol=1e-11)
    assert np.ptp(np.diff(found.times)) < 1e-9


@pytest.mark.long
def test_points_of_a_double_pendulum_are_those_of_scipy_on_the_dense_equations():
    chain, duration = Chain.uniform(2), 10.0
    rates = oracle.link_rates(chain, np.zeros(2))

    def second_rod(_t, y):
        return np.sin(y[1] - 0.2)

    start = [1.2, 1.2, 0.0, 0.0]
    exact = solve_ivp(
        lambda _, y: rates(y), (0.0, duration), start, "DOP853", events=second_rod,
        rtol=1e-12, atol=1e-12,
    )  # fmt: skip
    (times,), (states,) = exact.t_events, exact.y_events
    wanted = (states[:, 3] > 0.0) & (np.cos(states[:, 1] - 0.2) > 0.0)
    found = chaos.poincare_section(chain, 1.2, duration=duration, rod=-1, angle=0.2)
    assert wanted.sum() >= 3
    np.testing.assert_allclose(found.times, times[wanted], atol=1e-8)
    np.testing.assert_allclose(found.theta, states[wanted, :2], atol=1e-7)
    np.testing.assert_allclose(found.omega, states[wanted, 2:], atol=1e-7)


def test_a_nonlinear_normal_mode_is_one_point_of_a_section():
    (orbit,) = chaos.periodic_orbits(Chain.uniform(2), 0, amplitudes=[1.2])
    found = chaos.poincare_section(orbit.chain, orbit.theta, duration=4.5 * orbit.period)
    assert found.times.size == 4
    assert np.ptp(found.theta[:, 1]) < 1e-7
    assert np.ptp(found.omega, axis=0).max() < 1e-7
    np.testing.assert_allclose(np.diff(found.times), orbit.period, atol=1e-8)


@pytest.mark.parametrize(
    ("parts", "moved"),
    [
        ({"base": Cart(1.0)}, {}),
        pytest.param({"stiffness": 300.0}, {}, marks=pytest.mark.long),
        ({}, {"pivot_acceleration": [0, 1]}),
    ],
    ids=["cart", "springs", "moved pivot"],
)
def test_rods_are_counted_from_the_end_where_there_are_other_coordinates(parts, moved):
    chain = Chain([1.0, 0.5], [1.0, 0.7], **parts)
    found = chaos.poincare_section(chain, 0.8, duration=6.0, rod=-1, angle=0.5, **moved)
    np.testing.assert_allclose(found.theta[:, 1], 0.5, atol=1e-10)
    assert (found.omega[:, 1] > 0.0).all()
    event = Event("angle", -1, 0.5, direction=1)
    motion = simulate(chain, 0.8, 0.0, [0.0, 6.0], rtol=1e-10, events=event, **moved)
    np.testing.assert_allclose(found.times, motion.t_events[0], rtol=0, atol=1e-8)


# -- what is refused -------------------------------------------------------------------------------


def orbits(chain, **change):
    return chaos.periodic_orbits(**{"chain": chain, "mode": 0, "amplitudes": [1.0]} | change)


def section(chain, **change):
    return chaos.poincare_section(chain, **{"theta": 0.5, "duration": 2.0} | change)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda c: chaos.lyapunov_spectrum(c, 1.0, duration=1.0, count=5),
         "count must be between 1 and 4, got 5"),
        (lambda c: chaos.lyapunov_spectrum(c, 1.0, duration=0.0),
         "duration must be greater than zero, got 0.0"),
        (lambda c: chaos.lyapunov_spectrum(c, 1.0, duration=1.0, samples=0), "samples must"),
        (lambda _: chaos.lyapunov_spectrum(Chain.uniform(501), 1.0, duration=1.0),
         "n must be between 1 and 500"),
        (lambda c: chaos.largest_lyapunov(c, 1.0, duration=-1.0), "duration must"),
        (lambda c: chaos.largest_lyapunov(c, 1.0, duration=0.1), "duration must be at least"),
        (lambda c: chaos.largest_lyapunov(c, 1.0, duration=1e20), "duration must be at most"),
        (lambda c: chaos.megno(c, [1.0, np.nan], duration=1.0), "theta must be finite"),
        (lambda c: chaos.megno(c, [1.0] * 3, duration=1.0), "theta must be one number"),
        (lambda c: chaos.tangent_growth(c, 2.0, duration=0.001), "duration must be at least 0.03"),
        (lambda c: chaos.tangent_growth(c, 2.0, duration=1.0).exponent(2.0), "until must be betw"),
        (lambda c: chaos.neighbour_distance(c, 2.0, [0.1] * 3, [0.0, 1.0]), "change must be one"),
        (lambda c: orbits(c, amplitudes=None), "either amplitudes or energies, and not both"),
        (lambda c: orbits(c, energies=[1.0]), "either amplitudes or energies, and not both"),
        (lambda c: orbits(c, amplitudes=[1.0, 0.5]), "amplitudes must be a list of increasing"),
        (lambda c: orbits(c, amplitudes=[0.0, 0.5]), "amplitudes must be a list of increasing"),
        (lambda c: orbits(c, amplitudes=1.0), "amplitudes must be a list of increasing"),
        (lambda c: orbits(c, amplitudes=[np.pi]), "amplitudes must be below pi"),
        (lambda c: orbits(c, amplitudes=[np.nan]), "amplitudes must be finite"),
        (lambda c: orbits(c, mode=2), "mode must be between 0 and 1, got 2"),
        (lambda _: orbits(Chain.uniform(2, damping=0.1)), "no damping"),
        (lambda _: orbits(Chain.uniform(2, gravity=0.0)), "chain must hang"),
        (lambda _: orbits(Chain.uniform(2, base=Cart(1.0))), r"pivot at rest.*chain\.hung\(\)"),
        (lambda _: orbits(Chain.uniform(2, stiffness=1e2)), r"pivot at rest.*chain\.hung\(\)"),
        (lambda c: section(c, angle=3.0), "rod 0 does not pass the angle 3 rad within 2 s"),
        (lambda c: section(c, duration=0.0), "duration must be greater than zero"),
        (lambda c: section(c, duration=1e20), "duration must be at most"),
        (lambda c: section(c, direction=0), "direction must be 1 or -1, got 0"),
        (lambda c: section(c, rtol=1e-17), "rtol must be at least"),
        (lambda c: section(c, rod=2), "rod must be between -2 and 1, got 2"),
        (lambda c: section(c, angle=np.nan), "angle must be finite"),
        (lambda c: section(c, theta=[1.0, 2.0, 3.0]), "theta must be one number"),
    ],
)  # fmt: skip
def test_bad_input_is_refused_by_name(call, message):
    with pytest.raises(ValueError, match=message):
        call(Chain.uniform(2))


def test_what_is_no_chain_is_refused():
    for measure in (lambda: chaos.megno(2, 1.0, duration=1.0), lambda: orbits(2)):
        with pytest.raises(TypeError, match="chain must be"):
            measure()


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


def test_tangent_vectors_in_a_list_or_a_read_only_array_are_copied():
    def end(vectors):
        carried = chaos.tangents(Chain.uniform(2), 1.0, 0.0, [0.0, 0.5], vectors)
        return [frames for _, frames in carried][-1][-1]

    fixed = np.eye(4)
    fixed.flags.writeable = False
    for vectors in (fixed, np.eye(4).tolist()):
        np.testing.assert_array_equal(end(vectors), end(np.eye(4)))
    np.testing.assert_array_equal(fixed, np.eye(4))


@pytest.mark.parametrize(
    ("times", "vectors", "message"),
    [
        ([], np.eye(4), "times must be a list of increasing instants"),
        (1.0, np.eye(4), "times must be a list of increasing instants"),
        ([0.0, 1.0], np.eye(2), r"vectors must be float64 of shape \(D, 4\), got"),
        ([0.0, 1.0], None, "vectors must hold real numbers, got None"),
        ([0.0, 1.0], np.full((1, 4), np.nan), "vectors must be finite"),
    ],
)
def test_wrong_times_and_tangent_vectors_are_refused_by_name(times, vectors, message):
    with pytest.raises((TypeError, ValueError), match=message):
        chaos.tangents(Chain.uniform(2), 1.0, 0.0, times, vectors)


def test_the_growth_refuses_times_and_shares_outside_its_run():
    growth = chaos.tangent_growth(Chain.uniform(2), [2.0, 2.0], duration=5.0)
    assert growth.rate_after(5.0) == growth.rate_after(float(growth.times[-2]))
    assert growth.onset(-10.0, share=1.0) == growth.times[0]
    for ask, message in (
        (lambda: growth.onset("a"), "rate must be a real number"),
        (lambda: growth.onset(share=-1.0), "share must be between 0 and 1, got -1"),
        (lambda: growth.rate_after(100.0), "between 0 and the duration of the run, 5 s, got 100"),
    ):
        with pytest.raises((TypeError, ValueError), match=message):
            ask()
