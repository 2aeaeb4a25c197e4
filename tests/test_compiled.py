"""What the folder for compiled code relies on in Numba, and what it promises to kernels."""

import contextlib
import io
import math
import subprocess
import sys
from inspect import signature
from typing import NamedTuple

import numba
import numpy as np
import pytest
from numba.core.datamodel import register_default
from numba.core.typing import templates
from numba.extending import intrinsic, lower_builtin, overload, type_callable
from numba.np.arrayobj import populate_array
from scripts import run_uncompiled

from npend_gym.compiled.arrays import aligned_zeros, bare, packs
from npend_gym.compiled.exponential import one_minus_exp
from npend_gym.compiled.jit import kernel
from npend_gym.compiled.packs import WIDTH, any_of, where


class RowFields(NamedTuple):
    FIRST: int = 0
    SECOND: int = 1


Row = RowFields()


@kernel
def rows(array):
    return array[Row.SECOND, 0] - array[Row.FIRST, 0]


@kernel
def arithmetic(a, b, out):
    x, y, z = packs(a), packs(b), packs(out)
    for i in range(x.size):
        z[i] = where((x[i] > y[i]) & (x[i] != 0.0), math.sqrt(abs(x[i])) / y[i], -x[i] * 2.0 - y[i])
    return any_of(x[0] > 1e9)


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


def test_the_internals_of_numba_that_packs_use_are_there():
    # A new Numba that moves or renames one of these fails here, by name, and not in a kernel
    assert list(signature(populate_array).parameters)[:2] == ["array", "data"]
    assert {"shape", "strides", "itemsize", "meminfo"} <= set(signature(populate_array).parameters)
    for extension in (intrinsic, lower_builtin, overload, register_default, type_callable):
        assert callable(extension)
    assert hasattr(templates, "Signature")
    assert tuple(int(part) for part in numba.__version__.split(".")[:2]) >= (0, 60)


def test_fields_named_by_a_tuple_of_numbers_are_indices():
    assert rows(np.array([[1.0], [5.0]])) == 4.0


@pytest.mark.parametrize("count", [1, 3])
def test_a_pack_computes_in_every_lane_what_numpy_does_to_the_last_bit(count):
    rng = np.random.default_rng(count)
    a, b = rng.normal(size=(2, count * WIDTH))
    out = np.empty_like(a)
    assert not arithmetic(a, b, out)
    with np.errstate(invalid="ignore"):
        expected = np.where((a > b) & (a != 0.0), np.sqrt(np.abs(a)) / b, -a * 2.0 - b)
    np.testing.assert_array_equal(out, expected)


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


def test_a_kernel_is_loaded_from_the_disk_by_the_next_process(tmp_path):
    code = (
        "import numpy as np\n"
        "from npend_gym.compiled.sincos import sincos_all\n"
        "x = np.linspace(-9.0, 9.0, 7); s, c = np.empty(7), np.empty(7)\n"
        "sincos_all(x, s, c)\n"
        "print(sum(sincos_all.stats.cache_hits.values()))"
    )
    hits = [
        subprocess.run(
            [sys.executable, "-c", code],
            env={"NUMBA_CACHE_DIR": str(tmp_path), "PYTHONPATH": ":".join(sys.path)},
            capture_output=True,
            text=True,
            check=True,
        ).stdout.strip()
        for _ in range(2)
    ]
    assert hits == ["0", "1"]


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
