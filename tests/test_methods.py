"""The methods of `simulate` beside DOP853: their order, what they keep, how one is added."""

from pathlib import Path

import numpy as np
import pytest
from scripts import changed_copy, run_python

from npend_gym import Cart, Chain, Event, IntegrationError, Trajectory, simulate
from npend_gym.physics import Signal, momentum_jacobian
from npend_gym.physics.kernels.methods import METHODS

ROOT = Path(__file__).resolve().parents[1]
TIMES = np.linspace(0.0, 2.0, 9)
BODIES = {"centres": [0.5, 0.3], "inertias": [0.08, 0.02]}
CHAINS = {
    "bobs": Chain([1.0, 0.7], [1.0, 0.6]),
    "links on a cart": Chain([1.0, 0.7], [1.0, 0.6], base=Cart(2.0), **BODIES),
    "rotors": Chain([1.0, 0.7], [1.0, 0.6], armature=[0.1, 0.02], gear=[3.0, 5.0], **BODIES),
    "springs": Chain([1.0, 0.7], [1.0, 0.6], stiffness=[200.0, 300.0]),
    "all": Chain(
        [1.0, 0.7], [1.0, 0.6], armature=[0.1, 0.02], gear=[3.0, 5.0], base=Cart(2.0),
        stiffness=[200.0, 300.0], **BODIES,
    ),
}  # fmt: skip
BY_NIGHT = [pytest.mark.long, pytest.mark.nightly]  # "all" has what they have
each_kind = pytest.mark.parametrize(
    "kind",
    [
        pytest.param(k, marks={"bobs": [], "all": [pytest.mark.long]}.get(k, BY_NIGHT))
        for k in CHAINS
    ],
)
SYMPLECTIC = "midpoint", "gauss4", "gauss6"


def moved(chain, times=TIMES, **more):
    return simulate(chain, [1.0, 0.4], [0.3, -0.2], times, torque=[0.1, -0.2], **more)


def misses_of_orders(weights, tableau, instants, part=1.0):
    """By how much a method misses the conditions of orders 1 to 5, up to a part of its step."""
    one, a, c = np.ones(len(instants)), tableau, instants
    conditions = {
        1: [(one, 1)],
        2: [(c, 2)],
        3: [(c**2, 3), (a @ c, 6)],
        4: [(c**3, 4), (c * (a @ c), 8), (a @ c**2, 12), (a @ a @ c, 24)],
        5: [
            (c**4, 5), (c**2 * (a @ c), 10), ((a @ c) ** 2, 20), (c * (a @ c**2), 15),
            (a @ c**3, 20), (c * (a @ a @ c), 30), (a @ (c * (a @ c)), 40), (a @ a @ c**2, 60),
            (a @ a @ a @ c, 120),
        ],
    }  # fmt: skip
    return [
        max(abs(weights @ vector - part**order / number) for vector, number in own)
        for order, own in conditions.items()
    ]


@pytest.mark.parametrize(("name", "order", "estimate", "dense"), [
    ("dop853", 5, 5, 5), ("tsit5", 5, 4, 4), ("rk4", 4, 0, 3),
])  # fmt: skip
def test_coefficients_of_explicit_methods_meet_the_conditions_of_their_order(
    name, order, estimate, dense
):
    method = METHODS[name]
    parts = method.tableau, method.instants
    rows, end = len(method.tableau), method.tableau[method.stages]
    np.testing.assert_allclose(method.tableau.sum(axis=1), method.instants, atol=2e-15)
    misses = misses_of_orders(end, *parts)
    assert max(misses[:order]) < 1e-14
    assert all(each > 1e-4 for each in misses[order:])
    if estimate:
        other = end + np.pad(method.errors[0], (0, rows - method.errors.shape[1]))
        misses = misses_of_orders(other, *parts)
        assert max(misses[:estimate]) < 1e-14
        assert all(each > 1e-4 for each in misses[estimate:])
    if name != "rk4":
        for part in (0.3, 0.8):
            (weights,) = method.weights(np.array([part]))
            misses = misses_of_orders(weights, *parts, part)
            assert max(misses[:dense]) < 1e-13
            assert all(each > 1e-4 for each in misses[dense:])


