"""Many motions side by side, dense output, torques that change in time, events."""

# ruff: noqa: ARG001, ARG005  functions of users have the arguments that they are called with

import json

import numpy as np
import pytest
from lanes import assert_same
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import npend_gym
from npend_gym import Cart, Chain, Event, IntegrationError, Signal, simulate
from npend_gym.physics import accelerations
from npend_gym.physics.motion import Integration
from npend_gym.physics.trajectory import STATE

pytestmark = pytest.mark.long  # three more kernels are compiled

DOUBLE = Chain([1.0, 1.0], [1.0, 1.0])
ON_CART = Chain([1.0, 1.0], [1.0, 1.0], base=Cart(2.0, 0.1))
ON_SPRINGS = Chain([1.0, 1.0], [1.0, 1.0], stiffness=300.0, axial_damping=0.5)
SPRINGS_ON_CART = Chain([1.0, 1.0], [1.0, 1.0], stiffness=300.0, base=Cart(2.0))
TIMES = np.linspace(0.0, 5.0, 51)
LINKS = Chain([1.0, 0.5], [0.5, 0.4], centres=[0.2, 0.3], inertias=[0.02, 0.01], friction=0.01)


@pytest.fixture
def starts():
    rng = np.random.default_rng(0)
    return rng.uniform(-3.0, 3.0, (37, 2)), rng.normal(size=(37, 2))


METHODS = {"dop853": {}, "rk4": {"method": "rk4", "dt": 0.005}}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("chain", "raised"),
    [
        *((each, None) for each in (DOUBLE, LINKS, ON_CART, ON_SPRINGS, SPRINGS_ON_CART)),
        (DOUBLE, (1.0, -2.0)),
    ],
    ids=str,
)
def test_many_motions_have_the_bits_of_each_alone_on_any_number_of_threads(
    chain, raised, method, starts
):
    theta, omega = (0.5 * each for each in starts)
    torque = np.linspace(-1.0, 1.0, 74).reshape(37, 2)
    options = METHODS[method] | {"pivot_acceleration": raised}
    beside = {} if chain.base is None else {
        "force": np.linspace(-3.0, 3.0, 37), "velocity": np.linspace(0.5, -0.5, 37)
    }  # fmt: skip
    many = simulate(chain, theta, omega, TIMES, torque=torque, **beside, **options)
    assert many.theta.shape == (37, 51, 2)
    assert len(many) == 37
    for k in (0, 15, 16, 36):
        own = {name: values[k] for name, values in beside.items()}
        alone = simulate(chain, theta[k], omega[k], TIMES, torque=torque[k], **own, **options)
        for name in STATE:
            assert_same(getattr(many[k], name), getattr(alone, name))
        np.testing.assert_array_equal(many.energy()[k], alone.energy())
        np.testing.assert_array_equal(many[k].at(1.23), alone.at(1.23))
        if method == "dop853":
            assert (many.nfev[k], many.steps[k], many.refused_steps[k]) == (
                alone.nfev, alone.steps, alone.refused_steps
            )  # fmt: skip
    shared = simulate(chain, theta, omega, TIMES, torque=torque, **beside, **options, threads=3)
    np.testing.assert_array_equal(shared.theta, many.theta)


@pytest.mark.parametrize("mechanism", ["pivot", "springs on a cart"])
def test_chains_may_differ_and_motions_and_energies_are_those_of_each(mechanism, starts):
    def chain_of(m):
        parts = {"stiffness": 300.0 * m, "base": Cart(m, 0.1)} if mechanism != "pivot" else {}
        return Chain([m, 1.0], [1.0, 0.5 * m], **parts)

    chains, theta = [chain_of(m) for m in (0.5, 1.0, 2.0)], 0.3 * starts[0][:3]
    many = simulate(chains, theta, 0.0, TIMES)
    for k, chain in enumerate(chains):
        alone = simulate(chain, theta[k], 0.0, TIMES)
        assert many[k].chain == chain
        for name in ("theta", "position", "stretch"):
            assert_same(getattr(many[k], name), getattr(alone, name))
        np.testing.assert_array_equal(many.energy()[k], alone.energy())
        np.testing.assert_array_equal(many.positions()[k], alone.positions())


@pytest.mark.parametrize("options", METHODS.values(), ids=METHODS)
def test_chains_of_different_kinds_move_as_each_alone(options, starts):
    chains = [LINKS, DOUBLE, DOUBLE, *(Chain.uniform(2, **{name: 0.01}) for name in
              ("inertias", "friction", "armature", "drag"))]  # fmt: skip
    many = simulate(chains, starts[0][:7], 0.0, TIMES, **options)
    for k, chain in enumerate(chains):
        alone = simulate(chain, starts[0][k], 0.0, TIMES, **options)
        assert_same(many[k].theta, alone.theta)
        np.testing.assert_array_equal(many[k].sensitivities().A, alone.sensitivities().A)
        np.testing.assert_array_equal(many.at(1.23)[0][k], alone.at(1.23)[0])
    np.testing.assert_array_equal(many.bodies(), many.centres())
    assert many[1].bodies().shape == (51, 0, 2)


