import numpy as np
import oracle
import pytest
from conftest import chains_in_motion
from hypothesis import given, settings

from npend_gym import Cart, Chain, Event, IntegrationError, Signal, simulate, theory
from npend_gym.identification import read_motion


def test_adaptive_method_follows_scipy_on_the_dense_system(uneven):
    times = np.linspace(0.0, 5.0, 51)
    theta, omega = oracle.trajectory(uneven, 0.7, 0.0, times)
    ours = simulate(uneven, 0.7, 0.0, times, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(ours.theta, theta, rtol=0, atol=1e-9)
    np.testing.assert_allclose(ours.omega, omega, rtol=0, atol=1e-8)


@settings(max_examples=10)
@given(chains_in_motion(max_n=5))
def test_forced_and_damped_motion_follows_scipy_for_a_moment(motion):
    chain, theta, omega, torque = motion
    times = np.array([0.0, 0.02, 0.05])
    dense, _ = oracle.trajectory(chain, theta, omega, times, torque)
    ours = simulate(chain, theta, omega, times, torque=torque, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(ours.theta, dense, rtol=0, atol=1e-8)


@pytest.mark.parametrize(
    "method", ["dop853", "tsit5", pytest.param("gauss6", marks=pytest.mark.long), "rk4"]
)
def test_a_motion_is_as_exact_in_the_seconds_since_1970_as_from_zero_on(method):
    chain, start, options = Chain.uniform(2), [1.5, 0.5], {"method": method}
    if method in ("gauss6", "rk4"):
        options["dt"] = 0.005
    ends = [
        simulate(chain, start, 0.0, [t, t + 10.0], **options).theta[-1] for t in (0.0, 1.7e9, 1e11)
    ]
    np.testing.assert_allclose(ends[1:], [ends[0]] * 2, rtol=0, atol=3e-8)
    with pytest.raises(IntegrationError, match="count the time from the start of the motion"):
        simulate(chain, start, 0.0, [1e12, 1e12 + 10.0])


@pytest.mark.long
@pytest.mark.parametrize("count", [4, 7, 8, 13, 18])
def test_a_signal_ends_with_a_motion_whose_instants_are_rounded_otherwise(count):
    products, spaced = 0.1 * np.arange(count), np.linspace(0.0, 0.1 * (count - 1), count)
    motions = [
        simulate(Chain.uniform(1), 0.1, 0.0, times, torque=Signal(given, np.ones(count), kind=kind))
        for times, given in ((products, spaced), (spaced, products), (products, products))
        for kind in ("previous", "linear")
    ]
    for motion in motions:
        np.testing.assert_allclose(motion.theta, motions[0].theta, rtol=0, atol=1e-12)
        assert np.isfinite(motion.energy()).all()
    with pytest.raises(ValueError, match=r"whole motion, 0 to 0.300000001 s; .* 0 to 0.3 s"):
        simulate(Chain.uniform(1), 0.1, 0.0, [0.0, 0.300000001],
                 torque=Signal([0.0, 0.3], [1.0]))  # fmt: skip


def test_error_of_the_adaptive_method_follows_its_tolerance(uneven):
    times = np.linspace(0.0, 3.0, 7)
    exact = simulate(uneven, 0.5, 0.0, times, rtol=1e-13, atol=1e-15).theta
    tolerances = np.array([1e-5, 1e-7, 1e-9, 1e-11])
    errors = [
        np.abs(simulate(uneven, 0.5, 0.0, times, rtol=t, atol=t).theta - exact).max()
        for t in tolerances
    ]
    assert np.all(np.array(errors) < 100 * tolerances)
    slope = np.polyfit(np.log(tolerances), np.log(errors), 1)[0]
    assert slope == pytest.approx(1.0, abs=0.25)


@pytest.mark.parametrize("length", [1.0, 0.01])
def test_energy_of_a_hundred_rods_is_kept(length):
    chain = Chain.uniform(100, length=length)
    energy = simulate(chain, np.pi / 4, 0.0, np.linspace(0.0, 10.0, 1000)).energy()
    assert np.abs(energy / energy[0] - 1.0).max() < 1e-10


def test_small_oscillation_in_a_mode_keeps_its_shape_and_frequency(uneven):
    omega, modes = theory.normal_modes(uneven)
    for k in range(4):
        times = np.linspace(0.0, 2 * np.pi / omega[k], 9)
        path = simulate(uneven, 1e-5 * modes[:, k], 0.0, times, atol=1e-17)
        expected = 1e-5 * np.cos(omega[k] * times)[:, None] * modes[:, k]
        np.testing.assert_allclose(path.theta, expected, rtol=0, atol=1e-11)


def test_positions_and_energy_follow_the_definitions(uneven):
    path = simulate(uneven, [0.1, 0.2, 0.3, 0.4], 0.5, [0.0, 0.1])
    place = velocity = np.zeros(2)
    kinetic, potential = 0.0, sum(uneven.masses * uneven.gravity * np.cumsum(uneven.lengths))
    for i in range(4):
        s, c = np.sin(path.theta[0, i]), np.cos(path.theta[0, i])
        place = place + uneven.lengths[i] * np.array([s, -c])
        velocity = velocity + uneven.lengths[i] * path.omega[0, i] * np.array([c, s])
        np.testing.assert_allclose(path.positions()[0, i], place)
        np.testing.assert_allclose(path.velocities()[0, i], velocity)
        m = uneven.masses[i]
        kinetic += 0.5 * m * velocity @ velocity
        potential += m * uneven.gravity * place[1]
    assert path.kinetic_energy()[0] == pytest.approx(kinetic, rel=1e-13)
    assert path.energy()[0] == pytest.approx(kinetic + potential, rel=1e-13)


@pytest.mark.parametrize(
    "torque", [0.0, lambda t, q, u: t + q[0] - u[0], Signal([0.0, 9.0], [0.1])]
)
@pytest.mark.parametrize("options", [{}, {"method": "rk4", "dt": 0.1}])
def test_a_single_time_returns_the_start_whatever_drives_the_motion(uneven, torque, options):
    path = simulate(uneven, 0.3, 0.2, [5.0], torque=torque, **options)
    np.testing.assert_array_equal(path.theta, np.full((1, 4), 0.3))
    np.testing.assert_array_equal(path.at(5.0), [path.theta[0], path.omega[0]])


def test_a_motion_keeps_its_drives_whatever_becomes_of_the_arrays_it_was_given(uneven):
    lifted, samples = np.array([0.0, 1.0]), np.ones((2, 4))
    path = simulate(uneven, 0.3, 0.0, [0.0, 0.5], pivot_acceleration=lifted)
    lifted[:] = 50.0
    np.testing.assert_allclose(path.at(0.5)[0], path.theta[-1], rtol=1e-12)
    signal = Signal([0.0, 1.0], samples)
    samples[:] = signal(0.0)[:] = 50.0
    np.testing.assert_array_equal(signal(0.0), np.ones(4))
    with pytest.raises(ValueError, match="read-only"):
        signal.values[:] = 50.0


@pytest.mark.parametrize(("quantity", "rod"), [("angle", 0), ("angular_velocity", 1)])
@pytest.mark.parametrize(("method", "at_once"), [("rk4", 10_000), ("rk4", 2), ("dop853", 2)])
def test_an_event_where_two_steps_meet_is_found_once(quantity, rod, method, at_once, monkeypatch):
    def follow(**more):
        return simulate(Chain.uniform(2), [1.0, 0.7], 0.0, times, method=method, dt=0.05, **more)

    monkeypatch.setattr("npend_gym.physics.watch._RODS_AT_ONCE", at_once)  # 2: each step alone
    times, half = np.linspace(0.0, 3.0, 61), int(quantity != "angle")
    path = follow()
    path.at(0.0)
    instants, values = path._steps.begin[1:], path._steps.states[1:, 2 * half + rod]
    found = follow(events=[Event(quantity, rod, value) for value in values]).t_events
    for instant, near in zip(instants, found, strict=True):
        before, there, after = path.at(instant + np.array([-1e-4, 0.0, 1e-4]))[half][:, rod]
        if (before - there) * (after - there) < 0.0:  # no turning point
            assert np.sum(np.abs(near - instant) < 1e-9) == 1


def test_rk4_with_too_long_a_step_says_so_instead_of_returning_nonsense():
    chain = Chain.uniform(100, length=0.01)
    with pytest.raises(IntegrationError, match="is too long for this chain"):
        simulate(chain, 1.0, 0.0, np.linspace(0.0, 10.0, 11), method="rk4", dt=0.05)


def test_a_state_beyond_all_bounds_is_an_error_and_not_a_nan():
    weightless = Chain.uniform(1, gravity=0.0)
    for options in ({}, {"method": "rk4", "dt": 0.01}):
        with pytest.raises(IntegrationError, match=r"turned by more than 100000 rad"):
            simulate(weightless, 0.0, 1e6, [0.0, 1.0], **options)


@pytest.mark.parametrize("torque", [0.0, [0.3, 0.0, -0.1]])
def test_a_motion_in_a_csv_file_is_read_as_measured_motion_to_the_same_bits(torque, tmp_path):
    motion = simulate(Chain.uniform(3), 0.4, 0.1, np.linspace(0.0, 1.0, 31), torque=torque)
    motion.to_csv(tmp_path / "a.csv")
    heads, first = (tmp_path / "a.csv").read_text().splitlines()[:2]
    assert heads.startswith("time,theta0,theta1,theta2,omega0,omega1,omega2")
    assert first.startswith("0.0,0.4,0.4,0.4,0.1,0.1,0.1")
    read = read_motion(tmp_path / "a.csv")
    np.testing.assert_array_equal(read.times, motion.times)
    np.testing.assert_array_equal(read.theta, motion.theta)
    if np.any(torque):
        np.testing.assert_array_equal(read.torque, np.tile(torque, (31, 1)))
    else:
        assert read.torque is None


def test_names_of_files_that_promise_another_form_are_refused(uneven, tmp_path):
    with pytest.raises(ValueError, match=r"must end in \.npz, got .*a\.csv; to_csv\(path\) writes"):
        simulate(uneven, 0.4, 0.0, [0.0, 1.0]).save(tmp_path / "a.csv")
    many = simulate(uneven, np.full((2, uneven.n), 0.4), 0.0, [0.0, 1.0])
    with pytest.raises(ValueError, match=r"one motion, got 2: trajectory\[k\]"):
        many.to_csv(tmp_path / "a.csv")
    assert not list(tmp_path.iterdir())


ON_CART, STIFF = {"base": Cart(1.0)}, {"stiffness": 1e3}


@pytest.mark.parametrize(
    ("parts", "change", "message"),
    [
        ({}, {"omega": 1e200}, "omega must lie within"),
        ({}, {"theta": np.zeros((0, 3))}, r"must have the shape \(B, 3\), got \(0, 3\)"),
        ({}, {"method": "rk4"}, "dt must be given"),
        ({}, {"dt": 0.0}, "dt must be"),
        ({}, {"method": "rk4", "dt": 0.01, "times": [1e15, 1e15 + 1.0]}, "dt must be at least 0.1"),
        ({}, {"dt": 1e-20}, r"dt must make at most 1e\+12 steps between two times, got 1e-20"),
        ({}, {"pivot_acceleration": 1.0}, "pivot_acceleration must be two numbers"),
        *(
            ({}, drive, rf"{[*drive][-1]} .* must have base=Cart\(mass\)")
            for drive in (
                {"force": 1.0}, {"force": lambda _t: 1.0}, {"velocity": 1.0}, {"position": 1.0},
                {"pivot_acceleration": (0, 1), "force": 1.0},
            )
        ),
        (ON_CART, {"velocity": (0, 1)}, "velocity must"),
        (ON_CART, {"pivot_acceleration": (0, 1)}, "must be None for a chain"),
        (STIFF, {"stretch": [0.0, -1.0, 0.0]}, "stretch must leave every rod a le"),
        (STIFF, {"stretch": np.nan}, "stretch must be finite"),
        (STIFF, {"stretch_rate": 0.1}, "stretch must be given with stretch_rate"),
        ({}, {"stretch": 0.0}, "the chain must have stiffness"),
        ({}, {"stretch_rate": 0.0}, "the chain must have stiffness"),
        ({"stiffness": 5.0}, {"theta": 3.1}, "give stretch, or more stiffness"),
        ({"stiffness": [1e3, 1e22, 1e3]}, {}, r"at most 1e\+09 times in 1 s"),
        (STIFF | {"axial_damping": 1e12}, {}, "rigid rods are the limit of stiff spr"),
    ],
)  # fmt: skip
def test_bad_arguments_are_refused_with_their_rule(parts, change, message):
    arguments = {"theta": 0.1, "omega": 0.0, "times": [0.0, 1.0]} | change
    with pytest.raises(ValueError, match=message):
        simulate(Chain.uniform(3, **parts), **arguments)


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        ({"rod": 1.5}, TypeError, "rod must be an integer"),
        ({"rod": True}, TypeError, "rod must be an integer"),
        ({"direction": "up"}, TypeError, "direction must be an integer"),
        ({"direction": 2}, ValueError, "direction must be between -1 and 1"),
    ],
)
def test_what_is_no_event_is_refused_when_it_is_made(given, error, message):
    with pytest.raises(error, match=message):
        Event("angle", **given)


