"""Kernels as WebAssembly: the same bits, or an error that says why not."""

import base64
import math

import numpy as np
import pytest

from npend_gym.compiled import wasm
from npend_gym.compiled.jit import inner_kernel
from npend_gym.compiled.sincos import sincos_all
from npend_gym.envs.starts import scale_all

pytestmark = pytest.mark.long  # they compile

VECTORS = "void(float64[::1], float64[::1], float64[::1])"
RUN = """async ([module, numbers]) => {
  const bytes = Uint8Array.from(atob(module), (c) => c.charCodeAt(0)), size = numbers.length;
  const memory = new WebAssembly.Memory({ initial: 2 });
  const made = await WebAssembly.instantiate(bytes, { env: { __linear_memory: memory } });
  const places = [64, 64 + 8 * size, 64 + 16 * size];
  const arrays = places.map((place) => new Float64Array(memory.buffer, place, size));
  arrays[0].set(numbers);
  const given = places.flatMap((place) => [0, 0, BigInt(size), 8n, place, BigInt(size), 8n]);
  const failed = made.instance.exports.sincos_all(0, 32, ...given);
  return [failed, [...arrays[1]], [...arrays[2]]];
}"""


def test_sines_and_cosines_have_the_same_bits_in_a_browser(browser):
    angles = np.random.default_rng(0).uniform(-1e5, 1e5, 1000)
    angles[:4] = 0.0, 1e-300, math.pi, 1e5
    module = base64.b64encode(wasm.wasm_module({sincos_all: VECTORS})).decode()
    tab = browser.new_page()
    failed, sines, cosines = tab.evaluate(RUN, [module, angles.tolist()])
    tab.close()
    expected = np.empty((2, angles.size))
    sincos_all(angles, *expected)
    assert failed == 0
    np.testing.assert_array_equal([sines, cosines], expected)
    np.testing.assert_allclose(sines, np.sin(angles), rtol=0.0, atol=2.3e-16)


def test_what_this_process_has_compiled_already_changes_no_module(monkeypatch, tmp_path):
    before = wasm.wasm_module({sincos_all: VECTORS})
    sincos_all(np.ones(3), *np.empty((2, 3)))  # compiles, or has compiled
    monkeypatch.setattr(wasm, "cache_folder", lambda *_: tmp_path)
    assert wasm.wasm_module({sincos_all: VECTORS}) == before


def test_a_module_is_compiled_once(monkeypatch):
    first = wasm.wasm_module({sincos_all: VECTORS})
    monkeypatch.setattr(wasm, "_compiled", None)
    assert wasm.wasm_module({sincos_all: VECTORS}) == first


def test_where_no_file_can_be_written_modules_are_compiled_again(monkeypatch, tmp_path):
    file = tmp_path / "file"
    file.touch()
    monkeypatch.setattr(wasm, "cache_folder", lambda *_: file / "folder")
    monkeypatch.setattr(wasm, "_compiled", lambda _: b"compiled")
    assert wasm.wasm_module({sincos_all: VECTORS}) == b"compiled"


@inner_kernel
def grow(x):
    for i in range(x.size):
        x[i] = math.exp(x[i])


def test_kernels_that_call_a_library_are_refused():
    with pytest.raises(RuntimeError, match="must need memory alone"):
        wasm.wasm_module({grow: "void(float64[::1])"})


def test_kernels_that_need_a_linker_are_refused():
    types = "void(float64[:, ::1], float64[:, :, ::1], int64, int64[::1])"
    with pytest.raises(RuntimeError, match="must need memory alone"):
        wasm.wasm_module({scale_all: types})
