import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ellipk, j0, j1, jn_zeros

from npend_gym import Chain, pseudo_periods, theory

ZEROS = jn_zeros(0, 4000)
T1 = 4 * np.pi / ZEROS[0]  # of a rope, in sqrt(L/g)


def rope_velocity(s, t):
    """The modes of a rope, weighed so that their sum converges fast away from fronts."""
    filtered = np.exp(-36.0 * (ZEROS / ZEROS[-1]) ** 10)
    terms = j0(ZEROS * np.sqrt(s)) * np.sin(ZEROS * t / 2) / (ZEROS**2 * j1(ZEROS))
    return np.sum(filtered * terms)


@pytest.mark.parametrize("s", [0.0, 0.01, 0.08, 0.25, 0.5, 0.7, 0.9, 0.99])
def test_a_rope_turns_where_the_sum_of_its_modes_is_zero(s):
    turn = brentq(lambda t: rope_velocity(s, t), 0.9 * T1, 1.1 * T1, xtol=1e-14)
    assert theory.release_profile(s) == pytest.approx(turn / T1, abs=1e-10)
    # it is the second reversal: before, the velocity has risen through zero once
    signs = np.sign([rope_velocity(s, t) for t in np.linspace(0.01, 0.99, 60) * turn])
    assert np.count_nonzero(np.diff(signs)) == 1


def test_at_the_front_a_rope_turns_where_very_many_modes_say():
    # the front, back from the tip and the pivot, meets the turning point
    s = brentq(lambda s: theory.release_profile(s) * T1 / 2 + np.sqrt(s) - 3, 0.1, 0.2)
    tau = theory.release_profile(s) * T1 / 2
    zeros = jn_zeros(0, 20)
    k = np.arange(21, 2_000_001)
    b = (k - 0.25) * np.pi
    zeros = np.concatenate([zeros, b + 1 / (8 * b) - 124 / (3 * (8 * b) ** 3)])
    shape = j0(zeros * np.sqrt(s)) / (zeros**2 * j1(zeros))
    total = [np.sum(shape * np.sin(zeros * t)) for t in (tau - 1e-6, tau + 1e-6)]
    assert total[0] < 0.0 < total[1]


def test_the_profile_falls_from_tip_to_pivot_and_has_the_known_values():
    s = np.linspace(0.0, 1.0, 101).reshape(1, 101)
    profile = theory.release_profile(s)
    assert profile.shape == s.shape
    assert np.all(np.diff(profile) < 0.0)
    found = profile[0, [0, 50, 100]]
    np.testing.assert_allclose(found, [1.05139, 0.950024, 0.93661], atol=1e-5)
    mean = (profile[0, 1:] + profile[0, :-1]).mean() / 2
    assert mean == pytest.approx(0.963675, abs=1e-5)
    near = theory.release_profile(1 - np.array([1e-5, 1.1e-5, 2.5e-5, 1e-4]))
    np.testing.assert_allclose(near, profile[0, -1], atol=1e-8)


@pytest.mark.parametrize(
    "n", [100, pytest.param(1000, marks=[pytest.mark.long, pytest.mark.nightly])]
)
def test_a_long_chain_in_small_motion_turns_like_a_hanging_rope(n):
    chain = Chain.uniform(n)
    ratio = theory.small_angle_periods(chain) / theory.fundamental_period(chain)
    off = ratio - theory.release_profile((n - np.arange(1, n + 1) + 0.5) / (n + 0.5))
    late = ratio > 0.85
    assert np.count_nonzero(~late) < 1.3 * np.sqrt(n) / 3
    assert np.sqrt(np.mean(off[late] ** 2)) < {100: 2.5e-4, 1000: 1.6e-5}[n]
    assert np.quantile(np.abs(off[late]), 0.95) < {100: 5.1e-4, 1000: 3.1e-5}[n]
    assert np.abs(off[late]).max() < {100: 1.2e-3, 1000: 1.4e-4}[n]
    assert abs(off[-1]) < {100: 3e-6, 1000: 3e-8}[n]


@pytest.mark.long
@pytest.mark.parametrize(
    "chain",
    [
        Chain.uniform(5),
        Chain([1.0, 0.5, 2.0], [1.0, 0.3, 0.7]),
        Chain.rods([1.0, 0.4], [0.5, 0.8], gravity=3.0),
        # its tip first moves outwards
        Chain([0.69, 1.11], [1.51, 1.9], centres=[0.519, 0.352], inertias=[0.167, 0.003]),
    ],
)
def test_small_releases_have_the_periods_of_the_whole_dynamics(chain):
    measured = pseudo_periods(chain, 1e-4)
    np.testing.assert_allclose(theory.small_angle_periods(chain), measured, rtol=1e-8)


