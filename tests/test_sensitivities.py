"""Derivatives of motions against complex steps of the Lagrangian's equations and closed forms."""

import dataclasses

import numpy as np
import pytest
from lagrangian import all_accelerations
from oracle import complex_slopes, dense_rk4, link_rates
from scipy.integrate import DOP853
from scipy.linalg import expm
from test_derivatives import PARAMETERS, Varied

from npend_gym import Cart, Chain, Event, Signal, Trajectory, simulate
from npend_gym.physics import DifferentiableEnsemble, accelerations
from npend_gym.physics.dense import retaken

pytestmark = pytest.mark.long  # kernels of their own take long to compile

TIMES = np.array([0.0, 0.05, 0.11, 0.3, 0.34])
METHODS = {"rk4": {"method": "rk4", "dt": 0.02}, "dop853": {"rtol": 1e-8, "atol": 1e-10}}


def dense_dop853(rates, y, times, lengths):
    """Steps of the given lengths, with SciPy's coefficients and its dense output."""
    frames, t = [y], times[0]
    for h in lengths:
        k = [rates(y)]
        for row, count in zip(DOP853.A[1:], range(1, 12), strict=True):
            k.append(rates(y + h * np.tensordot(row[:count], k, 1)))
        new = y + h * np.tensordot(DOP853.B, k, 1)
        k.append(rates(new))
        for row, count in zip(DOP853.A_EXTRA, range(13, 16), strict=True):
            k.append(rates(y + h * np.tensordot(row[:count], k, 1)))
        rest = [new - y, h * k[0] - (new - y), 2.0 * (new - y) - h * (k[12] + k[0])]
        rest.extend(h * np.tensordot(row, k, 1) for row in DOP853.D)
        while len(frames) < len(times) and times[len(frames)] <= t + h + 1e-12:
            x, between = (times[len(frames)] - t) / h, 0.0
            for i, each in enumerate(reversed(rest)):
                between = (between + each) * (x if i % 2 == 0 else 1.0 - x)
            frames.append(y + between)
        y, t = new, t + h
    assert len(frames) == len(times)
    return np.array(frames)


def lengths_of(trajectory):
    steps = retaken(trajectory)[0].steps(trajectory.times)
    return steps.end - steps.begin


def torque_in_time(t, _theta, _omega):
    return 1.0 + t * t


def push_in_time(t):
    return 2.0 * np.sin(3.0 * t)


def shake_in_time(t):
    return 2.0 * np.cos(4.0 * t), 3.0 * t


BUMPS, KNOTS = [1.0, 2.0, -1.0, 0.5, 0.0], [0.0, 0.11, 1.0]
# of each kind: what `simulate` is given, then torques, force and acceleration of the pivot at t
DRIVES = {
    "constants": (
        {"torque": [0.7, -0.3, 0.4], "force": 1.5, "pivot_acceleration": (2.3, -1.4)},
        lambda _t: [0.7, -0.3, 0.4, 1.5, 2.3, -1.4],
    ),
    "functions of time": (
        {"torque": torque_in_time, "force": push_in_time, "pivot_acceleration": shake_in_time},
        lambda t: [1.0 + t * t, 0.0, 0.0, push_in_time(t), *shake_in_time(t)],
    ),
    "signals": (
        {
            "torque": Signal(TIMES, np.outer(BUMPS, [1.0, -0.5, 0.2]), "linear"),
            "force": Signal(KNOTS, [2.0, -1.0, 0.5], "linear"),
            "pivot_acceleration": Signal(KNOTS, np.outer([2.0, -1.0, 0.5], [1.0, 2.0]), "linear"),
        },
        lambda t: [
            *(np.interp(t, TIMES, BUMPS) * np.array([1.0, -0.5, 0.2])),
            *(np.interp(t, KNOTS, [2.0, -1.0, 0.5]) * np.array([1.0, 1.0, 2.0])),
        ],
    ),
}
AIR = {"drag": 0.2, "quadratic_drag": 0.15}
SPRINGS = {"stiffness": [90.0, 60.0, 120.0], "axial_damping": 0.4}
MACHINE = AIR | {
    "centres": [0.2, 0.5, 0.3], "inertias": [0.05, 0.1, 0.02], "friction": [0.3, 0.1, 0.2],
    "friction_speed": 0.5, "armature": [0.1, 0.2, 0.05], "gear": [3.0, -2.0, 5.0],
}  # fmt: skip
MECHANISMS = {
    "pivot": AIR,
    "links": {"centres": [0.2, 0.5, 0.3], "inertias": [0.05, 0.1, 0.02]},
    "machine": MACHINE,
    "cart": AIR | {"base": Cart(1.5, 0.3)},
    "machine on a cart": MACHINE | {"base": Cart(1.5, 0.3)},
    "springs": SPRINGS,
    "springs in air on a cart": AIR | SPRINGS | {"base": Cart(1.5, 0.3)},
    "accelerated pivot": AIR,
    "machine on an accelerated pivot": MACHINE,
    "springs in air on an accelerated pivot": AIR | SPRINGS,
}


