"""The decorators of all compiled functions.

Numba is imported where something is compiled, and not before: kept machine code runs without it.
"""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Mapping
from functools import cached_property, update_wrapper
from typing import TYPE_CHECKING, Any, TypeVar

_F = TypeVar("_F", bound=Callable[..., object])

# As Numba reads it; kernels are functions of Python then
UNCOMPILED = os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")


if TYPE_CHECKING:

    def kernel(function: _F) -> _F:
        """Compile `function`, which Python and other kernels call."""
        return function

    def inner_kernel(function: _F) -> _F:
        """Compile `function` for other kernels; Python cannot call it."""
        return function

    def inlined_kernel(function: _F) -> _F:
        """Compile `function` as a part of the kernels that call it; Python cannot."""
        return function

    def outlined_kernel(function: _F) -> _F:
        """Compile `function` once for all its calls in a kernel: for long ones, called often.

        And for what few chains need: in line it takes registers from all others. Kernels alone may
        call it, directly or not: no function that Numba compiles by itself.
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
    from npend_gym.compiled.native import Kernel, compiler

    class Part:
        """A function that kernels call, and Python does not.

        Parameters
        ----------
        function : function
        options : mapping
            Of Numba's ``njit``.
        stays_whole : bool
            Whether it is one function in the machine code of its callers.
        """

        def __init__(self, function, options, *, stays_whole=False):
            update_wrapper(self, function)
            self.py_func = function
            self.targetoptions = options  # Numba asks it whether the text is copied into callers
            self.stays_whole = stays_whole

        @cached_property
        def _numba_type_(self):
            """What Numba takes it for."""
            return compiler().type_of_part(self)

        def __call__(self, *_arguments):
            """Say that this is a part of kernels."""
            raise TypeError(f"{self.__qualname__} can be called by kernels alone")

        def __reduce__(self):
            return self.__qualname__

    class Choice:
        """A function whose text, in compiled code, is one of several.

        Parameters
        ----------
        function : function
        by_type : mapping
            As for `chosen_by_type`.
        place : int
            Which argument decides.
        """

        def __init__(self, function, by_type, place):
            update_wrapper(self, function)
            self.by_type, self.place = by_type, place

        @cached_property
        def _numba_type_(self):
            """What Numba takes it for."""
            return compiler().type_of_choice(self)

        def __call__(self, *arguments):
            """Call the function for the type of the argument, where nothing is compiled."""
            given = arguments[self.place]
            entries = len(given) if isinstance(given, tuple) else 0
            return self.by_type.get(type(given), self.by_type.get(entries))(*arguments)

    def kernel(function):
        """Compile `function`, which Python and other kernels call."""
        return function if UNCOMPILED else Kernel(function)

    def inner_kernel(function):
        """Compile `function` for other kernels."""
        return function if UNCOMPILED else Part(function, {})

    def inlined_kernel(function):
        """Compile `function` as a part of its callers: passing many arrays takes tens of ns."""
        return function if UNCOMPILED else Part(function, {"forceinline": True})

    def outlined_kernel(function):
        """Compile `function` once for all its calls in a kernel."""
        # else it is inlined where the first caller that Numba sees is
        options = {"forceinline": False}
        return function if UNCOMPILED else Part(function, options, stays_whole=True)

    def spliced_kernel(function):
        """Compile `function` as if its text stood in its caller's."""
        return function if UNCOMPILED else Part(function, {"inline": "always"})

    def chosen_by_type(argument, kernels):
        """Give the decorated function, in compiled code, the text of one of `kernels`."""

        def decorate(function):
            place = list(inspect.signature(function).parameters).index(argument)
            return Choice(function, kernels, place)

        return decorate