def test_small_releases_of_two_turn_where_two_sines_cancel():
    # theta = sum c_k v_k cos(w_k t), w^2 = (2 -+ sqrt 2) g/l, v = (1, +-sqrt 2); from (1, 1)
    w = np.sqrt((2 + np.array([-1, 1]) * np.sqrt(2)) * 9.81)
    c = np.array([1 + 1 / np.sqrt(2), 1 - 1 / np.sqrt(2)]) / 2
    shape = np.array([[1.0, 1.0], [1 + np.sqrt(2), 1 - np.sqrt(2)]])  # of the bobs' x
    t1 = 2 * np.pi / w[0]
    turns = [
        brentq(lambda t, row=row: row @ (c * w * np.sin(w * t)), 0.8 * t1, 1.2 * t1)
        for row in (*shape, shape.sum(axis=0))
    ]
    found = theory.small_angle_periods(Chain.uniform(2))
    np.testing.assert_allclose(found, turns[:2], rtol=1e-12)
    assert theory.com_period(2) == pytest.approx(turns[2], rel=1e-12)


def measured_com(chain, angle):
    return pseudo_periods(chain, angle, definition="com", rtol=1e-12)[0]


@pytest.mark.parametrize("n", [2, 3, 5, 20])
def test_the_centre_of_mass_of_equal_rods_has_the_period_of_the_law(n):
    chain = Chain.uniform(n)
    small = measured_com(chain, 1e-4)
    assert theory.com_period(chain) == pytest.approx(small, rel=1e-8)
    for angle in (0.5, 1.0):
        law = theory.large_n_com_period(n, angle)
        assert law == pytest.approx(measured_com(chain, angle), rel=0.002 if n >= 5 else 0.004)


def test_the_law_of_one_pendulum_is_its_period():
    angles = np.array([[0.1, 1.0], [2.0, 3.0]])
    np.testing.assert_allclose(
        theory.com_period(1, angles), theory.pendulum_period(angles), rtol=1e-12
    )


def test_links_with_inertia_have_their_own_centre_of_mass():
    # a compound pendulum: one rod, its centre of mass in the middle
    rod = Chain.rods([2.0], [0.8])
    expected = 2 * np.pi * np.sqrt(2 * 0.8 / (3 * 9.81)) * 2 / np.pi * ellipk(np.sin(0.35) ** 2)
    assert theory.com_period(rod, 0.7) == pytest.approx(expected, rel=1e-12)
    two = Chain.rods([1.0, 0.4], [0.5, 0.8])
    assert theory.com_period(two) == pytest.approx(measured_com(two, 1e-4), rel=1e-8)


def test_the_factor_of_the_law_is_that_of_a_sum_of_many_modes():
    k = np.arange(1, 4001)
    found = brentq(
        lambda t: np.sum(np.sin(ZEROS[k - 1] * t / 2) / ZEROS[k - 1] ** 3), 0.9 * T1, 1.1 * T1
    )
    assert theory.com_ratio() == pytest.approx(found / T1, abs=1e-7)
    assert theory.com_ratio() * 2 / ZEROS[0] == pytest.approx(0.8223, abs=5e-5)


def test_the_law_of_very_long_chains_is_that_of_their_modes():
    below, above = (theory.com_period(n) / theory.large_n_period(n) for n in (200, 201))
    assert below == pytest.approx(above, rel=2e-7)
    assert theory.com_period(10**5, 0.5) > theory.com_period(10**5)
    slow = Chain.uniform(1001, length=0.5, gravity=2.0)
    assert theory.com_period(slow) == pytest.approx(0.5 * theory.com_period(
        Chain.uniform(1001, gravity=1.0)), rel=1e-12)  # fmt: skip


def test_the_slowest_period_is_known_to_the_next_order():
    for n, error in ((5, 3.8e-6), (10, 2.9e-7), (100, 3.4e-11)):
        exact = theory.uniform_frequencies(n)[0]
        found = theory.large_n_period(n, terms=2)
        assert found == pytest.approx(2 * np.pi / exact, rel=error)
    assert theory.large_n_period(10) == theory.large_n_period(10, terms=1)


def test_where_straight_is_no_rest_there_is_no_period():
    upright = Chain([1.0, 1.0], [1.0, 1.0], centres=[0.5, -0.2], inertias=0.1)
    for chain in (Chain.uniform(3, gravity=0.0), Chain.uniform(20_000, gravity=0.0), upright):
        assert np.isnan(theory.small_angle_periods(chain)).all()
        assert np.isnan(theory.com_period(chain, [0.1, 0.2])).all()
