"""The parameters by which each kind of chains can be differentiated, and changes of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import BoolArray, FloatArray
from npend_gym.chain import ChainParameters
from npend_gym.physics.kernels.laws import AXIAL_DAMPING, STIFFNESS, Parameter
from npend_gym.physics.kernels.link_terms import (
    ChainArrays,
    LinkArrays,
    MachineArrays,
    SliderArrays,
    SpringArrays,
)

Kind = (
    type[ChainArrays] | type[LinkArrays] | type[MachineArrays] | type[SpringArrays]
    | type[SliderArrays]
)  # fmt: skip
_OF_POINT_MASSES = ("masses", "lengths", "gravity", "damping", "drag", "quadratic_drag")
_DIFFERENTIABLE: dict[Any, tuple[str, ...]] = {
    ChainArrays: _OF_POINT_MASSES,
    SpringArrays: (*ChainParameters._fields, "stiffness", "axial_damping"),
    SliderArrays: (*ChainParameters._fields, "stiffness", "axial_damping"),
    LinkArrays: tuple(
        name
        for name in ChainParameters._fields
        if name not in ("drag", "quadratic_drag", "armature", "gear")
    ),
    MachineArrays: ChainParameters._fields,
}
# By the number of arrays in the model, `count_terms`
KINDS: dict[int, Kind] = {0: ChainArrays, 3: LinkArrays, 4: MachineArrays}
_ROWS = Parameter._asdict() | {"stiffness": STIFFNESS, "axial_damping": AXIAL_DAMPING}


def row_count(kind: Kind) -> int:
    """Return how many rows of parameters kernels have for this kind of chains."""
    return len(_ROWS) if issubclass(kind, SpringArrays) else len(ChainParameters._fields)


def check_names(names: Iterable[str], kind: Kind) -> list[str]:
    """Return the names of parameters; raise an error if this kind of chains has no such thing."""
    if isinstance(names, str):
        raise TypeError(f"parameters must be a list of names such as ('masses',), got {names!r}")
    known, chosen = _DIFFERENTIABLE[kind], [*names]
    for name in chosen:
        _checks.choice("parameter", name, (*_ROWS,))
        if name not in known:
            raise ValueError(
                f"{name} cannot be differentiated for this kind of chain, which has "
                f"{', '.join(known)}: {_way_out(name)}"
            )
    return chosen


def _way_out(name: str) -> str:
    """Return how a chain is made that can be differentiated by the parameter."""
    if name in ("stiffness", "axial_damping"):
        return "simulate a chain with springs, Chain(..., stiffness=...)"
    return f"give it rotors, armature={_checks.SMALLEST:g} at least"


# The first parameter of a feature without which kernels leave it out, and its others
_FEATURES = (
    ("drag", "quadratic_drag"),
    ("friction", "friction_speed", "centres", "inertias"),
    ("armature", "gear"),
)


def with_features(parameters: ChainParameters, names: Iterable[str]) -> ChainParameters:
    """Return chains for kernels that differentiate by the named parameters.

    What they have not is there, too small to change anything.
    """
    least: dict[str, FloatArray] = {}
    for feature in _FEATURES:
        own = getattr(parameters, feature[0])
        if not {*feature}.isdisjoint(names) and not np.all(own):
            least[feature[0]] = np.where(own == 0.0, _checks.SMALLEST, own)
    return parameters._replace(**least) if least else parameters


def _check_mapping(parameters: Any) -> Mapping[str, ArrayLike]:
    if not isinstance(parameters, Mapping):
        raise TypeError(
            "parameters must be a dict of directions by name, such as {'masses': np.eye(n)}, "
            f"got {_checks.show(parameters)}"
        )
    return cast("Mapping[str, ArrayLike]", parameters)


def check_directions(
    parameters: Mapping[str, ArrayLike] | None, n: int, kind: Kind, ends: BoolArray
) -> FloatArray:
    """Return K directions in which parameters change, (K, len(Parameter) or 0, n) for kernels.

    `ends` (B, n) says which centres of mass are at the ends of rods, and stay there.
    """
    given = _check_mapping({} if parameters is None else parameters)
    names = check_names(given, kind)
    directions = {name: _checks.array(name, given[name]) for name in names}
    rows = {name: () if name == "gravity" else (n,) for name in names}
    count = max(
        (len(x) for name, x in directions.items() if x.ndim == 1 + len(rows[name])), default=0
    )
    for name, value in directions.items():
        if value.shape != (expected := (count, *rows[name])):
            any_number = f"(K, {n})" if rows[name] else "(K,)"
            rule = expected if count else f"{any_number} for K directions"
            raise ValueError(f"{name} must have the shape {rule}, got {value.shape}")
    changed = np.zeros((count, row_count(kind) if names else 0, n))
    for name, value in directions.items():
        changed[:, _ROWS[name]] = value[:, None] if name == "gravity" else value
    if "lengths" in names and "centres" not in names and kind is not ChainArrays:
        if np.any(ends.any(axis=0) != ends.all(axis=0)):
            raise ValueError("centres must be given where they are at ends of some rods alone")
        changed[:, Parameter.centres] = np.where(ends[0], changed[:, Parameter.lengths], 0.0)
    return changed


def by_names(bars: Any, names: Iterable[str], ends: Any) -> dict[str, Any]:
    """Return gradients by name, (B, n) each, from the rows (B, len(Parameter), n) of a kernel.

    `ends` is as for `check_directions`. Arrays may be tensors.
    """
    rows = {name: bars[:, _ROWS[name]] for name in names}
    if "lengths" in rows and "centres" not in rows:
        rows["lengths"] = rows["lengths"] + ends * bars[:, Parameter.centres]
    if "gravity" in rows:
        rows["gravity"] = rows["gravity"][:, 0]
    return rows
