"""Where bobs and links are, how fast they go and what energy they have, for any leading axes."""

from __future__ import annotations

from typing import Any

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.chain import Chain, ChainParameters
from npend_gym.compiled.sincos import sincos_all


def positions(chain: Chain | ChainParameters, theta: FloatArray) -> FloatArray:
    """Return the positions of the bobs [m], shape (..., n, 2), for angles (..., n).

    For links they are the positions of the far ends: the joints and the tip.

    x_i = sum_{k<=i} l_k sin theta_k, y_i = -sum_{k<=i} l_k cos theta_k (the paper's section 2).

    Examples
    --------
    >>> import numpy as np
    >>> positions(Chain.uniform(2), np.zeros(2)).tolist()
    [[0.0, -1.0], [0.0, -2.0]]
    """
    s, c = sincos(theta)
    x = np.cumsum(chain.lengths * s, axis=-1)
    y = -np.cumsum(chain.lengths * c, axis=-1)
    return np.stack([x, y], axis=-1)


def bodies(chain: Chain | ChainParameters, theta: FloatArray) -> FloatArray:
    """Return the centres of mass [m] where links are bodies, (..., n, 2); else (..., 0, 2).

    Links are bodies where the mass of one is spread, or not at its end. Pictures show them as bars.
    """
    return centres(chain, theta) if has_bodies(chain) else np.empty((*theta.shape[:-1], 0, 2))


def has_bodies(chain: Chain | ChainParameters) -> bool:
    """Return whether links are bodies, see `bodies`."""
    return bool(np.any(chain.inertias) or np.any(chain.centres != chain.lengths))


def velocities(chain: Chain | ChainParameters, theta: FloatArray, omega: FloatArray) -> FloatArray:
    """Return the velocities of the bobs, or of the links' far ends [m/s], shape (..., n, 2)."""
    s, c = sincos(theta)
    l = chain.lengths
    return np.cumsum(np.stack([l * c * omega, l * s * omega], axis=-1), axis=-2)


def centres(chain: Chain | ChainParameters, theta: FloatArray) -> FloatArray:
    """Return the positions of the links' centres of mass [m], shape (..., n, 2)."""
    s, c = sincos(theta)
    back = chain.centres - chain.lengths  # from the end of the link
    return positions(chain, theta) + np.stack([back * s, -back * c], axis=-1)


def centre_of_mass(chain: Chain | ChainParameters, theta: FloatArray) -> FloatArray:
    """Return the position of the chain's centre of mass [m], shape (..., 2)."""
    weights = chain.masses[..., None]
    return (weights * centres(chain, theta)).sum(axis=-2) / weights.sum(axis=-2)


def kinetic_energy(
    chain: Chain | ChainParameters, theta: FloatArray, omega: FloatArray
) -> FloatArray:
    """Return sum_i (m_i v_i^2 + I_i omega_i^2 + rotor_i) / 2 [J], shape (...).

    v_i is the velocity of a centre of mass, and `Chain.gear` defines rotor_i. The paper's T leaves
    the masses out.

    Examples
    --------
    >>> import numpy as np
    >>> float(kinetic_energy(Chain.uniform(1), np.zeros(1), np.full(1, 2.0)))
    2.0
    """
    return kinetic_from(chain, *sincos(theta), omega, bobs=bool(np.all(chain.has_bobs)))


def kinetic_from(chain: Chain | ChainParameters, s: Any, c: Any, omega: Any, *, bobs: bool) -> Any:
    """Return the kinetic energy [J], as `kinetic_energy`, from sines and cosines of the angles.

    All may be arrays or tensors: whatever has the arithmetic and the methods of both. `bobs` says
    whether all is point masses on massless rods.
    """
    horizontal = (chain.lengths * c * omega).cumsum(-1)
    vertical = (chain.lengths * s * omega).cumsum(-1)
    if not bobs:
        back = chain.centres - chain.lengths
        horizontal, vertical = horizontal + back * omega * c, vertical + back * omega * s
    return _kinetic(chain, horizontal, vertical, omega, bobs=bobs)


def _kinetic(chain: Any, horizontal: Any, vertical: Any, omega: Any, *, bobs: bool) -> Any:
    """Return the kinetic energy [J] from the velocities of the centres, arrays or tensors."""
    energy = 0.5 * (chain.masses * (horizontal**2 + vertical**2)).sum(-1)
    if bobs:
        return energy
    turning = (chain.inertias * omega**2).sum(-1) + _rotors(chain, omega).sum(-1)
    return energy + 0.5 * turning


def _rotors(chain: Any, omega: Any) -> Any:
    """Return twice the kinetic energy of each rotor [J], arrays or tensors (..., n)."""
    above = 0.0 * omega
    above[..., 1:] = omega[..., :-1]
    return chain.armature * ((1.0 / chain.gear - 1.0) * above + omega) ** 2


def potential_energy(chain: Chain | ChainParameters, theta: FloatArray) -> FloatArray:
    """Return g sum_i h_i (1 - cos theta_i) [J], h being `Chain.lift`, shape (...).

    It is zero where all links hang straight down. Written with 1 - cos theta = 2 sin^2(theta/2),
    exact for small angles too.

    Examples
    --------
    >>> import numpy as np
    >>> float(potential_energy(Chain.uniform(1, gravity=10.0), np.full(1, np.pi)))
    20.0
    """
    return chain.gravity * lift_from(chain.lift, sincos(0.5 * theta)[0])


def lift_from(lift: Any, half_sines: Any) -> Any:
    """Return the potential energy over gravity [kg m], from the sines of half the angles.

    `lift` is that of `Chain`; all may be arrays or tensors.
    """
    return (lift * (2.0 * half_sines**2)).sum(-1)


