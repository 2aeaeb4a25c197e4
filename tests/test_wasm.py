"""Kernels as WebAssembly: made once, and an error where they need more than memory."""

import math

import numpy as np
import pytest

from npend_gym.compiled import wasm
from npend_gym.compiled.jit import inner_kernel
from npend_gym.compiled.sincos import sincos_all
from npend_gym.envs.starts import scale_all

pytestmark = pytest.mark.long  # they compile

VECTORS = "void(float64[::1], float64[::1], float64[::1])"


def test_what_this_process_has_compiled_already_changes_no_module(monkeypatch, tmp_path):
    before = wasm.wasm_module({sincos_all: VECTORS})
    sincos_all(np.ones(3), *np.empty((2, 3)))  # compiles, or has compiled
    monkeypatch.setattr(wasm, "cache_folder", lambda *_: tmp_path)
    assert wasm.wasm_module({sincos_all: VECTORS}) == before
    monkeypatch.setattr(wasm, "_compiled", None)  # the file is read
    assert wasm.wasm_module({sincos_all: VECTORS}) == before


def test_where_no_file_can_be_written_modules_are_compiled_again(monkeypatch, tmp_path):
    file = tmp_path / "file"
    file.touch()
    monkeypatch.setattr(wasm, "cache_folder", lambda *_: file / "folder")
    monkeypatch.setattr(wasm, "_compiled", lambda _: b"compiled")
    assert wasm.wasm_module({sincos_all: VECTORS}) == b"compiled"


def test_a_damaged_module_is_compiled_again(monkeypatch, tmp_path):
    monkeypatch.setattr(wasm, "cache_folder", lambda *_: tmp_path)
    monkeypatch.setattr(wasm, "_compiled", lambda _: b"compiled")
    for damaged in (b"", b"compiled", b"\0" * 40):
        assert wasm.wasm_module({sincos_all: VECTORS}) == b"compiled"
        (file,) = tmp_path.iterdir()
        whole = file.read_bytes()
        file.write_bytes(damaged)
    assert wasm.wasm_module({sincos_all: VECTORS}) == b"compiled"
    assert file.read_bytes() == whole


@inner_kernel
def grow(x):
    for i in range(x.size):
        x[i] = math.exp(x[i])


TENSORS = "void(float64[:, ::1], float64[:, :, ::1], int64, int64[::1])"


@pytest.mark.parametrize(
    ("made", "types"),
    [(grow, "void(float64[::1])"), (scale_all, TENSORS)],
    ids=["calls a library", "needs a linker"],
)
def test_kernels_that_need_more_than_memory_are_refused(made, types):
    with pytest.raises(RuntimeError, match="must need memory alone"):
        wasm.wasm_module({made: types})
