import numpy as np
import oracle
import pytest
from scipy.linalg import eigh
from scipy.special import jn_zeros, roots_laguerre

from npend_gym import Cart, Chain, simulate, theory
from npend_gym.physics import linearise
from npend_gym.theory.modes import decay_rate


@pytest.mark.parametrize(("n", "printed"), [(5, 4.487), (10, 6.347), (20, 8.976), (100, 20.071)])
def test_ideal_period_is_the_papers_with_its_gravity(n, printed):
    # the paper computed with g = 9.8 and cut the digits off
    assert theory.ideal_period(Chain.uniform(n, gravity=9.8)) == pytest.approx(printed, abs=1e-3)


def test_ideal_period_of_unequal_rods_is_the_papers_formula():
    masses, lengths = np.array([1.0, 2.0, 3.0]), np.array([0.5, 1.0, 2.0])
    expected = 2 * np.pi * 3 / np.sqrt(9.81 * masses / (lengths * 6.0)).sum()
    assert theory.ideal_period(Chain(masses, lengths)) == pytest.approx(expected, rel=1e-14)


def test_amplitude_series_converges_to_the_elliptic_integral():
    limit = theory.amplitude_correction(np.pi / 4)
    assert limit == pytest.approx(0.0400, abs=5e-5)
    assert theory.amplitude_correction(np.pi / 4, 30) == pytest.approx(float(limit), rel=1e-13)
    assert theory.amplitude_correction(1.0, 0) == 0.0


def test_the_period_of_a_pendulum_keeps_its_digits_near_zero_and_near_the_top():
    small = np.array([1e-9, 1e-5, 1e-3])
    np.testing.assert_allclose(
        theory.amplitude_correction(small), small**2 / 16 + 11 * small**4 / 3072, rtol=1e-13
    )
    left = np.array([1e-6, 1e-8, 1e-12])  # K(k) is ln(4/k') where k' is small
    expected = 2.0 / np.pi * np.log(4.0 / np.cos(0.5 * (np.pi - left)))
    np.testing.assert_allclose(theory.pendulum_factor(np.pi - left), expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("masses", "lengths"),
    [([1e-3, 1e3], [0.01, 100.0]), ([1e-9, 1e9], [1.0, 1.0]), ([1.0, 1.0], [1.0, 1.0])],
)
def test_slow_modes_keep_their_digits_beside_fast_ones(masses, lengths):
    # of two rods: m_1 l_1 l_2 x^2 - (m_1 + m_2) (l_1 + l_2) g x + (m_1 + m_2) g^2 = 0, x = omega^2
    whole, g = sum(masses), 9.81
    a, b, c = masses[0] * lengths[0] * lengths[1], whole * sum(lengths) * g, whole * g * g
    slow = np.sqrt(2.0 * c / (b + np.sqrt(b * b - 4.0 * a * c)))
    chain = Chain(masses, lengths, gravity=g)
    assert 2.0 * np.pi / theory.fundamental_period(chain) == pytest.approx(slow, rel=1e-13)
    omega, modes = theory.normal_modes(chain)
    assert omega[0] == pytest.approx(slow, rel=1e-13)
    assert modes[:, 0].min() > 0.0 > modes[:, 1].min()


def test_the_corrected_model_of_several_angles_has_their_mean_correction():
    chain, angles = Chain.uniform(3), [0.3, -0.6]
    each = [theory.models(chain, angle).corrected for angle in angles]
    assert theory.models(chain, angles).corrected == pytest.approx(np.mean(each), rel=1e-14)


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
    assert theory.fundamental_period(uneven) == pytest.approx(2 * np.pi / omega[0], rel=1e-12)
    assert theory.fastest_frequency(uneven) == pytest.approx(omega[-1])


