"""Chains on a GPU, one a thread: each takes the step of its chain, as `steps` does of a group.

A thread has the arrays of an ensemble of one chain. They stand in its own memory, in registers as
far as these reach. This needs a small number of rods that is known when the kernel is compiled; for
long chains they stand in `storage`, the thread innermost, so that threads side by side read and
write side by side.
"""

# ruff: noqa: ARG001  what stands for another function has its parameters
from __future__ import annotations

from collections.abc import Callable
from typing import Any

from npend_gym._checks import FloatArray
from npend_gym.chain import ChainParameters
from npend_gym.compiled.jit import inlined_kernel
from npend_gym.compiled.sincos import MAX_ANGLE, sincos
from npend_gym.compiled.translation import CUDA, FLOAT
from npend_gym.physics.kernels.dynamics import copy
from npend_gym.physics.kernels.laws import Friction
from npend_gym.physics.kernels.layout import MAX_SPEED, Member, Model, Rod, Timing, group_of
from npend_gym.physics.kernels.link_terms import Base, Link, Rotor
from npend_gym.physics.kernels.member_rows import write_chain
from npend_gym.physics.kernels.rk4 import RK4_ROWS
from npend_gym.physics.kernels.rk4_derivatives import adjoint_of_group, adjoint_rows, step_of_group

_PARAMETERS = len(ChainParameters._fields)


@inlined_kernel
def _clear(array: FloatArray) -> None:
    for i in range(array.shape[0]):
        for j in range(array.shape[1]):
            array[i, j] = 0.0


@inlined_kernel
def _advance(
    theta: FloatArray, omega: FloatArray, torque: FloatArray, chain: FloatArray,
    members: FloatArray, rods: FloatArray, model: Model, timing: FloatArray, scratch: FloatArray,
) -> bool:  # fmt: skip
    """Advance one chain under its torques; return whether it leaves all bounds, and stays."""
    n, rows, lost = chain.shape[1], rods[0], False  # known when this is compiled
    for i in range(n):
        rows[Rod.THETA, i], rows[Rod.OMEGA, i], rows[Rod.TORQUE, i] = theta[i], omega[i], torque[i]
    write_chain(members, rods, model, 0, 1, chain)
    group = group_of(members, rods, model, None, 0)
    step_of_group(group, timing, scratch)
    for i in range(n):
        angle, speed = rows[Rod.THETA, i], rows[Rod.OMEGA, i]
        lost = lost or not (abs(angle) <= MAX_ANGLE and abs(speed) <= MAX_SPEED)
    if not lost:
        copy(rows[Rod.THETA][:n], theta)
        copy(rows[Rod.OMEGA][:n], omega)
    return lost


def short_chains(n: int) -> Callable[..., None]:
    """Kernel of a thread that has a chain of `n` rods in its own memory.

    Its arguments are theta, omega and torque, shape (lanes, n); diverged, (lanes,), of zeros and
    ones; the parameters of the chains, (lanes, 12, n) or (1, 12, n); then dt, the substeps, and
    one over the angle by which no rod may turn in a substep, or zero.
    """
    of_member, of_rods, of_scratch = (len(Member), 1), (1, len(Rod), n + 1), (RK4_ROWS, n + 2)
    of_chain, of_timing = (_PARAMETERS, n), len(Timing)
    of_links, of_friction, of_rotors = (1, len(Link), n), (1, len(Friction), n), (1, len(Rotor), n)
    of_base = (1, len(Base), 1)

    def advance_threads(
        theta: Any, omega: Any, torque: Any, diverged: Any, chains: Any, dt: Any, substeps: Any,
        per_rotation: Any,
    ) -> None:  # fmt: skip
        lane = CUDA.grid(1)
        if lane < theta.shape[0] and diverged[lane] == 0.0:
            members, timing = CUDA.local.array(of_member, FLOAT), CUDA.local.array(of_timing, FLOAT)
            rods, scratch = CUDA.local.array(of_rods, FLOAT), CUDA.local.array(of_scratch, FLOAT)
            links, rotors = CUDA.local.array(of_links, FLOAT), CUDA.local.array(of_rotors, FLOAT)
            base, chain = CUDA.local.array(of_base, FLOAT), CUDA.local.array(of_chain, FLOAT)
            friction = CUDA.local.array(of_friction, FLOAT)
            given = chains[lane if chains.shape[0] > 1 else 0]
            for i in range(n):
                for field in range(_PARAMETERS):
                    chain[field, i] = given[field, i]
            _clear(members)
            _clear(rods[0])
            _clear(scratch)
            timing[Timing.DT], timing[Timing.SUBSTEPS] = dt, substeps
            timing[Timing.PER_ROTATION] = per_rotation
            model = (links, friction, base[:, :0], rotors)  # the base rests
            state = theta[lane], omega[lane], torque[lane]
            if _advance(*state, chain, members, rods, model, timing, scratch):
                diverged[lane] = 1.0

    return advance_threads


