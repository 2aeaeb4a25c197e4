import numpy as np
import oracle
import pytest
from scipy.linalg import eigh
from scipy.special import roots_laguerre

from npend_gym import Chain, simulate, theory


@pytest.mark.parametrize(("n", "printed"), [(5, 4.487), (10, 6.347), (20, 8.976), (100, 20.071)])
def test_ideal_period_is_the_papers_with_its_gravity(n, printed):
    # the paper computed with g = 9.8 and cut the digits off
    assert theory.ideal_period(Chain.uniform(n, gravity=9.8)) == pytest.approx(printed, abs=1e-3)


def test_ideal_period_of_unequal_rods_is_the_papers_formula():
    masses, lengths = np.array([1.0, 2.0, 3.0]), np.array([0.5, 1.0, 2.0])
    expected = 2 * np.pi * 3 / np.sqrt(9.81 * masses / (lengths * 6.0)).sum()
    assert theory.ideal_period(Chain(masses, lengths)) == pytest.approx(expected, rel=1e-14)


def test_amplitude_series_starts_with_the_textbook_terms():
    # theta0^2/16 + 11 theta0^4/3072, in the paper and correct
    theta0 = np.array([0.01, 0.05, 0.1])
    expected = theta0**2 / 16 + 11 * theta0**4 / 3072
    np.testing.assert_allclose(theory.amplitude_correction(theta0, 10), expected, rtol=1e-4)


def test_amplitude_series_converges_to_the_elliptic_integral():
    limit = theory.amplitude_correction(np.pi / 4)
    assert limit == pytest.approx(0.0400, abs=5e-5)
    assert theory.amplitude_correction(np.pi / 4, 30) == pytest.approx(float(limit), rel=1e-13)
    assert theory.amplitude_correction(1.0, 0) == 0.0


@pytest.mark.parametrize("theta0", [0.1, 0.785, 2.0, 3.0])
def test_pendulum_period_is_the_time_after_which_a_pendulum_is_back(theta0):
    chain = Chain.uniform(1, length=0.7)
    period = float(theory.pendulum_period(theta0, 0.7))
    back = simulate(chain, theta0, 0.0, [0.0, period], rtol=1e-12, atol=1e-13)
    assert back.theta[-1, 0] == pytest.approx(theta0, abs=1e-9)
    assert back.omega[-1, 0] == pytest.approx(0.0, abs=1e-8)


def test_normal_modes_solve_the_dense_eigenproblem(uneven):
    stiffness = np.diag(uneven.gravity * uneven.lengths * uneven.carried_masses)
    mass = oracle.mass_matrix(uneven.masses, uneven.lengths, np.zeros(4))
    omega, modes = theory.normal_modes(uneven)
    np.testing.assert_allclose(omega**2, eigh(stiffness, mass, eigvals_only=True), rtol=1e-12)
    np.testing.assert_allclose(stiffness @ modes, mass @ modes * omega**2, atol=1e-10)
    np.testing.assert_allclose(np.abs(modes).max(axis=0), 1.0)


@pytest.mark.parametrize("n", [1, 2, 6, 30])
def test_equal_rods_oscillate_at_the_zeros_of_the_laguerre_polynomial(n):
    zeros = roots_laguerre(n)[0]
    omega, _ = theory.normal_modes(Chain.uniform(n, mass=2.0, length=0.5, gravity=3.0))
    np.testing.assert_allclose(omega**2, 3.0 / 0.5 * zeros, rtol=1e-9)
    np.testing.assert_allclose(theory.uniform_frequencies(n, 0.5, 3.0) ** 2, 6 * zeros, rtol=1e-9)


def test_fundamental_period_is_that_of_the_slowest_mode(uneven):
    omega, _ = theory.normal_modes(uneven)
    assert theory.fundamental_period(uneven) == pytest.approx(2 * np.pi / omega[0], rel=1e-12)
    two = Chain.uniform(2)  # omega^2 = (2 - sqrt 2) g/l
    expected = 2 * np.pi / np.sqrt((2 - np.sqrt(2)) * 9.81)
    assert theory.fundamental_period(two) == pytest.approx(expected, rel=1e-13)


def test_fastest_frequency_is_that_of_the_fastest_mode(uneven):
    assert theory.fastest_frequency(uneven) == pytest.approx(theory.normal_modes(uneven)[0][-1])
    assert theory.fastest_frequency(Chain.uniform(3, gravity=0.0)) == 0.0


def test_fundamental_period_tends_to_its_large_n_law():
    for n, tolerance in ((10, 5e-4), (100, 6e-6), (1000, 1e-7)):
        exact = theory.fundamental_period(Chain.uniform(n))
        assert theory.large_n_period(n) == pytest.approx(exact, rel=tolerance)


def test_without_gravity_a_period_is_not_a_number():
    free = Chain.uniform(3, gravity=0.0)
    assert np.isnan(theory.ideal_period(free))
    assert np.isnan(theory.fundamental_period(free))
    np.testing.assert_allclose(theory.normal_modes(free)[0], 0.0)


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: theory.amplitude_correction(np.pi), ValueError, "theta0 must lie between"),
        (lambda: theory.amplitude_correction(np.nan), ValueError, "theta0 must be finite"),
        (lambda: theory.amplitude_correction(1.0, -1), ValueError, "terms must be between 0 and"),
        (lambda: theory.amplitude_correction(1.0, 2.5), TypeError, "terms must be an integer"),
        (lambda: theory.single_period(0.0), ValueError, "length must be greater"),
        (lambda: theory.uniform_frequencies(0), ValueError, "n must be between 1 and"),
        (lambda: theory.large_n_period(True), TypeError, "n must be an integer"),
    ],
)
def test_bad_arguments_are_refused_by_name(call, error, message):
    with pytest.raises(error, match=message):
        call()
