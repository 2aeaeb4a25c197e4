"""One step of many chains: substeps, the work that is done, and the turning points of the bobs."""

from __future__ import annotations

from typing import Any

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import NumbersOf, bare, packs
from npend_gym.compiled.jit import inlined_kernel, kernel, spliced_kernel
from npend_gym.compiled.packs import WIDTH, any_of, where
from npend_gym.compiled.sincos import MAX_ANGLE, ROUND, sincos
from npend_gym.physics.kernels.dynamics import any_power, copy, joint_power
from npend_gym.physics.kernels.layout import (
    MAX_SPEED,
    RK4,
    Group,
    Member,
    Model,
    Scratch,
    Timing,
    Turns,
    group_of,
)
from npend_gym.physics.kernels.reversals import follow, waiting
from npend_gym.physics.kernels.rk4 import OMEGA_2, rk4_step

MAX_PARTS = 32.0  # of a substep


@inlined_kernel
def bob_velocities(group: Group, s: FloatArray, c: FloatArray) -> None:
    """Write sine and cosine of every angle, and the horizontal velocity of every bob."""
    for i in range(group.velocity.size):
        s[i], c[i] = sincos(group.theta[i])
    total = 0.0
    for i in range(group.velocity.size):
        total = total + group.chain.length[i] * (group.omega[i] * c[i])
        group.velocity[i] = total


@inlined_kernel
def _torque_work(group: Group, before: FloatArray) -> Any:
    """Return the work of constant torques over a step that began at the angles `before` [J]."""
    torque, theta, n = group.torque, group.theta, group.velocity.size
    above = theta[0] - before[0]
    total = torque[0] * above
    for i in range(1, n):
        turned = theta[i] - before[i]
        total = total + torque[i] * (turned - above)
        above = turned
    for i in range(n, theta.size):  # the force on a base that moves
        total = total + torque[i] * (theta[i] - before[i])
    return total


@inlined_kernel
def substep_parts(omega: FloatArray, n: int, h: float, per_rotation: float) -> Any:
    """Return into how many parts a substep is cut: no rod turns by more than 1/per_rotation."""
    fastest = abs(omega[0])
    for i in range(1, n):
        speed = abs(omega[i])
        fastest = where(speed > fastest, speed, fastest)
    wanted = fastest * (h * per_rotation)
    wanted = where(wanted > 1.0, wanted, 1.0)
    wanted = where(wanted < MAX_PARTS, wanted, MAX_PARTS)
    whole = (wanted + ROUND) - ROUND
    return where(whole < wanted, whole + 1.0, whole)


@inlined_kernel
def _begin_step(group: Group, scratch: FloatArray) -> None:
    """Keep the state at the start of the step."""
    copy(group.theta, scratch[Scratch.STEP_THETA])
    copy(group.omega, scratch[Scratch.STEP_OMEGA])
    scratch[Scratch.DISSIPATED][0] = 0.0 * group.theta[0]


@inlined_kernel
def _begin_substep(group: Group, scratch: FloatArray) -> None:
    """Keep the state and the velocities of the bobs at the start of the substep."""
    copy(group.velocity, scratch[Scratch.VELOCITY])
    copy(group.theta, scratch[Scratch.THETA])
    copy(group.omega, scratch[Scratch.OMEGA])


@inlined_kernel
def _dissipate(group: Group, h: Any, dissipated: Any, scratch: FloatArray) -> Any:
    """Add what the dampers take in the last three stages of a substep to `dissipated` [J]."""
    size = group.theta.size
    for stage in range(3):
        omega = scratch[RK4 + OMEGA_2 + stage][:size]
        weight = h / 6.0 if stage == 2 else h / 3.0
        dissipated = dissipated + weight * joint_power(omega, group.chain)
    return dissipated


@inlined_kernel
def _wait(group: Group, h: Any, scratch: FloatArray) -> None:
    """Put lanes whose substep is shorter, `h` being zero, back to its start."""
    theta, omega = group.theta, group.omega
    theta_before, omega_before = scratch[Scratch.THETA], scratch[Scratch.OMEGA]
    for i in range(theta.size):
        theta[i] = where(h > 0.0, theta[i], theta_before[i])
        omega[i] = where(h > 0.0, omega[i], omega_before[i])


