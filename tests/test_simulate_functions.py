"""Functions that drive a motion or are its events: none is missed while the chain is at rest."""

# ruff: noqa: ARG005  functions of users have the arguments that they are called with

import numpy as np
import oracle
import pytest

from npend_gym import Cart, Chain, Signal, chaos, simulate

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


@pytest.mark.parametrize("start", [0.0, 1e-9])
@pytest.mark.parametrize("width", [0.0101, 0.02, 0.05, 0.2])
def test_a_pulse_as_long_as_the_spacing_of_times_is_met(width, start):
    for begin in 3.0 + np.random.default_rng(0).uniform(0.0, 0.1, 20):
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


def test_driven_motions_take_few_more_steps_than_their_tolerance_asks_for():
    """The free motion has the steps of its tolerance; the function adds nothing to it."""
    for n, start, most in ((1, 0.3, 4.0), (2, 1.5, 1.2), (5, 1.5, 1.05)):
        chain = Chain.uniform(n)
        free = simulate(chain, start, 0.0, TIMES)
        driven = simulate(chain, start, 0.0, TIMES, torque=lambda t: 0.0)
        assert free.steps <= driven.steps < most * free.steps
        ends = simulate(chain, start, 0.0, [0.0, 20.0], torque=lambda t: 0.0)
        assert ends.steps < 1.05 * free.steps
