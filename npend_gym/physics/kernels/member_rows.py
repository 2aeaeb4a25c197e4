"""A member of an ensemble: its chain written to memory, and its measurements begun, lane by lane.

A chain is an array (parameters, n) with the rows of `Parameter`; gravity fills its row.
`physics.memory` writes whole ensembles by these functions, environments a lane that starts.
"""

# ruff: noqa: ARG001  all kinds of chains share the parameters of a kernel
from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import FloatArray
from npend_gym.chain import ChainParameters
from npend_gym.compiled.arrays import aligned_zeros, bare, innermost
from npend_gym.compiled.jit import chosen_by_type, inlined_kernel, kernel
from npend_gym.compiled.sincos import sincos
from npend_gym.physics.kernels.laws import Friction, Parameter, friction_terms_of
from npend_gym.physics.kernels.layout import Member, Model, Rod, Turn, Turns
from npend_gym.physics.kernels.link_terms import (
    BASE_AT,
    AnyArrays,
    ChainArrays,
    Link,
    LinkArrays,
    MachineArrays,
    Rotor,
    SliderArrays,
    SpringArrays,
    count_terms,
    link_terms_of,
    rotor_terms_of,
)
from npend_gym.physics.kernels.turning_points import latest_sign, speed_threshold

Indices = NDArray[np.int64]

_speed_threshold: Any = inlined_kernel(speed_threshold)


@inlined_kernel
def _no_terms(model: Model, g: int, lane: int, width: int, chain: FloatArray) -> None:
    return


@inlined_kernel
def _write_links(model: Any, g: int, lane: int, width: int, chain: FloatArray) -> None:
    terms, friction = model[0][g], model[1][g]
    for i in range(chain.shape[1]):
        link_terms_of(chain, i, terms, i * width + lane)
        friction_terms_of(chain, i, friction, i * width + lane)


@inlined_kernel
def _write_machine(model: Any, g: int, lane: int, width: int, chain: FloatArray) -> None:
    _write_links(model, g, lane, width, chain)
    for i in range(chain.shape[1]):
        rotor_terms_of(chain, i, model[3][g], i * width + lane)


@chosen_by_type("model", {0: _no_terms, 3: _write_links, 4: _write_machine})
def _write_terms(model: Model, g: int, lane: int, width: int, chain: FloatArray) -> None:
    """Write what a chain needs in the model, beside the rows of `Rod`."""
    raise NotImplementedError


@inlined_kernel
def write_chain(
    members: FloatArray, rods: FloatArray, model: Model, k: int, width: int, chain: FloatArray
) -> None:
    """Give member `k`, in groups of `width`, a chain."""
    g, lane, n = k // width, k % width, chain.shape[1]
    rows, below = rods[g], 0.0
    for i in range(n - 1, -1, -1):
        mass, length = chain[Parameter.masses, i], chain[Parameter.lengths, i]
        centre = chain[Parameter.centres, i]
        r, carried = i * width + lane, below + mass
        rows[Rod.MASS, r] = mass
        rows[Rod.LENGTH, r] = length
        rows[Rod.INVERSE_LENGTH, r] = 1.0 / length
        rows[Rod.DAMPING, r] = chain[Parameter.damping, i]
        rows[Rod.DRAG, r] = chain[Parameter.drag, i]
        rows[Rod.QUADRATIC_DRAG, r] = chain[Parameter.quadratic_drag, i]
        # `Chain.lift`
        rows[Rod.CARRIED, r] = (
            length * carried if centre == length else (mass * centre + length * below)
        )
        # at joints 0..n: zero at the pivot, because it cannot move
        rows[Rod.INVERSE_MASS, r + width] = 1.0 / mass
        below = carried
    members[Member.GRAVITY, k] = chain[Parameter.gravity, 0]
    _write_terms(model, g, lane, width, chain)


@inlined_kernel
def _no_turns(
    members: FloatArray, rods: FloatArray, record: None, k: int, width: int, n: int
) -> None:
    return