@inlined_kernel
def _commit_step(numbers: FloatArray, g: int, group: Group, dt: float, scratch: FloatArray) -> None:
    """Add up time and work; lanes that are not active, or have diverged, keep their last state."""
    theta, omega, size, n = group.theta, group.omega, group.theta.size, group.velocity.size
    step_theta, step_omega = scratch[Scratch.STEP_THETA], scratch[Scratch.STEP_OMEGA]
    active, diverged = numbers[Member.ACTIVE, g] > 0.0, numbers[Member.DIVERGED, g]
    sound = diverged == 0.0
    for i in range(n):  # no comparison holds for NaN
        sound = sound & (abs(theta[i]) <= MAX_ANGLE) & (abs(omega[i]) <= MAX_SPEED)
    for i in range(n, size):  # a cart may be anywhere; its numbers are finite if these are zero
        sound = sound & (theta[i] - theta[i] == 0.0) & (omega[i] - omega[i] == 0.0)
    moves = active & sound
    numbers[Member.DIVERGED, g] = where(active ^ moves, 1.0, diverged)
    if any_of(where(moves, 0.0, 1.0) > 0.0):
        for i in range(size):
            theta[i] = where(moves, theta[i], step_theta[i])
            omega[i] = where(moves, omega[i], step_omega[i])
        bob_velocities(group, scratch[Scratch.SIN], scratch[Scratch.COS])
    before = numbers[Member.WORK, g]
    done = (before - scratch[Scratch.DISSIPATED][0]) + _torque_work(group, step_theta)
    numbers[Member.WORK, g] = where(moves, done, before)
    time = numbers[Member.TIME, g]
    numbers[Member.TIME, g] = where(moves, time + dt, time)


@spliced_kernel
def advance_group(
    view: NumbersOf, width: int, members: FloatArray, timing: FloatArray, scratch: FloatArray,
    g: int, group: Group,
) -> None:  # fmt: skip
    """Advance one group under its torques, by the substeps that `timing` names.

    Lanes whose rods turn fast take a substep in several parts, while the others wait. After the
    last substep the step is complete, and SIN, COS and the velocities are those of the new state.
    """
    numbers, rest, n = view(members), view(scratch), group.velocity.size
    rk4 = rest[RK4:]
    theta, omega, torque, chain = group.theta, group.omega, group.torque, group.chain
    if timing[Timing.FIRST_SUBSTEP] == 0.0:
        _begin_step(group, rest)
    damped = any_power(chain)
    tracked, of_com = waiting(group.record, numbers, g, n)
    dissipated = rest[Scratch.DISSIPATED, 0]
    whole = timing[Timing.DT] / timing[Timing.SUBSTEPS]
    for substep in range(int(timing[Timing.FIRST_SUBSTEP]), int(timing[Timing.LAST_SUBSTEP])):
        parts = substep_parts(omega, n, whole, timing[Timing.PER_ROTATION])
        some_wait, part, more = any_of(parts > 1.0), 0, True
        while more:
            h = where(parts > part, whole / parts, 0.0)
            rest[Scratch.DURATION, 0] = h
            rest[Scratch.SINCE, 0] = substep * whole + part * h
            part += 1
            more = any_of(parts > part)
            if tracked or some_wait:  # to pass the group costs some ns, for its many views
                _begin_substep(group, rest)
            if damped:
                dissipated = dissipated + (h / 6.0) * joint_power(omega, chain)
            dissipated = dissipated + rk4_step(0.0, theta, omega, h, torque, chain, rk4)
            if damped:
                dissipated = _dissipate(group, h, dissipated, rest)
            if some_wait:
                _wait(group, h, rest)
            if tracked or (substep + 1 == timing[Timing.SUBSTEPS] and not more):
                bob_velocities(group, rest[Scratch.SIN], rest[Scratch.COS])
            if tracked:
                tracked, of_com = follow(group.record, numbers, g, group, of_com, h, width, rest)
    rest[Scratch.DISSIPATED, 0] = dissipated
    if timing[Timing.LAST_SUBSTEP] == timing[Timing.SUBSTEPS]:
        _commit_step(numbers, g, group, timing[Timing.DT], rest)


@kernel
def advance_one(
    members: FloatArray, rods: FloatArray, model: Model, record: Turns, timing: FloatArray,
    scratch: FloatArray,
) -> None:  # fmt: skip
    """Advance one chain; see `advance_many`."""
    members, rods, model, record = bare(members), bare(rods), bare(model), bare(record)
    timing, scratch = bare(timing), bare(scratch)
    group = group_of(members, rods, model, record, 0)
    advance_group(bare, 1, members, timing, scratch, 0, group)


@kernel
def advance_many(
    members: FloatArray, rods: FloatArray, model: Model, record: Turns, timing: FloatArray,
    scratch: FloatArray,
) -> None:  # fmt: skip
    """Advance the active members of some groups under their torques; arrays as in `layout`.

    The time dt is cut into equal substeps. Where a rod would turn by more than 1 / PER_ROTATION in
    a substep, its member takes it in equal parts, MAX_PARTS at most. A step may be taken in several
    calls, one after the other, of one group and with the same scratch: the bits are the same.
    """
    members, rods, model, record = bare(members), bare(rods), bare(model), bare(record)
    timing, scratch = bare(timing), bare(scratch)
    for g in range(int(timing[Timing.FIRST_GROUP]), int(timing[Timing.LAST_GROUP])):
        group = group_of(packs(members), packs(rods), packs(model), packs(record), g)
        advance_group(packs, WIDTH, members, timing, scratch, g, group)
