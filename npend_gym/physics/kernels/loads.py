"""What acts on the links of a mechanism: torques of joints, drag, the force on a cart."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import bare
from npend_gym.compiled.jit import inlined_kernel, outlined_kernel
from npend_gym.physics.kernels.laws import drag_factor, friction_torque
from npend_gym.physics.kernels.link_terms import Base


@inlined_kernel
def tip_drag(
    u: FloatArray, axial: int, lengths: FloatArray, chain: Any, s: FloatArray, c: FloatArray,
    along: FloatArray, across: FloatArray,
) -> Any:  # fmt: skip
    """Write the forces that overcome the drag of each tip, in its link's axes; return the power.

    `axial` is where the rates of springs begin, or the number of coordinates.
    """
    n = chain.length.size
    a: Any = 0.0 * u[0]  # velocity of the joint above, along e and n
    power = b = a
    if axial > n:
        b = u[n]
    if axial > n + 1:
        a = -u[n + 1]  # the axes of the base have e downwards
    for i in range(n):
        a, b = c[i] * a + s[i] * b, (c[i] * b - s[i] * a) + lengths[i] * u[i]
        if axial < u.size:
            a = a + u[axial + i]
        square = a * a + b * b
        drag = drag_factor(chain, i, square)
        along[i] = drag * a
        across[i] = drag * b
        power = power + drag * square
    return power


def _torques_of(rubbing: bool) -> Callable[..., None]:
    """Return `torques` with dry friction or without: one text, compiled for each.

    Numba drops what stands under `if rubbing` where that is False, here and below. Views of what is
    bare cost nothing; of other arrays it would count references, some tens of ns.
    """

    @inlined_kernel
    def torques(u: FloatArray, torque: FloatArray, chain: Any, net: FloatArray) -> None:
        """Write the torque on each link: that of its joint less that of the joint below."""
        damping, friction = bare(chain.damping), bare(chain.friction)
        for i in range(net.size):
            relative = u[i] - u[i - 1] if i > 0 else u[i]
            tau = torque[i] - damping[i] * relative
            if rubbing:
                tau = tau - friction_torque(friction, i, relative)
            net[i] = tau
            if i > 0:
                net[i - 1] = net[i - 1] - tau

    return torques


smooth_torques, rubbing_torques = _torques_of(rubbing=False), _torques_of(rubbing=True)


@outlined_kernel
def accelerate_cart(
    speed: Any, force: Any, gravity: FloatArray, base: FloatArray, en: Any, nn: Any, b_n: Any
) -> tuple[Any, Any]:
    """Return the acceleration of a base that moves, with gravity.

    Compiled in line, it would slow down chains that have no cart by a tenth.
    """
    x = -gravity[0] - base[Base.UP, 0]
    force = (force - base[Base.DAMPING, 0] * speed) - (en * x + b_n)
    inverse = base[Base.INVERSE_MASS, 0]
    return x, (base[Base.ACROSS, 0] + inverse * force) / (1.0 + inverse * nn)