def long_chains() -> Callable[..., None]:
    """Return the same for chains of any length.

    Its other arguments are arrays in which the threads work, see `storage_shapes`, zeros at first.
    """
    of_timing = len(Timing)

    def advance_threads(
        theta: Any, omega: Any, torque: Any, diverged: Any, chains: Any, dt: Any, substeps: Any,
        per_rotation: Any, members: Any, rods: Any, links: Any, friction: Any, rotors: Any,
        scratch: Any,
    ) -> None:  # fmt: skip
        lane = CUDA.grid(1)
        if lane < theta.shape[0] and diverged[lane] == 0.0:
            own, timing = members[:, :, lane], CUDA.local.array(of_timing, FLOAT)
            _clear(own)
            timing[Timing.DT], timing[Timing.SUBSTEPS] = dt, substeps
            timing[Timing.PER_ROTATION] = per_rotation
            model = (
                links[:, :, :, lane], friction[:, :, :, lane], links[:, :0, :1, lane],
                rotors[:, :, :, lane],
            )  # fmt: skip
            state = theta[lane], omega[lane], torque[lane]
            chain = chains[lane if chains.shape[0] > 1 else 0]
            work = scratch[:, :, lane]
            if _advance(*state, chain, own, rods[:, :, :, lane], model, timing, work):
                diverged[lane] = 1.0

    return advance_threads


def sines() -> Callable[..., None]:
    """Kernel of a thread that writes sine and cosine of an entry of x (m,) into s and c."""

    def sine_threads(x: Any, s: Any, c: Any) -> None:
        i = CUDA.grid(1)
        if i < x.size:
            s[i], c[i] = sincos(x[i])

    return sine_threads


def clears() -> Callable[..., None]:
    """Kernel of a thread that clears its part of an array (rows, columns, lanes)."""

    def clear_threads(array: Any) -> None:
        lane = CUDA.grid(1)
        if lane < array.shape[2]:
            _clear(array[:, :, lane])

    return clear_threads


def storage_shapes(n: int, terms: int, lanes: int) -> list[tuple[int, ...]]:
    """Return the shapes of the last arguments of `long_chains`.

    `terms` is the number of arrays that this kind of chain needs, see `link_terms.count_terms`.
    """
    links, friction = len(Link) * (terms > 0), len(Friction) * (terms > 0)
    model = (1, links, n), (1, friction, n), (1, len(Rotor) * (terms > 3), n)
    each = (len(Member), 1), (1, len(Rod), n + 1), *model, (RK4_ROWS, n + 2)
    return [(*shape, lanes) for shape in each]


def adjoints() -> Callable[..., None]:
    """Kernel of a thread that takes derivatives back through a step of any chain.

    Its arguments are theta, omega and torque; the derivatives by theta and omega, which it takes
    from the end of the step to its beginning; the derivatives by the torques, which it adds:
    (lanes, n) each; those by the parameters, (lanes, 12, n), added too, or (lanes, 0, n); then all
    that `long_chains` has from `diverged` on, of the shapes of `adjoint_shapes`.
    """
    of_timing = len(Timing)

    def adjoint_threads(
        theta: Any, omega: Any, torque: Any, theta_bar: Any, omega_bar: Any, torque_bar: Any,
        chain_bar: Any, diverged: Any, chains: Any, dt: Any, substeps: Any, per_rotation: Any,
        members: Any, rods: Any, links: Any, friction: Any, rotors: Any, scratch: Any, bars: Any,
        kept: Any,
    ) -> None:  # fmt: skip
        lane = CUDA.grid(1)
        if lane < theta.shape[0] and diverged[lane] == 0.0:  # else the step leaves all as it is
            timing, n = CUDA.local.array(of_timing, FLOAT), theta.shape[1]
            timing[Timing.DT], timing[Timing.SUBSTEPS] = dt, substeps
            timing[Timing.PER_ROTATION] = per_rotation
            model = (
                links[:, :, :, lane], friction[:, :, :, lane], links[:, :0, :1, lane],
                rotors[:, :, :, lane],
            )  # fmt: skip
            chain = chains[lane if chains.shape[0] > 1 else 0]
            own, rows, work = members[:, :, lane], rods[:, :, :, lane], scratch[:, :, lane]
            back, reached = bars[:3, :, lane], bars[3:, :, lane]
            _clear(own)
            for i in range(n):
                rows[0, Rod.THETA, i], rows[0, Rod.OMEGA, i] = theta[lane, i], omega[lane, i]
                rows[0, Rod.TORQUE, i], back[2, i] = torque[lane, i], torque_bar[lane, i]
                back[0, i], back[1, i] = theta_bar[lane, i], omega_bar[lane, i]
            write_chain(own, rows, model, 0, 1, chain)
            group = group_of(own, rows, model, None, 0)
            adjoint_of_group(group, timing, back, chain_bar[lane], reached, 1, kept[:, lane], work)
            for i in range(n):
                theta_bar[lane, i], omega_bar[lane, i] = back[0, i], back[1, i]
                torque_bar[lane, i] = back[2, i]
                if not (abs(reached[0, i]) <= MAX_ANGLE and abs(reached[1, i]) <= MAX_SPEED):
                    diverged[lane] = 1.0

    return adjoint_threads


def adjoint_shapes(n: int, terms: int, lanes: int, substeps: int) -> list[tuple[int, ...]]:
    """Return the shapes of the last arguments of `adjoints`, zeros at first."""
    rows, more = (adjoint_rows(substeps, 1), n + 2), ((5, n), (substeps,))
    return [*storage_shapes(n, terms, lanes)[:-1], *((*shape, lanes) for shape in (rows, *more))]


@inlined_kernel
def always_drag(drag: FloatArray, quadratic_drag: FloatArray) -> bool:
    """Stand for `layout.resists` where the air resists any bob of any chain."""
    return True


@inlined_kernel
def never_drag(drag: FloatArray, quadratic_drag: FloatArray) -> bool:
    """Stand for `layout.resists` where the air resists no bob."""
    return False


@inlined_kernel
def always(row: FloatArray) -> bool:
    """Stand for `layout.rubs` or `layout.turns`: the chains may have what they look for."""
    return True