def with_clock(rates, size):
    """Return rates of a state that has the time behind it, so that steps carry it along."""
    return lambda y: np.append(rates(y[-1].real, y[:size]), 1.0)


@pytest.mark.parametrize(
    ("mechanism", "drives", "method"),
    [  # drives take turns: a mechanism has both methods, and two of the three drives
        (mechanism, [*DRIVES][(k + turn) % 3], method)
        for k, mechanism in enumerate(MECHANISMS)
        for turn, method in enumerate(METHODS)
    ],
)
def test_every_mechanism_has_the_derivatives_of_the_lagrangian(mechanism, drives, method):
    chain = Chain([1.0, 0.6, 0.8], [0.5, 0.8, 0.4], damping=0.1, **MECHANISMS[mechanism])
    stretching, on_cart = chain.stiffness is not None, chain.base is not None
    accelerated = "accelerated" in mechanism
    given, loads_at = DRIVES[drives]
    used = {"torque": True, "force": on_cart, "pivot_acceleration": accelerated}
    given = {name: each for name, each in given.items() if used[name]}
    start = {"position": 0.2, "velocity": -0.4} if on_cart else {}
    start |= {"velocity": (0.3, -0.2)} if accelerated else {}
    start |= {"stretch": [0.1, 0.05, -0.02], "stretch_rate": 0.2} if stretching else {}
    made = simulate(
        chain, [0.9, -0.4, 0.2], [0.5, 1.0, -0.6], TIMES, **start, **given, **METHODS[method]
    )
    values = {name: getattr(chain, name) for name in PARAMETERS["machine"]}
    parameters = [name for name in PARAMETERS["bobs"] if np.any(values[name])]
    for kind in ("links", "machine"):
        parameters = PARAMETERS[kind] if kind in mechanism else parameters
    if stretching:
        values |= {name: getattr(chain, name) for name in SPRINGS}
        parameters = [*parameters, *SPRINGS]
    state, lengths = retaken(made)[1], lengths_of(made)
    m, count = state.size // 2, 3 + on_cart

    def base_at(t):
        if accelerated:
            return {"acceleration": loads_at(t)[4:]}
        return {"cart_mass": 1.5, "rail_damping": 0.3} if on_cart else None

    def moved(change, name=None):
        """Return the frames after a change of the state and the loads, or of a parameter."""
        own = dict(values)
        if name is not None:
            own[name] = own[name] + (change[0] if name == "gravity" else change)
            if name == "lengths" and chain.has_bobs:
                own["centres"] = own["lengths"]
            change = np.zeros(2 * m + count)

        def rates(t, y):
            q, u = np.split(y, 2)
            loads = np.array(loads_at(t)[:count]) + change[2 * m :]
            return np.concatenate([u, all_accelerations(own, q, u, loads, base_at(t))])

        y = np.append(state + change[: 2 * m], TIMES[0])
        clocked = with_clock(rates, 2 * m)
        if method == "rk4":
            return dense_rk4(clocked, y, TIMES, made.recipe.settings["dt"])[:, :-1]
        return dense_dop853(clocked, y, TIMES, lengths)[:, :-1]

    parts = (made.theta, made.position, made.stretch)
    columns = [part.reshape(TIMES.size, -1) for part in parts if part is not None]
    found = moved(np.zeros(2 * m + count))[:, :m]
    np.testing.assert_allclose(found, np.hstack(columns), rtol=0, atol=1e-12)
    expected = complex_slopes(moved, 2 * m + count)
    got = made.sensitivities(joints=range(3))  # and the force
    both = np.concatenate([got.A, got.B], axis=-1)
    assert np.abs(both - expected).max() <= 1e-12 * np.abs(expected).max()
    bars = np.random.default_rng(0).normal(size=(2, TIMES.size, m))
    weights = np.concatenate([*bars], axis=1)
    gradient = made.gradient(*bars, parameters=parameters)
    backward = np.hstack([gradient.by_theta, gradient.by_omega, gradient.by_torque])
    product = np.tensordot(weights, expected, 2)
    assert np.abs(backward - product).max() <= 1e-12 * np.abs(expected).max() * weights.size
    for name in parameters:
        size = 1 if name == "gravity" else 3
        expected = complex_slopes(lambda change, name=name: moved(change, name), size)
        scale = max(np.abs(expected).max(), 1e-3)
        got = made.sensitivities((), {name: [1.0] if name == "gravity" else np.eye(3)}).C
        assert np.abs(got - expected).max() <= 1e-12 * scale, name
        product = np.tensordot(weights, expected, 2)
        error = np.abs(gradient.by_parameters[name] - product).max()
        assert error <= 1e-11 * scale * weights.size, name