def total_energy(
    chain: Chain | ChainParameters, theta: FloatArray, omega: FloatArray
) -> FloatArray:
    """Kinetic and potential energy above rest [J], shape (...).

    Parameters
    ----------
    chain : Chain
        With a pivot at rest and rigid rods; for other chains use `Trajectory.energy`.
    theta, omega : ndarray, shape (..., n)
        Angles [rad] and angular velocities [rad/s].

    Examples
    --------
    >>> import numpy as np
    >>> from npend_gym import Chain
    >>> from npend_gym.physics import total_energy
    >>> float(total_energy(Chain.uniform(1, gravity=10.0), np.array([np.pi]), np.array([2.0])))
    22.0
    """
    return kinetic_energy(chain, theta, omega) + potential_energy(chain, theta)


def energy_of_links(
    chain: Chain | ChainParameters, theta: FloatArray, omega: FloatArray
) -> FloatArray:
    """Return the energy of each link with its rotor [J], (..., n); their sum is `total_energy`."""
    moving = chain.masses * (centre_velocities(chain, theta, omega) ** 2).sum(axis=-1)
    turning = chain.inertias * omega**2 + _rotors(chain, omega)
    risen = 2.0 * chain.lengths * sincos(0.5 * theta)[0] ** 2  # 1 - cos theta, for small angles too
    back = chain.centres - chain.lengths
    height = np.cumsum(risen, axis=-1) + back / chain.lengths * risen
    return 0.5 * (moving + turning) + chain.masses * chain.gravity * height


def sincos(theta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return sine and cosine, of the shape of `theta`; NumPy's differ between machines."""
    angles = np.array(theta, np.float64, order="C")
    s, c = np.empty_like(angles), np.empty_like(angles)
    sincos_all(angles.reshape(-1), s.reshape(-1), c.reshape(-1))
    return s, c


def centre_velocities(
    chain: Chain | ChainParameters, theta: FloatArray, omega: FloatArray
) -> FloatArray:
    """Return the velocities of the links' centres of mass [m/s], shape (..., n, 2)."""
    s, c = sincos(theta)
    back = (chain.centres - chain.lengths) * omega  # from the end of the link
    return velocities(chain, theta, omega) + np.stack([back * c, back * s], axis=-1)


def stretched(chain: Chain, stretch: FloatArray) -> ChainParameters:
    """Return the chain as rigid rods of the lengths that its springs have, for states (..., n)."""
    return _with_lengths(chain, chain.lengths + stretch, chain.centres + stretch)


def _with_lengths(chain: Chain, lengths: FloatArray, centres: FloatArray) -> ChainParameters:
    fields = {
        name: np.broadcast_to(row[0], lengths.shape)
        for name, row in chain.repeated(1)._asdict().items()
        if name != "gravity"
    }
    gravity = np.broadcast_to(chain.gravity, lengths.shape[:-1])
    return ChainParameters(**fields | {"lengths": lengths, "centres": centres, "gravity": gravity})


def potential_of_springs(chain: Chain, theta: FloatArray, stretch: FloatArray) -> FloatArray:
    """Return the energy of gravity and springs above hanging at rest [J], shape (...).

    With x the stretch and x_0 = g sum_{k>=i} m_k / k_i that at rest, the terms that are linear
    in x cancel: sum_i k_i (x_i - x_0i)^2 / 2 is left beside the energy of rods of these lengths.
    """
    stiffness = np.asarray(chain.stiffness)
    at_rest = chain.gravity * chain.carried_masses / stiffness
    in_springs = 0.5 * np.sum(stiffness * (stretch - at_rest) ** 2, axis=-1)
    return potential_energy(stretched(chain, stretch), theta) + in_springs


def velocities_of_motion(
    chain: Chain,
    theta: FloatArray,
    omega: FloatArray,
    stretch: FloatArray | None = None,
    rate: FloatArray | None = None,
    *,
    centres: bool = False,
) -> FloatArray:
    """Return the velocities of bobs or `centres`, of springs too, relative to the pivot [m/s]."""
    moving = centre_velocities if centres else velocities
    if stretch is None or rate is None:
        return moving(chain, theta, omega)
    # by stretching alone sum_k x_k' e_k, as positions are sums of the lengths along the rods
    along = positions(_with_lengths(chain, rate, rate), theta)
    return moving(stretched(chain, stretch), theta, omega) + along


def kinetic_of_motion(
    chain: Chain,
    theta: FloatArray,
    omega: FloatArray,
    velocity: FloatArray | None,
    stretch: FloatArray | None,
    rate: FloatArray | None,
) -> FloatArray:
    """Return the kinetic energy [J], with that of springs and of a cart of this velocity."""
    centres = velocities_of_motion(chain, theta, omega, stretch, rate, centres=True)
    energy = _kinetic(chain, centres[..., 0], centres[..., 1], omega, bobs=chain.has_bobs)
    if chain.base is None or velocity is None:
        return energy
    momentum = np.sum(chain.masses * centres[..., 0], axis=-1)
    return kinetic_on_cart(energy, momentum, chain.base.mass + chain.masses.sum(), velocity)


def kinetic_on_cart(energy: Any, momentum: Any, mass: Any, velocity: Any) -> Any:
    """Return the kinetic energy [J] of a cart and its chain, arrays or tensors.

    Energy [J] and momentum [kg m/s] are those of the chain, relative to the cart; the mass [kg] is
    that of both together, the velocity [m/s] that of the cart.
    """
    return energy + (momentum + 0.5 * mass * velocity) * velocity
