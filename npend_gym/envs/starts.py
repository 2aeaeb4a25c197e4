"""How episodes start: the chain drawn, the state drawn, the measurements begun, in compiled code.

All draws are functions of seed and number of the episode: see `npend_gym.compiled.philox`.
"""

# ruff: noqa: ARG001  all kinds of chains share the parameters of a kernel
from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym._streams import Purpose
from npend_gym.chain import STANDARD_GRAVITY
from npend_gym.compiled.arrays import bare
from npend_gym.compiled.jit import chosen_by_type, inlined_kernel, kernel
from npend_gym.compiled.philox import Keys, philox, unit
from npend_gym.envs.modes import Mode, NearPose, Release
from npend_gym.envs.rows import Episode, Pose, Setting
from npend_gym.physics.kernels.laws import Parameter
from npend_gym.physics.kernels.layout import Member, Model, Rod, Turns
from npend_gym.physics.kernels.link_terms import BASE_AT, Base
from npend_gym.physics.kernels.member_rows import Indices, begin_to_measure, write_chain
from npend_gym.theory.closed_forms import paper_period

_paper_period = inlined_kernel(paper_period)


class StartFields(NamedTuple):
    """Entries of `start`: how the built-in modes start."""

    KIND: int = 0
    POSE: int = 1  # rad
    GOALS: int = 2  # 1: it is near an equilibrium that is drawn, and so is a goal
    OTHERS: int = 3  # near an equilibrium: width of velocities and of a cart's place over `spread`


Start: StartFields = StartFields()
CUSTOM, RELEASE, NEAR_POSE = range(3)  # kinds of start
CHOSEN = 2.0  # times the cosines of an equilibrium that reset options choose


class DrawFields(NamedTuple):
    """Columns of `draws`, which has a row for each number that is drawn at a start."""

    OF_CHAIN: int = 0  # 1: a parameter of the chain; 0: a setting of the sub-environment
    FIELD: int = 1  # of `Parameter`, or of `Setting`
    ROD: int = 2
    LOW: int = 3
    HIGH: int = 4


Draw: DrawFields = DrawFields()


