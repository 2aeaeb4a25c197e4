"""How kernels are compiled: by Numba, with an entry that takes arguments as Python has them."""

# Numba's stubs leave parts unknown, and it has no public way to write a function's text
# pyright: basic, reportPrivateImportUsage=false, reportGeneralTypeIssues=false
# pyright: reportOptionalMemberAccess=false
from __future__ import annotations

import gc
from collections.abc import Generator
from contextlib import contextmanager
from hashlib import sha256
from typing import Any

from llvmlite import ir
from numba import njit, typeof, types
from numba.core import cgutils, errors
from numba.core.compiler_lock import global_compiler_lock
from numba.core.typing.templates import AbstractTemplate
from numba.np.arrayobj import populate_array
from numba.np.numpy_support import as_dtype

from npend_gym.compiled import intrinsics  # noqa: F401 - which Numba then knows
from npend_gym.compiled.inner import (
    EntryCompiler,
    EntryLibrary,
    InnerCompiler,
    KernelCompiler,
    OutlinedCompiler,
)
from npend_gym.compiled.native import DONE, OTHER_KIND, Code, Word, name_of_class
from npend_gym.compiled.notice import announce_compilation

# nogil: other Python threads run on while a kernel does.
# error_model: 1/0 is inf as in C, without the branch that stops vectorisation.
# fastmath stays off: it reorders sums, and the bits would depend on the machine.
# C calls no kernel, for which Numba would wrap it.
_OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
# a wrapper for Python would cost more to compile than the function itself
_INNER: dict[str, Any] = {**_OPTIONS, "no_cpython_wrapper": True}
_WORD, _NUMBER = ir.IntType(64), ir.DoubleType()
_FAILED = 2  # what an entry returns where a kernel raised an error, or Python did
_OF_LIBC = {"memset", "memcpy", "memmove", "sqrt"}  # which LLVM finds in every process
_ALIGNED, _WRITEABLE = 0x100, 0x400  # flags of an array of NumPy
# Of the flags C_CONTIGUOUS and F_CONTIGUOUS: which are looked at, and what they must be
_LAYOUTS = {"C": (1, 1), "F": (3, 2), "A": (3, 0)}


def type_of_part(part: Any) -> types.Dispatcher:
    """Return Numba's type of a function that kernels call, whose dispatcher it keeps alive."""
    compiler = OutlinedCompiler if part.stays_whole else InnerCompiler
    options = {**_INNER, **part.targetoptions}
    part.dispatcher = njit(**options, pipeline_class=compiler)(part.py_func)
    return types.Dispatcher(part.dispatcher)


def type_of_choice(choice: Any) -> types.Function:
    """Return Numba's type of a function whose text is chosen by the type of an argument."""

    class Chosen(AbstractTemplate):
        """A call of the function, as Numba sees it: that of one of the kernels."""

        key = choice

        def generic(self, arguments: Any, keywords: Any) -> Any:
            given = arguments[choice.place]
            kind = getattr(given, "instance_class", None) or getattr(given, "count", 0)
            chosen = choice.by_type[kind]._numba_type_
            found = chosen.get_call_type(self.context, arguments, keywords)
            self._found[found.args] = chosen.get_overload(found)
            return found

        def get_impl_key(self, sig: Any) -> Any:
            return self._found[sig.args]

        _found: dict[Any, Any] = {}  # noqa: RUF012 - one for each function

    return types.Function(Chosen)


def dispatcher_of_kernel(kernel: Any) -> Any:
    """Return a kernel as Numba's own dispatcher, which Python calls."""
    announce_compilation()
    return njit(**_OPTIONS, pipeline_class=KernelCompiler)(kernel.py_func)


@contextmanager
def _rare_collection() -> Generator[None]:
    """Let Python look for unreachable objects less often: a fifth of the time of compiling."""
    before = gc.get_threshold()
    gc.set_threshold(500_000, *before[1:])
    try:
        yield
    finally:
        gc.set_threshold(*before)


