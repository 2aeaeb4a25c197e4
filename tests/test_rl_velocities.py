import math

import numpy as np
import pytest

from npend_gym import Chain, simulate
from npend_gym.rl import VelocityEstimator


def ticks(duration, dt, jitter=0.0, seed=0):
    """Return the times at which a clock reads the encoders, each late by up to `jitter` dt."""
    times = np.arange(0.0, duration, dt)
    return times + jitter * dt * np.random.default_rng(seed).uniform(size=times.size)


def estimates(estimator, times, theta):
    steps = np.diff(times, prepend=times[0] - 1.0)
    return np.array([estimator(angle, dt) for angle, dt in zip(theta, steps, strict=True)])


@pytest.fixture(scope="module")
def swing():
    """Two rods that turn over, 4 s: the times of a clock with jitter, angles and velocities."""
    times = ticks(4.0, 0.005, jitter=0.3)
    motion = simulate(Chain.uniform(2), [2.5, 2.0], [0.0, 0.0], np.r_[0.0, times[1:]])
    return np.r_[0.0, times[1:]], motion.theta, motion.omega


def test_a_constant_velocity_is_found_whatever_the_clock_does():
    times = ticks(2.0, 0.01, jitter=0.9)
    rates = np.array([3.0, -0.2, 11.0])
    found = estimates(VelocityEstimator(0.03), times, 1.0 + np.outer(times, rates))
    np.testing.assert_allclose(found[-1], rates, rtol=1e-9)
    even = 0.01 * np.arange(times.size)  # the same angles, as if the clock had no jitter
    blind = estimates(VelocityEstimator(0.03), even, np.outer(times, rates))
    assert np.std(blind[100:] / rates) > 0.01


def test_it_is_the_line_of_least_squares_with_weights_that_fade():
    dt, tau, rng = 0.01, 0.025, np.random.default_rng(0)
    theta = rng.normal(size=400) * 0.1
    found = estimates(VelocityEstimator(tau), dt * np.arange(400), theta)[-1]
    ages = dt * np.arange(400)[::-1]
    weights = (1.0 + dt / tau) ** (-0.5 * ages / dt)  # np.polyfit squares them
    assert found == pytest.approx(np.polyfit(-ages, theta, 1, w=weights)[0], rel=1e-9)


def test_a_change_of_the_velocity_is_seen_two_time_constants_and_half_an_interval_late():
    times = 0.01 * np.arange(1000)
    found = estimates(VelocityEstimator(0.03), times, 0.5 * 7.0 * times**2)
    assert found[-1] == pytest.approx(7.0 * (times[-1] - 2.0 * 0.03 - 0.5 * 0.01), rel=1e-9)


@pytest.mark.parametrize("counts", [None, 4096, 1024])
@pytest.mark.parametrize("tau", [0.01, 0.03])
def test_what_a_clock_with_jitter_and_an_encoder_with_few_counts_cost(counts, tau, swing):
    times, theta, omega = swing
    step = 2.0 * math.pi / counts if counts else 0.0
    shown = np.round(theta / step) * step if counts else theta
    found = estimates(VelocityEstimator(tau), times, shown)
    delay = (2.0 * tau + 0.0025) * np.gradient(omega, times, axis=0)
    error = np.sqrt(np.mean((found - omega)[100:] ** 2))
    print(f"{counts} counts, {tau} s: {error:.3f} of {np.sqrt(np.mean(omega**2)):.1f} rad/s")
    assert error < np.sqrt(np.mean(delay[100:] ** 2)) + step / tau


def test_an_encoder_of_one_turn_may_jump_and_a_cart_may_not():
    times = 0.01 * np.arange(300)
    theta = 9.0 * times
    whole = estimates(VelocityEstimator(0.02), times, theta)
    turned = np.remainder(theta + math.pi, math.tau) - math.pi
    np.testing.assert_allclose(estimates(VelocityEstimator(0.02), times, turned), whole, atol=1e-9)
    assert np.ptp(estimates(VelocityEstimator(0.02, period=0.0), times, turned)) > 50.0


def test_reset_forgets_and_bad_arguments_are_refused():
    estimator = VelocityEstimator(0.02)
    assert estimator.omega is None
    np.testing.assert_array_equal(estimator([1.0, 2.0], 0.01), [0.0, 0.0])
    first = estimator([1.1, 2.0], 0.01)
    with pytest.raises(ValueError, match=r"shape \(2,\) of the last call, got \(3,\)"):
        estimator([1.0, 2.0, 3.0], 0.01)
    for dt in (0.0, -0.01, math.inf):
        with pytest.raises(ValueError, match="dt must be"):
            estimator([1.0, 2.0], dt)
    estimator.reset()
    estimator([1.0, 2.0], 1.0)
    np.testing.assert_array_equal(estimator([1.1, 2.0], 0.01), first)
    with pytest.raises(ValueError, match="time_constant must be greater than zero"):
        VelocityEstimator(0.0)
    with pytest.raises(ValueError, match="period must be zero or more"):
        VelocityEstimator(0.1, period=-1.0)