@inlined_kernel
def _stream(keys: Keys, k: int, purpose: int, episode: float, j: int) -> float:
    """Return number `j` of a stream of lane `k`, in [0, 1)."""
    words = philox(keys[0, k], keys[1, k], j // 4, 0, purpose, episode)
    return unit(words[j % 4])


@inlined_kernel
def _draw_chain(
    members: FloatArray, keys: Keys, k: int, draws: FloatArray, chain: FloatArray,
    context: FloatArray,
) -> None:  # fmt: skip
    """Draw the context of the next episode of sub-environment `k`, and write it where it belongs.

    That is into the chain, or into members.
    """
    episode = members[Episode.EPISODE, k] + 1.0
    for j in range(draws.shape[0]):
        low, high = draws[j, Draw.LOW], draws[j, Draw.HIGH]
        u = _stream(keys, k, Purpose.CHAIN, episode, j)
        value = low + (high - low) * u
        context[k, j] = value
        field, rod = int(draws[j, Draw.FIELD]), int(draws[j, Draw.ROD])
        if draws[j, Draw.OF_CHAIN] == 0.0:
            members[field, k] = value
            continue
        if field == Parameter.lengths and chain[Parameter.centres, rod] == chain[field, rod]:
            chain[Parameter.centres, rod] = value  # a bob stays at the end of its rod
        chain[field, rod] = value


@inlined_kernel
def _draw_equilibria(
    members: FloatArray, rods: FloatArray, keys: Keys, k: int, width: int, n: int
) -> None:
    """Draw start and goal of sub-environment `k`: two different equilibria.

    Those that `CHOSEN` marks are kept. Each n numbers of the stream are an equilibrium, in which
    rod i hangs where its number is below 1/2; one that is the other one is passed over.
    """
    rows, lane, episode, drawn = rods[k // width], k % width, members[Episode.EPISODE, k], 0
    for own, other in ((Pose.START, Pose.GOAL), (Pose.GOAL, Pose.START)):
        # the goal is drawn after the start
        free = own == Pose.START and abs(rows[other, lane]) < CHOSEN
        if abs(rows[own, lane]) == CHOSEN:
            for i in range(n):
                rows[own, i * width + lane] /= CHOSEN
            continue
        differs = False
        while not differs:
            differs = free
            for i in range(n):
                r = i * width + lane
                hangs = _stream(keys, k, Purpose.GOAL, episode, drawn + i) < 0.5
                rows[own, r] = 1.0 if hangs else -1.0
                differs = differs or rows[own, r] * rows[other, r] < 0.0
            drawn += n


@inlined_kernel
def _draw_state(
    members: FloatArray, rods: FloatArray, keys: Keys, k: int, width: int, n: int,
    start: FloatArray,
) -> None:  # fmt: skip
    """Draw the state of environment `k` as the mode's `start` does, from the equilibrium drawn."""
    rows, lane, episode = rods[k // width], k % width, members[Episode.EPISODE, k]
    if start[Start.KIND] == RELEASE:
        u = _stream(keys, k, Purpose.START, episode, 0)
        angle = members[Setting.amplitude, k] + members[Setting.spread, k] * u
        for i in range(n):
            rows[Rod.THETA, i * width + lane] = angle
            rows[Rod.OMEGA, i * width + lane] = 0.0
        return
    near = members[Setting.spread, k]
    words = philox(keys[0, k], keys[1, k], 0, 0, Purpose.START, episode)
    for j in range(2 * n):  # the angles, then the angular velocities
        if j > 0 and j % 4 == 0:  # as `_stream`, with each block computed once
            words = philox(keys[0, k], keys[1, k], j // 4, 0, Purpose.START, episode)
        drawn = -near + (near + near) * unit(words[j % 4])
        if j >= n:
            rows[Rod.OMEGA, (j - n) * width + lane] = start[Start.OTHERS] * drawn
            continue
        pose = start[Start.POSE]
        if start[Start.GOALS] > 0.0 and rows[Pose.START, j * width + lane] < 0.0:
            pose += math.pi
        rows[Rod.THETA, j * width + lane] = pose + drawn


@inlined_kernel
def _no_cart(
    members: FloatArray, rods: FloatArray, model: Model, keys: Keys, k: int, start: FloatArray
) -> None:
    return


@inlined_kernel
def _cart(
    members: FloatArray, rods: FloatArray, model: tuple[FloatArray, ...], keys: Keys, k: int,
    start: FloatArray,
) -> None:  # fmt: skip
    width = members.shape[1] // rods.shape[0]
    g, lane, last = k // width, k % width, rods.shape[2] - width
    if model[BASE_AT].shape[1] == 0:
        return
    model[BASE_AT][g, Base.INVERSE_MASS, lane] = 1.0 / members[Setting.cart_mass, k]
    model[BASE_AT][g, Base.DAMPING, lane] = members[Setting.rail_damping, k]
    near = 0.0
    if start[Start.KIND] == NEAR_POSE:
        near = start[Start.OTHERS] * members[Setting.spread, k]
    for row, field in enumerate((Rod.THETA, Rod.OMEGA)):
        u = _stream(keys, k, Purpose.START, members[Episode.EPISODE, k], 2 * (last // width) + row)
        rods[g, field, last + lane] = -near + (near + near) * u


@chosen_by_type("model", {0: _no_cart, 3: _cart, 4: _cart})
def _begin_cart(
    members: FloatArray, rods: FloatArray, model: Model, keys: Keys, k: int, start: FloatArray
) -> None:
    """Give the cart of lane `k` its mass, and draw place and velocity after those of the chain."""
    raise NotImplementedError


@inlined_kernel
def _scale(members: FloatArray, rods: FloatArray, k: int, width: int, n: int) -> None:
    """Set what makes quantities mean the same for every chain, from the chain of lane `k`."""
    rows, lane = rods[k // width], k % width
    lift = size = length = 0.0
    for i in range(n):
        lifts = rows[Rod.CARRIED, i * width + lane]
        lift += lifts
        size += abs(lifts)
        length += rows[Rod.LENGTH, i * width + lane]
    gravity = members[Member.GRAVITY, k]
    unit_of_energy = 2.0 * (gravity if gravity > 0.0 else STANDARD_GRAVITY) * size
    members[Episode.PER_ENERGY, k] = 1.0 / unit_of_energy
    members[Episode.PER_LENGTH, k] = 1.0 / length
    members[Episode.PER_LIFT, k] = 0.5 / lift
    members[Episode.IDEAL_PERIOD, k] = 0.0
    if members[Episode.HAS_BOBS, k] > 0.0 and gravity > 0.0:
        masses, lengths = rows[Rod.MASS, lane::width][:n], rows[Rod.LENGTH, lane::width][:n]
        members[Episode.IDEAL_PERIOD, k] = _paper_period(masses, lengths, gravity)


@kernel
def draw_chains(
    members: FloatArray, rods: FloatArray, model: Model, keys: Keys, nominal: FloatArray,
    draws: FloatArray, context: FloatArray, chain: FloatArray,
) -> None:  # fmt: skip
    """Draw the chains of the next episode of the environments that are STARTING, before it begins.

    Parameters
    ----------
    members, rods, model
        As for `step_many`.
    keys : ndarray, uint64, shape (2, lanes)
        Those of the sub-environments' seeds.
    nominal : ndarray, shape (parameters, n)
        The chain that the environment was made with.
    draws : ndarray, shape (numbers, len(Draw))
        What is drawn of it.
    context : ndarray, shape (lanes, numbers)
        Written: the numbers drawn.
    chain : ndarray, shape (parameters, n)
        Overwritten.
    """
    members, rods, model, context = bare(members), bare(rods), bare(model), bare(context)
    n = nominal.shape[1]
    width = rods.shape[2] // (n + 1)
    for k in range(members.shape[1]):
        if members[Episode.STARTING, k] == 0.0:
            continue
        for field in range(nominal.shape[0]):  # `chain[:] =` takes 2 s to compile
            for rod in range(n):
                chain[field, rod] = nominal[field, rod]
        _draw_chain(members, keys, k, draws, chain, context)
        write_chain(members, rods, model, k, width, bare(chain))
        _scale(members, rods, k, width, n)


@kernel
def begin_episodes(
    members: FloatArray, rods: FloatArray, model: Model, record: Turns, n: int, keys: Keys,
    start: FloatArray, actions: FloatArray,
) -> None:  # fmt: skip
    """Begin the next episode of the lanes that are STARTING; the next step does not move them.

    Parameters
    ----------
    members, rods, model, record
        As for `step_many`.
    n : int
        Number of rods.
    keys : ndarray, uint64, shape (2, lanes)
        Those of the sub-environments' seeds.
    start : ndarray, shape (len(Start),)
    actions : ndarray, shape (joints, lanes)
        Written, as the torques are: 0, of the sub-environments that start.
    """
    members, rods, model, actions = bare(members), bare(rods), bare(model), bare(actions)
    record = bare(record)
    width = rods.shape[2] // (n + 1)
    for k in range(members.shape[1]):
        if members[Episode.STARTING, k] == 0.0:
            continue
        members[Episode.EPISODE, k] += 1.0
        members[Member.ACTIVE, k] = 0.0
        for row in range(actions.shape[0]):
            actions[row, k] = 0.0
        for i in range(n + 1):
            rods[k // width, Rod.TORQUE, i * width + k % width] = 0.0
        if start[Start.GOALS] > 0.0:
            _draw_equilibria(members, rods, keys, k, width, n)
        _begin_cart(members, rods, model, keys, k, start)
        if start[Start.KIND] != CUSTOM:
            _draw_state(members, rods, keys, k, width, n, start)
        begin_to_measure(members, rods, record, k, width, n)


@kernel
def scale_all(members: FloatArray, rods: FloatArray, n: int, chosen: Indices) -> None:
    """Set what makes quantities mean the same for every chain, of `chosen` sub-environments."""
    members, rods = bare(members), bare(rods)
    for k in chosen:
        _scale(members, rods, k, rods.shape[2] // (n + 1), n)


@kernel
def begin_one(
    members: FloatArray, rods: FloatArray, model: Model, record: Turns, chain: FloatArray
) -> None:
    """Give a single environment a chain, and measure from its present state."""
    members, rods, model, chain = bare(members), bare(rods), bare(model), bare(chain)
    record = bare(record)
    n = chain.shape[1]
    write_chain(members, rods, model, 0, 1, chain)
    _scale(members, rods, 0, 1, n)
    begin_to_measure(members, rods, record, 0, 1, n)


def start_plan(mode: Mode) -> FloatArray:
    """Return `start` of a mode; of one of the user's own, Python calls its `start`.

    A class derived from a built-in mode, or an instance of one, may have any `start` of its own.
    """
    plan = np.zeros(len(Start))
    plan[Start.GOALS] = mode.has_goals
    start = getattr(mode.start, "__func__", None)
    if start is Release.start:
        plan[Start.KIND] = RELEASE
    elif isinstance(mode, NearPose) and start is NearPose.start:
        own = Start.KIND, Start.POSE, Start.OTHERS
        plan[[*own]] = NEAR_POSE, mode.pose, mode.other_spread
    return plan
