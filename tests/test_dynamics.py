import mpmath
import numpy as np
import oracle
import pytest
from conftest import chains_in_motion
from hypothesis import given
from hypothesis import strategies as st
from numba import njit

from npend_gym import Chain
from npend_gym.compiled.packs import WIDTH, any_of, packs, where
from npend_gym.compiled.sincos import MAX_ANGLE, sincos
from npend_gym.physics import energy
from npend_gym.physics.kernels.dynamics import (
    WORK_ROWS,
    Rods,
    accelerations,
    derivative,
    new_work,
    pack_rods,
)


def accelerate(chain, theta, omega, torque=None):
    change = np.empty(2 * chain.n)
    torque = np.zeros(chain.n) if torque is None else torque
    state = np.concatenate([theta, omega])
    derivative(state, torque, pack_rods(chain), new_work(chain.n), change)
    return change[chain.n :]


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


@njit(error_model="numpy")
def accelerate_packs(
    theta, omega, torque, v, l, inverse_l, damping, gravity, drag, pivot, work, alpha
):
    rods = Rods(
        packs(v), packs(l), packs(inverse_l), packs(damping), packs(gravity), packs(drag),
        packs(pivot),
    )  # fmt: skip
    accelerations(packs(theta), packs(omega), packs(torque), rods, packs(work), packs(alpha))


@given(chains_in_motion(max_n=9))
def test_every_lane_of_a_pack_has_the_bits_of_one_chain(motion):
    chain, theta, omega, torque = motion
    n = chain.n
    rng = np.random.default_rng(n)
    thetas, omegas, torques = (
        np.ascontiguousarray(x[:, None] * rng.uniform(0.5, 1.0, WIDTH))
        for x in (theta, omega, torque)
    )
    rods = [np.repeat(array, WIDTH) for array in pack_rods(chain)]
    alpha = np.empty(n * WIDTH)
    accelerate_packs(
        thetas.ravel(),
        omegas.ravel(),
        torques.ravel(),
        *rods,
        np.zeros((WORK_ROWS, (n + 2) * WIDTH)),
        alpha,
    )
    for k in range(WIDTH):
        alone = accelerate(
            chain, *(np.ascontiguousarray(x[:, k]) for x in (thetas, omegas, torques))
        )
        np.testing.assert_array_equal(alpha.reshape(n, WIDTH)[:, k], alone)


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


@njit(error_model="numpy")
def combine(a, b, out):
    """Every operation of packs, lane by lane; `out` has a row for each."""
    x, y, z = packs(a), packs(b), packs(out)
    for i in range(x.size):
        z[0, i] = (x[i] + 2) * (3.0 - y[i]) / (1.0 + abs(y[i]))
        z[1, i] = where((x[i] < y[i]) | (x[i] == 1.0), -x[i], y[i])
        z[2, i] = where((x[i] >= y[i]) & (y[i] != 0.0), 1.0, 2.0)
        z[3, i] = where((x[i] <= 0.0) ^ (y[i] > 0.0), x[i], 0.0)
        z[4, i] = 0.0
        z[4, i] += 1.0 if any_of(x[i] > 2.9) else 0.0


def test_packs_calculate_as_numpy_does():
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 5 * WIDTH)).round(1)
    a[3], b[WIDTH], b[7] = np.nan, np.inf, np.nan
    out = np.empty((5, a.size))
    combine(a, b, out)
    with np.errstate(invalid="ignore"):
        expected = [
            (a + 2) * (3.0 - b) / (1.0 + abs(b)),
            np.where((a < b) | (a == 1.0), -a, b),
            np.where((a >= b) & (b != 0.0), 1.0, 2.0),
            np.where((a <= 0.0) ^ (b > 0.0), a, 0.0),
            np.repeat((a.reshape(-1, WIDTH) > 2.9).any(axis=1), WIDTH),
        ]
    np.testing.assert_array_equal(out, expected)