@global_compiler_lock
def compiled_code(kernel: Any, arguments: tuple[Any, ...]) -> Code | None:
    """Return a kernel's machine code for arguments; None where an entry cannot serve it."""
    announce_compilation()
    dispatcher = njit(**_INNER, pipeline_class=EntryCompiler)(kernel.py_func)
    try:
        with _rare_collection():
            dispatcher.compile(tuple(map(typeof, arguments)))
    except errors.NumbaError as error:
        if "NRT required" in str(error):  # it makes arrays
            return None
        raise
    (compiled,) = dispatcher.overloads.values()
    returns = _letters(compiled.signature.return_type)
    if returns is None:
        return None
    digest = sha256(f"{kernel.__module__} {compiled.signature}".encode()).hexdigest()[:16]
    library = EntryLibrary(compiled.target_context.codegen(), f"{kernel.__name__}_{digest}")
    library.add_linking_library(compiled.library)
    entry = _Entry(compiled, library)
    library.add_ir_module(entry.module)
    library.finalize()
    if not library.calls <= _OF_LIBC:
        return None
    return Code(library.name, tuple(entry.needs), returns, library.object)


def _letters(returned: Any) -> str | None:
    """Return letters for what a kernel returns, as in `Code`; None where there are none."""
    if returned == types.none:
        return ""
    if isinstance(returned, types.BaseTuple):
        each = [_letters(part) for part in returned]
        return f"({''.join(map(str, each))})" if all(x and len(x) == 1 for x in each) else None
    simple = {types.float64: "f", types.int64: "i", types.uint64: "u", types.boolean: "b"}
    return simple.get(returned)