def test_chains_that_do_not_fit_each_other_or_their_starts_are_refused():
    with pytest.raises(ValueError, match=r"shape \(B, 2\) for B = 3 chains, got \(2, 2\)"):
        simulate([DOUBLE] * 3, np.ones((2, 2)), 0.0, TIMES)
    with pytest.raises(ValueError, match=r"chain must be one npend_gym\.Chain or more, got none"):
        simulate([], 1.0, 0.0, TIMES)
    for others in ([DOUBLE, ON_CART], [DOUBLE, ON_SPRINGS]):
        with pytest.raises(ValueError, match="must all have"):
            simulate(others, np.ones((2, 2)), 0.0, TIMES)


def test_the_number_of_evaluations_is_near_that_of_scipy():
    motion = simulate(DOUBLE, [2.0, 1.0], 0.0, [0.0, 5.0])
    peer = solve_ivp(
        right_side(DOUBLE), (0, 5), [2, 1, 0, 0], method="DOP853", rtol=1e-10, atol=1e-12
    )
    assert motion.steps == peer.t.size - 1
    # SciPy evaluates the end of steps that it refuses too
    assert motion.nfev + motion.refused_steps == peer.nfev


def test_steps_after_a_terminal_event_do_not_count():
    motion = simulate(DOUBLE, 1.0, 0.0, [0.0, 10.0], events=Event("angle", rod=0, terminal=True))
    peer = solve_ivp(
        right_side(DOUBLE), (0, 10), [1, 1, 0, 0], method="DOP853", rtol=1e-10, atol=1e-12,
        events=ending(lambda _, y: y[0]),
    )  # fmt: skip
    assert motion.steps == peer.t.size - 1
    # SciPy evaluates the end of steps that it refuses too, and interpolates one step alone
    assert 2 + 12 * (motion.steps + motion.refused_steps) + 3 == peer.nfev
    assert motion.nfev == 2 + 12 * motion.steps + 11 * motion.refused_steps + 3 * motion.steps
    long = Event("angle", rod=0, terminal=150)  # more than one compiled call
    for options in ({}, {"torque": Signal([0.0, 1.0, 200.0], [0.1, 0.1])}):
        motion = simulate(DOUBLE, 1.0, 0.0, [0.0, 200.0], events=long, **options)
        shorter = simulate(DOUBLE, 1.0, 0.0, [0.0, motion.times[-1]], **options)
        assert 0 <= motion.steps - shorter.steps + 1 <= 2
        assert abs(motion.refused_steps - shorter.refused_steps) <= 2


def ending(event):
    event.terminal = True
    return event


def right_side(chain, torque=lambda t, y: np.zeros(2)):
    def slope(t, y):
        return np.r_[y[2:], accelerations(chain, y[:2], y[2:], torque(t, y))]

    return slope


def test_dense_output_has_the_bits_of_frames_and_any_shape():
    motion = simulate(DOUBLE, [2.0, 1.0], 0.0, TIMES)
    theta, omega = motion.at(TIMES.reshape(17, 3))
    np.testing.assert_array_equal(theta.reshape(51, 2), motion.theta)
    np.testing.assert_array_equal(omega.reshape(51, 2), motion.omega)
    signal = Signal([0, 1.234, 5.0], [1.0, -1.0, 0.0])
    for chain, keywords in (
        (ON_CART, {"velocity": 0.5}), (SPRINGS_ON_CART, {}), (DOUBLE, {"torque": signal}),
        (DOUBLE, {"torque": drive}), (DOUBLE, {"pivot_acceleration": lambda t: (np.sin(t), 1.0)}),
        (DOUBLE, {"events": Event("flip", terminal=True)}),
    ):  # fmt: skip
        motion = simulate(chain, [0.9, 0.7], 0.0, TIMES, **keywords)
        np.testing.assert_allclose(motion.at(TIMES)[0], motion.theta, rtol=0, atol=1e-9)
        if chain.base is not None:
            position, velocity = motion.cart_at(TIMES)
            np.testing.assert_allclose(position, motion.position, rtol=0, atol=1e-9)
            np.testing.assert_allclose(velocity, motion.velocity, rtol=0, atol=1e-9)
    with pytest.raises(ValueError, match=r"within the motion, 0 to 5 s, got 5\.5"):
        motion.at(5.5)


@pytest.mark.parametrize("chain", [DOUBLE, SPRINGS_ON_CART])
def test_dense_output_of_rk4_is_of_order_three_and_meets_its_frames(chain):
    between, errors = np.linspace(0.1, 1.9, 91), []
    exact = simulate(chain, 0.6, 0.5, [0.0, 2.0], rtol=1e-13, atol=1e-14).at(between)[0]
    for dt in (0.02, 0.01, 0.005):
        times = np.linspace(0.0, 2.0, 11)
        motion = simulate(chain, 0.6, 0.5, times, method="rk4", dt=dt)
        np.testing.assert_allclose(motion.at(times)[0], motion.theta, rtol=0, atol=1e-14)
        errors.append(np.abs(motion.at(between)[0] - exact).max())
    slope = np.polyfit(np.log([0.02, 0.01, 0.005]), np.log(errors), 1)[0]
    assert 3.5 < slope < 4.5  # a polynomial of order 3 has an error of order 4


