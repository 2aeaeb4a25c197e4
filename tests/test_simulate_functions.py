"""Functions that drive a motion or are its events: none is missed while the chain is at rest."""

# ruff: noqa: ARG001, ARG002, ARG005  functions of users have the arguments that they are called with

import enum
import math
import sys
import types

import numba
import numpy as np
import oracle
import pytest

from npend_gym import Cart, Chain, Signal, chaos, simulate
from npend_gym.compiled.identity import identity_of
from npend_gym.physics import functions

DOUBLE = Chain.uniform(2)
TIMES = np.linspace(0.0, 20.0, 2001)
KINDS = {
    "points": (DOUBLE, "torque"),
    "links with friction": (Chain.rods([1.0, 0.5], [0.8, 0.6], friction=0.01), "torque"),
    "springs": (Chain.uniform(2, stiffness=300.0), "torque"),
    "a cart": (Chain.uniform(2, base=Cart(2.0)), "force"),
    "a pivot": (DOUBLE, "pivot_acceleration"),
    "no gravity": (Chain.uniform(2, gravity=0.0), "torque"),
}


def pulse(name, begin, width, size=1.0):
    """Return a pulse as a function of time, and as a Signal, at whose samples steps end."""
    beside = {"torque": [1.0, 0.0], "pivot_acceleration": [1.0, 0.0]}.get(name, 1.0)
    values = np.multiply.outer([0.0, size, 0.0], beside)

    def function(t):
        on = size if begin <= t < begin + width else 0.0
        return (on, 0.0) if name == "pivot_acceleration" else on

    return function, Signal([-1.0, begin, begin + width, 1e3], values)


def test_a_pulse_moves_a_chain_at_rest_as_scipy_says():
    motion = simulate(DOUBLE, 0.0, 0.0, TIMES, torque=lambda t: 1.0 if 5.0 < t < 5.2 else 0.0)
    at = np.linspace(0.0, 20.0, 201)
    push = lambda t, _: np.array([1.0 if 5.0 < t < 5.2 else 0.0, 0.0])  # noqa: E731
    theta, _ = oracle.trajectory(DOUBLE, 0.0, 0.0, at, push, breaks=(5.0, 5.2))
    np.testing.assert_allclose(motion.theta[::10], theta, rtol=0, atol=1e-8)
    assert np.abs(motion.theta).max() == pytest.approx(0.0564839, abs=1e-7)


@pytest.mark.long
@pytest.mark.parametrize("times", [TIMES, [0.0, 20.0]], ids=["frames", "ends"])
@pytest.mark.parametrize(("chain", "name"), KINDS.values(), ids=KINDS)
def test_no_kind_of_chain_misses_a_pulse_while_it_is_at_rest(chain, name, times):
    given, sampled = pulse(name, 7.123, 0.15)
    exact = simulate(chain, 0.0, 0.0, times, **{name: sampled}).theta
    assert np.abs(exact).max() > 1e-3
    found = simulate(chain, 0.0, 0.0, times, **{name: given})
    np.testing.assert_allclose(found.theta, exact, rtol=0, atol=1e-7)
    many = simulate(chain, np.zeros((2, 2)), 0.0, times, **{name: given})
    np.testing.assert_array_equal(many.theta[1], found.theta)
    fixed = simulate(chain, 0.0, 0.0, times, method="rk4", dt=20.0, **{name: given})
    assert np.abs(fixed.theta).max() > 1e-4


@pytest.mark.long
@pytest.mark.parametrize("start", [0.0, 1e-9])
@pytest.mark.parametrize("width", [0.0101, 0.02, 0.05, 0.2])
def test_a_pulse_as_long_as_the_spacing_of_times_is_met(width, start):
    for begin in 3.0 + np.random.default_rng(0).uniform(0.0, 0.1, 5):
        given, sampled = pulse("torque", begin, width)
        feedback = lambda t, theta, omega, given=given: given(t)  # noqa: E731
        found = simulate(DOUBLE, start, 0.0, TIMES[:501], torque=feedback)
        exact = simulate(DOUBLE, start, 0.0, TIMES[:501], torque=sampled)
        np.testing.assert_allclose(found.theta, exact.theta, rtol=0, atol=1e-8)


@pytest.mark.long
def test_derivatives_dense_output_and_copies_take_the_steps_of_the_motion():
    given, sampled = pulse("torque", 5.0, 0.2)
    found = simulate(DOUBLE, 0.0, 0.0, TIMES, torque=given)
    exact = simulate(DOUBLE, 0.0, 0.0, TIMES, torque=sampled, dt=0.02)
    by_start = found.sensitivities().A
    np.testing.assert_allclose(by_start, exact.sensitivities().A, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.at(7.7), exact.at(7.7), rtol=0, atol=1e-7)
    bars = np.zeros_like(found.theta)
    bars[-1] = 1.0
    np.testing.assert_allclose(
        found.gradient(bars, 0.0).by_theta, by_start[-1, :2, :2].sum(axis=0), rtol=0, atol=1e-9
    )


