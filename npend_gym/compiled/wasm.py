"""Kernels as WebAssembly: the package's own compiled functions, for a browser.

Numba writes a kernel in the language of LLVM, and the LLVM that comes with Numba knows WebAssembly.
There is no fused multiply-add there, and sines are polynomials (`sincos`): a browser computes the
bits that the processor does.

LLVM makes an object file for a linker. Kernels need nothing but memory, no library and no stack, so
that there is nothing to link: the object is a module, which lacks only the names under which its
functions are called.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager, suppress
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from npend_gym import _files
from npend_gym.compiled.machine_code import read_code
from npend_gym.compiled.native import compiler
from npend_gym.compiled.sources import PACKAGE, cache_folder

_TRIPLE = "wasm32-unknown-unknown"
_FEATURES = "+bulk-memory,+sign-ext,+nontrapping-fptoint"  # in every browser since 2020
_MEMORY = "env.__linear_memory"
_OPTIMISATION = 2
_LINES = re.MULTILINE
# Sections of a module, WebAssembly Core Specification 2.0, 5.5.2: their numbers and their order
_CUSTOM, _TYPE, _IMPORT, _FUNCTION, _EXPORT, _CODE = 0, 1, 2, 3, 7, 10
_HEADER = b"\0asm\x01\0\0\0"
_PROGRAM = (
    "import sys; from npend_gym.compiled.wasm import write_module; write_module(*sys.argv[1:])"
)
# The table of symbols in the section "linking", tool-conventions/Linking.md
_SYMBOL_TABLE, _IS_FUNCTION, _UNDEFINED = 8, 0, 0x10


def wasm_module(kernels: Mapping[Callable[..., Any], str]) -> bytes:
    """Return a WebAssembly module that exports kernels by their names; it is compiled once.

    It imports its memory, as `_MEMORY`. A function takes, after two addresses for what it returns
    and raises, its arguments as Numba hands them on: a number as it is, None as 0, an array as
    (0, 0, size, bytes of an entry, address, *shape, *strides), addresses of 32 bits and all else of
    64. It returns 0 unless it raises.

    Parameters
    ----------
    kernels : mapping
        Functions of a module, decorated with `kernel`, each with the types of its arguments as
        Numba writes them, such as "void(float64[:, ::1], none)".

    Raises
    ------
    RuntimeError
        If the kernels need more than memory, or this version of Numba cannot compile them.
    """
    versions = (import_module(name).__version__ for name in ("numba", "llvmlite"))
    what = [*versions, *(f"{one.__name__}{types}" for one, types in kernels.items())]
    chosen = import_module("numba").config.CACHE_DIR
    digest = sha256("\n".join(what).encode()).hexdigest()[:16]
    kept = cache_folder(PACKAGE, chosen) / f"{digest}.wasm"
    module = read_code(kept)
    if module is not None:
        return module
    module = _compiled(kernels)
    with suppress(OSError):  # a folder that cannot be written to: the next call compiles again
        kept.parent.mkdir(parents=True, exist_ok=True)
        _files.write_checked(kept, module)
    return module


def _compiled(kernels: Mapping[Callable[..., Any], str]) -> bytes:
    """Compile the kernels in a process of its own.

    In this one, kernels that they call may have been compiled already, for its processor; and what
    is compiled for a browser must not be kept as machine code of this computer.
    """
    named = [(one.__module__, one.__name__, types) for one, types in kernels.items()]
    with TemporaryDirectory() as folder:
        module = Path(folder) / "kernels.wasm"
        done = subprocess.run(  # noqa: S603 - this Python
            [sys.executable, "-W", "ignore", "-c", _PROGRAM, json.dumps(named), str(module)],
            env=os.environ
            | {
                "NUMBA_CACHE_DIR": folder,
                "NPEND_GYM_QUIET": "1",
                "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
            },
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode != 0:
            raise RuntimeError((done.stderr.strip() or "compiling ended").splitlines()[-1])
        return module.read_bytes()


def write_module(named: str, out: str) -> None:
    """Compile kernels that are given as JSON, (module, name, types) each, into the file `out`."""
    kernels = {getattr(import_module(at), name): types for at, name, types in json.loads(named)}
    try:
        Path(out).write_bytes(_compiled_here(kernels))
    except RuntimeError as error:
        raise SystemExit(str(error)) from error


def _compiled_here(kernels: Mapping[Callable[..., Any], str]) -> bytes:
    """Compile the kernels together."""
    llvm: Any = import_module("llvmlite.binding")
    compiler()  # with which Numba knows views of arrays, and packs
    if not hasattr(llvm, "create_pass_builder"):
        raise RuntimeError("compiling for WebAssembly needs Numba 0.62 or newer")
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    machine = llvm.Target.from_triple(_TRIPLE).create_target_machine(
        cpu="mvp", features=_FEATURES, opt=_OPTIMISATION, reloc="static"
    )
    whole, names = llvm.parse_assembly(""), dict[str, str]()
    for function, types in kernels.items():
        symbol, text = _llvm_of(function, types)
        names[symbol] = function.__name__
        whole.link_in(llvm.parse_assembly(_retargeted(text, str(machine.target_data))))
    for one in whole.functions:
        if not one.is_declaration:
            one.linkage = "external" if one.name in names else "internal"
    options = llvm.create_pipeline_tuning_options(speed_level=_OPTIMISATION)
    # kernels are small and called some thousand times a second: short code comes first
    options.loop_unrolling = options.loop_vectorization = options.slp_vectorization = False
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(whole, builder)
    missing = [f.name for f in whole.functions if f.is_declaration and "llvm." not in f.name]
    if missing:
        raise RuntimeError(f"kernels for a browser must not call {', '.join(missing)}")
    return with_exports(machine.emit_object(whole), names)


def _llvm_of(function: Any, types: str) -> tuple[str, str]:
    """Return the symbol of a kernel and its text in LLVM's language, not yet optimised."""
    numba: Any = import_module("numba")
    options = {
        "nogil": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True,
        "pipeline_class": import_module("npend_gym.compiled.inner").KernelCompiler,
    }  # fmt: skip
    with _not_optimised():
        dispatcher = numba.njit(error_model="numpy", **options)(function.py_func)
        dispatcher.compile(types)
        (compiled,) = dispatcher.overloads.values()
        return compiled.fndesc.llvm_func_name, compiled.library.get_llvm_str()


