import math

import mpmath
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numba import njit

from npend_gym.compiled.arrays import packs
from npend_gym.compiled.packs import WIDTH, any_of, where
from npend_gym.compiled.sincos import MAX_ANGLE, sincos


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
