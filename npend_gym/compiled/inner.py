"""The compilers of kernels, which make Numba do less.

Numba makes machine code of each function, and links its text into every caller, where it is
compiled again. If Python never calls the function, only the caller's copy runs. An inner function
therefore gets no machine code of its own; it is still optimised before it is linked, because
kernels of packs would take a tenth longer without.

A long function that is called several times stays one function in its caller's machine code, where
Numba would copy it to each call. It is linked into the kernel alone, and not into the inner
functions between. What it is called with becomes short, because nobody else can call it: LLVM drops
the arguments that it does not use, most of the 7 numbers of each array.
"""

# Numba's stubs leave parts unknown, and it has no public way to leave machine code out
# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false
# pyright: reportUnknownVariableType=false, reportUntypedBaseClass=false
# pyright: reportPrivateImportUsage=false, reportIncompatibleMethodOverride=false
# ruff: noqa: SLF001
from __future__ import annotations

from itertools import count
from typing import Any

from llvmlite import binding
from numba.core import compiler, compiler_machinery
from numba.core.codegen import JITCodeLibrary
from numba.core.runtime import rtsys
from numba.core.typed_passes import NopythonTypeInference

_NUMBERS = count()
# LLVM's older passes, of Numba before 0.62, need all that Numba does
_NEW_PASSES = hasattr(binding, "create_pass_builder")


class Flags(compiler.Flags):
    """Numba's options of a function, compared in less time: that takes a part of each look-up.

    Numba compares the values of all options, set or not, tens of thousands of times.
    """

    __slots__ = ()
    _hash = hash(compiler.Flags())  # Numba hashes the names of the options: all have the same

    def __eq__(self, other: object) -> bool:
        same = isinstance(other, Flags) and self._values == other._values
        return same or super().__eq__(other)

    def __hash__(self) -> int:
        return self._hash


class _Library(JITCodeLibrary):
    """Machine code that is optimised once, by LLVM's passes over the whole module.

    Numba runs passes over each function before that, and simple ones over the module.
    """

    def _optimize_functions(self, ll_module: Any) -> None:
        if _NEW_PASSES:
            ll_module.data_layout = self._codegen._data_layout
        else:
            super()._optimize_functions(ll_module)

    def _optimize_final_module(self) -> None:
        if _NEW_PASSES:
            passes, builder = self._codegen._module_pass_manager()
            passes.run(self._final_module, builder)
        else:
            super()._optimize_final_module()


class _KernelLibrary(_Library):
    """The machine code of a kernel, and of the functions that it calls."""

    def add_linking_library(self, library: Any) -> None:
        """Link a function that is called, and those that its text only names."""
        super().add_linking_library(library)
        # callers first: LLVM leaves out what nothing that is linked before has called
        for outlined in reversed(getattr(library, "outlined", {})):
            super().add_linking_library(outlined)

    def _optimize_final_module(self) -> None:
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage.name == "linkonce_odr":
                function.linkage = "internal"
        super()._optimize_final_module()


class _InnerLibrary(_Library):
    """The text of a function for its callers, who make machine code of it."""

    stays_whole = False

    def __init__(self, codegen: Any, name: str) -> None:
        super().__init__(codegen, name)
        self.outlined: dict[Any, None] = {}  # what kernels must link beside it, in order

    def add_linking_library(self, library: Any) -> None:
        """Link a function that is called, unless it is to stay whole.

        What counts references is left to the caller, too: it would be optimised in each function.
        """
        if library is rtsys.library:
            return
        self.outlined |= getattr(library, "outlined", {})
        if getattr(library, "stays_whole", False):
            self.outlined[library] = None
        else:
            super().add_linking_library(library)

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        for variable in self._final_module.global_variables:
            if variable.name.startswith("_ZN08NumbaEnv"):  # Numba writes an address there
                stub = binding.parse_assembly(f'@"{variable.name}" = common global i64 0')
                self._codegen._add_module(stub)
        self._finalized = True


class _TextLibrary(_InnerLibrary):
    """The text of a kernel for the library of its entry, which optimises both."""

    def _optimize_final_module(self) -> None:
        pass


class EntryLibrary(_KernelLibrary):
    """The object file of a kernel and its entry, which alone can be called.

    Parameters
    ----------
    codegen : object
        Numba's.
    symbol : str
        Of the entry.
    """

    def __init__(self, codegen: Any, symbol: str) -> None:
        super().__init__(codegen, symbol)
        self.object: bytes = b""

    def _optimize_final_module(self) -> None:
        for function in self._final_module.functions:
            if not function.is_declaration:
                function.linkage = "external" if function.name == self.name else "internal"
        super()._optimize_final_module()

    def _finalize_final_module(self) -> None:
        self.object = self._codegen._tm.emit_object(self._final_module)
        self._finalized = True

    @property
    def calls(self) -> set[str]:
        """Names of the functions that are not in the object."""
        functions = self._final_module.functions
        named = {each.name for each in functions if each.is_declaration}
        return {name for name in named if not name.startswith("llvm.")}


class _OutlinedLibrary(_InnerLibrary):
    """The text of a function that is not copied to its calls."""

    stays_whole = True

    def _optimize_functions(self, ll_module: Any) -> None:
        super()._optimize_functions(ll_module)
        for function in ll_module.functions:
            if not function.is_declaration:
                function.add_function_attribute("noinline")


class KernelCompiler(compiler.Compiler):
    """Numba's compiler, for functions that Python calls."""

    library_class: type[JITCodeLibrary] = _KernelLibrary

    def __init__(
        self, typing: Any, target: Any, library: Any, args: Any, returns: Any, flags: Any,
        local_types: Any,
    ) -> None:  # fmt: skip
        if library is None and _NEW_PASSES:
            name = f"{self.library_class.__name__}_{next(_NUMBERS)}"
            library = self.library_class(target.codegen(), name)
            library.enable_object_caching()
        super().__init__(typing, target, library, args, returns, Flags(flags), local_types)


@compiler_machinery.register_pass(mutates_CFG=False, analysis_only=False)
class _CountNothing(compiler_machinery.FunctionPass):
    """Lets Numba's next passes count no references; before, it would allow no views of arrays."""

    _name = "npend_gym_count_nothing"

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        """Change the context that the next passes write for."""
        state.targetctx.enable_nrt = False
        return True


class _TextCompiler(KernelCompiler):
    """The compiler of functions whose arrays belong to Python: references are not counted."""

    def define_pipelines(self) -> list[Any]:
        """Return Numba's passes, which write no counting into the text."""
        passes = super().define_pipelines()
        for each in passes:
            each.add_pass_after(_CountNothing, NopythonTypeInference)
            each.finalize()
        return passes


class EntryCompiler(_TextCompiler):
    """The compiler of kernels that are called by an entry."""

    library_class: type[JITCodeLibrary] = _TextLibrary


class InnerCompiler(_TextCompiler):
    """The compiler of functions that are nothing but parts of others."""

    library_class: type[JITCodeLibrary] = _InnerLibrary


class OutlinedCompiler(_TextCompiler):
    """The compiler of such functions that are too long for a copy at each call."""

    library_class: type[JITCodeLibrary] = _OutlinedLibrary
