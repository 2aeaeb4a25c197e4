"""The energy of links and machines, and the power that their joints take."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from npend_gym._checks import FloatArray
from npend_gym.compiled.jit import inlined_kernel
from npend_gym.physics.kernels.laws import friction_torque
from npend_gym.physics.kernels.link_terms import Base, Link, Rotor
from npend_gym.physics.kernels.tensions import any_damped, one_minus_cos


@inlined_kernel
def link_power(u: FloatArray, chain: Any) -> Any:
    """Return the power that damping and friction of joints and rail take [W]."""
    n, rubbing = chain.length.size, chain.friction.shape[0] > 0
    total = 0.0 * u[0]
    for i in range(n):
        relative = u[i] - u[i - 1] if i > 0 else u[i]
        torque = chain.damping[i] * relative
        if rubbing:
            torque = torque + friction_torque(chain.friction, i, relative)
        total = total + torque * relative
    if u.size > n:
        total = total + chain.base[Base.DAMPING, 0] * (u[n] * u[n])
    return total


@inlined_kernel
def link_damped(chain: Any) -> bool:
    """Return whether joints or rail may take power."""
    return any_damped(chain) or chain.friction.shape[0] > 0 or chain.base.shape[0] > 0


def energies_of(ideal: bool, machine: bool) -> Callable[..., Any]:
    """Return `energies` of point masses, links or machines: see `dynamics.energies`."""

    @inlined_kernel
    def energies(
        omega: FloatArray, carried: FloatArray, mass: FloatArray, velocity: FloatArray,
        chain: Any, s: FloatArray, c: FloatArray,
    ) -> Any:  # fmt: skip
        n = velocity.size
        kinetic = lift = tip = vertical = horizontal = momentum = total = 0.0 * omega[0]
        for i in range(n):
            turning, centre, spread = omega[i], chain.length[i], 0.0 * omega[i]
            if not ideal:
                centre = chain.terms[Link.CENTRE, i]
                spread = chain.terms[Link.INERTIA, i] * (turning * turning)
            across = horizontal + centre * (turning * c[i])
            up = vertical + centre * (turning * s[i])
            moving = mass[i] * (across * across + up * up)
            kinetic = kinetic + 0.5 * (moving + spread)
            momentum, total = momentum + mass[i] * across, total + mass[i]
            vertical = vertical + chain.length[i] * (turning * s[i])
            horizontal = velocity[i]
            lift = lift + carried[i] * one_minus_cos(s[i], c[i])
            tip = tip - chain.length[i] * c[i]
        if machine:
            above = 0.0 * omega[0]
            for i in range(n if chain.rotors.shape[0] > 0 else 0):
                rotor = chain.rotors[Rotor.RATIO, i] * above + omega[i]
                kinetic = kinetic + 0.5 * (chain.rotors[Rotor.ARMATURE, i] * (rotor * rotor))
                above = omega[i]
        if not ideal and chain.base.size > 0:
            # all links move with the cart: m v_cart^2 / 2 + v_cart . momentum; the cart's own
            cart, speed = 1.0 / chain.base[Base.INVERSE_MASS, 0], omega[n]
            kinetic = kinetic + (momentum + 0.5 * ((total + cart) * speed)) * speed
        return kinetic, lift, tip

    return energies
