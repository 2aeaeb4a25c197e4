import numpy as np
import oracle
import pytest
from conftest import chains_in_motion
from hypothesis import given

from npend_gym import Chain, simulate, theory
from npend_gym.physics import linearise, step_jacobian


def slopes(f, x, step=1e-5):
    columns = [(f(x + step * e) - f(x - step * e)) / (2 * step) for e in np.eye(x.size)]
    return np.column_stack(columns)


@given(chains_in_motion(max_n=6))
def test_both_matrices_are_the_slopes_of_the_dense_system(case):
    chain, theta, omega, torque = case
    n = chain.n

    def rates(x):
        theta, omega, torque = np.split(x, 3)
        parameters = chain.masses, chain.lengths, chain.gravity, chain.damping
        return np.concatenate([omega, oracle.accelerations(*parameters, theta, omega, torque)])

    expected = slopes(rates, np.concatenate([theta, omega, torque]))
    a, b = linearise(chain, theta, omega, torque, joints=range(n))
    tolerance = 1e-6 * np.abs(expected).max()
    np.testing.assert_allclose(a, expected[:, : 2 * n], rtol=1e-5, atol=tolerance)
    np.testing.assert_allclose(b, expected[:, 2 * n :], rtol=1e-5, atol=tolerance)


def test_hanging_at_rest_the_eigenvalues_are_the_normal_frequencies(uneven):
    a, _ = linearise(uneven, 0.0)
    omega, modes = theory.normal_modes(uneven)
    np.testing.assert_allclose(a[4:, :4] @ modes, -modes * omega**2, atol=1e-11)
    eigenvalues = np.linalg.eigvals(a)
    np.testing.assert_allclose(np.sort(eigenvalues.imag)[4:], omega, rtol=1e-9)
    np.testing.assert_allclose(eigenvalues.real, 0.0, atol=1e-9)


def test_upright_the_normal_frequencies_are_rates_of_growth(uneven):
    eigenvalues = np.linalg.eigvals(linearise(uneven, np.pi).A)
    omega, _ = theory.normal_modes(uneven)
    np.testing.assert_allclose(np.sort(eigenvalues.real)[4:], omega, rtol=1e-9)


def test_states_of_a_trajectory_are_linearised_all_at_once(uneven):
    path = simulate(uneven, 0.7, 0.0, np.linspace(0.0, 1.0, 5))
    a, b = linearise(uneven, path.theta, path.omega, joints=(0, 2))
    assert a.shape == (5, 8, 8)
    assert b.shape == (5, 8, 2)
    for k in range(5):
        alone = linearise(uneven, path.theta[k], path.omega[k], joints=(0, 2))
        np.testing.assert_allclose(a[k], alone.A, atol=1e-12)
        np.testing.assert_allclose(b[k], alone.B, atol=1e-12)


def test_steps_of_an_accelerated_pivot_are_linearised_elsewhere():
    with pytest.raises(ValueError, match=r"pivot_acceleration must be None, .*sensitivities\(\)"):
        step_jacobian(Chain.uniform(2), 0.1, dt=0.02, pivot_acceleration=(1.0, 0.0))


def test_a_joint_that_is_none_is_refused_by_name():
    with pytest.raises(ValueError, match="joint must be between 0 and 1"):
        linearise(Chain.uniform(2), 0.1, joints=(2,))
