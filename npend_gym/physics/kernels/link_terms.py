"""The parameters of mechanisms, as `recursion` takes them; the symbols are explained there.

=================  =============================================  ============================
parameters         mechanism                                      solved in
=================  =============================================  ============================
`ChainArrays`      point masses on massless rods, fixed pivot     `tensions`, the fastest
`LinkArrays`       links with damping and dry friction, any base  `recursion`
`MachineArrays`    the same with rotors and drag                  `recursion`
`SpringArrays`     point masses on springs, all else of machines  `recursion`
`SliderArrays`     all of it: links, with rotors, on springs      `recursion`
=================  =============================================  ============================

What is only in the later ones costs nothing in the earlier ones. What a mechanism of its kind has
not is an array without rows, or without entries.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import FloatArray
from npend_gym.chain import ChainParameters
from npend_gym.compiled.jit import inlined_kernel
from npend_gym.physics.kernels.laws import Parameter
from npend_gym.physics.kernels.tensions import ChainArrays


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


class RotorFields(NamedTuple):
    """Rows of `MachineArrays.rotors`, an entry for each joint."""

    COUPLING: int = 0  # k, of the accelerations of the two links, by the rotor [kg m^2]
    ARMATURE: int = 1  # inertia of the rotor, as the joint sees it [kg m^2]
    RATIO: int = 2  # 1/gear - 1: turns of the rotor by the link above, by those of its own
    GEAR: int = 3  # only to tell the parameters again


Rotor: RotorFields = RotorFields()


class BaseFields(NamedTuple):
    """Rows of `LinkArrays.base`, of a base that moves."""

    INVERSE_MASS: int = 0  # 1/M; zero where the motion is prescribed
    ACROSS: int = 1  # x'' as prescribed [m/s^2]
    UP: int = 2  # y''
    DAMPING: int = 3  # of the rail, N s/m


Base: BaseFields = BaseFields()
MODEL = "links", "friction", "base", "rotors"  # the arrays of an ensemble's, see `layout.Model`
BASE_AT = MODEL.index("base")


class LinkArrays(NamedTuple):
    """The parameters of rigid links, or of a pack of such chains."""

    length: FloatArray  # (n,)
    damping: FloatArray  # joints 0..n-1, (n,)
    gravity: FloatArray  # (1,)
    terms: FloatArray  # (len(Link), n)
    friction: FloatArray  # (len(Friction), n); (0, n) where joints have no dry friction
    base: FloatArray  # (len(Base), 1); (0, 1) where the base rests


class MachineArrays(NamedTuple):
    """The same with what links may have beside it: rotors and drag."""

    length: FloatArray
    damping: FloatArray
    gravity: FloatArray
    terms: FloatArray
    friction: FloatArray
    base: FloatArray
    rotors: FloatArray  # (len(Rotor), n) or (0, n)
    drag: FloatArray  # (n,), or empty where air resists no tip
    quadratic_drag: FloatArray  # as drag


class SpringArrays(NamedTuple):
    """Point masses on springs, whose lengths are those without load; rotors are empty."""

    length: FloatArray
    damping: FloatArray
    gravity: FloatArray
    terms: FloatArray
    friction: FloatArray
    base: FloatArray
    rotors: FloatArray
    drag: FloatArray
    quadratic_drag: FloatArray
    springs: FloatArray  # stiffness and axial damping, (2, n)


class SliderArrays(SpringArrays):
    """Links on springs: the same fields, for links and rotors of any kind."""


AnyArrays = ChainArrays | LinkArrays | MachineArrays | SpringArrays | SliderArrays


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
def rotor_terms_of(chain: FloatArray, i: int, rotors: FloatArray, column: int) -> None:
    """Write the rows of `MachineArrays.rotors` for joint `i` of a chain (parameters, n)."""
    armature, gear = chain[Parameter.armature, i], chain[Parameter.gear, i]
    ratio = 1.0 / gear - 1.0
    # above joint 0 nothing turns
    rotors[Rotor.COUPLING, column] = armature * ratio if i > 0 else 0.0
    rotors[Rotor.ARMATURE, column] = armature
    rotors[Rotor.RATIO, column] = ratio
    rotors[Rotor.GEAR, column] = gear


def count_terms(chains: ChainParameters, base: object = None) -> int:
    """Return how many arrays a `layout.Model` has of chains on a `base`, or at rest: 0, 3 or 4."""
    if base is None and chains.is_ideal:
        return 0
    return 4 if chains.has_drag or np.any(chains.armature) else 3


def terms_of_each(chains: ChainParameters) -> NDArray[np.int64]:
    """Return `count_terms` of each chain alone at rest, (B,)."""
    ideal = chains.has_bobs & ~np.any(chains.friction, axis=-1)
    machinery = chains.armature, chains.drag, chains.quadratic_drag
    machines = np.any([np.any(values, axis=-1) for values in machinery], axis=0)
    return np.where(ideal, 0, np.where(machines, 4, 3))


def lacks_terms(chains: ChainParameters, count: int) -> bool:
    """Return whether chains need a larger model than one of `count` arrays."""
    needed = count_terms(chains)
    return needed > count or (count == 3 and chains.has_drag)


def check_terms(chains: ChainParameters, count: int) -> None:
    """Raise a ValueError where chains need a larger model than one of `count` arrays."""
    if lacks_terms(chains, count):
        raise ValueError(
            "chains of point masses cannot become links or get friction, nor links get rotors or "
            "drag, while they are at work: begin with a chain that has these"
        )