@pytest.mark.parametrize(("method", "order", "dt"), [
    pytest.param("midpoint", 2, 0.01, marks=pytest.mark.long),
    ("gauss4", 4, 0.02), ("gauss6", 6, 0.025),
])  # fmt: skip
def test_the_error_of_a_symplectic_method_falls_with_the_order_that_it_has(method, order, dt):
    exact = moved(CHAINS["bobs"], rtol=1e-13, atol=1e-14)
    between = np.linspace(0.0, 2.0, 100)
    errors = []
    for step in (dt, 0.5 * dt):
        own = moved(CHAINS["bobs"], method=method, dt=step)
        inside = np.abs(np.subtract(own.at(between), exact.at(between))).max()
        errors.append([np.abs(own.theta - exact.theta).max(), inside])
    at_times, inside = np.log2(np.divide(*errors))
    assert at_times == pytest.approx(order, abs=0.2)
    assert inside > min(order, 5) - 0.2


@pytest.mark.long  # kernels of several methods
@each_kind
def test_symplectic_motions_of_all_chains_are_those_of_the_adaptive_method(kind):
    exact = moved(CHAINS[kind], rtol=1e-12, atol=1e-13)
    many = simulate(
        CHAINS[kind], np.tile([[1.0, 0.4], [0.2, 0.1]], (9, 1)), [0.3, -0.2], TIMES,
        torque=[0.1, -0.2], method="gauss6", dt=0.005,
    )  # fmt: skip
    one = moved(CHAINS[kind], method="gauss6", dt=0.005)
    np.testing.assert_allclose(one.theta, exact.theta, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(many.theta[4], one.theta)


@pytest.mark.long
@pytest.mark.parametrize("kind", [pytest.param(k, marks=BY_NIGHT) for k in CHAINS])
def test_a_symplectic_step_keeps_the_two_form_of_coordinates_and_momenta(kind):
    chain, m = CHAINS[kind], CHAINS[kind].coordinates
    form = np.block([[np.zeros((m, m)), np.eye(m)], [-np.eye(m), np.zeros((m, m))]])
    misses = []
    for method in ("gauss4", "rk4"):
        own = moved(chain, [0.0, 1.0], method=method, dt=0.05 if m == 2 else 0.02)
        ends = []
        for k in range(2):
            parts = [own.theta, own.position, own.stretch], [
                own.omega, own.velocity, own.stretch_rate,
            ]  # fmt: skip
            q, u = (
                np.concatenate([np.atleast_1d(x[k]) for x in each if x is not None])
                for each in parts
            )
            ends.append(np.vstack([np.eye(m, 2 * m), momentum_jacobian(chain, q, u)]))
        step = ends[1] @ own.sensitivities().A[-1] @ np.linalg.inv(ends[0])
        misses.append(np.abs(step.T @ form @ step - form).max() / np.abs(step).max() ** 2)
    assert misses[0] < 1e-11
    assert misses[1] > 1e-8


def test_the_error_of_the_energy_does_not_grow_in_time():
    times = np.linspace(0.0, 2000.0, 8001)
    chain = Chain.uniform(2)
    found = {
        method: simulate(chain, [1.0, -0.5], 0.0, times, method=method, dt=0.02).energy()
        for method in (*SYMPLECTIC, "rk4")
    }
    for method, energy in found.items():
        errors = np.abs(energy - energy[0])
        early, late = errors[:800].max(), errors[-800:].max()
        assert (late < 1.2 * early) == (method != "rk4")


@pytest.mark.long
@each_kind
def test_derivatives_of_symplectic_steps_are_those_of_differences(kind):
    chain, h, options = CHAINS[kind], 1e-5, {"method": "gauss4", "dt": 0.05}
    names = ["masses", "lengths", "gravity", "damping"]
    names += ["centres", "inertias", "armature", "gear"] if chain.armature.any() else []
    names += ["stiffness"] if chain.stiffness is not None else []
    count = len(names)
    values = {name: np.array(getattr(chain, name)) for name in names}
    directions = {
        name: np.zeros((count, *value.shape)) for name, value in values.items()
    }  # fmt: skip
    for k, name in enumerate(names):
        directions[name][k] = 1.0
    times = np.array([0.0, 0.33, 1.0])
    own = moved(chain, times, **options)
    found = own.sensitivities([0, 1], directions)
    start = {"theta": np.array([1.0, 0.4]), "omega": np.array([0.3, -0.2])}

    def end(torque=(0.1, -0.2), made=chain, **more):
        given = start | more
        if made.stiffness is not None:
            given |= {"stretch": own.stretch[0], "stretch_rate": own.stretch_rate[0]}
        given = simulate(made, given.pop("theta"), given.pop("omega"), times, torque=torque,
                         **given, **options)  # fmt: skip
        return given.theta

    def difference(change):
        return (change(h) - change(-h)) / (2.0 * h)

    m = chain.coordinates
    near = difference(lambda e: end(theta=start["theta"] + [0.0, e]))
    np.testing.assert_allclose(found.A[:, :2, 1], near, rtol=0, atol=1e-7)
    near = difference(lambda e: end(omega=start["omega"] + [e, 0.0]))
    np.testing.assert_allclose(found.A[:, :2, m], near, rtol=0, atol=1e-7)
    near = difference(lambda e: end(torque=(0.1, -0.2 + e)))
    np.testing.assert_allclose(found.B[:, :2, 1], near, rtol=0, atol=1e-7)
    for k, name in enumerate(names):
        if name != "damping":  # of chains without
            near = difference(
                lambda e, name=name: end(
                    made=Chain.from_dict(chain.as_dict() | {name: values[name] + e})
                )
            )
            np.testing.assert_allclose(found.C[:, :2, k], near, rtol=1e-6, atol=1e-6)
    bars = np.random.default_rng(0).normal(size=(3, 2))
    back = own.gradient(bars, 0.0, names)
    np.testing.assert_allclose(
        back.by_theta, np.einsum("ti,tij->j", bars, found.A[:, :2, :m]), rtol=1e-10, atol=1e-10
    )
    for k, name in enumerate(names):
        along = np.einsum("ti,ti->", bars, found.C[:, :2, k])
        assert np.sum(back.by_parameters[name]) == pytest.approx(along, rel=1e-9, abs=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("method", ["tsit5", pytest.param("gauss6", marks=BY_NIGHT)])
def test_events_signals_and_files_go_with_every_method(method, tmp_path):
    options = {"rtol": 1e-11, "atol": 1e-13} if method == "tsit5" else {"dt": 0.01}
    chain, pushed = CHAINS["bobs"], Signal([0.0, 0.55, 1.3, 9.0], [0.1, -0.4, 0.3, 0.0])
    watched = [Event("angular_velocity", 0), Event("angle", 1, direction=-1, terminal=2)]
    given = chain, [1.0, 0.4], 0.2, np.linspace(0.0, 9.0, 50)
    found = simulate(*given, torque=pushed, events=watched, method=method, **options)
    exact = simulate(*given, torque=pushed, events=watched, rtol=1e-12, atol=1e-13)
    assert found.status == exact.status == 1
    for own, other in zip(found.t_events, exact.t_events, strict=True):
        np.testing.assert_allclose(own, other, rtol=0, atol=1e-7)
    again = simulate(*given, torque=lambda t: 0.2 * np.sin(3.0 * t), method=method, **options)
    other = simulate(*given, torque=lambda t: 0.2 * np.sin(3.0 * t), rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(again.theta, other.theta, rtol=0, atol=1e-6)
    plain = simulate(*given, method=method, **options)
    plain.save(tmp_path / "a.npz")
    loaded = Trajectory.load(tmp_path / "a.npz")
    np.testing.assert_array_equal(loaded.at([3.3])[0], plain.at([3.3])[0])


def test_steps_and_evaluations_of_a_pair_are_counted():
    counted = []
    exact = moved(CHAINS["bobs"], rtol=1e-13, atol=1e-14).theta
    for tolerance in (1e-5, 1e-7, 1e-9):
        own = moved(CHAINS["bobs"], method="tsit5", rtol=tolerance, atol=tolerance)
        counted.append([np.abs(own.theta - exact).max(), own.steps])
        assert own.nfev == 2 + 6 * (own.steps + own.refused_steps)
    errors, steps = np.transpose(counted)
    slopes = np.diff(np.log(errors)) / np.diff(np.log(steps))
    np.testing.assert_allclose(slopes, -5.0, atol=0.8)


@pytest.mark.parametrize(("more", "given", "message"), [
    ({"damping": 0.1}, {}, "damping, friction and drag must be zero"),
    ({"friction": 0.1}, {}, 'use method "dop853"'),
    ({"quadratic_drag": 0.1}, {}, "for chains that keep their energy"),
    ({"base": Cart(1.0, damping=0.1)}, {}, "must be zero"),
    ({}, {"pivot_acceleration": [1.0, 0.0]}, "pivot_acceleration must be None"),
    ({}, {"dt": None}, 'dt must be given with method "gauss4"'),
])  # fmt: skip
def test_what_a_symplectic_method_is_not_for_is_refused_with_the_way_out(more, given, message):
    with pytest.raises(ValueError, match=message):
        simulate(Chain(1.0, 1.0, **more), 1.0, 0.0, TIMES, method="gauss4", **{"dt": 0.1} | given)


def test_a_symplectic_step_that_is_too_long_says_so():
    with pytest.raises(IntegrationError, match="dt is too long for this chain"):
        simulate(Chain.uniform(3), 2.0, 0.0, [0.0, 100.0], method="gauss4", dt=2.0)
    own = moved(CHAINS["bobs"], method="gauss4", dt=0.1)
    with pytest.raises(ValueError, match="friction cannot be differentiated"):
        own.sensitivities(parameters={"friction": np.ones((1, 2))})


# Bogacki and Shampine, Appl. Math. Lett. 2 (1989)
BS23 = """
from npend_gym.physics.kernels.pairs import Pair, pair

BS23: Pair = pair(
    [[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.0, 0.75, 0.0]], [2 / 9, 1 / 3, 4 / 9], [0.0, 0.5, 0.75],
    [2 / 9 - 7 / 24, 1 / 3 - 1 / 4, 4 / 9 - 1 / 3, -1 / 8], 2,
)
"""
ADDED = (
    "npend_gym/physics/kernels/methods.py",
    [
        (
            "from npend_gym.physics.kernels.dop853 import DOP853\n",
            (
                "from npend_gym.physics.kernels.bs23 import BS23\n"
                "from npend_gym.physics.kernels.dop853 import DOP853\n"
            ),
        ),
        ('"tsit5": TSIT5,', '"tsit5": TSIT5, "bs23": BS23,'),
    ],
)
USED = """
import numpy as np
from npend_gym import Chain, Event, simulate
from npend_gym.cli import main

chain, times = Chain([1.0, 0.7], [1.0, 0.6]), np.linspace(0.0, 2.0, 9)
exact = simulate(chain, 1.0, 0.0, times, rtol=1e-12, atol=1e-13)
errors = []
for tolerance in (1e-6, 1e-9):
    options = {"method": "bs23", "rtol": tolerance, "atol": tolerance}
    own = simulate(chain, 1.0, 0.0, times, events=Event("angular_velocity", 0), **options)
    errors.append([np.abs(own.theta - exact.theta).max(), own.steps])
(coarse, few), (fine, many) = errors
assert 2.5 < np.log(coarse / fine) / np.log(many / few) < 3.5
assert np.abs(np.subtract(own.at(0.77), exact.at(0.77))).max() < 1e-6
turned = simulate(chain, 1.0, 0.0, times, events=Event("angular_velocity", 0)).t_events[0]
np.testing.assert_allclose(own.t_events[0], turned, atol=1e-6)
found, h = own.sensitivities().A[-1, :2, 0], 1e-4
ends = [simulate(chain, [1.0 + e, 1.0], 0.0, times, rtol=1e-12, atol=1e-13).theta[-1]
        for e in (h, -h)]
np.testing.assert_allclose(found, (ends[0] - ends[1]) / (2 * h), atol=1e-4)
bars = np.zeros((9, 2)); bars[-1, 0] = 1.0
np.testing.assert_allclose(own.gradient(bars, 0.0).by_theta, own.sensitivities().A[-1, 0, :2])
assert main(["simulate", "-n", "2", "--duration", "1", "--method", "bs23"]) == 0
"""


@pytest.mark.long
@pytest.mark.nightly
def test_an_integrator_with_all_that_belongs_to_it_takes_two_files(tmp_path):
    environment = changed_copy(tmp_path, [ADDED])
    added = tmp_path / "npend_gym" / "physics" / "kernels" / "bs23.py"
    added.write_text(BS23, encoding="utf-8")
    run_python("-c", USED, env=environment, cwd=tmp_path)