@pytest.mark.parametrize("n", [1, 2, 6, 30])
def test_equal_rods_oscillate_at_the_zeros_of_the_laguerre_polynomial(n):
    zeros = roots_laguerre(n)[0]
    omega, _ = theory.normal_modes(Chain.uniform(n, mass=2.0, length=0.5, gravity=3.0))
    np.testing.assert_allclose(omega**2, 3.0 / 0.5 * zeros, rtol=1e-9)
    np.testing.assert_allclose(theory.uniform_frequencies(n, 0.5, 3.0) ** 2, 6 * zeros, rtol=1e-9)


def test_fundamental_period_tends_to_its_large_n_law():
    for n, tolerance in ((10, 5e-4), (100, 6e-6), (1000, 1e-7)):
        exact = theory.fundamental_period(Chain.uniform(n))
        assert theory.large_n_period(n) == pytest.approx(exact, rel=tolerance)


def test_without_gravity_a_period_is_not_a_number():
    free = Chain.uniform(3, gravity=0.0)
    assert np.isnan(theory.ideal_period(free))
    assert np.isnan(theory.fundamental_period(free))
    assert np.isnan(theory.models(free, 0.7)).all()
    np.testing.assert_allclose(theory.normal_modes(free)[0], 0.0)
    assert theory.fastest_frequency(free) == 0.0


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
        (lambda: theory.large_n_period(3, terms=3), ValueError, "terms must be between 1 and 2"),
        (lambda: theory.release_profile([0.5, -0.1]), ValueError, "s must lie between 0"),
        (lambda: theory.release_profile(1.1), ValueError, "s must lie between 0"),
        (lambda: theory.com_period(0), ValueError, "chain must be at least 1"),
        (lambda: theory.com_period(2.5), TypeError, "chain must be an integer"),
        (lambda: theory.com_period(Chain([1e-9, 1e9], 1.0)), ValueError, "within a factor of 1e"),
        (lambda: theory.models(Chain.uniform(2), []), ValueError, "angle must be one or more"),
        (lambda: theory.com_period(2, 3.2), ValueError, "amplitude must lie between"),
        (lambda: theory.small_angle_periods(Chain.uniform(20_000)), ValueError, "n must be"),
    ],
)
def test_bad_arguments_are_refused_by_name(call, error, message):
    with pytest.raises(error, match=message):
        call()


def links(n, seed=0):
    rng = np.random.default_rng(seed)
    lengths = rng.uniform(0.3, 2.0, n)
    return Chain(
        rng.uniform(0.3, 2.0, n), lengths, 9.81, rng.uniform(0.1, 1.0, n), rng.uniform(0.1, 1.0, n),
        centres=rng.uniform(0.2, 1.2, n) * lengths, inertias=rng.uniform(0.01, 0.5, n),
        armature=rng.uniform(0.0, 0.5, n), gear=rng.choice([6.0, -6.0, 0.5, np.inf], n),
    )  # fmt: skip


def test_two_uniform_rods_swing_with_the_textbook_frequencies():
    chain = Chain.rods(0.7, [0.4, 0.4], gravity=9.0)
    expected = 3.0 + 6.0 / np.sqrt(7.0) * np.array([-1.0, 1.0])
    np.testing.assert_allclose(theory.normal_modes(chain)[0] ** 2 * 0.4 / 9.0, expected, rtol=1e-13)
    frequencies = 2.0 * np.pi / theory.fundamental_period(chain), theory.fastest_frequency(chain)
    np.testing.assert_allclose(np.square(frequencies) * 0.4 / 9.0, expected, rtol=1e-14)


@pytest.mark.parametrize(("n", "tolerance"), [(100, 4e-6), (1000, 4e-8), (100_000, 1e-11)])
def test_many_uniform_rods_swing_as_the_hanging_rope(n, tolerance):
    chain = Chain.rods(1.0 / n, np.full(n, 1.0 / n), gravity=1.0)
    frequency = 2.0 * np.pi / theory.fundamental_period(chain)
    assert frequency == pytest.approx(jn_zeros(0, 1)[0] / 2.0, rel=tolerance)


