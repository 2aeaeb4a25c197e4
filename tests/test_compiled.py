"""What the folder for compiled code promises to kernels."""

import contextlib
import io
import sys

import numpy as np
import pytest
from scripts import run_uncompiled

from npend_gym.compiled.arrays import aligned_zeros, bare, packs
from npend_gym.compiled.exponential import one_minus_exp
from npend_gym.compiled.jit import kernel
from npend_gym.compiled.packs import WIDTH


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
