import mpmath
import numpy as np
import oracle
import pytest
from conftest import chains_in_motion
from hypothesis import given
from hypothesis import strategies as st

from npend_gym import Chain
from npend_gym.physics import energy
from npend_gym.physics.kernels.dynamics import Rods, accelerations, new_work, pack_rods
from npend_gym.physics.kernels.sincos import MAX_ANGLE, sincos


def accelerate(chain, theta, omega, torque=None):
    alpha = np.empty(chain.n)
    torque = np.zeros(chain.n) if torque is None else torque
    accelerations(theta, omega, torque, pack_rods(chain), new_work(chain.n), alpha, 1)
    return alpha


@given(chains_in_motion())
def test_tensions_give_the_accelerations_of_the_dense_system(motion):
    chain, theta, omega, torque = motion
    dense = oracle.accelerations(
        chain.masses, chain.lengths, chain.gravity, chain.damping, theta, omega, torque
    )
    np.testing.assert_allclose(
        accelerate(chain, theta, omega, torque), dense, rtol=0, atol=1e-10 * np.abs(dense).max()
    )


@pytest.mark.parametrize("n", [50, 51])
def test_long_chains_agree_with_the_dense_system(n):
    rng = np.random.default_rng(n)
    chain = Chain(rng.uniform(0.5, 2.0, n), rng.uniform(0.5, 2.0, n), damping=0.3)
    theta, omega, torque = rng.normal(size=(3, n))
    dense = oracle.accelerations(
        chain.masses, chain.lengths, chain.gravity, chain.damping, theta, omega, torque
    )
    error = np.abs(accelerate(chain, theta, omega, torque) - dense).max()
    assert error < 1e-11 * np.abs(dense).max()


@given(chains_in_motion())
def test_power_of_gravity_torque_and_damping_is_the_change_of_energy(motion):
    # d/dt (kinetic + potential) by the chain rule = joint torques times relative speeds
    chain, theta, omega, torque = motion
    alpha = accelerate(chain, theta, omega, torque)
    matrix = oracle.mass_matrix(chain.masses, chain.lengths, theta)
    h = 1e-6
    kinetic_change = omega @ matrix @ alpha + (
        energy.kinetic_energy(chain, theta + h * omega, omega)
        - energy.kinetic_energy(chain, theta - h * omega, omega)
    ) / (2 * h)
    gravity_power = -np.sum(
        chain.gravity * chain.carried_masses * chain.lengths * np.sin(theta) * omega
    )
    relative = np.diff(omega, prepend=0.0)
    power = np.sum((torque - chain.damping * relative) * relative)
    scale = omega @ matrix @ omega * 10 + np.abs(torque * relative).sum() + abs(gravity_power)
    assert abs(kinetic_change - gravity_power - power) < 1e-6 * scale + 1e-9


@given(chains_in_motion(max_n=9), st.integers(2, 20))
def test_many_lanes_give_the_bits_of_one(motion, lanes):
    chain, theta, omega, torque = motion
    n = chain.n
    rng = np.random.default_rng(n)
    thetas, omegas, torques = (
        np.ascontiguousarray(x[:, None] * rng.uniform(0.5, 1.0, lanes))
        for x in (theta, omega, torque)
    )
    rods = Rods(*(np.repeat(array, lanes) for array in pack_rods(chain)))
    alpha = np.empty(n * lanes)
    accelerations(
        thetas.ravel(), omegas.ravel(), torques.ravel(), rods, new_work(n, lanes), alpha, lanes
    )
    for k in range(lanes):
        alone = accelerate(
            chain, *(np.ascontiguousarray(x[:, k]) for x in (thetas, omegas, torques))
        )
        np.testing.assert_array_equal(alpha.reshape(n, lanes)[:, k], alone)


def test_mirrored_state_has_mirrored_accelerations_to_the_last_bit(uneven):
    rng = np.random.default_rng(3)
    theta, omega, torque = rng.normal(size=(3, 4))
    there, mirrored = (
        accelerate(uneven, theta, omega, torque),
        accelerate(uneven, -theta, -omega, -torque),
    )
    np.testing.assert_array_equal(there, -mirrored)


def test_hanging_at_rest_stays_at_rest(uneven):
    np.testing.assert_array_equal(accelerate(uneven, np.zeros(4), np.zeros(4)), np.zeros(4))


def test_uniform_tilt_accelerates_the_first_rod_alone():
    chain = Chain.uniform(7)
    alpha = accelerate(chain, np.full(7, 0.6), np.zeros(7))
    assert alpha[0] == pytest.approx(-chain.gravity * np.sin(0.6), rel=1e-14)
    np.testing.assert_allclose(alpha[1:], 0.0, atol=1e-14)


def test_a_vanishing_last_mass_tends_to_the_shorter_chain():
    theta, omega = np.array([0.3, -0.8, 1.1]), np.array([1.0, -2.0, 0.5])
    short = accelerate(Chain([1.0, 2.0], 1.0), theta[:2], omega[:2])
    long = accelerate(Chain([1.0, 2.0, 1e-9], 1.0), theta, omega)
    np.testing.assert_allclose(long[:2], short, rtol=1e-7)


@given(st.floats(-MAX_ANGLE, MAX_ANGLE))
def test_sine_and_cosine_are_within_one_ulp(x):
    check_ulp(x)


def test_sine_and_cosine_are_within_one_ulp_near_multiples_of_half_pi():
    rng = np.random.default_rng(0)
    for k in rng.integers(-60_000, 60_000, 500):
        check_ulp(k * np.pi / 2)
        check_ulp(np.nextafter(k * np.pi / 2 + np.pi / 4, 0.0))


def check_ulp(x):
    with mpmath.workprec(250):
        exact = mpmath.sin(mpmath.mpf(x)), mpmath.cos(mpmath.mpf(x))
        for ours, truth in zip(sincos(x), exact, strict=True):
            assert abs(ours - truth) < np.spacing(abs(float(truth)))
