import math

import mpmath
import numpy as np
import pytest
from conftest import chains_in_motion
from hypothesis import given
from hypothesis import strategies as st
from numba import njit

from npend_gym import Chain
from npend_gym.compiled.arrays import packs
from npend_gym.compiled.packs import WIDTH, any_of, where
from npend_gym.compiled.sincos import MAX_ANGLE, sincos
from npend_gym.physics import equations
from npend_gym.physics.kernels.dynamics import (
    WORK_ROWS,
    accelerations,
    arrays_of,
)


@njit(error_model="numpy")
def accelerate_packs(theta, omega, torque, chain, work, alpha):
    accelerations(
        packs(theta), packs(omega), packs(torque), packs(chain), packs(work), packs(alpha)
    )


@pytest.mark.parametrize(
    "parts",
    [
        {},
        {"inertias": 0.2, "centres": 0.3},
        {"inertias": 0.2, "friction": 0.1, "armature": 0.02, "gear": -6.0, "drag": 0.1},
    ],
    ids=["point masses", "links", "machine"],
)
@given(chains_in_motion(max_n=9))
def test_every_lane_of_a_pack_has_the_bits_of_one_chain(parts, motion):
    chain, theta, omega, torque = motion
    chain = Chain(**chain.as_dict() | parts)
    n = chain.n
    rng = np.random.default_rng(n)
    thetas, omegas, torques = (
        np.ascontiguousarray(x[:, None] * rng.uniform(0.5, 1.0, WIDTH))
        for x in (theta, omega, torque)
    )
    alpha = np.empty(n * WIDTH)
    accelerate_packs(
        thetas.ravel(),
        omegas.ravel(),
        torques.ravel(),
        arrays_of(chain.repeated(WIDTH)),
        np.zeros((WORK_ROWS, (n + 2) * WIDTH)),
        alpha,
    )
    for k in range(WIDTH):
        alone = equations.accelerations(chain, *(x[:, k] for x in (thetas, omegas, torques)))
        np.testing.assert_array_equal(alpha.reshape(n, WIDTH)[:, k], alone)


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
