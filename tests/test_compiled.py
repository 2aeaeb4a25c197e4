"""What the folder for compiled code promises to kernels, against NumPy and mpmath."""

import contextlib
import io
import math
import sys

import mpmath
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from numba import njit
from oracle import box_muller, numpys_philox
from scripts import run_uncompiled

from npend_gym._streams import Purpose
from npend_gym.compiled import intrinsics  # noqa: F401 - Numba then knows packs
from npend_gym.compiled.arrays import aligned_zeros, bare, packs
from npend_gym.compiled.exponential import one_minus_exp
from npend_gym.compiled.jit import kernel
from npend_gym.compiled.normal import log, make_normal, normal_pair
from npend_gym.compiled.packs import WIDTH, any_of, where
from npend_gym.compiled.philox import (
    first_units,
    generator,
    key_of,
    keys_of,
    philox,
    unit,
)
from npend_gym.compiled.sincos import MAX_ANGLE, sincos


@kernel
def references(array):
    """Make many views of an array that the caller owns."""
    view = bare(array)
    total = 0.0
    for i in range(view.shape[0]):
        total += view[i][1:].sum()
    return total


@kernel
def decays(x, out, of_packs):
    for i in range(x.size):
        out[i] = one_minus_exp(x[i])
    y, z = packs(x), packs(of_packs)
    for i in range(y.size):
        z[i] = one_minus_exp(y[i])


def test_a_decay_is_accurate_however_short_and_its_bits_are_the_same_in_packs():
    x = aligned_zeros(64 * WIDTH)
    x[1:] = np.geomspace(1e-30, 1e30, x.size - 1)
    found, of_packs = np.empty_like(x), aligned_zeros(x.size)
    decays(x, found, of_packs)
    np.testing.assert_array_equal(found, of_packs)
    np.testing.assert_allclose(found, -np.expm1(-x), rtol=2e-15)


def test_views_of_a_bare_array_count_no_references():
    array = np.ones((100, 5))
    before = sys.getrefcount(array)
    assert references(array) == 400.0
    assert sys.getrefcount(array) == before


ACCELERATIONS = """
import numpy as np
from npend_gym import Chain, simulate
from npend_gym.physics import accelerations

for chain in (Chain.uniform(3), Chain.rods(1.0, [1.0, 0.5]), Chain.realaigym("C.1")):
    print(*accelerations(chain, 0.5, 1.0))
springs = Chain.uniform(2, stiffness=50.0)
path = simulate(springs, 0.5, 1.0, [0.0, 0.02], method="rk4", dt=0.01)
print(*path.theta[-1], *path.stretch[-1])
"""


@pytest.mark.long
def test_kernels_of_every_kind_of_chain_run_without_compilation_too():
    with contextlib.redirect_stdout(io.StringIO()) as compiled:
        exec(ACCELERATIONS, {})
    ours = run_uncompiled(ACCELERATIONS)
    expected = np.array(compiled.getvalue().split(), float)
    np.testing.assert_allclose(ours, expected, rtol=1e-13)
    assert ours.size == 3 + 2 + 2 + 4


# -- sines, cosines and packs ----------------------------------------------------------------------


@given(st.floats(-MAX_ANGLE, MAX_ANGLE))
def test_sine_and_cosine_are_within_one_ulp(x):
    check_ulp(x)


def test_sine_and_cosine_are_within_one_ulp_near_multiples_of_half_pi():
    rng = np.random.default_rng(0)
    for k in rng.integers(-60_000, 60_000, 500):
        check_ulp(k * np.pi / 2)
        check_ulp(np.nextafter(k * np.pi / 2 + np.pi / 4, 0.0))


def check_ulp(x):
    with mpmath.workprec(250):
        exact = mpmath.sin(mpmath.mpf(x)), mpmath.cos(mpmath.mpf(x))
        for ours, truth in zip(sincos(x), exact, strict=True):
            assert abs(ours - truth) < np.spacing(abs(float(truth)))


@njit(error_model="numpy")
def combine(a, b, out):
    """Every operation of packs, lane by lane; `out` has a row for each."""
    x, y, z = packs(a), packs(b), packs(out)
    for i in range(x.size):
        z[0, i] = (x[i] + 2) * (3.0 - y[i]) / (1.0 + math.sqrt(abs(y[i])))
        z[1, i] = where((x[i] < y[i]) | (x[i] == 1.0), -x[i], y[i])
        z[2, i] = where((x[i] >= y[i]) & (y[i] != 0.0), 1.0, 2.0)
        z[3, i] = where((x[i] <= 0.0) ^ (y[i] > 0.0), x[i], 0.0)
        z[4, i] = 0.0
        z[4, i] += 1.0 if any_of(x[i] > 2.9) else 0.0