@pytest.mark.parametrize("ratio", [1e-12, 1e-3, 1e3, 1e10, 1e12, 1e16])
def test_the_fastest_frequency_has_all_digits_for_masses_of_any_ratio(ratio):
    """Of two equal rods omega^2 l / g = M + sqrt(M (M - 1)), M being all mass over the upper."""
    total = 1.0 + ratio
    expected = np.sqrt(9.81 * (total + np.sqrt(total * ratio)))
    assert theory.fastest_frequency(Chain([1.0, ratio], 1.0)) == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize(
    ("chain", "rest"),
    [
        *((links(n), np.zeros(n)) for n in (1, 2, 5, 40)),
        # the weight of the first link is above its joint: it rests upright
        (Chain([1.0, 0.2], [1.0, 0.5], centres=[-0.5, 0.3], inertias=0.1), np.array([np.pi, 0.0])),
    ],
)
@pytest.mark.long
def test_the_modes_of_links_solve_the_linearised_system(chain, rest):
    n, rounding = chain.n, 1e-9 if chain.n == 40 else 1e-12
    omega, modes = theory.normal_modes(chain)
    motion = linearise(chain, rest).A[n:, :n] @ modes
    np.testing.assert_allclose(motion, -modes * omega**2, atol=rounding * omega[-1] ** 2)
    assert np.abs(modes).max(axis=0) == pytest.approx(1.0)
    assert theory.fastest_frequency(chain) == pytest.approx(omega[-1], rel=1e-12)
    assert 2.0 * np.pi / theory.fundamental_period(chain) == pytest.approx(omega[0], rel=1e-11)
    np.testing.assert_array_equal(chain.lift < 0.0, rest > 0.0)


@pytest.mark.long
def test_the_fastest_decay_is_an_eigenvalue_of_the_damped_system():
    chain = links(6)
    still = Chain.from_dict(chain.as_dict() | {"gravity": 0.0})
    rates = -np.linalg.eigvals(linearise(still, 0.0).A).real
    assert decay_rate(chain, chain.damping, chain.drag) == pytest.approx(rates.max(), rel=1e-12)


def test_a_balanced_link_has_no_period():
    wheel = Chain(1.0, [1.0], centres=0.0, inertias=1.0)
    assert np.isnan(theory.fundamental_period(wheel))
    assert theory.fastest_frequency(wheel) == 0.0
    np.testing.assert_array_equal(theory.normal_modes(wheel)[0], 0.0)


def test_no_law_is_known_where_frequencies_lie_far_apart():
    chain = Chain([1e-9, 1e9], 1.0)
    models = theory.models(chain, 0.5)
    assert np.isnan(models.law)
    assert models.fundamental == theory.fundamental_period(chain)


def test_the_papers_period_does_not_apply_to_links():
    chain = Chain.acrobot()
    with pytest.raises(ValueError, match="does not apply to links: use fundamental_period"):
        theory.ideal_period(chain)
    models = theory.models(chain, 0.5)
    assert np.isnan([models.ideal, models.corrected]).all()
    assert models.fundamental == theory.fundamental_period(chain)
    rubbing = Chain(1.0, [1.0, 1.0], friction=0.1)  # friction is no matter of the period
    assert theory.ideal_period(rubbing) == theory.ideal_period(Chain.uniform(2))


@pytest.mark.parametrize("parts", [{"base": Cart(1.0)}, {"stiffness": 1e3}])
def test_no_model_applies_to_carts_and_springs(parts):
    assert np.isnan(theory.models(Chain.uniform(3, **parts), 0.1)).all()


@pytest.mark.parametrize(
    "function",
    [
        theory.normal_modes, theory.fundamental_period, theory.fastest_frequency,
        theory.ideal_period, theory.small_angle_periods, theory.com_period,
    ],
)  # fmt: skip
@pytest.mark.parametrize("parts", [{"base": Cart(1.0)}, {"stiffness": 1e3}])
def test_what_is_known_of_a_pivot_at_rest_alone_is_refused_for_carts_and_springs(function, parts):
    with pytest.raises(ValueError, match="rigid rods on a pivot at rest"):
        function(Chain.uniform(300, **parts))
