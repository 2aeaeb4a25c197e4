"""Checks of the arguments that several functions of the physics take."""

from __future__ import annotations

import inspect
import math
import warnings
from collections.abc import Iterable, Sequence
from numbers import Integral
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain, ChainParameters
from npend_gym.chain.parameters import check_rows
from npend_gym.compiled.sincos import MAX_ANGLE
from npend_gym.physics.kernels.layout import MAX_SPEED
from npend_gym.physics.mechanism import Mechanism, mechanism_of

MIN_RTOL = 1e-14
_MOST_DEGREES = 720.0  # larger numbers are no degrees of a start


def check_chains(chains: Chain | Sequence[Chain], size: int | None) -> tuple[Mechanism, int]:
    """Return one chain for all, or each, as kernels take them, and the number of members.

    Raises
    ------
    ValueError, TypeError
        If one is no chain, they are not of one kind, or `size` is not their number.
    """
    listed = [chains] if isinstance(chains, Chain) else [*chains]
    mechanism = mechanism_of(listed)
    members = len(listed) if size is None else _checks.count("size", size)
    if members != len(listed) and not isinstance(chains, Chain):
        raise ValueError(f"size must be the number of chains, {len(listed)}, got {members}")
    return mechanism, members


def check_states(n: int, **values: ArrayLike) -> tuple[FloatArray, ...]:
    """Return the named quantities of all rods as arrays of one common shape (..., n).

    Raises
    ------
    ValueError, TypeError
        If one is not numeric, not finite, or neither one number nor of shape (..., n); or if their
        leading axes do not fit.
    """
    arrays = [_checks.array(name, value) for name, value in values.items()]
    for name, value in zip(values, arrays, strict=True):
        if value.ndim and value.shape[-1] != n:
            raise ValueError(
                f"{name} must be one number or an array of shape (..., {n}), "
                f"got shape {value.shape}"
            )
    try:
        shape = np.broadcast_shapes((n,), *(value.shape for value in arrays))
    except ValueError as error:
        raise ValueError(
            f"{' and '.join(values)} must have the same leading axes, "
            f"got shapes {', '.join(str(value.shape) for value in arrays)}"
        ) from error
    return tuple(np.broadcast_to(value, shape).copy() for value in arrays)


def check_members(members: Any, size: int) -> NDArray[np.int64]:
    """Return the numbers of the members meant by indices, a mask or a slice, of `size` in all."""
    try:
        chosen = np.atleast_1d(np.arange(size)[members])
        (_,) = chosen.shape  # None, True and lists of lists add axes
    except (IndexError, TypeError, ValueError) as error:
        raise ValueError(
            f"members must be indices below {size} in one list, a mask or a slice, got "
            f"{_checks.show(members)}"
        ) from error
    return chosen


def check_parameters(chains: Any, members: int, n: int) -> ChainParameters:
    """Return the parameters of some members, refused where one breaks its rule or has no row."""
    if not isinstance(chains, ChainParameters):
        raise TypeError(
            f"chain must be an npend_gym.Chain or ChainParameters, got {_checks.show(chains)}"
        )
    shapes = ((members,) if name == "gravity" else (members, n) for name in chains._fields)
    return ChainParameters(*map(check_rows, chains._fields, chains, shapes)).check()


def check_torque(torque: ArrayLike | None, n: int) -> FloatArray:
    """Return the torque on every joint [N m], shape (..., n): a number acts on joint 0.

    Raises
    ------
    ValueError, TypeError
        If `torque` is neither None, a number nor an array of shape (..., n).
    """
    if torque is None:
        return np.zeros(n)
    given = _checks.array("torque", torque)
    if given.ndim == 0:
        return np.concatenate([[float(given)], np.zeros(n - 1)])
    return check_states(n, torque=given)[0]


def checked_joints(joints: Iterable[int], n: int) -> list[int]:
    """Return joints of a chain of n rods; raise an error if one is named twice."""
    named = _checks.listed("joints", joints, "(0,)")
    if any(isinstance(j, Integral) and j == n for j in named):
        raise ValueError(
            f"joint must be between 0 and {n - 1}, got {_checks.show(named)}: {n} would be the "
            "force on a cart, which this chain lacks, or which is an argument of its own, force"
        )
    listed = [_checks.count("joint", j, low=0, high=n - 1) for j in named]
    if len(set(listed)) != len(listed):
        raise ValueError(f"joints must name each joint once, got {_checks.show(listed)}")
    return listed


def check_inputs(chain: Chain, joints: Iterable[int]) -> list[int]:
    """Return where the inputs stand among the loads: `joints`, and the force on a cart.

    That is number n, as in the settings of an environment. It is last where `joints` lacks it.
    """
    if chain.base is None:
        return checked_joints(joints, chain.n)
    wanted = checked_joints(joints, chain.n + 1)
    return wanted if chain.n in wanted else [*wanted, chain.n]


def check_limits(theta: FloatArray, omega: FloatArray) -> None:
    """Refuse states for which the equations would lose digits; warn where angles look like degrees.

    See `warn_of_degrees`.
    """
    _checks.within("theta", theta, MAX_ANGLE)
    _checks.within("omega", omega, MAX_SPEED)
    warn_of_degrees("theta", theta)


def warn_of_degrees(name: str, angles: FloatArray) -> None:
    """Warn where the angles of a chain, shape (..., n), look like degrees.

    They do where all are multiples of 0.5 and one is beyond a full turn of 2 pi. Angles of a motion
    that has turned round are beyond it too, but are no such multiples.
    """
    size = np.abs(angles)
    if not (size > math.tau).any():  # as nearly all are
        return
    rows = np.atleast_1d(size)
    round_numbers = np.all((2.0 * rows == np.rint(2.0 * rows)) & (rows <= _MOST_DEGREES), axis=-1)
    largest = rows.max(axis=-1)[round_numbers].max(initial=0.0)
    if largest > math.tau:
        ask_about_degrees(name, float(largest))


def plain_angle(name: str, value: Any) -> float:
    """Return `value` as an angle [rad] that sines know, and warn where it looks like degrees."""
    number = _checks.number(name, value)
    warn_of_degrees(name, _checks.within(name, np.array(number), 0.5 * MAX_ANGLE))
    return number


def ask_about_degrees(name: str, largest: float) -> None:
    """Warn that angles up to `largest` may be degrees."""
    warn_caller(
        f"{name} reaches {largest:.4g} rad, {largest / math.tau:.1f} turns: are these degrees? "
        f"They must be radians ({_checks.converts(largest)})"
    )


def warn_caller(text: str) -> None:
    """Warn of `text` at the line outside the package that led here."""
    frame, level = inspect.currentframe(), 0
    while frame and frame.f_globals.get("__name__", "").startswith("npend_gym."):
        frame, level = frame.f_back, level + 1
    warnings.warn(text, stacklevel=level + 1)


def check_rtol(rtol: float) -> float:
    """Return the relative tolerance `rtol`; raise an error if float64 cannot meet it."""
    rtol = _checks.number("rtol", rtol)
    if rtol < MIN_RTOL:
        raise ValueError(
            f"rtol must be at least {MIN_RTOL:g}, because float64 resolves no less, got {rtol:g}"
        )
    return rtol


def loses_energy(chain: Chain) -> bool:
    """Return whether damping, drag or dry friction takes energy from the chain."""
    resists = np.any(chain.damping) or np.any(chain.friction) or np.any(chain.axial_damping)
    return chain.has_drag or bool(resists) or (chain.base is not None and chain.base.damping > 0.0)
