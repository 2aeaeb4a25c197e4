"""The parameters of links and machines, as `links` takes them; the symbols are explained there."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.chain import ChainParameters
from npend_gym.compiled.arrays import innermost


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


Link = LinkFields()


class JointFields(NamedTuple):
    """Rows of `MachineArrays.joints`, an entry for each joint."""

    COUPLING: int = 0  # k, of the accelerations of the two links, by the rotor [kg m^2]
    FRICTION: int = 1  # N m
    PER_SPEED: int = 2  # s/rad: one over the speed at which friction is 0.7 of that
    ARMATURE: int = 3  # inertia of the rotor, as the joint sees it [kg m^2]
    RATIO: int = 4  # 1/gear - 1: turns of the rotor by the link above, by those of its own
    DRAG: int = 5  # N s/m, on the tip
    QUADRATIC_DRAG: int = 6  # N s^2/m^2


Joint = JointFields()


class BaseFields(NamedTuple):
    """Rows of `MachineArrays.base`, of a base that moves."""

    INVERSE_MASS: int = 0  # 1/M; zero where the motion is prescribed
    ACROSS: int = 1  # x'' as prescribed [m/s^2]
    UP: int = 2  # y''
    DAMPING: int = 3  # of the rail, N s/m


Base = BaseFields()


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


def link_terms(chains: ChainParameters) -> FloatArray:
    """Return the rows of `LinkArrays.terms` of many chains, shape (len(Link), B, n)."""
    m, c, inertia = chains.masses, chains.centres, chains.inertias
    rest = chains.lengths - c
    # the rotor at a joint turns with the link below it, and with the link above by its ratio
    rotors = np.array(chains.armature)
    rotors[:, :-1] += (chains.armature * _ratio(chains) ** 2)[:, 1:]
    return np.stack([
        m, m * c, inertia + m * c * c + rotors, inertia - m * c * rest + rotors,
        inertia + m * rest * rest + rotors, m * (inertia + rotors), c, inertia,
    ])  # fmt: skip


def joint_terms(chains: ChainParameters) -> FloatArray:
    """Return the rows of `MachineArrays.joints` of many chains, shape (len(Joint), B, n)."""
    ratio = _ratio(chains)
    coupling = chains.armature * ratio
    coupling[:, 0] = 0.0  # above joint 0 nothing turns
    return np.stack([
        coupling, chains.friction, 1.0 / chains.friction_speed, chains.armature, ratio,
        chains.drag, chains.quadratic_drag,
    ])  # fmt: skip


def _ratio(chains: ChainParameters) -> FloatArray:
    return 1.0 / chains.gear - 1.0


def count_terms(chains: ChainParameters) -> int:
    """Return how many arrays `model_terms` makes of chains whose base rests: 0, 1 or 3."""
    machinery = (chains.friction, chains.armature, chains.drag, chains.quadratic_drag)
    return 0 if chains.is_ideal else 3 if any(np.any(values) for values in machinery) else 1


def model_terms(
    chains: ChainParameters, base: FloatArray | None = None, count: int | None = None
) -> list[FloatArray]:
    """Return what chains need beside lengths, damping and gravity: none, one or three arrays.

    Shapes are (rows, B, n), and (len(Base), B, 1) for a base that moves, or (0, B, 1) if it rests.
    `count` asks for more arrays than they need; fewer are a ValueError.
    """
    least = count_terms(chains) if base is None else 3
    wanted = least if count is None else count
    if least > wanted:
        raise ValueError(
            "chains of point masses cannot become links, nor links get friction, rotors or drag, "
            "while they are at work: begin with a chain that has these"
        )
    if wanted == 0:
        return []
    if wanted == 1:
        return [link_terms(chains)]
    entries = np.zeros(0) if base is None else base
    moving = np.broadcast_to(entries[:, None, None], (entries.size, len(chains.masses), 1))
    return [link_terms(chains), joint_terms(chains), moving]


def link_arrays(chains: ChainParameters, base: FloatArray | None = None) -> Any:
    """Return the parameters of B chains with links or machinery, the lane innermost.

    `base` holds the entries of `Base` where the base moves.
    """
    plain = innermost(chains.lengths), innermost(chains.damping), np.array(chains.gravity)
    rows = [innermost(terms) for terms in model_terms(chains, base)]
    if len(rows) == 1:
        return LinkArrays(*plain, *rows)
    return MachineArrays(*plain, *rows)