@inlined_kernel
def _begin_turns(
    members: FloatArray,
    rods: FloatArray,
    record: tuple[FloatArray, ...],
    k: int,
    width: int,
    n: int,
) -> None:
    g, lane = k // width, k % width
    rows, turns, total, fastest, lift = rods[g], record[0][g], 0.0, 0.0, 0.0
    position, velocity, moment, momentum, mass = 0.0, 0.0, 0.0, 0.0, 0.0
    around = False
    for i in range(n):
        r = i * width + lane
        _, c = sincos(rows[Rod.THETA, r])
        around = around or rows[Rod.CARRIED, r] * c < 0.0
        lift += abs(rows[Rod.CARRIED, r])
        mass += rows[Rod.MASS, r]
    members[Member.AROUND, k] = 1.0 if around else 0.0
    side = down = up = moment_down = moment_up = 0.0
    for i in range(n):
        r = i * width + lane
        length, omega = rows[Rod.LENGTH, r], rows[Rod.OMEGA, r]
        s, c = sincos(rows[Rod.THETA, r])
        total += length
        fastest = max(fastest, abs(omega))
        position += length * s
        # a link that rests upright falls away from its side
        side += -length * s if around and rows[Rod.CARRIED, r] < 0.0 else length * s
        velocity += length * (omega * c)
        down += length * c
        up += length * (omega * s)
        moment += rows[Rod.CARRIED, r] * s
        momentum += rows[Rod.CARRIED, r] * (omega * c)
        moment_down += rows[Rod.CARRIED, r] * c
        moment_up += rows[Rod.CARRIED, r] * (omega * s)
        scale = 1.0 / total if around else 1.0
        turns[Turn.ORIENTATION, r] = -scale if side < 0.0 else scale
        rows[Rod.VELOCITY, r] = velocity
        turns[Turn.SIGN, r] = position * up + down * velocity if around else velocity
        turns[Turn.PERIOD, r] = turns[Turn.ZERO, r] = math.nan
        turns[Turn.RISEN, r] = 0.0
    last = n * width + lane
    scale = 1.0 / (mass * lift) if around else 1.0
    turns[Turn.ORIENTATION, last] = -scale if moment < 0.0 else scale
    turns[Turn.SIGN, last] = momentum / mass
    if around:
        turns[Turn.SIGN, last] = moment * moment_up + moment_down * momentum
    turns[Turn.PERIOD, last] = math.nan if members[Member.WITH_COM, k] > 0.0 else 0.0
    turns[Turn.ZERO, last] = math.nan
    turns[Turn.RISEN, last] = 0.0
    mean = total / n
    natural = math.sqrt(members[Member.GRAVITY, k] / mean)
    threshold = members[Member.THRESHOLD, k] = _speed_threshold(natural, fastest) * mean
    for i in range(n + 1):
        r = i * width + lane
        turns[Turn.SIGN, r] = latest_sign(
            turns[Turn.ORIENTATION, r] * turns[Turn.SIGN, r], threshold, 0.0
        )


@chosen_by_type("record", {0: _no_turns, 1: _begin_turns})
def _begin_record(
    members: FloatArray, rods: FloatArray, record: Turns, k: int, width: int, n: int
) -> None:
    """Begin to look for turning points of member `k`, where they are measured."""
    raise NotImplementedError


@inlined_kernel
def begin_to_measure(
    members: FloatArray, rods: FloatArray, record: Turns, k: int, width: int, n: int
) -> None:
    """Begin to measure member `k` from its present state: time, work, turning points."""
    _begin_record(members, rods, record, k, width, n)
    members[Member.TIME, k] = members[Member.WORK, k] = 0.0
    members[Member.COMPLETED, k] = members[Member.DIVERGED, k] = 0.0


@kernel
def write_chains(
    members: FloatArray, rods: FloatArray, model: Model, chosen: Indices, chains: FloatArray
) -> None:
    """Give `chosen` members, k of them, the chains (k, parameters, n); or (1, ...) to all."""
    members, rods, model = bare(members), bare(rods), bare(model)
    width = rods.shape[2] // (chains.shape[2] + 1)
    for row in range(chosen.size):
        chain = chains[row if chains.shape[0] > 1 else 0]
        write_chain(members, rods, model, chosen[row], width, chain)