def test_dense_output_of_many_motions_keeps_their_steps(monkeypatch):
    chains = [DOUBLE, Chain.uniform(2, length=0.5)]
    many = simulate(chains, [[1.0, 0.5], [0.2, 0.1]], 0.0, TIMES)
    theta, _ = many.at(1.234)
    monkeypatch.setattr(Integration, "steps", None)  # nothing integrates once more
    np.testing.assert_array_equal(many.at([1.234, 0.0])[0][:, 0], theta)
    monkeypatch.undo()
    alone = [simulate(chains[k], many.theta[k, 0], 0.0, TIMES).at(1.234)[0] for k in range(2)]
    np.testing.assert_array_equal(theta, alone)


@pytest.mark.parametrize("options", METHODS.values(), ids=METHODS)
@pytest.mark.parametrize("chain", [DOUBLE, ON_CART, SPRINGS_ON_CART], ids=lambda chain: f"{chain}")
def test_a_motion_among_many_goes_up_to_its_event_as_one_alone_does(chain, options, tmp_path):
    options = {"events": Event("angle", 0, 0.3, terminal=True), **options}
    starts, times = np.array([[1.0, 1.0], [0.01, 0.01]]), [0.0, 1.0, 2.0]
    many = simulate(chain, starts, 0.0, times, **options)
    many.save(tmp_path / "many.npz")
    for again in (many, npend_gym.Trajectory.load(tmp_path / "many.npz")):
        np.testing.assert_array_equal(again.theta, many.theta)
        for k, start in enumerate(starts):
            alone = simulate(chain, start, 0.0, times, **options)
            for name in ("times", *STATE, "t_events", "theta_events", "omega_events"):
                assert_same(getattr(again[k], name), getattr(alone, name))
            assert_same(again[k].at(alone.times), alone.at(alone.times))
        end = many.t_events[0][0][0]
        np.testing.assert_array_equal(again.at([0.1, end])[0][0], again[0].at([0.1, end])[0])
        with pytest.raises(ValueError, match=rf"ended motion 0 at {end:g} s, got 1\.5 s; .*\[k\]"):
            again.at([0.1, 1.5])


def test_what_was_seen_and_the_chains_of_many_motions_come_back_from_a_file(tmp_path):
    seen = simulate(DOUBLE, [[2.0, 1.0], [1.0, 0.5]], 0.0, TIMES, events=Event("angle", 0))
    for each in (seen, seen[0]):
        each.save(tmp_path / "b.npz")
        again = npend_gym.Trajectory.load(tmp_path / "b.npz")
        assert_same(again.t_events, each.t_events)
        assert_same(again.theta_events, each.theta_events)
        np.testing.assert_array_equal(again.steps, each.steps)
    with pytest.raises(ValueError, match='took them, not those of a GPU or of "rk4"'):
        _ = simulate(DOUBLE, 1.0, 0.0, TIMES, **METHODS["rk4"]).steps
    chains = [DOUBLE, Chain([1.0, 2.0], [1.0, 1.0])]
    simulate(chains, np.ones((2, 2)), 0.0, TIMES).save(tmp_path / "c.npz")
    assert npend_gym.Trajectory.load(tmp_path / "c.npz").chains == tuple(chains)


# -- functions and signals --------------------------------------------------------------------


def drive(t, theta, omega):
    return 3.0 * np.sin(t) - 0.1 * omega[0]


def slow_drive(t, theta, omega):
    return json.loads(json.dumps(3.0 * float(np.sin(t)) - 0.1 * float(omega[0])))


def test_a_torque_function_gives_what_scipy_gives_compiled_or_not():
    motion = simulate(DOUBLE, [2.0, 1.0], 0.0, TIMES, torque=drive)
    assert motion.provenance["arguments"]["torque"] == "function drive, compiled"
    peer = solve_ivp(
        right_side(DOUBLE, lambda t, y: [drive(t, y[:2], y[2:]), 0.0]), (0, 5), [2, 1, 0, 0],
        method="DOP853", rtol=1e-11, atol=1e-13, t_eval=TIMES,
    )  # fmt: skip
    np.testing.assert_allclose(motion.theta, peer.y[:2].T, atol=2e-9)
    slow = simulate(DOUBLE, [2.0, 1.0], 0.0, TIMES, torque=slow_drive)
    assert slow.provenance["arguments"]["torque"] == "function slow_drive, in Python"
    np.testing.assert_allclose(slow.theta, motion.theta, atol=1e-9)


CALLS = 0


def counts(t, theta, omega):
    global CALLS  # noqa: PLW0603
    CALLS += 1
    return 0.1


def imports(t, theta, omega):
    from math import exp

    return 0.1 * exp(0.0 * t)


def names_errors(t, theta, omega):
    try:
        return 0.1 if t else 1 / 0
    except ZeroDivisionError as error:
        return 0.1 * len(error.args)


def unpacks(t, theta, omega):
    _, *rest = (0.0, 0.1)
    del rest[1:]
    return rest[0]