def test_packs_calculate_as_numpy_does():
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 5 * WIDTH)).round(1)
    a[3], b[WIDTH], b[7] = np.nan, np.inf, np.nan
    out = np.empty((5, a.size))
    combine(a, b, out)
    with np.errstate(invalid="ignore"):
        expected = [
            (a + 2) * (3.0 - b) / (1.0 + np.sqrt(abs(b))),
            np.where((a < b) | (a == 1.0), -a, b),
            np.where((a >= b) & (b != 0.0), 1.0, 2.0),
            np.where((a <= 0.0) ^ (b > 0.0), a, 0.0),
            np.repeat((a.reshape(-1, WIDTH) > 2.9).any(axis=1), WIDTH),
        ]
    np.testing.assert_array_equal(out, expected)


# -- normally distributed numbers, and the logarithm that they need --------------------------------


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


def test_a_pair_is_that_of_box_and_muller(units):
    np.testing.assert_allclose(normals(units), box_muller(*units), rtol=1e-13, atol=1e-15)


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


# -- random numbers without a state: Philox4x64-10 is NumPy's, to the last bit ---------------------


WORDS = st.integers(0, 2**64 - 1)


@kernel
def block_of(key_low, key_high, block, step, purpose, episode):
    return philox(key_low, key_high, block, step, purpose, episode)


@kernel
def goal_of(key_low, key_high, step, episode):
    word = philox(key_low, key_high, 0, step, Purpose.GOAL, episode)[1]
    return unit(word)


@given(WORDS, WORDS, st.integers(0, 9), WORDS, WORDS, WORDS)
@example(0, 0, 0, 0, 0, 0)
@example(*(2**64 - 1,) * 2, 1, *(2**64 - 1,) * 3)
@example(2**63, 2**64 - 1, 3, 2**32, 5, 2**32 - 1)
def test_every_block_of_words_is_that_of_numpy(low, high, block, step, purpose, episode):
    stream = numpys_philox(low + (high << 64), step, purpose, episode)
    expected = stream.random_raw(4 * (block + 1))[-4:]
    words = block_of(*map(np.uint64, (low, high, block, step, purpose, episode)))
    assert words == tuple(expected.tolist())


def test_a_block_far_down_the_stream_is_the_one_that_numpy_reaches_by_advancing():
    stream = numpys_philox(7, 1, Purpose.SENSOR, 2)
    stream.advance(2**63 + 11)  # in blocks
    words = block_of(np.uint64(7), np.uint64(0), np.uint64(2**63 + 11), 1, Purpose.SENSOR, 2)
    assert words == tuple(stream.random_raw(4).tolist())


def test_whole_numbers_that_are_kept_as_floats_count_as_integers():
    integers = block_of(np.uint64(3), np.uint64(4), 0, 17, Purpose.MOTOR, 2)
    assert block_of(np.uint64(3), np.uint64(4), 0, 17.0, Purpose.MOTOR, 2.0) == integers


@given(st.integers(0, 2**128 - 1), st.integers(0, 2**53))
def test_units_are_what_generators_of_numpy_draw(seed, step):
    expected = np.random.Generator(numpys_philox(seed, step, Purpose.GOAL, 1)).random(2)
    low, high = (np.uint64(word) for word in key_of(seed))
    assert goal_of(low, high, step, 1) == expected[1]
    assert first_units(keys_of(seed, 1), step, Purpose.GOAL, 1)[0] == expected[0]
    np.testing.assert_array_equal(generator(seed, step, Purpose.GOAL, 1).random(2), expected)


@pytest.mark.parametrize("purpose", Purpose)
def test_every_purpose_has_a_stream_of_its_own(purpose):
    others = [first_units(keys_of(0, 100), 0, other, 0) for other in Purpose if other != purpose]
    assert not np.isin(first_units(keys_of(0, 100), 0, purpose, 0), others).any()


@given(st.integers(0, 2**200), st.integers(0, 50))
@example(2**64 - 3, 7)
@example(2**128 - 3, 7)
@example(2**192 - 1, 2)
def test_lane_k_has_the_key_of_the_seed_plus_k(seed, count):
    expected = np.array([key_of(seed + k) for k in range(count)], np.uint64).reshape(count, 2)
    np.testing.assert_array_equal(keys_of(seed, count), expected.T)


def test_the_key_of_a_seed_is_the_seed_itself_or_its_pieces_combined():
    assert key_of(5 + (6 << 64)) == (5, 6)
    assert key_of(np.int64(5)) == (5, 0)
    assert key_of(2**128 - 1) == (2**64 - 1, 2**64 - 1)
    assert key_of((3 << 256) + (9 << 192) + (12 << 128) + 5) == (5 ^ 12 ^ 3, 9)


@pytest.mark.parametrize(("seed", "error"), [(-1, ValueError), (1.5, TypeError), (True, TypeError)])
def test_a_seed_that_is_none_is_refused_by_name(seed, error):
    with pytest.raises(error, match="seed must be"):
        key_of(seed)