class _Entry:
    """Writes the function that is given a tuple of Python, `Word`s, and a place for results."""

    def __init__(self, compiled: Any, library: Any) -> None:
        self.needs: list[str] = []
        self.context = compiled.target_context
        self.module = library.create_ir_module(f"entry of {library.name}")
        for counting in ("NRT_incref", "NRT_decref"):  # an entry's arrays belong to Python
            kind = ir.FunctionType(ir.VoidType(), [ir.IntType(8).as_pointer()])
            nothing = ir.Function(self.module, kind, counting).append_basic_block()
            ir.IRBuilder(nothing).ret_void()
        kind = ir.FunctionType(ir.IntType(32), [_WORD] * 3)
        function = ir.Function(self.module, kind, library.name)
        self.given, self.words, self.out = function.args
        self.builder = ir.IRBuilder(function.append_basic_block())
        self.otherwise = function.append_basic_block("other_kind")
        signature = compiled.signature
        values = self._parts(self.given, signature.args)
        builder = self.builder
        thread = builder.call(self._function(Word.SAVE_THREAD, _WORD), [])
        fndesc, convention = compiled.fndesc, self.context.call_conv
        returned = signature.return_type
        of_numba = cgutils.get_or_insert_function(
            self.module, convention.get_function_type(returned, signature.args),
            fndesc.llvm_func_name,
        )  # fmt: skip
        status, value = convention.call_function(
            builder, of_numba, returned, signature.args, values
        )
        builder.call(self._function(Word.RESTORE_THREAD, ir.VoidType(), _WORD), [thread])
        with builder.if_then(status.is_error, likely=False):
            builder.ret(ir.Constant(ir.IntType(32), _FAILED))
        self._write(value, returned)
        builder.ret(ir.Constant(ir.IntType(32), DONE))
        builder.position_at_end(self.otherwise)
        builder.ret(ir.Constant(ir.IntType(32), OTHER_KIND))

    def _load(self, address: Any, kind: Any = _WORD) -> Any:
        return self.builder.load(self.builder.inttoptr(address, kind.as_pointer()))

    def _after(self, address: Any, size: int) -> Any:
        return self.builder.add(address, ir.Constant(_WORD, size))

    def _word(self, number: int) -> Any:
        return self._load(self._after(self.words, 8 * number))

    def _needed(self, name: str) -> Any:
        """Return the address of an object that is to be compared with."""
        if name not in self.needs:
            self.needs.append(name)
        return self._word(len(Word) + self.needs.index(name))

    def _function(self, number: int, returns: Any, *arguments: Any) -> Any:
        kind = ir.FunctionType(returns, arguments)
        return self.builder.inttoptr(self._word(number), kind.as_pointer())

    def _check(self, found: Any, expected: Any) -> None:
        """Go on if two numbers are the same; otherwise the arguments are of another kind."""
        if isinstance(expected, int):
            expected = ir.Constant(found.type, expected)
        onwards = self.builder.append_basic_block()
        same = self.builder.icmp_unsigned("==", found, expected)
        self.builder.cbranch(same, onwards, self.otherwise)
        self.builder.position_at_end(onwards)

    def _check_type(self, address: Any, expected: Any) -> Any:
        """Check the type of an object; return the address of what follows its head."""
        behind = self.builder.add(address, self._word(Word.HEAD))
        self._check(self._load(self._after(behind, -8)), expected)
        return behind

    def _parts(self, given: Any, kinds: Any) -> list[Any]:
        """Return the values of the items of a tuple."""
        behind = self.builder.add(given, self._word(Word.HEAD))
        self._check(self._load(behind), len(kinds))
        items = self.builder.add(given, self._word(Word.ITEMS))
        return [
            self._value(self._load(self._after(items, 8 * k)), kind) for k, kind in enumerate(kinds)
        ]

    def _value(self, given: Any, kind: Any) -> Any:
        """Return Numba's value of an object of Python."""
        builder = self.builder
        if isinstance(kind, types.Array):
            return self._array(given, kind)
        if isinstance(kind, types.BaseTuple):
            named = getattr(kind, "instance_class", None)
            expected = (
                self._word(Word.TUPLE) if named is None else self._needed(name_of_class(named))
            )
            self._check_type(given, expected)
            return self.context.make_tuple(builder, kind, self._parts(given, kind))
        if kind == types.none:
            self._check(given, self._word(Word.NONE))
            return self.context.get_dummy_value()
        if kind == types.boolean:
            is_true = builder.icmp_unsigned("==", given, self._word(Word.TRUE))
            is_false = builder.icmp_unsigned("==", given, self._word(Word.FALSE))
            self._check(builder.or_(is_true, is_false), 1)
            return is_true
        if kind == types.float64:
            return self._load(self._check_type(given, self._word(Word.FLOAT)), _NUMBER)
        if kind != types.int64:
            raise TypeError(f"an entry cannot take {kind}")
        self._check_type(given, self._word(Word.INT))
        number = builder.call(self._function(Word.AS_INT, _WORD, _WORD), [given])
        with builder.if_then(builder.icmp_signed("==", number, ir.Constant(_WORD, -1))):
            error = builder.call(self._function(Word.ERROR, _WORD), [])
            with builder.if_then(builder.icmp_unsigned("!=", error, ir.Constant(_WORD, 0))):
                builder.ret(ir.Constant(ir.IntType(32), _FAILED))
        return number

    def _array(self, given: Any, kind: Any) -> Any:
        """Return the array of an object whose layout is NumPy's ``PyArrayObject_fields``."""
        builder = self.builder
        behind = self._check_type(given, self._word(Word.ARRAY))
        dtype = self._needed(as_dtype(kind.dtype).str)
        self._check(self._load(self._after(behind, 40)), dtype)
        self._check(self._load(self._after(behind, 8), ir.IntType(32)), kind.ndim)
        looked_at, expected = _LAYOUTS[kind.layout]
        looked_at |= _ALIGNED | _WRITEABLE
        expected |= _ALIGNED | (_WRITEABLE if kind.mutable else 0)
        flags = self._load(self._after(behind, 48), ir.IntType(32))
        self._check(builder.and_(flags, ir.Constant(flags.type, looked_at)), expected)
        shape, strides = (
            [self._load(self._after(self._load(self._after(behind, at)), 8 * k))
             for k in range(kind.ndim)]
            for at in (16, 24)
        )  # fmt: skip
        size = self.context.get_abi_sizeof(self.context.get_data_type(kind.dtype))
        array = self.context.make_array(kind)(self.context, builder)
        populate_array(
            array,
            data=builder.inttoptr(self._load(behind), array.data.type),
            shape=cgutils.pack_array(builder, shape, _WORD),
            strides=cgutils.pack_array(builder, strides, _WORD),
            itemsize=ir.Constant(_WORD, size),
            meminfo=None,
        )
        return array._getvalue()  # noqa: SLF001 - as all of Numba's extensions do

    def _write(self, value: Any, kind: Any) -> None:
        """Write what the kernel returned."""
        if kind == types.none:
            return
        is_tuple, builder = isinstance(kind, types.BaseTuple), self.builder
        kinds = list(kind) if is_tuple else [kind]
        for k, each in enumerate(kinds):
            part = builder.extract_value(value, k) if is_tuple else value
            if each == types.boolean:
                part = builder.zext(part, _WORD)
            place = builder.inttoptr(self._after(self.out, 8 * k), part.type.as_pointer())
            builder.store(part, place)
