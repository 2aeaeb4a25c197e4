"""The paper's equations, integrators and chaos: each computation against an independent truth."""

import hashlib
import math

import numpy as np
import oracle
import pytest
from scipy.integrate import odeint
from scipy.linalg import eigh
from scipy.special import ellipk, jn_zeros

from npend_gym import Chain, simulate, theory
from paper.checks import frequencies, integrators, linear, listings
from paper.checks import pendulum as one
from paper.checks import series as amplitude
from paper.checks.chaos import growth
from paper.checks.equations import accelerations, lagrange_accelerations
from paper.estimator import listing_estimate, listing_periods
from paper.findings import finding, groups, outcome
from paper.kane import sympy_and_mechanics
from paper.motions import EXACT, compare, lagrangian, samples
from paper.printed import dead_functions, function, simulated_counts, undefined_names
from paper.printed import listings as printed_listings
from paper.registry import Verdict

FORMULAS = [key for key, group in groups().items() if group in ("equations", "derivation")]


def by_oracle(motion):
    zero = np.zeros(motion.n)
    return oracle.accelerations(
        motion.m, motion.l, motion.g, zero, motion.theta, motion.omega, zero
    )


@pytest.mark.parametrize("motion", samples(3)[:5])
def test_lagrange_by_sympy_and_the_papers_system_with_max_give_the_dense_oracle(motion):
    expected = by_oracle(motion)
    scale = np.abs(expected).max()
    for ours in (lagrange_accelerations(motion), accelerations(motion, "max"), motion.alpha):
        np.testing.assert_allclose(ours, expected, rtol=0.0, atol=1e-12 * scale)
    assert np.abs(accelerations(motion, "min") - expected).max() > 1e-2 * scale


@pytest.mark.long
def test_chaos_is_looked_for_over_the_periods_that_are_said():
    note = finding("chaos-energy").note
    assert f"{500.0 / theory.fundamental_period(Chain.uniform(2)):.0f} periods" in note


@pytest.mark.parametrize("key", FORMULAS)
def test_every_formula_holds_as_printed_or_with_its_correction(key):
    verdict, numbers = outcome(key)
    if "mended" in numbers:
        assert verdict is Verdict.SLIP
        assert numbers["mended"] < (1e-6 if key == "two-bodies-small" else EXACT)
        assert numbers["off"] > 0.1
    else:
        assert verdict is Verdict.HOLDS
        assert numbers["off"] < EXACT


def test_a_verdict_follows_the_computation():
    def wrong(motion):
        return 1.01 * lagrangian(motion)

    assert len(FORMULAS) == 20
    assert compare(lagrangian, lagrangian).verdict is Verdict.HOLDS
    assert compare(lagrangian, wrong).verdict is Verdict.FAILS
    assert compare(lagrangian, wrong, wrong).verdict is Verdict.FAILS
    assert compare(lagrangian, wrong, lagrangian).verdict is Verdict.SLIP


def test_the_printed_series_cut_off_gives_the_printed_numbers_and_diverges():
    sums = amplitude.printed_sums(math.pi / 4)
    assert sums[9] == pytest.approx(0.049, abs=5e-4)
    assert 1.0 / (1.0 + sums[14]) == pytest.approx(0.309, abs=5e-4)
    terms = np.diff(sums)
    assert np.all(terms[1:] > terms[:-1])
    assert amplitude.origin(0.049, sums) == "the printed value"
    assert amplitude.origin(0.5, sums) == "the printed value is no partial sum"


def test_the_corrected_series_is_the_elliptic_integral():
    limit = 2.0 * ellipk(math.sin(math.pi / 8) ** 2) / math.pi - 1.0
    assert amplitude.corrected_sums(math.pi / 4)[-1] == pytest.approx(limit, rel=1e-13)
    assert one.measured_period(math.pi / 4, Chain.uniform(1)) == pytest.approx(
        theory.single_period() * (1.0 + limit), rel=1e-10
    )


def test_small_angle_errors_grow_as_their_taylor_series_say():
    orders = outcome("cubic-error").numbers
    assert orders["torque"] == pytest.approx(3.0, abs=0.01)
    assert orders["relative"] == pytest.approx(2.0, abs=0.01)
    assert orders["period"] == pytest.approx(2.0, abs=0.01)


def test_full_matrices_have_the_normal_frequencies_and_the_papers_have_its_own(uneven):
    mass, stiffness = linear.full_matrices(uneven)
    rows = uneven.lengths[:, None]
    squares = eigh(stiffness * rows, mass * rows, eigvals_only=True)
    np.testing.assert_allclose(np.sqrt(squares), theory.normal_modes(uneven)[0], rtol=1e-12)
    assert linear.acceleration_error((mass, stiffness), uneven) < 1e-8
    mass, stiffness = linear.paper_matrices(uneven)
    roots = frequencies.generalised_roots(stiffness, mass)
    np.testing.assert_allclose(roots, np.sort(frequencies.diagonal_frequencies(uneven)))
    mean = 2 * np.pi / frequencies.paper_frequencies(uneven).mean()
    assert theory.ideal_period(uneven) == pytest.approx(mean, rel=1e-14)


def test_the_error_of_the_papers_period_tends_to_that_of_a_hanging_rope():
    assert frequencies.period_ratio(Chain.uniform(1)) == pytest.approx(1.0, rel=1e-14)
    limit = jn_zeros(0, 1)[0] / 2.0
    assert frequencies.period_ratio(Chain.uniform(2000)) == pytest.approx(limit, rel=5e-4)


