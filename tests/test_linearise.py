import numpy as np
import oracle
import pytest
from conftest import chains_in_motion
from hypothesis import given

from npend_gym import Chain, simulate, theory
from npend_gym.physics import linearise


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


def test_a_small_change_of_the_start_follows_the_linear_equation():
    chain = Chain([1.0, 2.0], [1.0, 0.5], damping=[0.1, 0.2])
    start, change = np.array([0.5, -0.8, 1.0, 2.0]), np.array([1.0, -2.0, 0.5, 1.0])
    span = 1e-3

    def flow(y, span):
        path = simulate(chain, y[:2], y[2:], [0.0, span], rtol=1e-13, atol=1e-14, torque=0.3)
        return np.concatenate([path.theta[-1], path.omega[-1]])

    moved = (flow(start + 1e-4 * change, span) - flow(start - 1e-4 * change, span)) / 2e-4
    middle = flow(start, span / 2)
    a = linearise(chain, middle[:2], middle[2:], 0.3).A
    linear = change + span * a @ (change + 0.5 * span * a @ change)
    np.testing.assert_allclose(moved, linear, atol=1e-6)
    assert np.abs(moved - change).max() > 5e-3


def test_states_of_a_trajectory_are_linearised_all_at_once(uneven):
    path = simulate(uneven, 0.7, 0.0, np.linspace(0.0, 1.0, 5))
    a, b = linearise(uneven, path.theta, path.omega, joints=(0, 2))
    assert a.shape == (5, 8, 8)
    assert b.shape == (5, 8, 2)
    for k in range(5):
        alone = linearise(uneven, path.theta[k], path.omega[k], joints=(0, 2))
        np.testing.assert_allclose(a[k], alone.A, atol=1e-12)
        np.testing.assert_allclose(b[k], alone.B, atol=1e-12)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"chain": 2}, TypeError, "chain must be"),
        ({"theta": [0.1]}, ValueError, r"theta must be one number or an array of shape \(..., 2\)"),
        ({"omega": np.nan}, ValueError, "omega must be finite"),
        ({"theta": np.zeros((3, 2)), "omega": np.zeros((4, 2))}, ValueError, "leading axes"),
        ({"torque": [1.0]}, ValueError, "torque must be"),
        ({"joints": (2,)}, ValueError, "joint must be between 0 and 1"),
    ],
)
def test_bad_arguments_are_refused_by_name(change, error, message):
    arguments = {"chain": Chain.uniform(2), "theta": 0.1} | change
    with pytest.raises(error, match=message):
        linearise(**arguments)
