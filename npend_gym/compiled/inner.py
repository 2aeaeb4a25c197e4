"""The compiler of functions that only compiled functions call.

Numba makes machine code of each function, and links its text into every caller, where it is
compiled again. If Python never calls the function, only the caller's copy runs. This compiler makes
no other, which saves an eighth of the time of a cold `npend release`. Each function is still
optimised before it is linked. To leave that out as well would save 3 s more, but kernels of packs
would take a tenth longer.
"""

# Numba's stubs leave parts unknown, and it has no public way to leave machine code out
# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false
# pyright: reportUnknownVariableType=false
# ruff: noqa: SLF001
from __future__ import annotations

from itertools import count
from typing import Any

from llvmlite.binding import parse_assembly
from numba.core.compiler import Compiler

_NUMBERS = count()
_STEPS = ("_finalize_final_module", "_finalize_dynamic_globals")


class InnerCompiler(Compiler):
    """Numba's compiler, for functions that are nothing but parts of others."""

    def __init__(self, typing: Any, target: Any, library: Any, *others: Any) -> None:
        if library is None:
            library = target.codegen().create_library(f"inner_{next(_NUMBERS)}")
            if all(hasattr(library, name) for name in _STEPS):  # else as Numba does it
                _leave_for_callers(library)
        super().__init__(typing, target, library, *others)


def _leave_for_callers(library: Any) -> None:
    """Leave the machine code of `library` to the libraries that link it."""

    def finalize() -> None:
        library._finalize_dynamic_globals()
        for variable in library._final_module.global_variables:
            if variable.name.startswith("_ZN08NumbaEnv"):  # Numba writes an address there
                stub = parse_assembly(f'@"{variable.name}" = common global i64 0')
                library.codegen._add_module(stub)
        library._finalized = True

    library._finalize_final_module = finalize
