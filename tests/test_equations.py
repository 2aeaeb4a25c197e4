"""Accelerations, tensions and mass matrix against the dense system and closed forms."""

import numpy as np
import oracle
import pytest
from conftest import chains_in_motion
from hypothesis import given

from npend_gym import Cart, Chain, simulate
from npend_gym.physics import linearise, step_jacobian
from npend_gym.physics.equations import accelerations, tensions
from npend_gym.physics.mass import mass_matrix


@given(chains_in_motion())
def test_tensions_give_the_accelerations_of_the_dense_system(motion):
    chain, theta, omega, torque = motion
    dense = oracle.accelerations(
        chain.masses, chain.lengths, chain.gravity, chain.damping, theta, omega, torque
    )
    np.testing.assert_allclose(
        accelerations(chain, theta, omega, torque), dense, rtol=0, atol=1e-10 * np.abs(dense).max()
    )


def test_hanging_at_rest_stays_at_rest(uneven):
    np.testing.assert_array_equal(accelerations(uneven, np.zeros(4), np.zeros(4)), np.zeros(4))


def test_uniform_tilt_accelerates_the_first_rod_alone():
    chain = Chain.uniform(7)
    alpha = accelerations(chain, np.full(7, 0.6), np.zeros(7))
    assert alpha[0] == pytest.approx(-chain.gravity * np.sin(0.6), rel=1e-14)
    np.testing.assert_allclose(alpha[1:], 0.0, atol=1e-14)


def test_a_vanishing_last_mass_tends_to_the_shorter_chain():
    theta, omega = np.array([0.3, -0.8, 1.1]), np.array([1.0, -2.0, 0.5])
    short = accelerations(Chain([1.0, 2.0], 1.0), theta[:2], omega[:2])
    long = accelerations(Chain([1.0, 2.0, 1e-9], 1.0), theta, omega)
    np.testing.assert_allclose(long[:2], short, rtol=1e-7)


@given(chains_in_motion())
def test_tensions_and_torques_move_every_bob_as_newton_says(motion):
    # The bobs' accelerations from the angles', and the forces on each: nothing of Eq. (1) or (2)
    chain, theta, omega, torque = motion
    alpha = accelerations(chain, theta, omega, torque)
    along = np.stack([np.sin(theta), -np.cos(theta)], axis=-1)
    across = np.stack([np.cos(theta), np.sin(theta)], axis=-1)
    about = chain.lengths[:, None] * (alpha[:, None] * across - omega[:, None] ** 2 * along)
    of_bobs = np.cumsum(about, axis=0)
    at_joint = torque - chain.damping * np.diff(omega, prepend=0.0)
    net = at_joint - np.append(at_joint[1:], 0.0)
    of_rods = (net / chain.lengths)[:, None] * across
    of_rods -= tensions(chain, theta, omega, torque)[:, None] * along
    force = of_rods - np.append(of_rods[1:], [[0.0, 0.0]], axis=0)
    force[:, 1] -= chain.masses * chain.gravity
    scale = np.abs(of_rods).max() + np.abs(force).max()
    np.testing.assert_allclose(chain.masses[:, None] * of_bobs, force, rtol=0, atol=1e-10 * scale)


def test_one_pendulum_is_the_pendulum_of_the_textbook():
    chain = Chain(2.0, [0.5], gravity=9.0, damping=0.3)
    theta, omega, torque = 0.7, -1.2, 0.4
    alpha = accelerations(chain, theta, omega, torque)
    expected = -9.0 / 0.5 * np.sin(theta) + (torque - 0.3 * omega) / (2.0 * 0.5**2)
    np.testing.assert_allclose(alpha, [expected], rtol=1e-14)
    pull = 2.0 * (9.0 * np.cos(theta) + 0.5 * omega**2)
    np.testing.assert_allclose(tensions(chain, theta, omega, torque), [pull], rtol=1e-14)
    np.testing.assert_allclose(mass_matrix(chain, theta), [[2.0 * 0.5**2]], rtol=1e-15)


def test_each_rod_of_a_hanging_chain_carries_the_weight_below_it(uneven):
    np.testing.assert_allclose(
        tensions(uneven, 0.0, 0.0), 9.81 * np.array([4.3, 3.3, 2.8, 0.8]), rtol=1e-14
    )
    np.testing.assert_allclose(
        tensions(uneven, np.pi, 0.0), -9.81 * np.array([4.3, 3.3, 2.8, 0.8]), rtol=1e-14
    )


