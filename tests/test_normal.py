"""Normally distributed numbers and the logarithm they need, against mpmath and NumPy."""

import mpmath
import numpy as np
import pytest
from scripts import run_uncompiled

from npend_gym.compiled.jit import kernel
from npend_gym.compiled.normal import log, make_normal, normal_pair
from npend_gym.compiled.philox import first_units, keys_of


@kernel
def logs(x):
    out = np.empty_like(x)
    for i in range(x.size):
        out[i] = log(x[i])
    return out


@kernel
def pair(u, v):
    return normal_pair(u, v)


def normals(units):
    out = units.copy()
    make_normal(out[0], out[1])
    return out


@pytest.fixture(scope="module")
def units():
    return np.random.default_rng(11).random((2, 100_000))


def test_the_logarithm_is_exact_to_one_unit_in_the_last_place():
    rng = np.random.default_rng(0)
    x = np.concatenate([
        rng.random(2000), 1.0 + rng.normal(size=1000) * 1e-3, 2.0 ** rng.uniform(-1000, 1000, 1000),
        1.0 - 2.0**-53 * np.arange(1, 20), 2.0 ** -np.arange(60.0), [np.sqrt(0.5), np.sqrt(2.0)],
    ])  # fmt: skip
    with mpmath.workdps(40):
        exact = [mpmath.log(mpmath.mpf(value)) for value in x.tolist()]
        errors = np.array(
            [abs(float(a - e)) for a, e in zip(map(mpmath.mpf, logs(x)), exact, strict=True)]
        )
    assert (errors <= np.spacing(np.abs(np.array(exact, float)))).all()
    assert logs(np.ones(1))[0] == 0.0
    np.testing.assert_allclose(logs(x), np.log(x), rtol=4e-16)


def test_a_pair_is_that_of_box_and_muller(units):
    u, v = units
    radius = np.sqrt(-2.0 * np.log1p(-u))
    expected = [radius * np.cos(2.0 * np.pi * v), radius * np.sin(2.0 * np.pi * v)]
    np.testing.assert_allclose(normals(units), expected, rtol=1e-13, atol=1e-15)


def test_the_extreme_numbers_give_finite_ones():
    ends = np.array([0.0, 2.0**-53, 0.5, 1.0 - 2.0**-53])
    found = normals(np.array(np.meshgrid(ends, ends)).reshape(2, -1))
    assert np.isfinite(found).all()
    assert np.abs(found).max() == pytest.approx(np.sqrt(2.0 * 53.0 * np.log(2.0)), rel=1e-15)


def test_one_at_a_time_or_many_the_bits_are_the_same(units):
    alone = np.array([pair(*each) for each in units[:, :200].T]).T
    np.testing.assert_array_equal(alone, normals(units)[:, :200])


def test_what_is_drawn_is_the_same_without_compilation():
    code = (
        "from npend_gym.compiled.normal import normal_pair\n"
        "from npend_gym.compiled.philox import first_units, keys_of\n"
        "u, v = (first_units(keys_of(2**64 - 2, 50), 5, purpose, 2) for purpose in (3, 4))\n"
        "print(*u, *v, *(z for each in zip(u, v) for z in normal_pair(*each)))"
    )
    drawn = np.array([first_units(keys_of(2**64 - 2, 50), 5, purpose, 2) for purpose in (3, 4)])
    expected = np.concatenate([drawn.ravel(), normals(drawn).T.ravel()])
    np.testing.assert_array_equal(run_uncompiled(code), expected)