@kernel
def begin_all_to_measure(
    members: FloatArray, rods: FloatArray, record: Turns, n: int, chosen: Indices
) -> None:
    """Begin to measure `chosen` members from their present states."""
    members, rods, record = bare(members), bare(rods), bare(record)
    width = rods.shape[2] // (n + 1)
    for k in chosen:
        begin_to_measure(members, rods, record, k, width, n)


Arrays = tuple[FloatArray, FloatArray, Model]  # members, rods and model


def new_model(terms: int, n: int, groups: int, width: int, base: FloatArray | None = None) -> Model:
    """Return the arrays of a model, see `count_terms`, of chains on a `base` (len(Base), B or 1).

    They are zeros but for the base.
    """
    rows = 0 if base is None else len(base)
    shapes = (len(Link), n), (len(Friction), n), (rows, 1), (len(Rotor), n)
    model = tuple(aligned_zeros(groups, count, m * width) for count, m in shapes[:terms])
    if base is not None:
        own = base[:, np.minimum(np.arange(groups * width), base.shape[1] - 1)]
        model[BASE_AT][:] = own.reshape(rows, groups, width).swapaxes(0, 1)
    return model or None


def new_arrays(
    chains: ChainParameters, terms: int, groups: int, width: int, base: FloatArray | None = None,
    *, columns: int = 0, spare: tuple[int, int] = (0, 0),
) -> Arrays:  # fmt: skip
    """Return chains, or one for all, in a model of `terms` arrays; lanes to spare repeat the last.

    `columns` are those of `members`, if there are more than lanes; `spare` are more rows of
    `members` and of `rods`.
    """
    n, lanes, rows = chains.masses.shape[1], groups * width, chains.stacked()
    arrays = (
        aligned_zeros(len(Member) + spare[0], max(columns, lanes)),
        aligned_zeros(groups, len(Rod) + spare[1], (n + 1) * width),
        new_model(terms, n, groups, width, base),
    )
    if len(rows) > 1:
        rows = rows[np.minimum(np.arange(lanes), len(rows) - 1)]
    write_chains(*arrays, np.arange(lanes), rows)
    return arrays


def arrays_of(
    chains: ChainParameters,
    base: FloatArray | None = None,
    springs: tuple[FloatArray, FloatArray] | None = None,
) -> AnyArrays:
    """Return the parameters of B mechanisms in the form that the kernels take, the lane innermost.

    `base` (len(Base), B or 1) holds the rows of `Base` where the base moves; `springs` stiffness
    and axial damping, (B, n) each.
    """
    (lanes, n), terms = chains.masses.shape, count_terms(chains, base) if springs is None else 4
    members, (rows,), model = new_arrays(chains, terms, 1, lanes, base)
    size, gravity = n * lanes, members[Member.GRAVITY]
    length, damping = rows[Rod.LENGTH][:size], rows[Rod.DAMPING][:size]
    resisted = size if chains.has_drag else 0
    drag = rows[Rod.DRAG][:resisted], rows[Rod.QUADRATIC_DRAG][:resisted]
    if model is None:
        inverse_length = rows[Rod.INVERSE_LENGTH][:size]
        return ChainArrays(
            rows[Rod.INVERSE_MASS], length, inverse_length, damping, gravity, *drag
        )  # fmt: skip
    links, friction, moving, *rotors = (part[0] for part in model)
    rubbed = slice(None if np.any(chains.friction) else 0)
    shared = length, damping, gravity, links, friction[rubbed], moving
    if terms == 3:
        return LinkArrays(*shared)
    geared = slice(None if np.any(chains.armature) else 0)
    if springs is None:
        return MachineArrays(*shared, rotors[0][geared], *drag)
    kind = SpringArrays if np.all(chains.has_bobs) else SliderArrays
    each = np.broadcast_to(np.array(springs), (2, lanes, n))
    return kind(*shared, rotors[0][geared], *drag, innermost(each))
