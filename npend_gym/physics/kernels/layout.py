"""Where many chains stand in memory: the fields of an ensemble by name, and views of one group.

The chains ("members") stand in groups: of WIDTH, worked on as packs, or of one where there is only
one chain. The last group is filled up with chains that hang at rest. Two arrays hold them all::

    members[Member.TIME, k]                  one number for member k
    rods[g, Rod.THETA, i * width + lane]     one for rod i of the member in that lane of group g

The fields are tuples of numbers, which every supported Numba compiles to constants. Seen as packs,
which take the lanes of a group as one number, these are `members[Member.TIME, g]` and
`rods[g, Rod.THETA, i]`: for kernels a group of many chains looks like one chain.

A third argument, `model`, says what kind of chains they are, at compile time: None for point
masses, three arrays for links, four for machines. Where their base moves, its place, speed and
force stand in the last entry of THETA, OMEGA and TORQUE.

A fourth, `record`, says whether turning points are measured, at compile time too: it is a tuple of
one array (groups, len(Turn), (n + 1) * width), or None. Kernels that do not measure have no code
for it.
"""

# ruff: noqa: ARG001  all kinds of chains share the parameters of a kernel
from __future__ import annotations

from typing import Any, NamedTuple

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import aligned_zeros
from npend_gym.compiled.jit import chosen_by_type, inlined_kernel
from npend_gym.compiled.packs import WIDTH
from npend_gym.physics.kernels.laws import Friction
from npend_gym.physics.kernels.link_terms import (
    BASE_AT,
    AnyArrays,
    ChainArrays,
    LinkArrays,
    MachineArrays,
    Rotor,
)
from npend_gym.physics.kernels.rk4 import RK4_ROWS
from npend_gym.physics.kernels.tensions import any_positive
from npend_gym.physics.kernels.turning_points import Record

MAX_SPEED = 1e6  # rad/s; a rod beyond this, or beyond MAX_ANGLE, has diverged


class MemberFields(NamedTuple):
    """Rows of `members`. Rows beyond these belong to whoever keeps the ensemble."""

    TIME: int = 0  # s since the start
    WORK: int = 1  # J done by torque, damping and drag since the start
    THRESHOLD: int = 2  # m/s: the speed above which the direction of a bob counts
    COMPLETED: int = 3  # number of bobs whose pseudo-period is known
    DIVERGED: int = 4  # 1 where the state has left all bounds, else 0
    ACTIVE: int = 5  # 1 where the next step is to be taken, else 0
    GRAVITY: int = 6  # m/s^2
    WITH_COM: int = 7  # 1 where the pseudo-period of the centre of mass is measured too
    AROUND: int = 8  # 1 where velocities around the pivot count: a rod began beyond 90 degrees


Member: MemberFields = MemberFields()


class RodFields(NamedTuple):
    """Rows of `rods` for each group, (n + 1) entries for each lane; the last one is mostly free."""

    THETA: int = 0  # rad
    OMEGA: int = 1  # rad/s
    TORQUE: int = 2  # N m at the joint above the rod
    VELOCITY: int = 3  # m/s, horizontal, of the bob
    LENGTH: int = 4  # m
    INVERSE_LENGTH: int = 5
    DAMPING: int = 6  # N m s
    DRAG: int = 7  # N s/m
    QUADRATIC_DRAG: int = 8  # N s^2/m^2
    MASS: int = 9  # kg
    CARRIED: int = 10  # kg m: mass that the rod carries times its length
    INVERSE_MASS: int = 11  # at joints 0..n: the one row that fills its n + 1 entries


Rod: RodFields = RodFields()


class TurnFields(NamedTuple):
    """Rows of `record` for each group: fields of a `Record` of turning points, (n + 1) entries.

    The last entry is that of the centre of mass: a period of 0 is not measured.
    """

    PERIOD: int = 0
    ORIENTATION: int = 1
    SIGN: int = 2
    RISEN: int = 3
    ZERO: int = 4


