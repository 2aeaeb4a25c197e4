"""The equations of motion, one name for all kinds of chains: chosen when a kernel is compiled.

`link_terms` has a table of them. A kernel that calls `accelerations` is compiled for the kind of
its argument `chain`, so that a kind costs nothing where it is not used.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import aligned_zeros
from npend_gym.compiled.jit import chosen_by_type, inner_kernel, kernel
from npend_gym.physics.kernels import energies as _energies
from npend_gym.physics.kernels import recursion, tensions
from npend_gym.physics.kernels.link_terms import (
    AnyArrays,
    ChainArrays,
    LinkArrays,
    MachineArrays,
    SliderArrays,
    SpringArrays,
)

WORK_ROWS = 7
ANSWER_ROWS = 3  # of `respond`

# Features of mechanisms that are not point masses on rigid rods: machine, springs, solid links
FEATURES: dict[Any, tuple[bool, bool, bool]] = {
    LinkArrays: (False, False, True),
    MachineArrays: (True, False, True),
    SpringArrays: (True, True, False),
    SliderArrays: (True, True, True),
}


def _solvers(kept: bool) -> dict[Any, Callable[..., Any]]:
    return {kind: recursion.solver(*flags, kept) for kind, flags in FEATURES.items()}


def new_work(n: int, width: int = 1) -> FloatArray:
    """Return scratch rows for `accelerations`; the guard entries at their ends stay zero."""
    return aligned_zeros(WORK_ROWS, (n + 2) * width)


@inner_kernel
def copy(source: FloatArray, target: FloatArray) -> None:
    """Copy a row; a slice assignment would cost a second of compile time in each kernel."""
    for i in range(source.size):
        target[i] = source[i]


@chosen_by_type(
    "chain",
    {
        ChainArrays: tensions.solve_tensions,
        **_solvers(kept=False),
    },
)
def accelerations(
    q: FloatArray, u: FloatArray, torque: FloatArray, chain: AnyArrays, work: FloatArray,
    alpha: FloatArray,
) -> float:  # fmt: skip
    """Write the accelerations of a chain, or of a pack of them, into `alpha`.

    `q` are the angles [rad], then the coordinates of the base where it moves, then how far the rods
    are stretched [m] where they do; `u` are their rates. `torque` acts at joints 0..n-1 [N m], then
    a force on the base [N]. Return the power that drag takes [W].
    """
    raise NotImplementedError


@chosen_by_type(
    "chain",
    {
        ChainArrays: tensions.solve_tensions_kept,
        **_solvers(kept=True),
    },
)
def accelerations_kept(
    q: FloatArray, u: FloatArray, torque: FloatArray, chain: AnyArrays, work: FloatArray,
    alpha: FloatArray,
) -> float:  # fmt: skip
    """Do as `accelerations`, and keep in `work`, which has a row more, what `respond` needs."""
    raise NotImplementedError


@chosen_by_type(
    "chain",
    {
        ChainArrays: tensions.tensions_respond,
        **{kind: recursion.response(*flags) for kind, flags in FEATURES.items()},
    },
)
def respond(
    force: FloatArray, chain: AnyArrays, work: FloatArray, answer: FloatArray, alpha: FloatArray
) -> None:
    """Write into `alpha` the solution of N alpha = force, N being the mass matrix.

    `force` are moments on each rod alone, not on joints [N m], then a force on a cart [N], then
    forces along springs [N]; `work` is as `accelerations_kept` left it. N is symmetric: this serves
    tangents and adjoints. Point masses leave their force couples and tensions in `answer`,
    ANSWER_ROWS for work, zero at first.
    """
    raise NotImplementedError


@kernel
def derivative(
    y: FloatArray, torque: FloatArray, chain: AnyArrays, work: FloatArray, dydt: FloatArray
) -> None:
    """Write the time derivative of one chain's state y = (q, u) into `dydt`."""
    n = y.size // 2
    for i in range(n):
        dydt[i] = y[n + i]
    accelerations(y[:n], y[n:], torque, chain, work, dydt[n:])


@chosen_by_type(
    "chain",
    {
        ChainArrays: tensions.damping_power,
        LinkArrays: _energies.link_power,
        MachineArrays: _energies.link_power,
    },
)
def joint_power(u: FloatArray, chain: AnyArrays) -> float:
    """Return the power that damping and dry friction take [W]."""
    raise NotImplementedError


@chosen_by_type(
    "chain",
    {
        ChainArrays: tensions.any_damped,
        LinkArrays: _energies.link_damped,
        MachineArrays: _energies.link_damped,
    },
)
def any_power(chain: AnyArrays) -> bool:
    """Return whether `joint_power` may differ from zero."""
    raise NotImplementedError


@chosen_by_type(
    "chain",
    {
        ChainArrays: _energies.energies_of(ideal=True, machine=False),
        LinkArrays: _energies.energies_of(ideal=False, machine=False),
        MachineArrays: _energies.energies_of(ideal=False, machine=True),
    },
)
def energies(
    omega: FloatArray, carried: FloatArray, mass: FloatArray, velocity: FloatArray,
    chain: AnyArrays, s: FloatArray, c: FloatArray,
) -> tuple[float, float, float]:  # fmt: skip
    """Return kinetic energy [J], potential energy over g [kg m] and height of the tip [m].

    `carried` has the `lift` of each link, `velocity` the horizontal velocities of the bobs, `s` and
    `c` sines and cosines of the angles.
    """
    raise NotImplementedError