def test_many_motions_have_no_slices():
    with pytest.raises(TypeError, match="slice"):
        simulate(Chain.uniform(2), np.zeros((3, 2)), 0.0, [0.0, 1.0])[0:2]


def test_states_between_are_refused_where_a_function_returns_something_else_than_before():
    gains = {"damping": 1.0}

    def torque(_, __, omega):
        return -gains["damping"] * omega[0]

    path = simulate(Chain.uniform(2), 1.0, 0.0, [0.0, 2.0], torque=torque)
    gains["damping"] = 5.0
    with pytest.raises(
        ValueError, match="a function of it returns something else than in simulate"
    ):
        path.at([1.0])
    gains["damping"] = 1.0
    np.testing.assert_allclose(path.at([2.0])[0][0], path.theta[-1], atol=1e-12)


def test_instants_of_signals_may_be_as_near_as_rounding():
    tenths, rounded = np.arange(11) / 10, np.arange(11) * 0.1
    assert np.any(tenths != rounded)
    chain = Chain.uniform(2, base=Cart(1.0))
    torque, force = Signal(tenths, np.full((11, 2), 0.1)), Signal(rounded, np.ones(11))
    found = simulate(chain, 0.1, 0.0, [0.0, 1.0], torque=torque, force=force)
    expected = simulate(chain, 0.1, 0.0, [0.0, 1.0], torque=[0.1, 0.1], force=1.0)
    np.testing.assert_allclose(found.theta, expected.theta, rtol=1e-7)
    still = simulate(Chain.uniform(2), 1.0, 0.0, [1e6, 1e6 + 1e-9])
    np.testing.assert_allclose(still.theta[1], 1.0, rtol=1e-12)


def test_functions_are_called_within_the_motion_alone():
    seen = []

    def torque(t, theta, omega):  # noqa: ARG001
        seen.append(t)
        return 0.1

    simulate(Chain.uniform(2), 1.0, 1.0, [0.0, 1e-3], torque=torque)
    assert 0.0 == min(seen) < max(seen) <= 1e-3
