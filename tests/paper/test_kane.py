import sys

import numpy as np
import oracle
import pytest

from npend_gym import Chain
from npend_gym.physics import accelerations
from paper.checks.kane import kane_costs
from paper.kane import derive, kane_accelerations


@pytest.mark.long
@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 6])
def test_kanes_method_gives_the_same_accelerations_for_unequal_rods(n):
    rng = np.random.default_rng(n)
    by_kane = kane_accelerations(n)
    for _ in range(5):
        masses, lengths = rng.uniform(0.3, 3.0, n), rng.uniform(0.3, 3.0, n)
        theta, omega = rng.uniform(-np.pi, np.pi, n), rng.normal(0.0, 3.0, n)
        expected = oracle.accelerations(masses, lengths, 9.81, np.zeros(n), theta, omega, 0.0)
        ours = accelerations(Chain(masses, lengths), theta, omega)
        got = by_kane(theta, omega, masses, lengths, 9.81)
        scale = np.abs(expected).max()
        np.testing.assert_allclose(got, ours, rtol=0.0, atol=1e-12 * scale)
        np.testing.assert_allclose(got, expected, rtol=0.0, atol=1e-12 * scale)


def test_one_number_stands_for_all_rods():
    expected = oracle.accelerations(
        np.full(2, 2.0), np.full(2, 0.5), 3.0, np.zeros(2), np.full(2, 0.1), np.zeros(2), 0.0
    )
    np.testing.assert_allclose(kane_accelerations(2)(0.1, 0.0, 2.0, 0.5, 3.0), expected)


@pytest.mark.long
def test_the_equations_grow_as_a_cube_of_n():
    costs = kane_costs(7)
    assert not np.diff([cost["operations"] for cost in costs[1:]], 4).any()
    assert all(cost["seconds"] > 0.0 for cost in costs)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ((0.1, 0.0, [1.0], 1.0, 9.81), ValueError, "masses must be one number"),
        ((np.nan, 0.0, 1.0, 1.0, 9.81), ValueError, "theta must be finite"),
        ((0.1, 0.0, 1.0, 1.0, "g"), TypeError, "gravity must be a real number"),
    ],
)
def test_bad_arguments_are_refused_by_name(arguments, error, message):
    with pytest.raises(error, match=message):
        kane_accelerations(2)(*arguments)
    with pytest.raises(ValueError, match="n must be between 1 and"):
        derive(0)


def test_without_sympy_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "sympy", None)  # as where it is not installed
    with pytest.raises(ImportError, match=r"npend-gym\[paper\]"):
        derive(1)
