"""Kernels as Python calls them: what an entry takes, refuses, and leaves to Numba."""

import pickle
import shutil
import subprocess
import sys
import threading
from typing import NamedTuple

import numpy as np
import pytest
from numba.core.errors import NumbaError

from npend_gym.compiled import native, processors
from npend_gym.compiled.jit import kernel
from npend_gym.compiled.sincos import sincos
from npend_gym.compiled.sources import code_folder


class Pair(NamedTuple):
    first: np.ndarray
    second: np.ndarray


@kernel
def total(x, scale, out):
    """Add up an array of any kind."""
    out[0] = 0.0
    for i in range(x.shape[0]):
        for j in range(x.shape[1]):
            out[0] += scale * x[i, j]


@kernel
def both(pair, more):
    return pair[0][0] + pair[1][0], more is None


@kernel
def read_only(x):
    return x[0]


@kernel
def copied(x):
    return x.copy()


ARRAYS = [
    np.arange(12.0).reshape(3, 4),
    np.asfortranarray(np.arange(12.0).reshape(3, 4)),
    np.arange(24.0).reshape(3, 8)[:, ::2],
    np.arange(12).reshape(3, 4),
    np.arange(12, dtype=np.float32).reshape(3, 4),
    np.arange(12).reshape(3, 4) > 5,
    np.zeros((0, 4)),
]


@pytest.mark.parametrize("scale", [2.0, 2, True, np.float64(2.0), np.int64(2)])
def test_an_entry_reads_arrays_of_every_layout_and_numbers_of_python_and_numpy(scale):
    out = np.empty(1)
    for _ in range(2):  # once found by what they are, once by what is loaded
        for x in ARRAYS:
            total(x, scale, out)
            assert out[0] == x.sum() * scale


def test_what_another_kind_of_arguments_has_loaded_is_not_run():
    out = np.empty(1)
    total(np.ones((2, 2)), 1.0, out)
    with pytest.raises(NumbaError):
        total(np.ones(4), 1.0, out)
    with pytest.raises(TypeError):
        total(np.ones((2, 2)), 1.0)
    frozen = np.empty(1)
    frozen.flags.writeable = False
    with pytest.raises(NumbaError):
        total(np.ones((2, 2)), 1.0, frozen)


def test_tuples_named_tuples_and_none_are_told_apart():
    x, y = np.array([1.0]), np.array([2.0])
    assert both((x, y), None) == (3.0, True)
    assert both(Pair(x, y), None) == (3.0, True)
    assert both((x, y), 1.0) == (3.0, False)
    assert both((x, np.array([2])), None) == (3.0, True)
    assert both._by_numba.nopython_signatures == []


def test_arrays_that_may_not_be_written_have_machine_code_of_their_own():
    x = np.array([5.0])
    assert read_only(x) == 5.0
    x.flags.writeable = False
    assert read_only(x) == 5.0
    assert len(read_only._loaded) == 2


def test_an_unpickled_type_of_numpys_is_the_usual_one():
    dtype = pickle.loads(pickle.dumps(np.dtype(float).newbyteorder("=")))
    x = np.array([5.0], dtype)
    assert read_only(x) == 5.0
    assert read_only(pickle.loads(pickle.dumps(x))) == 5.0


def test_a_kernel_that_returns_an_array_is_left_to_numba():
    np.testing.assert_array_equal(copied(np.arange(3.0)), [0.0, 1.0, 2.0])
    assert copied._loaded == ()


def test_integers_beyond_64_bits_are_refused():
    with pytest.raises(OverflowError):
        total(np.ones((1, 1)), 2**64, np.empty(1))


def test_threads_get_their_own_results():
    found, count = {}, 2000

    def run(x):
        found[x] = {sincos(x) for _ in range(count)}

    threads = [threading.Thread(target=run, args=(float(x),)) for x in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for x, results in found.items():
        ((sine, cosine),) = results
        assert (sine, cosine) == pytest.approx((np.sin(x), np.cos(x)), abs=1e-15)


def test_an_argument_is_kept_no_longer_than_the_call():
    x, out = np.ones((2, 2)), np.empty(1)
    total(x, 1.0, out)
    before = sys.getrefcount(x)
    for _ in range(10):
        total(x, 1.0, out)
    assert sys.getrefcount(x) == before


def test_kernels_are_pickled_by_their_name():
    assert pickle.loads(pickle.dumps(sincos)) is sincos


STEP = """
import sys
import gymnasium as gym
import npend_gym
env = gym.make("npend/SwingUp-v1", {keywords})
env.reset(seed=0)
env.step(env.action_space.sample())
print(sorted({{"numba", "scipy", "torch", "matplotlib"}} & set(sys.modules)))
"""


@pytest.mark.parametrize(
    "keywords",
    [
        "",
        pytest.param("chain='realaigym C.1'", marks=pytest.mark.long),
        "base='cart', max_force=10.0",
    ],
)
def test_kept_machine_code_runs_without_numba_and_without_scipy(keywords):
    program = STEP.format(keywords=keywords)
    for _ in range(2):  # the first may have to compile
        done = subprocess.run(
            [sys.executable, "-c", program], capture_output=True, text=True, check=True
        )
    assert done.stdout == "[]\n"


@pytest.mark.skipif(
    not processors.levels() and "x86_64" not in processors.processor(), reason="not x86-64"
)
def test_shipped_machine_code_is_taken_where_none_is_kept(tmp_path, monkeypatch):
    level = next(iter(processors.LEVELS))
    text, kind = processors.made_for(level), native.kind_of((1.0,))
    shipped = tmp_path / "shipped" / code_folder().name
    shipped.mkdir(parents=True)
    ours = code_folder() / sincos._file(kind, processors.processor())
    sincos(1.0)
    shutil.copy(ours, shipped / sincos._file(kind, text))
    monkeypatch.setattr(native, "SHIPPED", tmp_path / "shipped")
    monkeypatch.setattr(native, "levels", lambda: [text])
    monkeypatch.setattr(native, "code_folder", lambda: tmp_path / "empty" / code_folder().name)
    fresh = native.Kernel(sincos.py_func)
    assert fresh(1.0) == sincos(1.0)
    assert fresh.hits == 1
    assert not (tmp_path / "empty").exists()
