"""The decorators of all compiled functions, their flags, and where the machine code is kept."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from npend_gym.compiled.sources import sources_digest

_F = TypeVar("_F", bound=Callable[..., object])

PACKAGE = Path(__file__).parent.parent


def cache_folder(package: Path, chosen: str) -> Path:
    """Return the folder that keeps the machine code made from the sources in `package`.

    Numba looks at the file that a function stands in, not at the files of the functions that it
    calls: an edit or an upgrade of one kernel file would leave stale machine code of another in
    use. Each state of the sources therefore has a folder of its own: in the one that was `chosen`
    (NUMBA_CACHE_DIR), else beside the sources, else, where these are read-only, in the user's
    cache.
    """
    if chosen:
        base = Path(chosen)
    elif os.access(package, os.W_OK):
        base = package / "__pycache__"
    else:
        try:
            base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        except RuntimeError:  # there is no home
            base = Path(tempfile.gettempdir())
    return base / f"npend_gym-{sources_digest(package)}"


if TYPE_CHECKING:

    def kernel(function: _F) -> _F:
        """Compile `function` with Numba."""
        return function

    def inner_kernel(function: _F) -> _F:
        """Compile `function` for other kernels; Python cannot call it."""
        return function

    def inlined_kernel(function: _F) -> _F:
        """Compile `function` as a part of the kernels that call it; Python cannot."""
        return function

    def outlined_kernel(function: _F) -> _F:
        """Compile `function` once for all its calls in a kernel: for long ones, called often.

        Kernels alone may call it, directly or not: no function that Numba compiles by itself.
        """
        return function

    def spliced_kernel(function: _F) -> _F:
        """Compile `function` as if its text stood in its caller's: for long ones, called once.

        What is inlined otherwise is optimised on its own first, and again with every caller.
        """
        return function

    def chosen_by_type(
        argument: str, kernels: Mapping[type | int, Callable[..., Any]]
    ) -> Callable[[_F], _F]:
        """Give the decorated function, in compiled code, the text of one of `kernels`.

        The one for the type of `argument`: a NamedTuple, or else the number of entries of a tuple,
        0 for None. All have the parameters of the function.
        """
        del argument, kernels
        return lambda function: function

else:
    import inspect

    from numba import config, njit, types
    from numba.core.typing.templates import AbstractTemplate, infer_global

    from npend_gym.compiled.inner import InnerCompiler, KernelCompiler, OutlinedCompiler
    from npend_gym.compiled.machine_code import CheckedCache
    from npend_gym.compiled.notice import announce_first_compilation

    announce_first_compilation()
    _FOLDER = cache_folder(PACKAGE, config.CACHE_DIR)
    # nogil: other Python threads run on while a kernel does.
    # error_model: 1/0 is inf as in C, without the branch that stops vectorisation.
    # fastmath stays off: it reorders sums, and the bits would depend on the machine.
    # C calls no kernel, for which Numba would wrap it.
    _OPTIONS = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
    # a wrapper for Python would cost more to compile than the function itself
    _INNER = {**_OPTIONS, "no_cpython_wrapper": True}

    def kernel(function):
        """Compile `function` with Numba."""
        before, config.CACHE_DIR = config.CACHE_DIR, str(_FOLDER)  # read when decorating
        try:
            compiled = njit(**_OPTIONS, pipeline_class=KernelCompiler)(function)
            if not config.DISABLE_JIT:
                compiled._cache = CheckedCache(function)  # noqa: SLF001 - once per machine
            return compiled
        finally:
            config.CACHE_DIR = before

    def inner_kernel(function):
        """Compile `function` for other kernels."""
        return njit(**_INNER, pipeline_class=InnerCompiler)(function)

    def inlined_kernel(function):
        """Compile `function` as a part of its callers: passing many arrays takes tens of ns."""
        return njit(**_INNER, pipeline_class=InnerCompiler, forceinline=True)(function)

    def outlined_kernel(function):
        """Compile `function` once for all its calls in a kernel."""
        # else it is inlined where the first caller that Numba sees is
        return njit(**_INNER, pipeline_class=OutlinedCompiler, forceinline=False)(function)

    def spliced_kernel(function):
        """Compile `function` as if its text stood in its caller's."""
        return njit(**_INNER, pipeline_class=InnerCompiler, inline="always")(function)

    def chosen_by_type(argument, kernels):
        """Give the decorated function, in compiled code, the text of one of `kernels`."""

        def decorate(function):
            function.by_type = kernels  # for `npend_gym.compiled.gpu`, which chooses by itself
            place = list(inspect.signature(function).parameters).index(argument)
            if config.DISABLE_JIT:  # kernels are functions of Python then, and so is this

                def run(*arguments):
                    given = arguments[place]
                    entries = len(given) if isinstance(given, tuple) else 0
                    return kernels.get(type(given), kernels.get(entries))(*arguments)

                return run

            class Choice(AbstractTemplate):
                """A call of the function, as Numba sees it: that of one of the kernels."""

                key = function

                def generic(self, arguments, keywords):
                    given = arguments[place]
                    kind = getattr(given, "instance_class", None) or getattr(given, "count", 0)
                    chosen = types.Dispatcher(kernels[kind])
                    found = chosen.get_call_type(self.context, arguments, keywords)
                    self._found[found.args] = chosen.get_overload(found)
                    return found

                def get_impl_key(self, sig):
                    return self._found[sig.args]

                _found: dict = {}  # noqa: RUF012 - one for each function

            infer_global(function, types.Function(Choice))
            return function

        return decorate