@pytest.mark.parametrize("method", METHODS)
def test_samples_held_constant_are_differentiated_as_segments_one_after_another(method):
    chain, knots, values = Chain.uniform(2, base=Cart(2.0)), [0.0, 0.11, 0.34], [3.0, -2.0]
    whole = simulate(
        chain, 1.0, 0.5, TIMES, torque=0.3, force=Signal(knots, values), **METHODS[method]
    )
    first = simulate(chain, 1.0, 0.5, TIMES[:3], torque=0.3, force=3.0, **METHODS[method])
    then = simulate(
        chain, first.theta[-1], first.omega[-1], TIMES[2:], position=first.position[-1],
        velocity=first.velocity[-1], torque=0.3, force=-2.0, **METHODS[method],
    )  # fmt: skip
    np.testing.assert_array_equal(whole.theta[2:], then.theta)
    got, before, after = (each.sensitivities((0,)) for each in (whole, first, then))
    np.testing.assert_allclose(got.A[2:], after.A @ before.A[-1], rtol=1e-11, atol=1e-12)
    expected = after.A @ before.B[-1] + after.B
    np.testing.assert_allclose(got.B[2:], expected, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("method", METHODS)
def test_small_motions_change_as_the_linear_equations_say(method):
    """A pendulum swings by cosines, a chain by the exponential of its matrix."""
    settings = METHODS[method] | {"dt": 2e-3 if method == "rk4" else 0.05}
    times = np.linspace(0.0, 3.0, 7)
    pendulum = Chain([2.0], [0.7])
    w = np.sqrt(9.81 / 0.7)
    cos, sin = np.cos(w * times), np.sin(w * times)
    got = simulate(pendulum, 0.0, 0.0, times, **settings).sensitivities()
    expected = np.array([[cos, sin / w], [-w * sin, cos]])
    np.testing.assert_allclose(got.A, np.moveaxis(expected, 2, 0), atol=1e-7)
    swing = (1.0 - cos) / (2.0 * 9.81 * 0.7)  # about a mean pushed aside by the torque
    np.testing.assert_allclose(got.B[:, 0, 0], swing, atol=1e-7)

    chain = Chain([1.0, 2.0, 0.5], [0.5, 1.0, 0.8], damping=0.1)
    a = complex_slopes(link_rates(Varied.of(chain), np.zeros(3)), 6)
    got = simulate(chain, 0.0, 0.0, times, **settings).sensitivities()
    np.testing.assert_allclose(got.A, [expm(a * t) for t in times], atol=1e-7)


@pytest.mark.parametrize("bars", [None, (1.0, 0.0)])
def test_steps_of_a_chain_at_rest_that_are_too_long_for_derivatives_are_refused(bars):
    times, chain = np.linspace(0.0, 10.0, 3), Chain.uniform(2)
    a = complex_slopes(link_rates(Varied.of(chain), np.zeros(2)), 4)

    def derive(**settings):
        motion = simulate(chain, 0.0, 0.0, times, **settings)
        return motion.sensitivities() if bars is None else motion.gradient(*bars)

    with pytest.raises(ValueError, match=r"dt must be at most 0\.0855 s in `simulate`") as refused:
        derive()
    longest = float(str(refused.value).split("at most ")[1].split(" s")[0])
    found, exact = derive(dt=longest), np.array([expm(a * t) for t in times])
    if bars is None:
        np.testing.assert_allclose(found.A, exact, atol=1e-6)
    else:
        expected = exact[:, :2].sum(axis=(0, 1))  # all angles at all times
        np.testing.assert_allclose([*found.by_theta, *found.by_omega], expected, atol=1e-6)


@pytest.mark.parametrize(
    ("chain", "theta", "more"),
    [
        (Chain.uniform(2, base=Cart(1.0)), 0.0, {"velocity": 0.5}),
        (Chain.uniform(2), 0.0, {"pivot_acceleration": (0.0, 1.0)}),
        (Chain.uniform(2), 0.0, {"pivot_acceleration": (0.0, 0.0), "velocity": (0.3, 0.0)}),
        (Chain.uniform(2), np.pi, {}),  # the sine of pi is not 0: it leaves within the tolerance
        (Chain.uniform(2, damping=5.0, gravity=0.0), 0.0, {}),
        (Chain.uniform(2, stiffness=1e3), 0.0, {}),
    ],
    ids=["rolling", "accelerated", "carried along", "upright", "damped", "springs"],
)
def test_rods_that_rest_on_a_base_that_moves_or_to_the_tolerance_alone_are_refused(
    chain, theta, more
):
    times = np.linspace(0.0, 3.0, 3)  # until it falls, changes grow by 10^8
    with pytest.raises(ValueError, match="dt must be at most") as refused:
        simulate(chain, theta, 0.0, times, **more).sensitivities()
    longest = float(str(refused.value).split("at most ")[1].split(" s")[0])
    found, exact = (
        simulate(chain, theta, 0.0, times, dt=dt, **more).sensitivities().A
        for dt in (longest, longest / 4.0)
    )
    np.testing.assert_allclose(found, exact, atol=1e-6 * np.abs(exact).max())


@pytest.mark.parametrize("more", [{"gravity": 0.0}, {}], ids=["no gravity", "free fall"])
def test_rods_that_nothing_pulls_rest_in_any_step(more):
    drives = {} if more else {"pivot_acceleration": (0.0, -Chain.uniform(2).gravity)}
    motion = simulate(Chain.uniform(2, **more), 0.0, 0.0, np.linspace(0.0, 10.0, 3), **drives)
    np.testing.assert_allclose(motion.sensitivities().A[-1, 0, [0, -2 if more else 4]], [1.0, 10.0])


def test_a_motion_carries_its_own_velocity_along():
    """Where nothing depends on time, d (theta, omega)/dt is a tangent vector, in closed form."""
    chain, times = Chain([1.0, 2.0], [1.0, 0.5]), np.linspace(0.0, 4.0, 41)
    motion = simulate(chain, [1.0, -0.5], [0.0, 1.0], times, rtol=1e-13, atol=1e-14)
    rates = np.hstack([motion.omega, accelerations(chain, motion.theta, motion.omega)])
    carried = motion.sensitivities().A @ rates[0]
    np.testing.assert_allclose(carried, rates, atol=1e-10 * np.abs(rates).max())


@pytest.mark.parametrize("method", METHODS)
def test_the_way_back_through_many_segments_is_the_way_forward(method):
    chain, times = Chain.uniform(2, damping=0.2), np.linspace(0.0, 12.0, 50)
    settings = METHODS[method] | ({"rtol": 1e-11} if method == "dop853" else {})
    made = simulate(chain, 1.0, 0.5, times, torque=0.3, **settings)
    assert len(lengths_of(made)) > 100  # more than three segments
    bars = np.random.default_rng(0).normal(size=(2, 50, 2))
    ways = {"lengths": np.eye(2), "drag": np.zeros((2, 2))}
    ways = made.sensitivities((0, 1), ways | {"drag": [[0.0, 0.0], [0.0, 1.0]]})
    weights = np.concatenate([*bars], axis=1)
    expected = [np.tensordot(weights, way, 2) for way in ways]
    got = made.gradient(*bars, parameters=["lengths", "drag"])
    rows = got.by_parameters
    np.testing.assert_allclose(np.hstack([got.by_theta, got.by_omega]), expected[0], rtol=1e-11)
    np.testing.assert_allclose(got.by_torque, expected[1], rtol=1e-11)
    together = [rows["lengths"][0], rows["lengths"][1] + rows["drag"][1]]
    np.testing.assert_allclose(together, expected[2], rtol=1e-11)


def test_a_trajectory_of_one_instant_is_its_start():
    made = simulate(Chain.uniform(2), 1.0, 0.0, [3.0])
    np.testing.assert_array_equal(made.sensitivities().A, np.eye(4)[None])
    got = made.gradient([[1.0, 2.0]], 3.0)
    assert (got.by_theta.tolist(), got.by_omega.tolist()) == ([1.0, 2.0], [3.0, 3.0])


def test_a_saved_trajectory_keeps_its_derivatives(tmp_path):
    made = simulate(Chain.uniform(2), 1.0, 0.0, TIMES, torque=0.3)
    made.save(tmp_path / "motion.npz")
    kept = Trajectory.load(tmp_path / "motion.npz")
    np.testing.assert_array_equal(kept.sensitivities().A, made.sensitivities().A)


def test_motions_without_derivatives_are_refused_by_name():
    chain = Chain.uniform(2)
    made = simulate(chain, 1.0, 0.0, TIMES)
    by_hand = Trajectory(chain, TIMES, made.theta, made.omega)
    for derive in (by_hand.sensitivities, lambda: by_hand.gradient(1.0, 0.0)):
        with pytest.raises(ValueError, match=r"need a trajectory made by simulate\(\)"):
            derive()
    many = simulate(chain, [[1.0, 0.5], [0.5, 1.0]], 0.0, TIMES)
    with pytest.raises(ValueError, match=r"those of one motion, got 2: take trajectory\[k\]"):
        many.sensitivities()
    for torque in (
        lambda _t, _theta, omega: -0.1 * omega,
        lambda t, theta, _omega: 1.0 if t < TIMES[1] else -theta[0],
        lambda _t, _theta, omega: np.sign(omega[0] - omega[1]),
    ):
        fed_back = simulate(chain, 1.0, 0.5, TIMES, torque=torque)
        for derive in (fed_back.sensitivities, lambda made=fed_back: made.gradient(1.0, 0.0)):
            with pytest.raises(ValueError, match="torque must depend on time alone"):
                derive()
    ended = simulate(chain, 1.0, 0.0, TIMES, events=Event("angle", 0, value=0.9, terminal=True))
    assert ended.status == 1
    with pytest.raises(ValueError, match="an event ended it"):
        ended.gradient(1.0, 0.0)
    other = dataclasses.replace(made, chain=Chain.uniform(2, length=1.1))
    for derive in (other.sensitivities, lambda: other.gradient(1.0, 1.0)):
        with pytest.raises(ValueError, match="does not end where its start and settings lead"):
            derive()
    with pytest.raises(ValueError, match="stiffness cannot be differentiated for this kind"):
        made.gradient(1.0, 0.0, ["stiffness"])
    with pytest.raises(TypeError, match=r"list of names such as \('masses',\), got 'masses'"):
        made.gradient(1.0, 0.0, "masses")
    for name, value, rule in (
        ("masses", [[1.0, 2.0, 3.0]], r"\(1, 2\), got \(1, 3\)"),
        ("masses", [1.0, 2.0, 3.0], r"\(K, 2\) for K directions, got \(3,\)"),
        ("gravity", 1.0, r"\(K,\) for K directions, got \(\)"),
    ):
        with pytest.raises(ValueError, match=f"{name} must have the shape {rule}"):
            made.sensitivities(parameters={name: value})
    two = {"masses": np.ones((2, 2)), "gravity": [1.0]}
    with pytest.raises(ValueError, match=r"gravity must have the shape \(2,\), got \(1,\)"):
        made.sensitivities(parameters=two)
    with pytest.raises(ValueError, match="joint must"):
        made.sensitivities(joints=[2])
    with pytest.raises(ValueError, match="theta_bar must"):
        made.gradient(np.zeros(3), 0.0)
    with pytest.raises(ValueError, match="theta_bar must be a number or a rectangular array"):
        made.gradient([[1.0], [1.0, 2.0]], 0.0)
    wild = simulate(Chain.uniform(5), 2.0, 0.0, np.linspace(0.0, 400.0, 5), rtol=1e-6)
    with pytest.raises(FloatingPointError, match=r"beyond all bounds until t = \d+\.?\d* s"):
        wild.sensitivities()
    with pytest.raises(FloatingPointError, match=r"beyond all bounds until t = \d00 s"):
        wild.gradient(1.0, 0.0)


@pytest.mark.parametrize(
    "chain",
    [Chain.acrobot(), Chain.uniform(2), Chain.uniform(2, base=Cart(1.0), damping=0.1)],
    ids=["links", "bobs", "cart"],
)
@pytest.mark.parametrize("name", ["drag", "quadratic_drag", "friction", "armature", "inertias"])
def test_motions_are_differentiated_by_parameters_that_are_zero(chain, name):
    h, given = 1e-6, {"rtol": 1e-12, "atol": 1e-14}
    own = np.array(getattr(chain, name))
    ends = [
        simulate(Chain.from_dict(chain.as_dict() | {name: own + k * h}), 1.0, 0.3, TIMES, **given)
        for k in (0, 1, 2)
    ]
    near = [end.theta[-1] for end in ends]
    expected = (4.0 * near[1] - near[2] - 3.0 * near[0]) / (2.0 * h)  # none may be below zero
    found = ends[0].sensitivities(parameters={name: np.ones((1, 2))}).C[-1, :2, 0]
    np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-5)
    by_all = ends[0].gradient(1.0, 0.0, [name]).by_parameters[name].sum()
    whole = ends[0].sensitivities(parameters={name: np.ones((1, 2))}).C[:, :2, 0].sum()
    np.testing.assert_allclose(by_all, whole, rtol=1e-8)


@pytest.mark.parametrize(
    ("chain", "name"),
    [(Chain.acrobot(), "drag"), (Chain.uniform(2), "armature"), (Chain.uniform(2), "inertias")],
)
def test_an_ensemble_made_as_the_refusal_of_a_parameter_says_can_be_differentiated(chain, name):
    def derive(of):
        ensemble = DifferentiableEnsemble(of, 2)
        ensemble.set_state(slice(None), 0.3)
        return ensemble.step_vjp(0.0, 0.01, theta_bar=1.0, omega_bar=0.0, parameters=[name])[-1][
            name
        ]

    with pytest.raises(ValueError, match=f"{name} cannot be differentiated") as refused:
        derive(chain)
    assert "give it rotors, armature=1e-30 at least" in str(refused.value)
    assert np.all(np.isfinite(derive(Chain.from_dict(chain.as_dict() | {"armature": 1e-30}))))


def test_a_chain_of_rigid_rods_has_no_stiffness_to_differentiate_by():
    motion = simulate(Chain.uniform(2), 0.3, 0.0, TIMES)
    with pytest.raises(ValueError, match=r"simulate a chain with springs, Chain\(..., stiffness"):
        motion.sensitivities(parameters={"stiffness": [[1.0, 0.0]]})