Turn: TurnFields = TurnFields()


class ScratchFields(NamedTuple):
    """Rows of the work space of one group, as wide as a row of `rods`."""

    SIN: int = 0  # of theta
    COS: int = 1
    STEP_THETA: int = 2  # state at the start of the step
    STEP_OMEGA: int = 3
    THETA: int = 4  # state and velocities at the start of the substep
    OMEGA: int = 5
    VELOCITY: int = 6
    ACCELERATION: int = 7  # of the bobs, horizontal, at the start of the substep [m/s^2]
    ACCELERATION_END: int = 8
    VELOCITY_END: int = 9  # of the bobs and the centre of mass around the pivot
    MARKED: int = 10  # 1 for bobs that may have turned
    OBSERVED: int = 11  # what is observed: for the environments
    DISSIPATED: int = 12  # first entry: J that damping and drag have taken in the step
    SINCE: int = 13  # first entry: s from the start of the step to that of the substep
    DURATION: int = 14  # first entry: s, of the substep


Scratch: ScratchFields = ScratchFields()


RK4 = len(Scratch)  # from here on RK4_ROWS rows of the work space are for the Runge-Kutta step


class TimingFields(NamedTuple):
    """Entries of `timing`: what one compiled call is to do."""

    DT: int = 0  # s
    SUBSTEPS: int = 1  # that dt is cut into
    PER_ROTATION: int = 2  # 1/rad: a substep in which a rod turns by more than its inverse is cut
    FIRST_GROUP: int = 3  # the groups to advance: from this one
    LAST_GROUP: int = 4  # to the one before this
    FIRST_SUBSTEP: int = 5  # the substeps to take: from this one
    LAST_SUBSTEP: int = 6  # to the one before this


Timing: TimingFields = TimingFields()


# What chains need beside `rods`: nothing if they are ideal; (terms, friction, base) if they are
# links; and (terms, friction, base, rotors) if they are machines, of shapes (groups, rows, n width)
# and, of the base, (groups, len(Base), width), or (groups, 0, width) if it rests. Plain tuples,
# because others cost 2 us in a call from Python.
Model = tuple[FloatArray, ...] | None
Turns = tuple[FloatArray, ...] | None  # the `record` of kernels


class Group(NamedTuple):
    """The state and the parameters of a group of chains of n rods: views, written in place."""

    theta: FloatArray  # (n,), or (n + 1,) with the place of a base that moves
    omega: FloatArray  # as theta
    torque: FloatArray  # as theta
    velocity: FloatArray  # (n,)
    mass: FloatArray  # (n + 1,), as what follows; the last entry is free
    carried: FloatArray
    chain: AnyArrays
    record: Record  # None where nothing is measured


def group_width(size: int) -> int:
    """Return how many members stand in a group, of `size` in all."""
    return 1 if size == 1 else WIDTH


def new_scratch(n: int, width: int) -> FloatArray:
    """Return the work space of one thread."""
    return aligned_zeros(RK4 + RK4_ROWS, (n + 2) * width)


@inlined_kernel
def resists(drag: FloatArray, quadratic_drag: FloatArray) -> bool:
    """Return whether the air resists any bob of any lane."""
    return any_positive(drag) or any_positive(quadratic_drag)


@inlined_kernel
def rubs(friction: FloatArray) -> bool:
    """Return whether any joint of any lane has dry friction."""
    return any_positive(friction)


@inlined_kernel
def turns(armature: FloatArray) -> bool:
    """Return whether any joint of any lane has a rotor."""
    return any_positive(armature)