@pytest.mark.parametrize("torque", [counts, imports, names_errors, unpacks])
def test_functions_of_any_python_drive_where_numba_cannot_compile_them(torque):
    motion = simulate(DOUBLE, 1.0, 0.0, TIMES[:6], torque=torque)
    assert motion.provenance["arguments"]["torque"] == f"function {torque.__name__}, in Python"
    np.testing.assert_array_equal(motion.theta, simulate(DOUBLE, 1, 0, TIMES[:6], torque=0.1).theta)


@pytest.mark.parametrize("within", [False, True])
def test_functions_that_remember_are_called_in_python(within):
    calls = 0

    def remembers(t, theta, omega):
        nonlocal calls
        calls += 1
        return 0.0

    def remembers_within(t, theta, omega):
        def count():
            nonlocal calls
            calls += 1

        count()
        return 0.0

    torque = remembers_within if within else remembers
    simulate(DOUBLE, 1.0, 0.0, [0.0, 0.1], torque=torque, method="rk4", dt=0.01)
    assert calls == 41  # one to check, four in each of ten steps


def test_functions_that_change_their_arguments_move_no_chain():
    def careless(t, theta, omega):
        theta[0] += 1.0
        omega *= 2.0
        return 0.0

    careful = simulate(DOUBLE, 1.0, 0.0, TIMES, torque=lambda t, theta, omega: 0.0)
    motion = simulate(DOUBLE, 1.0, 0.0, TIMES, torque=careless)
    np.testing.assert_array_equal(motion.theta, careful.theta)


def test_a_torque_function_may_drive_all_joints_and_many_motions(starts):
    many = simulate(DOUBLE, starts[0][:3], 0.0, TIMES, torque=lambda t, theta, omega: -0.5 * omega)
    damped = simulate(DOUBLE, starts[0][1], 0.0, TIMES, torque=lambda t, theta, omega: [
        -0.5 * omega[0], -0.5 * omega[1]])  # fmt: skip
    np.testing.assert_allclose(many.theta[1], damped.theta, atol=1e-9)
    assert np.all(np.diff(many.energy(), axis=1) < 1e-9)


def test_samples_on_straight_lines_are_the_function_of_them():
    knots = np.linspace(0.0, 5.0, 21)
    signal = Signal(knots, np.sin(knots), "linear")
    motion = simulate(DOUBLE, [0.2, 0.1], 0.0, TIMES, torque=signal)
    function = simulate(
        DOUBLE, [0.2, 0.1], 0.0, TIMES, dt=0.01,
        torque=lambda t, theta, omega: np.interp(t, knots, np.sin(knots)),
    )  # fmt: skip
    np.testing.assert_allclose(motion.theta, function.theta, atol=1e-8)
    assert signal(0.125) == pytest.approx(0.5 * np.sin(0.25))
    assert Signal([0, 1, 2], [5.0, 6.0])(1.0) == 6.0


@pytest.mark.parametrize("kind", ["previous", "linear"])
def test_a_signal_has_its_own_samples_at_all_instants_of_them(kind):
    times, values = np.linspace(0.3, 2.0, 8), np.random.default_rng(0).normal(size=(8, 2))
    signal = Signal(times, values, kind)
    np.testing.assert_array_equal([signal(t) for t in times], values)
    if kind == "previous":  # without a value for the end, the last one holds until there
        assert Signal(times, values[:-1, 0])(times[-1]) == values[-2, 0]


def test_a_moving_pivot_as_a_function_is_the_frame_that_moves():
    # a pivot that falls freely: no gravity is felt, and the chain goes on as it was
    falling = simulate(DOUBLE, [1.0, 0.5], 0.0, TIMES, pivot_acceleration=lambda t: (0.0, -9.81))
    np.testing.assert_allclose(falling.theta[-1], [1.0, 0.5], atol=1e-12)
    np.testing.assert_allclose(falling.position[-1], [0.0, -0.5 * 9.81 * 25], rtol=1e-12)
    start = {"theta": [1.0, 0.5], "omega": 0.0, "times": TIMES, "dt": 0.05}  # no longer steps
    constant = simulate(DOUBLE, **start, pivot_acceleration=[1.0, 2.0])
    law = simulate(DOUBLE, **start, pivot_acceleration=lambda t: (1.0, 2.0))
    np.testing.assert_array_equal(law.theta, constant.theta)
    for chain in (ON_CART, SPRINGS_ON_CART):
        pushed = simulate(chain, **start, force=lambda t: 3.0)
        np.testing.assert_array_equal(pushed.theta, simulate(chain, **start, force=3.0).theta)


def in_time(t, size=0.5, rate=3.0):
    return size * np.sin(rate * t)


@pytest.mark.parametrize(
    "function",
    [
        in_time,
        CubicSpline(TIMES, in_time(TIMES)),
        lambda t, *state: in_time(t),
    ],
)
@pytest.mark.parametrize(("chain", "name"), [(DOUBLE, "torque"), (ON_CART, "force")])
def test_functions_of_time_are_called_with_the_time_alone(chain, name, function):
    motion = simulate(chain, 0.3, 0.0, TIMES, **{name: function})
    exact = simulate(chain, 0.3, 0.0, TIMES, **{name: lambda t, q, u: 0.5 * np.sin(3.0 * t)})
    np.testing.assert_allclose(motion.theta, exact.theta, atol=1e-4)


