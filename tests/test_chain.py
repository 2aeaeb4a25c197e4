import pickle
from dataclasses import FrozenInstanceError

import numpy as np
import pytest

from npend_gym import Chain


def test_scalars_stand_for_every_rod():
    chain = Chain(2.0, [1.0, 2.0, 3.0], damping=0.1)
    np.testing.assert_array_equal(chain.masses, [2.0, 2.0, 2.0])
    np.testing.assert_array_equal(chain.damping, [0.1, 0.1, 0.1])
    assert chain.n == 3
    assert Chain(1, 1).n == 1
    assert Chain([1, 2], 0.5) == Chain([1.0, 2.0], [0.5, 0.5])


def test_uniform_chain_is_the_chain_of_equal_rods():
    assert Chain.uniform(3, 2.0, 0.5, 9.8, 0.1) == Chain([2.0] * 3, [0.5] * 3, 9.8, [0.1] * 3)


def test_carried_masses_sum_from_the_tip():
    np.testing.assert_array_equal(Chain([1.0, 2.0, 4.0], 1.0).carried_masses, [7.0, 6.0, 4.0])
    assert Chain(1.0, [1.0, 0.5]).total_length == 1.5


def test_a_chain_cannot_be_changed():
    given = np.ones(3)
    chain = Chain(given, 1.0)
    given[0] = 5.0
    assert chain.masses[0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        chain.masses[0] = 2.0
    with pytest.raises(FrozenInstanceError):
        chain.gravity = 1.0


def test_equal_chains_have_equal_hashes_and_survive_pickling():
    a, b = Chain([1.0, 2.0], 1.0), Chain([1.0, 2.0], 1.0)
    assert a == b
    assert hash(a) == hash(b)
    assert pickle.loads(pickle.dumps(a)) == a
    assert a != Chain([1.0, 2.0], 1.0, gravity=1.0)
    assert a != "chain"


def test_repr_is_short_for_long_chains():
    assert repr(Chain.uniform(1000)) == (
        "Chain(n=1000, masses=1, lengths=1, gravity=9.81, damping=0)"
    )
    assert "masses=[1. 2.]" in repr(Chain([1.0, 2.0], 1.0))


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (([], 1.0), ValueError, "masses must be one number or a list"),
        ((1.0, []), ValueError, "lengths must be one number or a list"),
        (([1.0, 2.0], [1.0]), ValueError, "got 2 masses and 1 lengths"),
        (([[1.0]], 1.0), ValueError, "masses must be one number or a list"),
        ((0.0, 1.0), ValueError, "masses must be greater than zero"),
        ((-1.0, 1.0), ValueError, "masses must be greater than zero"),
        ((1.0, [1.0, -2.0]), ValueError, "lengths must be greater than zero"),
        ((np.nan, 1.0), ValueError, "masses must be finite"),
        ((1.0, np.inf), ValueError, "lengths must be finite"),
        (("1", 1.0), TypeError, "masses must hold real numbers"),
        ((True, 1.0), TypeError, "masses must hold real numbers"),
        ((1j, 1.0), TypeError, "masses must hold real numbers"),
        ((None, 1.0), TypeError, "masses must hold real numbers"),
        ((10**400, 1.0), (TypeError, ValueError), "masses must"),
        ((1.0, 1.0, -9.81), ValueError, "gravity must be zero or more"),
        ((1.0, 1.0, np.nan), ValueError, "gravity must be finite"),
        ((1.0, 1.0, "9"), TypeError, "gravity must be a real number"),
        ((1.0, 1.0, [9.81]), TypeError, "gravity must be a real number"),
        ((1.0, 1.0, 9.81, -0.1), ValueError, "damping must be zero or more"),
        ((1.0, 1.0, 9.81, 1e-40), ValueError, "damping must be zero or at least 1e-30"),
        ((1.0, 1.0, 9.81, 0.0, 1e-40), ValueError, "drag must be zero or at least 1e-30"),
        ((1.0, 1.0, 1e-40), ValueError, "gravity must be zero or at least 1e-30"),
        ((1.0, 1.0, 9.81, [0.1, 0.1]), ValueError, r"damping must be one number or .* \(1,\)"),
    ],
)
def test_bad_arguments_are_refused_by_name(arguments, error, message):
    with pytest.raises(error, match=message):
        Chain(*arguments)


@pytest.mark.parametrize(
    ("n", "error", "message"),
    [
        (0, ValueError, "n must be between 1 and 1000000, got 0"),
        (-3, ValueError, "n must be between"),
        (10**9, ValueError, "n must be between"),
        (10**400, ValueError, "n must be between"),
        (2.0, TypeError, "n must be an integer"),
        (True, TypeError, "n must be an integer"),
        ("3", TypeError, "n must be an integer"),
        (np.nan, TypeError, "n must be an integer"),
    ],
)
def test_bad_counts_are_refused_by_name(n, error, message):
    with pytest.raises(error, match=message):
        Chain.uniform(n)


def test_per_rod_input_to_uniform_is_refused_by_name():
    with pytest.raises(TypeError, match="mass must be a real number"):
        Chain.uniform(2, mass=[1.0, 2.0])
    with pytest.raises(ValueError, match="length must be greater than zero"):
        Chain.uniform(2, length=0.0)