@inlined_kernel
def _point_masses(members: FloatArray, rods: FloatArray, model: Model, g: int) -> ChainArrays:
    """Return the parameters of point masses. Drag is empty where no lane has any."""
    n, rows = rods.shape[2] - 1, rods[g]
    drag, quadratic = rows[Rod.DRAG], rows[Rod.QUADRATIC_DRAG]
    resisted = n if resists(drag, quadratic) else 0
    return ChainArrays(
        rows[Rod.INVERSE_MASS],
        rows[Rod.LENGTH][:n],
        rows[Rod.INVERSE_LENGTH],
        rows[Rod.DAMPING],
        members[Member.GRAVITY][g : g + 1],
        drag[:resisted],
        quadratic[:resisted],
    )


@inlined_kernel
def _links(
    members: FloatArray, rods: FloatArray, model: tuple[FloatArray, ...], g: int
) -> LinkArrays:
    n, rows, friction = rods.shape[2] - 1, rods[g], model[1][g]
    gravity = members[Member.GRAVITY][g : g + 1]
    rubbed = len(Friction) if rubs(friction[Friction.FRICTION]) else 0
    return LinkArrays(
        rows[Rod.LENGTH][:n], rows[Rod.DAMPING], gravity, model[0][g], friction[:rubbed],
        model[BASE_AT][g],
    )  # fmt: skip


@inlined_kernel
def _machine(
    members: FloatArray, rods: FloatArray, model: tuple[FloatArray, ...], g: int
) -> MachineArrays:
    """Return the parameters of machines. What no lane has is empty."""
    n, rows, own, rotors = rods.shape[2] - 1, rods[g], _links(members, rods, model, g), model[3][g]
    drag, quadratic = rows[Rod.DRAG], rows[Rod.QUADRATIC_DRAG]
    resisted = n if resists(drag, quadratic) else 0
    geared = len(Rotor) if turns(rotors[Rotor.ARMATURE]) else 0
    return MachineArrays(
        own.length, own.damping, own.gravity, own.terms, own.friction, own.base, rotors[:geared],
        drag[:resisted], quadratic[:resisted],
    )  # fmt: skip


@chosen_by_type("model", {0: _point_masses, 3: _links, 4: _machine})
def _chain_of(members: FloatArray, rods: FloatArray, model: Model, g: int) -> AnyArrays:
    """Return the parameters of the chains of group `g`."""
    raise NotImplementedError


@inlined_kernel
def _angles_alone(rods: FloatArray, model: Model) -> int:
    return rods.shape[2] - 1


@inlined_kernel
def _angles_and_base(rods: FloatArray, model: tuple[FloatArray, ...]) -> int:
    return rods.shape[2] - (1 if model[BASE_AT].shape[1] == 0 else 0)


@chosen_by_type("model", {0: _angles_alone, 3: _angles_and_base, 4: _angles_and_base})
def _coordinates(rods: FloatArray, model: Model) -> int:
    """Return the number of coordinates of a chain."""
    raise NotImplementedError


@inlined_kernel
def _no_record(record: None, g: int) -> None:
    return None


@inlined_kernel
def _record(record: tuple[FloatArray, ...], g: int) -> Record:
    rows = record[0][g]
    return Record(
        rows[Turn.PERIOD],
        rows[Turn.ORIENTATION],
        rows[Turn.SIGN],
        rows[Turn.RISEN],
        rows[Turn.ZERO],
        rows[Turn.ZERO][:0],
    )


@chosen_by_type("record", {0: _no_record, 1: _record})
def _record_of(record: Turns, g: int) -> Any:
    """Return the record of turning points of group `g`, or None."""
    raise NotImplementedError


@inlined_kernel
def group_of(members: FloatArray, rods: FloatArray, model: Model, record: Turns, g: int) -> Group:
    """Return the named views of group `g`."""
    n, rows, size = rods.shape[2] - 1, rods[g], _coordinates(rods, model)
    return Group(
        rows[Rod.THETA][:size],
        rows[Rod.OMEGA][:size],
        rows[Rod.TORQUE][:size],
        rows[Rod.VELOCITY][:n],
        rows[Rod.MASS],
        rows[Rod.CARRIED],
        _chain_of(members, rods, model, g),
        _record_of(record, g),
    )
