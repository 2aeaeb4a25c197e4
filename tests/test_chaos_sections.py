"""Poincare sections: where and when a rod passes an angle."""

import numpy as np
import oracle
import pytest
from scipy.integrate import solve_ivp

from npend_gym import Chain, chaos, theory


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

    def rates(_t, y):
        alpha = oracle.accelerations(
            chain.masses, chain.lengths, 9.81, chain.damping, y[:2], y[2:], np.zeros(2)
        )
        return np.concatenate([y[2:], alpha])

    def second_rod(_t, y):
        return np.sin(y[1] - 0.2)

    start = [1.2, 1.2, 0.0, 0.0]
    exact = solve_ivp(
        rates, (0.0, duration), start, "DOP853", events=second_rod, rtol=1e-12, atol=1e-12
    )
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
    ("arguments", "text"),
    [
        ({"angle": 3.0}, "rod 0 does not pass the angle 3 rad within 2 s"),
        ({"duration": 0.0}, "duration must be greater than zero"),
        ({"duration": 1e20}, "duration must be at most"),
        ({"direction": 0}, "direction must be 1 or -1, got 0"),
        ({"rtol": 1e-17}, "rtol must be at least"),
        ({"rod": 2}, "rod must be between -2 and 1, got 2"),
        ({"angle": np.nan}, "angle must be finite"),
        ({"theta": [1.0, 2.0, 3.0]}, "theta must be one number"),
    ],
)
def test_bad_input_is_refused_by_name(arguments, text):
    given = {"chain": Chain.uniform(2), "theta": 0.5, "duration": 2.0} | arguments
    with pytest.raises(ValueError, match=text):
        chaos.poincare_section(**given)