def test_a_force_that_feeds_the_cart_back_sees_all_coordinates():
    """A cart held by a spring of its own: F = -k x - d v, by which it swings."""
    heavy = Chain([1e-6], [1.0], base=Cart(2.0))
    motion = simulate(
        heavy, 0.0, 0.0, TIMES, position=0.3, force=lambda t, q, u: -8.0 * q[1] - 0.4 * u[1]
    )
    w = np.sqrt(4.0 - 0.1**2)
    swing = np.exp(-0.1 * TIMES) * (np.cos(w * TIMES) + 0.1 / w * np.sin(w * TIMES))
    np.testing.assert_allclose(motion.position, 0.3 * swing, rtol=0, atol=1e-5)
    shaken = simulate(
        SPRINGS_ON_CART, 0.3, 0.0, TIMES, torque=lambda t, q, u: 0.1 * q[3] - 0.2 * u[4]
    )
    assert shaken.chain.coordinates == 5


def test_fixed_steps_with_functions_and_signals_converge_to_the_adaptive_motion():
    signal = Signal([0.0, 1.25, 5.0], [[1.0, 0.0], [-1.0, 0.5], [0.0, 0.0]], "linear")
    for chain, keywords in (
        (DOUBLE, {"torque": drive}), (DOUBLE, {"torque": slow_drive}), (DOUBLE, {"torque": signal}),
        (ON_CART, {"force": lambda t: 3.0 * np.sin(t)}),
        (DOUBLE, {"pivot_acceleration": lambda t: (np.sin(3.0 * t), np.cos(t))}),
    ):  # fmt: skip
        exact = simulate(chain, [0.5, 0.3], 0.0, [0.0, 2.0], rtol=1e-12, atol=1e-13, **keywords)
        errors = [
            np.abs(
                simulate(chain, [0.5, 0.3], 0.0, [0.0, 2.0], method="rk4", dt=dt, **keywords).theta
                - exact.theta
            ).max()
            for dt in (0.02, 0.01)
        ]
        assert errors[1] < 1e-6
        assert 12.0 < errors[0] / errors[1] < 20.0  # order 4


def fails_late(t, theta, omega):
    return 1.0 / (t < 1.0)


def reads_beyond(t, theta, omega):
    return 0.01 * theta[int(10.0 * t)]


def returns_fewer(t, theta, omega):
    return theta[: 2 - int(t)]


def returns_more(t):
    return np.zeros(2 + 3 * int(t))


def returns_text_late(t):
    return "3" if t > 1.0 else 3.0


def nan_late(t, theta, omega):
    return np.nan if t > 1.0 else 0.0


def fails_in_python(t, theta, omega):
    if t > 1.0:
        raise RuntimeError(json.dumps("no more"))
    return 0.0


@pytest.mark.parametrize(
    ("keywords", "text"),
    [
        ({"torque": lambda t, theta, omega: 1 / 0}, "torque raised ZeroDivisionError at t = 0 s"),
        ({"torque": fails_late}, "torque raised ZeroDivisionError at t = 1 s"),
        ({"torque": reads_beyond}, "torque raised IndexError at t = 0.2 s: index 2 is out of"),
        ({"torque": reads_beyond, "method": "rk4", "dt": 0.1}, "torque raised IndexError"),
        ({"torque": returns_fewer}, "torque must return finite numbers, got .* an exception soon"),
        ({"torque": returns_more}, "torque must return finite numbers, got .* another shape"),
        ({"torque": lambda t: "3"}, "torque raised TypeError at t = 0 s: it must .* got '3'"),
        ({"torque": returns_text_late}, "torque raised TypeError soon after t = .* got '3'"),
        ({"events": lambda t, theta, omega: "3"}, "it must return real numbers, got '3'"),
        ({"torque": nan_late}, "torque must return finite numbers, got NaN"),
        ({"torque": fails_in_python}, "torque raised RuntimeError soon after t = .*no more"),
        ({"torque": lambda t, theta, omega: [1, 2, 3]}, r"shape \(\) or \(2,\), got"),
        ({"torque": Signal([0, 1], [1, 1])}, "sampled over the whole motion, 0 to 5 s"),
        (
            {"torque": Signal([0, 9], [[1, 1, 1]])},
            r"must have the shape \(K,\) or \(K, 2\), got \(1, 3\)",
        ),
        ({"force": lambda t: 1.0}, r"must have base=Cart\(mass\)"),
        ({"torque": fails_late, "method": "rk4", "dt": 0.1}, "torque raised ZeroDivisionError"),
        ({"torque": nan_late, "method": "rk4", "dt": 0.1}, "torque must return finite numbers"),
        (
            {"torque": drive, "pivot_acceleration": Signal([0, 9], [[0, 0], [1, 1]])},
            "all functions",
        ),
        ({"events": lambda t, theta, omega: [1, 2]}, "must return one finite number"),
        ({"events": lambda t, theta, omega: 1 / 0}, "raised ZeroDivisionError"),
        ({"events": Event("angle", rod=2)}, "rod of an event must be from -2 to 1"),
    ],
)
def test_functions_that_fail_are_named(keywords, text):
    with pytest.raises(ValueError, match=text):
        simulate(DOUBLE, 1.0, 0.0, TIMES, **keywords)