def test_a_straight_chain_that_spins_without_gravity_pulls_as_its_bobs_need():
    chain = Chain([1.0, 2.0], [0.5, 1.0], gravity=0.0)
    outer = 2.0 * 3.0**2 * 1.5  # m omega^2 r
    np.testing.assert_allclose(
        tensions(chain, 0.3, 3.0), [outer + 1.0 * 3.0**2 * 0.5, outer], rtol=1e-14
    )


def test_all_states_of_a_trajectory_are_solved_at_once_with_the_bits_of_one(uneven):
    path = simulate(uneven, 0.7, 0.0, np.linspace(0.0, 1.0, 6))
    theta, omega = path.theta.reshape(2, 3, 4), path.omega.reshape(2, 3, 4)
    torque = np.random.default_rng(0).normal(size=(3, 4))  # its leading axes broadcast
    for solve in (accelerations, tensions):
        together = solve(uneven, theta, omega, torque)
        assert together.shape == (2, 3, 4)
        for i, j in np.ndindex(2, 3):
            alone = solve(uneven, theta[i, j], omega[i, j], torque[j])
            np.testing.assert_array_equal(together[i, j], alone)
    matrices = mass_matrix(uneven, theta)
    assert matrices.shape == (2, 3, 4, 4)
    np.testing.assert_array_equal(matrices[1, 2], mass_matrix(uneven, theta[1, 2]))


def test_one_number_stands_for_all_rods_and_a_torque_for_the_first_joint(uneven):
    np.testing.assert_array_equal(
        accelerations(uneven, 0.4, -1.0, 2.0),
        accelerations(uneven, np.full(4, 0.4), np.full(4, -1.0), [2.0, 0.0, 0.0, 0.0]),
    )


def test_no_states_give_no_accelerations(uneven):
    assert accelerations(uneven, np.zeros((2, 0, 4)), 0.0).shape == (2, 0, 4)


def test_arguments_are_left_as_they_were(uneven):
    theta = np.full(4, 0.3)
    theta.flags.writeable = False
    result = accelerations(uneven, theta, theta)
    result[:] = 7.0
    np.testing.assert_array_equal(theta, 0.3)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"chain": 2}, TypeError, "chain must be"),
        ({"theta": [0.1]}, ValueError, r"theta must be one number or an array of shape \(..., 2\)"),
        ({"theta": [0.1, 1j]}, TypeError, "theta must hold real numbers"),
        ({"theta": 1e6}, ValueError, r"theta must lie within"),
        ({"omega": 1e20}, ValueError, r"omega must lie within"),
        ({"omega": [np.nan, 0.0]}, ValueError, "omega must be finite"),
        ({"theta": np.zeros((3, 2)), "omega": np.zeros((4, 2))}, ValueError, "leading axes"),
        ({"torque": [1.0]}, ValueError, "torque must be"),
        ({"torque": "2"}, TypeError, "torque must hold real numbers"),
    ],
)
def test_bad_arguments_are_refused_by_name(change, error, message):
    arguments = {"chain": Chain.uniform(2), "theta": 0.1, "omega": 0.0} | change
    for solve in (accelerations, tensions, linearise):
        with pytest.raises(error, match=message):
            solve(**arguments)


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (
            lambda: mass_matrix(Chain.uniform(10_001), 0.0),
            ValueError, "n must be between 1 and 10000",  # it would not fit into memory
        ),
        (
            lambda: mass_matrix(Chain.uniform(2), 0.0, stretch=5.0),
            ValueError, "the chain must have stiffness, got stretch=5.0",
        ),
        (
            lambda: linearise(Chain.uniform(2), 0.1, joints=(2,)),
            ValueError, "joint must be between 0 and 1",
        ),
        (
            lambda: linearise(Chain.uniform(2), 0.1, joints=(1, 1)),
            ValueError, r"joints must name each joint once, got \[1, 1\]",
        ),
        (
            lambda: step_jacobian(Chain.uniform(2), 0.1, dt=0.02, pivot_acceleration=(1.0, 0.0)),
            ValueError, r"pivot_acceleration must be None, .*sensitivities\(\)",
        ),
        (
            lambda: accelerations(Chain.uniform(1, base=Cart(1.0)), 0.1, 0.0, velocty=1.0),
            TypeError, "no keyword 'velocty'; did you mean 'velocity'",
        ),
    ],
)  # fmt: skip
def test_what_one_of_the_functions_does_not_take_is_refused_by_name(call, error, message):
    with pytest.raises(error, match=message):
        call()