@contextmanager
def _not_optimised() -> Generator[None]:
    """Let Numba leave out the passes that are for the processor of this machine."""
    config: Any = import_module("numba.core.config")
    before = config.OPT
    config.OPT = type(before)(0)
    try:
        yield
    finally:
        config.OPT = before


def _retargeted(text: str, layout: str) -> str:
    """Return a module's text for WebAssembly.

    Arrays in a browser belong to nobody: what counts references to them does nothing.
    """
    for name, value in {"datalayout": layout, "triple": _TRIPLE}.items():
        text = re.sub(rf'^target {name} = ".*"', f'target {name} = "{value}"', text, flags=_LINES)
    counting = r"(^define (?:linkonce_odr|internal) [^\n]*@NRT_(?:inc|dec)ref\([^\n]*\{\n).*?\n\}"
    text = re.sub(counting, r"\1  ret void\n}", text, flags=_LINES | re.DOTALL)
    # a call would need a stack, for what is returned
    text = re.sub(r"^(attributes [^\n]*)\bnoinline\b", r"\1alwaysinline", text, flags=_LINES)
    text = re.sub(r"^(@[^\n=]* =) common ", r"\1 internal ", text, flags=_LINES)
    return text.replace("@sqrt(", "@llvm.sqrt.f64(")  # an instruction, and no call of a library


def with_exports(compiled: bytes, names: Mapping[str, str]) -> bytes:
    """Return an object file of LLVM as a module that exports functions under other names.

    Parameters
    ----------
    compiled : bytes
    names : mapping
        Symbols of functions, and the names to export them under.

    Raises
    ------
    RuntimeError
        If the object needs a linker: it has data, globals or imports besides its memory.
    """
    sections = list(_sections(compiled))
    known = {_TYPE, _IMPORT, _FUNCTION, _CODE}
    numbers = [number for number, _ in sections if number != _CUSTOM]
    (imports,) = [body for number, body in sections if number == _IMPORT] or [b""]
    memory = b"".join(_text(part) for part in _MEMORY.split("."))
    if not set(numbers) <= known or not imports.startswith(b"\x01" + memory):
        raise RuntimeError(f"kernels for a browser must need memory alone, not sections {numbers}")
    if any(body.startswith(_text("reloc.CODE")) for _, body in sections):
        raise RuntimeError("kernels for a browser must call nothing that is to be linked")
    (linking,) = [body for _, body in sections if body.startswith(_text("linking"))]
    indices = _function_indices(linking[len(_text("linking")) :])
    entries = [_text(name) + b"\0" + _leb(indices[symbol]) for symbol, name in names.items()]
    exports = _leb(len(entries)) + b"".join(entries)
    parts = [(number, body) for number, body in sections if number in known]
    parts.insert(1 + [number for number, _ in parts].index(_FUNCTION), (_EXPORT, exports))
    return _HEADER + b"".join(bytes([k]) + _leb(len(body)) + body for k, body in parts)


def _sections(module: bytes) -> Generator[tuple[int, bytes]]:
    place = len(_HEADER)
    while place < len(module):
        number = module[place]
        size, start = _read_leb(module, place + 1)
        place = start + size
        yield number, module[start:place]


def _function_indices(linking: bytes) -> dict[str, int]:
    """Return the number of each function by its symbol."""
    _, place = _read_leb(linking, 0)  # the version
    kind = linking[place]
    _, place = _read_leb(linking, place + 1)
    count, place = _read_leb(linking, place)
    if kind != _SYMBOL_TABLE:
        raise RuntimeError("the object of LLVM does not begin with its symbols")
    indices = dict[str, int]()
    for _ in range(count):
        kind = linking[place]
        flags, place = _read_leb(linking, place + 1)
        if kind != _IS_FUNCTION or flags & _UNDEFINED:
            raise RuntimeError("kernels for a browser must have no data and call no library")
        index, place = _read_leb(linking, place)
        size, place = _read_leb(linking, place)
        indices[linking[place : place + size].decode()] = index
        place += size
    return indices


def _leb(number: int) -> bytes:
    """Return a number as WebAssembly writes it, seven bits to a byte."""
    out = bytearray()
    while number > 127:
        out.append(number & 127 | 128)
        number >>= 7
    return bytes([*out, number])


def _read_leb(data: bytes, place: int) -> tuple[int, int]:
    number = shift = 0
    while True:
        byte = data[place]
        number |= (byte & 127) << shift
        place, shift = place + 1, shift + 7
        if byte < 128:
            return number, place


def _text(text: str) -> bytes:
    return _leb(len(text)) + text.encode()