@pytest.mark.parametrize("end", [20.0, 2000.0])  # the last in more than one compiled call
@pytest.mark.parametrize(
    "functions",
    [
        {"torque": lambda t, theta, omega: -theta[0]},
        {"torque": lambda t, theta, omega: json.loads(str(-int(theta[0])))},  # raises for NaN
        {"events": lambda t, theta, omega: theta[0] - 1e9},
    ],
)
def test_steps_too_long_are_no_fault_of_the_functions(functions, end):
    with pytest.raises(IntegrationError, match=r"the state diverged .* dt = 0\.\d+ .* shorten it"):
        simulate(Chain.uniform(5), 2.0, 60.0, [0.0, end], method="rk4", dt=0.2, **functions)


# -- events -----------------------------------------------------------------------------------


def test_events_of_a_small_swing_are_at_quarters_of_its_period():
    chain, small = Chain([1.0], [1.0]), 1e-4
    period = 2.0 * np.pi / np.sqrt(9.81)
    motion = simulate(
        chain, small, 0.0, [0.0, 5.0 * period],
        events=[Event("angle"), Event("angle", direction=-1), Event("velocity"),
                Event("height", value=-1.0 + 0.25 * small**2)],
    )  # fmt: skip
    quarters = 0.25 * period * np.arange(1.0, 20.0, 2.0)
    np.testing.assert_allclose(motion.t_events[0], quarters, atol=1e-8)
    np.testing.assert_allclose(motion.t_events[1], quarters[::2], atol=1e-8)
    np.testing.assert_allclose(motion.t_events[2][:9], 0.5 * period * np.arange(1, 10), atol=1e-8)
    # at half the height it rises to: 45 degrees of the phase
    np.testing.assert_allclose(motion.t_events[3][0], 0.125 * period, atol=1e-6)


EVENTS = [
    Event("angle", 0), Event("angular_velocity", -1, direction=-1), Event("velocity"),
    Event("height", 0, -0.9), Event("flip", 1), Event("angle", 1, 0.4, terminal=3),
]  # fmt: skip


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    "chain", [DOUBLE, LINKS, ON_CART, ON_SPRINGS, SPRINGS_ON_CART], ids=lambda chain: f"{chain}"
)
def test_events_of_many_motions_have_the_bits_of_each_alone(chain, method, starts):
    theta, omega = (0.5 * each for each in starts)
    theta[15] = omega[15] = 0.0  # hangs
    options = {"events": EVENTS, **METHODS[method]}
    many = simulate(chain, theta, omega, TIMES, **options)
    assert 0 < many.status.sum() < 37
    shared = simulate([chain] * 37, theta, omega, TIMES, **options, threads=2)
    np.testing.assert_array_equal(shared.theta, many.theta)
    for k in (0, 15, 16, 30, 36):
        alone, own = simulate(chain, theta[k], omega[k], TIMES, **options), many[k]
        for name in ("times", *STATE, "t_events", "theta_events", "omega_events", "counts"):
            assert_same(getattr(own, name), getattr(alone, name))


def test_motions_beside_one_that_fails_after_its_end_keep_their_events():
    one = Chain([1.0], [1.0], stiffness=50.0)  # the rod of the first has no length left soon after
    short, stretch = Event("height", 0, -0.1, terminal=True), np.array([[2.0], [0.1], [0.2]])
    many = simulate(one, np.zeros((3, 1)), 0.0, [0.0, 1.0], stretch=stretch, events=short)
    assert many.status.tolist() == [1, 0, 0]
    for k in (0, 1):
        alone = simulate(one, 0.0, 0.0, [0.0, 1.0], stretch=stretch[k], events=short)
        for name in ("times", *STATE, "t_events"):
            assert_same(getattr(many[k], name), getattr(alone, name))
    with pytest.raises(IntegrationError, match=r"for motion 0 .* no length left"):
        simulate(one, np.zeros((3, 1)), 0.0, [0.0, 1.0], stretch=stretch, events=Event("flip"))


def test_motions_side_by_side_are_looked_at_together(starts, monkeypatch):
    calls, of = [], Event.of
    monkeypatch.setattr(Event, "of", lambda *given: calls.append(1) or of(*given))
    event, (theta, omega) = Event("angle", 0), starts
    simulate(DOUBLE, theta[:1], omega[:1], TIMES, events=event)
    alone = len(calls)
    simulate(DOUBLE, theta[:16], omega[:16], TIMES, events=event)
    assert len(calls) - alone < 3 * alone


def test_an_event_without_slope_at_its_zero_is_found_where_its_sign_changes():
    for function in (
        lambda t, theta, omega: 1.0 if t > 0.77 else -1.0,
        lambda t, theta, omega: (t - 0.77) ** 9,
        lambda t, theta, omega: np.sign(t - 0.77) * 1e-300 ** abs(t - 0.77),
    ):
        found = simulate(DOUBLE, 1.0, 0.0, [0.0, 1.0], events=function).t_events[0]
        np.testing.assert_allclose(found, [0.77], atol=1e-9)


