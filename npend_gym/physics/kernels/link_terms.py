"""The parameters of links and machines, as `links` takes them; the symbols are explained there."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import BoolArray, FloatArray
from npend_gym.chain import ChainParameters
from npend_gym.compiled.arrays import innermost
from npend_gym.compiled.jit import inlined_kernel, kernel

# The rows of a chain (parameters, n), by the names of `ChainParameters`
Parameter: Any = ChainParameters(*range(len(ChainParameters._fields)))  # type: ignore[arg-type]


class LinkFields(NamedTuple):
    """Rows of `LinkArrays.terms`, an entry for each link."""

    MASS: int = 0  # m
    MOMENT: int = 1  # m c
    J: int = 2
    K: int = 3
    E: int = 4
    Z: int = 5  # m J - (m c)^2
    CENTRE: int = 6  # c
    INERTIA: int = 7  # I, about the centre


Link: LinkFields = LinkFields()


class JointFields(NamedTuple):
    """Rows of `MachineArrays.joints`, an entry for each joint."""

    COUPLING: int = 0  # k, of the accelerations of the two links, by the rotor [kg m^2]
    FRICTION: int = 1  # N m
    PER_SPEED: int = 2  # s/rad: one over the speed at which friction is 0.7 of that
    ARMATURE: int = 3  # inertia of the rotor, as the joint sees it [kg m^2]
    RATIO: int = 4  # 1/gear - 1: turns of the rotor by the link above, by those of its own
    DRAG: int = 5  # N s/m, on the tip
    QUADRATIC_DRAG: int = 6  # N s^2/m^2
    GEAR: int = 7  # this and the next only to tell the parameters again
    FRICTION_SPEED: int = 8


Joint: JointFields = JointFields()


class BaseFields(NamedTuple):
    """Rows of `MachineArrays.base`, of a base that moves."""

    INVERSE_MASS: int = 0  # 1/M; zero where the motion is prescribed
    ACROSS: int = 1  # x'' as prescribed [m/s^2]
    UP: int = 2  # y''
    DAMPING: int = 3  # of the rail, N s/m


Base: BaseFields = BaseFields()


class LinkArrays(NamedTuple):
    """The parameters of rigid links with viscous joints, or of a pack of such chains."""

    length: FloatArray  # (n,)
    damping: FloatArray  # joints 0..n-1, (n,)
    gravity: FloatArray  # (1,)
    terms: FloatArray  # (len(Link), n)


class MachineArrays(NamedTuple):
    """The same with all that a machine has: rotors, dry friction, drag, a base that moves."""

    length: FloatArray
    damping: FloatArray
    gravity: FloatArray
    terms: FloatArray
    joints: FloatArray  # (len(Joint), n)
    base: FloatArray  # (len(Base), 1); (0, 1) where the base rests


@inlined_kernel
def link_terms_of(chain: FloatArray, i: int, terms: FloatArray, column: int) -> None:
    """Write the rows of `LinkArrays.terms` for link `i` of a chain (parameters, n)."""
    m, c, inertia = (
        chain[Parameter.masses, i],
        chain[Parameter.centres, i],
        chain[Parameter.inertias, i],
    )
    rest, n = chain[Parameter.lengths, i] - c, chain.shape[1]
    # the rotor at a joint turns with the link below it, and with the link above by its ratio
    rotors = chain[Parameter.armature, i]
    if i + 1 < n:
        ratio = 1.0 / chain[Parameter.gear, i + 1] - 1.0
        rotors += chain[Parameter.armature, i + 1] * (ratio * ratio)
    terms[Link.MASS, column] = m
    terms[Link.MOMENT, column] = m * c
    terms[Link.J, column] = inertia + m * c * c + rotors
    terms[Link.K, column] = inertia - m * c * rest + rotors
    terms[Link.E, column] = inertia + m * rest * rest + rotors
    terms[Link.Z, column] = m * (inertia + rotors)
    terms[Link.CENTRE, column] = c
    terms[Link.INERTIA, column] = inertia


@inlined_kernel
def joint_terms_of(chain: FloatArray, i: int, joints: FloatArray, column: int) -> None:
    """Write the rows of `MachineArrays.joints` for joint `i` of a chain (parameters, n)."""
    ratio = 1.0 / chain[Parameter.gear, i] - 1.0
    # above joint 0 nothing turns
    joints[Joint.COUPLING, column] = chain[Parameter.armature, i] * ratio if i > 0 else 0.0
    joints[Joint.FRICTION, column] = chain[Parameter.friction, i]
    joints[Joint.PER_SPEED, column] = 1.0 / chain[Parameter.friction_speed, i]
    joints[Joint.ARMATURE, column] = chain[Parameter.armature, i]
    joints[Joint.RATIO, column] = ratio
    joints[Joint.DRAG, column] = chain[Parameter.drag, i]
    joints[Joint.QUADRATIC_DRAG, column] = chain[Parameter.quadratic_drag, i]
    joints[Joint.GEAR, column] = chain[Parameter.gear, i]
    joints[Joint.FRICTION_SPEED, column] = chain[Parameter.friction_speed, i]


@kernel
def _fill_terms(chains: FloatArray, links: FloatArray, joints: FloatArray) -> None:
    """Write the terms (rows, B, n) of the chains (B, parameters, n); of joints where wanted."""
    for k in range(chains.shape[0]):
        for i in range(chains.shape[2]):
            link_terms_of(chains[k], i, links[:, k], i)
            if joints.shape[1] > 0:
                joint_terms_of(chains[k], i, joints[:, k], i)


def count_terms(chains: ChainParameters) -> int:
    """Return how many arrays `model_terms` makes of chains whose base rests: 0, 1 or 3."""
    return 0 if chains.is_ideal else 3 if _have_machinery(chains).any() else 1


def terms_of_each(chains: ChainParameters) -> NDArray[np.int64]:
    """Return `count_terms` of each chain alone, (B,)."""
    ideal = chains.has_bobs & ~np.any(chains.friction, axis=-1)
    return np.where(ideal, 0, np.where(_have_machinery(chains), 3, 1))


def _have_machinery(chains: ChainParameters) -> BoolArray:
    machinery = chains.friction, chains.armature, chains.drag, chains.quadratic_drag
    return np.any([np.any(values, axis=-1) for values in machinery], axis=0)


def loses_drag(chains: ChainParameters, count: int) -> bool:
    """Return whether drag of the chains has no place in `count` arrays: in those of mere links."""
    return count == 1 and chains.has_drag


def check_terms(chains: ChainParameters, count: int) -> None:
    """Raise a ValueError where chains need more arrays than `count`."""
    if count_terms(chains) > count or loses_drag(chains, count):
        raise ValueError(
            "chains of point masses cannot become links, nor links get friction, rotors or drag, "
            "while they are at work: begin with a chain that has these"
        )


def model_terms(chains: ChainParameters, base: FloatArray | None = None) -> list[FloatArray]:
    """Return what chains need beside lengths, damping and gravity: none, one or three arrays.

    Shapes are (rows, B, n), and (len(Base), B, 1) for a base that moves, or (0, B, 1) if it rests.
    """
    wanted = count_terms(chains) if base is None else 3
    if wanted == 0:
        return []
    lanes, n = chains.masses.shape
    links, joints = np.empty((len(Link), lanes, n)), np.empty((len(Joint), lanes, n))
    if wanted == 1:
        _fill_terms(chains.stacked(), links, joints[:, :0])
        return [links]
    _fill_terms(chains.stacked(), links, joints)
    rows = np.zeros((0, 1)) if base is None else base
    moving = np.broadcast_to(rows[:, :, None], (len(rows), lanes, 1))
    return [links, joints, moving]


def link_arrays(chains: ChainParameters, base: FloatArray | None = None) -> Any:
    """Return the parameters of B chains with links or machinery, the lane innermost.

    `base` (len(Base), B or 1) holds the rows of `Base` where the base moves.
    """
    plain = innermost(chains.lengths), innermost(chains.damping), np.array(chains.gravity)
    rows = [innermost(terms) for terms in model_terms(chains, base)]
    if len(rows) == 1:
        return LinkArrays(*plain, *rows)
    return MachineArrays(*plain, *rows)
