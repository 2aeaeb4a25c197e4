"""The methods that take the steps of a motion, by name; what each kind of them does.

A method is the value of its coefficients. Its type chooses, when a kernel is compiled, the
functions that take a step and fit the polynomial between its ends.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from npend_gym.compiled.jit import chosen_by_type
from npend_gym.physics.kernels import gauss, gauss_derivatives, pairs, tape
from npend_gym.physics.kernels.dop853 import DOP853
from npend_gym.physics.kernels.gauss import GAUSS4, GAUSS6, MIDPOINT, Gauss
from npend_gym.physics.kernels.pairs import Pair
from npend_gym.physics.kernels.rk4 import RK4
from npend_gym.physics.kernels.solver import Problem, Solver
from npend_gym.physics.kernels.tsit5 import TSIT5

Method = Pair | Gauss
METHODS: dict[str, Method] = {
    "dop853": DOP853, "tsit5": TSIT5, "rk4": RK4,
    "midpoint": MIDPOINT, "gauss4": GAUSS4, "gauss6": GAUSS6,
}  # fmt: skip


@chosen_by_type("method", {Pair: pairs.start, Gauss: gauss.start})
def start(solver: Solver, problem: Problem, method: Method, rest: float, longest: float) -> None:
    """Begin an integration that lasts `rest`, in steps not longer than `longest` [s]."""
    raise NotImplementedError


@chosen_by_type("method", {Pair: pairs.attempt, Gauss: gauss.attempt})
def attempt(solver: Solver, t_end: float, problem: Problem, method: Method) -> float:
    """Try one step, not beyond `t_end`. Where the error is small enough, take it.

    Return 1.0 where it was taken, 0.0 where a smaller one is to be tried, -1.0 where no step is
    small enough.
    """
    raise NotImplementedError


@chosen_by_type("method", {Pair: pairs.prepare_dense, Gauss: gauss.prepare_dense})
def prepare_dense(solver: Solver, problem: Problem, method: Method) -> None:
    """Fit the polynomial of dense output to the last step."""
    raise NotImplementedError


def longest_gap(method: Method) -> float:
    """Return the longest part of a step in which nothing that drives a chain is evaluated."""
    return float(np.diff(np.unique([*method.instants[: method.stages], 1.0])).max())


def carrier(method: Method, m: int) -> Callable[..., None]:
    """Return `tape.carry_changes` for a method and `m` coordinates, with its work space."""
    kernel: Any = tape.carry_changes
    more: tuple[Any, ...] = (tape.new_scratch(len(method.tableau), m),)
    if isinstance(method, Gauss):
        kernel = gauss_derivatives.carry_gauss
        more = method, gauss_derivatives.new_gauss_scratch(method.stages, m)

    def carry(*given: Any) -> None:
        kernel(*given, *more)

    return carry