def test_events_are_those_of_scipy_and_change_no_bit_of_the_motion():
    def crossing(t, theta, omega):
        return theta[0] + theta[1] - 1.0

    motion = simulate(DOUBLE, [2.0, 1.0], 0.0, TIMES, events=[crossing, Event("velocity", rod=0)])
    np.testing.assert_array_equal(motion.theta, simulate(DOUBLE, [2.0, 1.0], 0.0, TIMES).theta)
    peer = solve_ivp(
        right_side(DOUBLE), (0, 5), [2, 1, 0, 0], method="DOP853", rtol=1e-12, atol=1e-14,
        max_step=0.02, events=[lambda t, y: y[0] + y[1] - 1.0, lambda t, y: y[2] * np.cos(y[0])],
    )  # fmt: skip
    np.testing.assert_allclose(motion.t_events[0], peer.t_events[0], atol=1e-8)
    np.testing.assert_allclose(motion.t_events[1], peer.t_events[1][1:], atol=1e-8)
    np.testing.assert_allclose(motion.theta_events[0].sum(axis=1), 1.0, atol=1e-11)


def test_a_terminal_event_ends_the_motion_and_its_dense_output_there():
    motion = simulate(DOUBLE, [2.0, 1.0], 0.0, TIMES, events=Event("angle", 0, terminal=True))
    whole, end = simulate(DOUBLE, [2.0, 1.0], 0.0, TIMES), motion.times[-1]
    assert motion.status == 1
    assert end == motion.t_events[0][0]
    assert motion.theta[-1, 0] == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_array_equal(motion.theta[:-1], whole.theta[: motion.times.size - 1])
    np.testing.assert_allclose(motion.at(end)[0], motion.theta[-1], rtol=0, atol=1e-10)
    np.testing.assert_allclose(motion.at(0.9 * end)[0], whole.at(0.9 * end)[0], rtol=0, atol=1e-9)
    with pytest.raises(ValueError, match="within the motion"):
        motion.at(end + 0.1)
    never = simulate(DOUBLE, [0.1, 0.1], 0.0, TIMES, events=Event("flip", 1, terminal=True))
    assert (never.status, never.t_events[0].size, never.times.size) == (0, 0, 51)
    many = simulate(
        DOUBLE, [[2.0, 1.0], [0.1, 0.1]], 0.0, TIMES, events=Event("flip", 1, terminal=True)
    )
    assert many.status.tolist() == [1, 0]
    last = np.searchsorted(TIMES, many.t_events[0][0][0])
    assert np.all(np.isnan(many.theta[0, last:]))
    assert not np.any(np.isnan(many.theta[1]))


@ending
def soon(t, theta, omega):
    return t - 0.3


def fails_later(t, theta, omega):
    if t > 0.5:
        raise ValueError("beyond")
    return 0.0


@pytest.mark.parametrize("options", METHODS.values(), ids=METHODS)
@pytest.mark.parametrize(
    "broken",
    [{"torque": fails_later}, {"torque": lambda t: np.sqrt(0.5 - t)}, {"events": [fails_later]}],
)
def test_what_fails_after_a_terminal_event_does_no_harm(broken, options):
    others = broken.get("events", [])
    torque = {name: each for name, each in broken.items() if name == "torque"}
    motion = simulate(
        DOUBLE, 1.0, 0.0, [0.0, 0.2, 1.0], events=[*others, soon], **torque, **options
    )
    np.testing.assert_allclose(motion.times, [0.0, 0.2, 0.3], atol=1e-12)
    until = simulate(DOUBLE, 1.0, 0.0, [0.0, 0.2, 0.3], **torque, **options)
    np.testing.assert_allclose(motion.theta, until.theta, rtol=0, atol=1e-9)

    @ending
    def late(t, theta, omega):
        return t - 0.7

    for end in (late, lambda t, theta, omega: t - 0.3):
        with pytest.raises(ValueError, match=r" raised |must return finite numbers"):
            simulate(DOUBLE, 1.0, 0.0, [0.0, 1.0], events=[*others, end], **torque, **options)


def test_an_event_may_be_undefined_after_the_end_that_it_sets():
    root = ending(lambda t, theta, omega: np.sqrt(0.5 - t) - 0.4)
    with np.errstate(invalid="ignore"):
        motion = simulate(DOUBLE, 1.0, 0.0, [0.0, 1.0], events=root)
        assert motion.times[-1] == pytest.approx(0.5 - 0.4**2, abs=1e-12)
        root.terminal = False
        with pytest.raises(ValueError, match=r"must return one finite number, got array\(nan\)"):
            simulate(DOUBLE, 1.0, 0.0, [0.0, 1.0], events=root)


@pytest.mark.parametrize("options", [{}, {"method": "rk4", "dt": 1e-3}], ids=["dop853", "rk4"])
def test_a_motion_that_ends_before_a_spring_has_no_length_is_right(options):
    short = ending(lambda t, theta, omega: theta[1] + 0.9)
    one = Chain([1.0], [1.0], stiffness=50.0)
    motion = simulate(one, 0.0, 0.0, [0.0, 1.0], stretch=2.0, events=short, **options)
    rest = 9.81 / 50.0  # about which it swings as a cosine
    end = np.arccos((-0.9 - rest) / (2.0 - rest)) / np.sqrt(50.0)
    assert motion.times[-1] == pytest.approx(end, abs=1e-9)
    with pytest.raises(IntegrationError, match="no length"):
        simulate(one, 0.0, 0.0, [0.0, 1.0], stretch=2.0, **options)