@pytest.mark.long
def test_tangent_vectors_meet_a_pulse_of_the_pivot():
    given, sampled = pulse("pivot_acceleration", 5.03, 0.03, 30.0)
    ends = []
    for each in (given, sampled):
        vectors = np.eye(8)
        for _ in chaos.tangents(DOUBLE, 0.0, 0.0, TIMES[:601], vectors, pivot_acceleration=each):
            pass
        ends.append(vectors)
    np.testing.assert_allclose(*ends, rtol=0, atol=1e-6)


def test_motions_of_different_chains_have_the_steps_of_each_alone():
    chains = [DOUBLE, Chain.uniform(2, length=0.1)]
    many = simulate(chains, np.zeros((2, 2)), 0.0, [0.0, 9.0], torque=pulse("torque", 5.0, 0.2)[0])
    for k, chain in enumerate(chains):
        alone = simulate(chain, 0.0, 0.0, [0.0, 9.0], torque=pulse("torque", 5.0, 0.2)[0])
        np.testing.assert_array_equal(many[k].theta, alone.theta)
        np.testing.assert_array_equal(many[k].at(6.0), alone.at(6.0))


@pytest.mark.parametrize("times", [TIMES[:5], [0.0, 100.0], np.linspace(0.0, 100.0, 11)])
@pytest.mark.parametrize("rate", [1.0, 5.0])
@pytest.mark.parametrize("options", [{}, {"method": "rk4", "dt": 5.0}], ids=["dop853", "rk4"])
def test_an_event_in_time_is_found_while_the_chain_is_at_rest(rate, times, options):
    motion = simulate(
        DOUBLE, 0.0, 0.0, times, events=lambda t, theta, omega: np.sin(rate * t), **options
    )
    zeros = np.arange(1, int(rate * times[-1] / np.pi) + 1) * np.pi / rate
    np.testing.assert_allclose(motion.t_events[0], zeros, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(motion.theta, simulate(DOUBLE, 0.0, 0.0, times, **options).theta)


@pytest.mark.long
def test_driven_motions_take_few_more_steps_than_their_tolerance_asks_for():
    """The free motion has the steps of its tolerance; the function adds nothing to it."""
    for n, start, most in ((1, 0.3, 4.0), (2, 1.5, 1.2), (5, 1.5, 1.05)):
        chain = Chain.uniform(n)
        free = simulate(chain, start, 0.0, TIMES)
        driven = simulate(chain, start, 0.0, TIMES, torque=lambda t: 0.0)
        assert free.steps <= driven.steps < most * free.steps
        ends = simulate(chain, start, 0.0, [0.0, 20.0], torque=lambda t: 0.0)
        assert ends.steps < 1.05 * free.steps


# -- machine code is made once -----------------------------------------------------------------

GAIN, SCALE = 0.3, np.array([1.0, 2.0])
OWN = types.ModuleType("own")
OWN.rate, OWN.deep = 1.0, types.SimpleNamespace()
Mode = enum.IntEnum("Mode", "HOLD SWING")


@numba.njit
def helper(x):
    return GAIN * x


def level(t, size=0.2, *, shift=0.0):
    return GAIN * size + shift


def nested(t):
    return sum([SCALE[i] * GAIN for i in range(2)]) * helper(t) + math.sin(t) * OWN.rate


def even(k):
    return k == 0 or odd(k - 1)


def odd(k):
    return k != 0 and even(k - 1)


def closure(gain, values=SCALE):
    def inner(t):
        return gain * np.sin(t) * values[0]

    return inner


def same(one, other):
    found = identity_of(one), identity_of(other)
    assert all(each.whole for each in found)
    return found[0].key == found[1].key and hash(found[0].key) == hash(found[1].key)


def test_functions_that_compute_the_same_have_one_identity():
    assert same(closure(0.5), closure(0.5))
    assert same(closure(0.5, np.ones(2)), closure(0.5, np.ones(2)))
    assert same(closure(math.nan), closure(math.nan))
    assert same(even, even)
    assert same(nested, nested)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (0.5, 0.6), (1, 1.0), (1, True), (0.0, -0.0), (np.float32(1.0), np.float64(1.0)),
        (np.ones(2), np.ones(3)), (np.ones(2), np.ones(2, int)), (np.ones(2), np.array([1.0, 2.0])),
        ((1.0, 2.0), (1.0, 3.0)), ([1.0], [2.0]), (None, 0.0), (math.sin, math.cos),
        (np.sin, np.cos), (Mode.HOLD, Mode.SWING), (closure(1.0), closure(2.0)), (1j, 2j),
    ],
)  # fmt: skip
def test_a_closure_over_another_value_has_another_identity(one, other):
    assert same(closure(one), closure(one))
    assert not same(closure(one), closure(other))


def test_lambdas_of_one_line_and_functions_defined_again_are_told_apart():
    assert not same(*(lambda t: t + 1.0, lambda t: t + 2.0))
    spaces = [{}, {}, {}]
    for space, factor in zip(spaces, (2.0, 3.0, 2.0), strict=True):
        exec(f"def torque(t):\n    return {factor} * t", space)
    first, second, again = (space["torque"] for space in spaces)
    assert same(first, again)
    assert not same(first, second)