@pytest.mark.long
def test_runge_kutta_has_its_orders():
    local, after = integrators.runge_kutta_errors()
    np.testing.assert_allclose(local[:-1] / local[1:], 32.0, rtol=0.1)
    np.testing.assert_allclose(after[:-1] / after[1:], 16.0, rtol=0.15)
    np.testing.assert_allclose(outcome("local-error").numbers["ratios"], 1.0, atol=0.02)
    assert outcome("taylor").numbers["order"] == pytest.approx(3.0, abs=0.05)


def test_the_printed_integrator_runs_and_gives_our_motion():
    times = np.linspace(0.0, 2.0, 21)
    sympy, mechanics = sympy_and_mechanics()
    integrate = function(
        1, "integrate_pendulum", mechanics=mechanics, odeint=odeint,
        **{name: getattr(sympy, name) for name in ("symbols", "Dummy", "lambdify")},
    )  # fmt: skip
    theirs = integrate(2, times, 45.0)
    ours = simulate(Chain.uniform(2, length=0.5), np.deg2rad(45.0), 0.0, times)
    np.testing.assert_allclose(theirs[:, :2], ours.theta, atol=1e-6)
    np.testing.assert_allclose(theirs[:, 2:], ours.omega, atol=1e-5)
    x, y = function(2, "get_xy_coords")(theirs)
    np.testing.assert_allclose(np.stack([x, y], -1)[:, 1:], ours.positions(), atol=1e-6)


def test_order_grows_linearly_and_chaos_exponentially():
    regular = growth(1, 1.0, 400.0)
    assert not regular.chaotic
    assert regular.logarithm[-1] < np.log(10.0 * regular.times[-1])
    wild = growth(2, 2.0, 260.0)
    assert wild.chaotic
    assert wild.exponent(0.5) == pytest.approx(wild.exponent(), rel=0.15)


def test_lyapunov_exponents_scale_with_the_square_root_of_the_length():
    long, short = (growth(2, 2.0, 80.0 * length**0.5, length) for length in (1.0, 0.25))
    assert short.times[-1] == pytest.approx(long.times[-1] / 2.0)
    # chaotic runs of different steps differ, their rates little
    assert short.rate == pytest.approx(2.0 * long.rate, rel=0.3)


def test_python_stops_at_one_line_of_two_of_the_listings():
    texts = [listing.printed for listing in printed_listings()]
    assert len(texts) == 4
    for text, whole in zip(texts, (True, True, False, False), strict=True):
        if whole:
            compile(text, "listing", "exec")
        else:
            with pytest.raises(SyntaxError):
                compile(text, "listing", "exec")
    assert [len(listing.mends) for listing in printed_listings()] == [0, 0, 1, 1]
    assert texts[2].count("theta_j.append") == 2  # both on the line that is split


def test_what_the_listings_define_call_and_lack():
    assert dead_functions(3) == {"theta", "computeperiod", "get_r"}
    assert undefined_names(4) == {"sequence_of_periods_0", "n"}
    assert list(simulated_counts()) == list(range(1, 22))
    assert function(4, "period")(5) == pytest.approx(2 * math.pi * math.sqrt(5 / 9.8))


def test_a_turning_point_counts_once_where_none_is_found_twice(monkeypatch):
    assert outcome("index-seconds", counts=(1, 2)).verdict is Verdict.SLIP
    turns_at_once = np.r_[0.0, 1.0, -1.0, 2.0, np.linspace(1.0, 0.0, 30)]
    monkeypatch.setattr(listings, "heights", lambda *_: turns_at_once[None])
    assert outcome("index-seconds", counts=(1,)).verdict is Verdict.FAILS


def test_the_listings_estimate_is_its_printed_loop():
    swing = -np.cos(0.7 * np.cos(np.linspace(0.0, 20.0, 90)))
    turns_at_once = np.r_[0.0, 1.0, -1.0, 2.0, np.linspace(1.0, 0.0, 30)]
    for height in (swing, turns_at_once):
        printed = listings.printed_estimate(height)
        assert printed == pytest.approx(listing_estimate(height), rel=1e-13)


def test_listing_of_a_steady_climb_is_not_a_number():
    assert np.isnan(listing_estimate(np.linspace(0.0, 100.0, 50)))


def test_the_listing_gives_the_same_bits_on_every_machine():
    digest = hashlib.sha256()
    for n in (1, 5, 20):
        digest.update(listing_periods(Chain.uniform(n), 0.7).tobytes())
    for start in np.linspace(0.1, 1.0, 17):
        digest.update(listing_periods(Chain.uniform(3), start).tobytes())
    golden = "ac4a922183b77f6611320cd8e1f9860775fb865e779440ac1f909e7ae9ca1312"
    assert digest.hexdigest() == golden


def test_runge_kutta_follows_the_longest_listed_chain_that_is_called_stable_near_rest():
    times, n = np.linspace(0.0, 10.0, 101), integrators.first_unstable()
    for rods, stays in ((n - 1, True), (n, False)):
        chain = Chain.uniform(rods, length=1.0 / rods)
        theta = simulate(chain, 1e-6, 0.0, times, method="rk4", dt=integrators.FRAME).theta
        assert (np.abs(theta).max() < 1e-5) == stays


def test_every_rest_but_the_one_that_hangs_is_unstable():
    numbers = outcome("right-angle").numbers
    assert numbers["others"] == 2 ** numbers["rods"] - 1