def test_a_motion_among_many_keeps_the_frame_at_which_it_ends():
    half = ending(lambda t, theta, omega: t - 0.5)
    times = np.linspace(0.0, 1.0, 11)
    alone = simulate(DOUBLE, 1.0, 0.0, times, events=half)
    np.testing.assert_array_equal(alone.times, times[:6])
    many = simulate(DOUBLE, [[1.0, 1.0], [1.0, 1.0]], 0.0, times, events=half)
    np.testing.assert_array_equal(many.times, times[:6])
    np.testing.assert_allclose(many[1].theta, alone.theta, rtol=0, atol=1e-12)


@pytest.mark.parametrize("chains", [[DOUBLE, Chain.uniform(2, length=0.5)], [DOUBLE, DOUBLE]])
@pytest.mark.parametrize("second", [1.0, 0.0])  # the rods that hang reach no angle
def test_what_follows_from_motions_that_end_apart_is_that_of_each_up_to_its_end(chains, second):
    given = chains[0] if chains[0] is chains[1] else chains
    starts = [[1.0, 1.0], [second, second]]
    many = simulate(given, starts, 0.0, TIMES, events=Event("angle", rod=0, terminal=True))
    assert many.status.tolist() == [1, int(second > 0.0)]
    names = (
        "lengths", "positions", "centres", "bodies", "velocities", "kinetic_energy", "energy",
    )  # fmt: skip
    for name in names:
        found = getattr(many, name)()
        for k, chain in enumerate(chains):
            whole = getattr(simulate(chain, starts[k], 0.0, TIMES), name)()
            last = int((min(many.t_events[0][k], default=np.inf) > TIMES).sum())
            np.testing.assert_array_equal(found[k, :last], whole[:last])
            assert np.isnan(found[k, last:]).all()
            assert (last < TIMES.size) == bool(many.status[k])


@pytest.mark.parametrize("terminal", [None, False, 0, True, 1, 2, np.int64(3), 99])
@pytest.mark.parametrize("direction", [-1, 0, 1])
def test_a_motion_ends_at_the_occurrence_that_terminal_counts_as_in_scipy(terminal, direction):
    def watched(function):
        function.terminal, function.direction = terminal, direction
        return function

    motion = simulate(
        Chain([1.0], [1.0]), 1.0, 0.0, TIMES,
        events=[watched(lambda _, theta, _omega: theta[0] - 0.2), Event("angular_velocity")],
    )  # fmt: skip
    peer = solve_ivp(
        lambda _, y: [y[1], -9.81 * np.sin(y[0])], (0, 5), [1, 0], rtol=1e-11, atol=1e-13,
        max_step=0.02, events=[watched(lambda _, y: y[0] - 0.2), lambda _, y: y[1]],
    )  # fmt: skip
    assert motion.status == peer.status
    assert motion.times[-1] == pytest.approx(peer.t[-1], abs=1e-8)
    np.testing.assert_allclose(motion.t_events[0], peer.t_events[0], atol=1e-8)
    np.testing.assert_allclose(motion.t_events[1], peer.t_events[1][1:], atol=1e-8)
    if terminal is not None:
        event = Event("angle", 0, 0.2, direction, terminal)
        of_each = simulate(Chain([1.0], [1.0]), [[1.0], [0.1]], 0.0, TIMES, events=event)
        assert of_each.status.tolist() == [motion.status, 0]
        np.testing.assert_array_equal(of_each.t_events[0][0], motion.t_events[0])


@pytest.mark.parametrize(
    ("terminal", "error", "message"),
    [
        (-1, ValueError, "terminal must be at least 0, got -1"),
        (2.0, TypeError, "terminal must be an integer, got 2.0"),
        ("2", TypeError, "terminal must be an integer, got '2'"),
    ],
)
def test_a_terminal_that_counts_no_occurrences_is_refused(terminal, error, message):
    def event(_t, theta, _omega):
        return theta[0]

    event.terminal = terminal
    with pytest.raises(error, match=message):
        simulate(DOUBLE, 1.0, 0.0, TIMES, events=event)
    with pytest.raises(error, match=message):
        Event("angle", terminal=terminal)


def test_the_velocity_of_a_moved_pivot_is_a_pair_for_all_motions_or_one_for_each():
    def first(velocity, count=3):
        start = np.zeros((count, 2))
        lifted = {"pivot_acceleration": (0.0, 0.0), "velocity": velocity}
        return simulate(DOUBLE, start, 0.0, TIMES[:2], **lifted).velocity[:, 0].tolist()

    assert first([1.0, -1.0], count=2) == [[1.0, -1.0]] * 2
    assert first(np.arange(6.0).reshape(3, 2)) == [[0.0, 1.0], [2.0, 3.0], [4.0, 5.0]]
    with pytest.raises(ValueError, match=r"number or two \(sideways and up\), or .*\(3, 2\), got"):
        first([1.0, 2.0, 3.0])