@pytest.mark.parametrize(
    ("name", "value"), [("GAIN", 0.4), ("SCALE", np.array([1.0, 3.0])), ("OWN", math)]
)
def test_a_changed_variable_of_the_module_changes_the_identity(name, value, monkeypatch):
    before = identity_of(nested).key
    monkeypatch.setattr(sys.modules[__name__], name, value)
    assert identity_of(nested).key != before
    monkeypatch.undo()
    assert identity_of(nested).key == before


def test_what_changes_in_place_and_far_away_changes_the_identity(monkeypatch):
    array = np.ones(3)
    function, before = closure(1.0, array), identity_of(closure(1.0, array)).key
    array[1] = 2.0
    assert identity_of(function).key != before
    for target, name, value in (
        (OWN, "rate", 2.0), (level, "__defaults__", (0.3,)),
        (level, "__kwdefaults__", {"shift": 1.0}), (sys.modules[__name__], "odd", lambda k: False),
    ):  # fmt: skip
        one = {"rate": nested, "odd": even}.get(name, level)
        before = identity_of(one).key
        monkeypatch.setattr(target, name, value)
        assert identity_of(one).key != before
        monkeypatch.undo()
        assert identity_of(one).key == before


def test_what_cannot_be_known_by_its_value_is_said_to_be_unknown():
    for value in (object(), {"gain": 1.0}, OWN.deep, [].append, np.array([None])):
        assert not identity_of(closure(value)).whole
    assert not identity_of(OWN.deep).whole


@pytest.fixture
def compiled(monkeypatch):
    """Count how often functions are compiled, or tried to be."""
    attempts = []
    make = functions.compiled_if_possible

    def counted(given, build):
        attempts.append(given)
        return make(given, build)

    monkeypatch.setattr(functions, "compiled_if_possible", counted)
    monkeypatch.setattr(functions, "_KEPT", type(functions._KEPT)())
    return attempts


def turned(torque, **more):
    return simulate(DOUBLE, 0.3, 0.0, [0.0, 1.0], torque=torque, dt=0.05, **more).theta


@pytest.mark.long
def test_a_function_given_twice_is_compiled_once_and_a_changed_one_again(compiled, monkeypatch):
    def constant(gain):
        return lambda t: gain

    for k, gain in enumerate((0.1, 0.1, 0.2, 0.1, 0.2)):
        np.testing.assert_array_equal(turned(constant(gain)), turned(gain))
        assert len(compiled) == min(2, 1 + (k > 1))
    for k, gain in enumerate((GAIN, 0.7, GAIN)):
        monkeypatch.setattr(sys.modules[__name__], "GAIN", gain)
        np.testing.assert_array_equal(turned(level), turned(gain * 0.2 + 0.0))
        assert len(compiled) == min(4, 3 + k)
    values = np.array([0.5, 0.0])
    held = lambda t: values  # noqa: E731
    for size in (0.5, 0.6):
        values[0] = size
        np.testing.assert_array_equal(turned(held), turned(size))
    assert len(compiled) == 6
    many = simulate(DOUBLE, np.full((5, 2), 0.3), 0.0, [0.0, 1.0], torque=held, dt=0.05)
    np.testing.assert_array_equal(many.theta[4], turned(0.6))
    moved = {"base": Cart(1.0)}
    forces = np.arange(3.0)  # beside the function, another for each motion
    cart = Chain.uniform(2, **moved)
    beside = simulate(cart, np.full((3, 2), 0.3), 0.0, [0.0, 1.0], torque=held, force=forces)
    for k, force in enumerate(forces):
        alone = simulate(cart, 0.3, 0.0, [0.0, 1.0], torque=held, force=force)
        np.testing.assert_array_equal(beside.theta[k], alone.theta)
    assert len(compiled) == 6


def test_what_numba_cannot_compile_is_tried_once(compiled):
    class Controller:
        gain = 0.1

        def torque(self, t, theta, omega):
            return self.gain

    controller = Controller()
    for gain in (0.1, 0.2):
        controller.gain = gain
        np.testing.assert_array_equal(turned(controller.torque), turned(gain))
        np.testing.assert_array_equal(turned(lambda t: controller.gain), turned(gain))
    assert len(compiled) <= 3


@pytest.mark.long
def test_machine_code_recovers_from_an_exception_and_names_it():
    wide = lambda t, theta, omega: 1.0 / np.array([1.0])[int(theta[0] > 3.0)]  # noqa: E731
    for _ in range(2):
        with pytest.raises(ValueError, match=r"torque must return .* or an exception"):
            simulate(DOUBLE, 1.0, 5.0, [0.0, 10.0], torque=wide)
        np.testing.assert_array_equal(turned(wide), turned(1.0))


def test_only_so_many_functions_are_kept(monkeypatch):
    monkeypatch.setattr(functions, "_KEPT", type(functions._KEPT)())
    monkeypatch.setattr(functions, "compiled_if_possible", lambda given, build: None)
    monkeypatch.setattr(functions, "_MOST_KEPT", 3)
    for gain in range(5):
        turned(closure(float(gain)))
    assert len(functions._KEPT) == 3
