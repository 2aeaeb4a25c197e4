"""Normally distributed numbers and the logarithm they need, against mpmath, NumPy and SciPy."""

import mpmath
import numpy as np
import pytest
from scipy import stats
from scripts import run_uncompiled

from npend_gym._streams import Purpose
from npend_gym.compiled.jit import kernel
from npend_gym.compiled.normal import log, make_normal, normal_pair
from npend_gym.compiled.philox import keys_of, philox, unit

COUNT = 100_000


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


@kernel
def four_units(keys):
    out = np.empty((4, keys.shape[1]))
    for i in range(keys.shape[1]):
        words = philox(keys[0, i], keys[1, i], 0, 1, Purpose.SENSOR, 0)
        for k in range(4):
            out[k, i] = unit(words[k])
    return out


@pytest.fixture(scope="module")
def units():
    return four_units(keys_of(11, COUNT))


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
    u, v = units[:2]
    radius = np.sqrt(-2.0 * np.log1p(-u))
    expected = [radius * np.cos(2.0 * np.pi * v), radius * np.sin(2.0 * np.pi * v)]
    np.testing.assert_allclose(normals(units[:2]), expected, rtol=1e-13, atol=1e-15)


def test_the_numbers_are_normally_distributed_and_unrelated(units):
    found = np.concatenate([normals(units[:2]), normals(units[2:])])
    for row in found:
        assert stats.kstest(row, "norm").pvalue > 1e-3
        # neighbours, whose seeds differ by 1
        assert abs(np.corrcoef(row[:-1], row[1:])[0, 1]) < 4.0 / np.sqrt(COUNT)
    assert stats.kstest((found**2).sum(axis=0), stats.chi2(4).cdf).pvalue > 1e-3
    assert np.abs(np.corrcoef(found) - np.eye(4)).max() < 4.0 / np.sqrt(COUNT)
    # in the tails too: beyond 3 standard deviations by a count at 4 sigma
    beyond = 2.0 * stats.norm.sf(3.0)
    assert (np.abs(found) > 3.0).mean() == pytest.approx(
        beyond, abs=4.0 * np.sqrt(beyond / found.size)
    )


def test_the_extreme_numbers_give_finite_ones():
    ends = np.array([0.0, 2.0**-53, 0.5, 1.0 - 2.0**-53])
    found = normals(np.array(np.meshgrid(ends, ends)).reshape(2, -1))
    assert np.isfinite(found).all()
    assert np.abs(found).max() == pytest.approx(np.sqrt(2.0 * 53.0 * np.log(2.0)), rel=1e-15)


def test_one_at_a_time_or_many_compiled_or_not_the_bits_are_the_same(units):
    many = normals(units[:2])
    alone = np.array([pair(*each) for each in units[:2, :200].T]).T
    np.testing.assert_array_equal(alone, many[:, :200])
    code = (
        "from npend_gym.compiled.normal import normal_pair\n"
        f"print(*(z for each in {units[:2, :50].T.tolist()} for z in normal_pair(*each)))"
    )
    np.testing.assert_array_equal(run_uncompiled(code), many[:, :50].T.ravel())
