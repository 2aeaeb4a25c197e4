"""Where the bobs are, how fast they go and what energy they have, for any leading axes."""

from __future__ import annotations

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.chain import Chain, ChainParameters
from npend_gym.compiled.sincos import sincos_all


def positions(chain: Chain | ChainParameters, theta: FloatArray) -> FloatArray:
    """Return the positions of the bobs [m], shape (..., n, 2), for angles (..., n).

    x_i = sum_{k<=i} l_k sin theta_k, y_i = -sum_{k<=i} l_k cos theta_k (the paper's section 2).
    """
    s, c = _sincos(theta)
    x = np.cumsum(chain.lengths * s, axis=-1)
    y = -np.cumsum(chain.lengths * c, axis=-1)
    return np.stack([x, y], axis=-1)


def sideways(
    lengths: FloatArray, theta: FloatArray, omega: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the horizontal position [m] and velocity [m/s] of every bob, shape (..., n) each."""
    s, c = _sincos(theta)
    return np.cumsum(lengths * s, axis=-1), np.cumsum(lengths * (omega * c), axis=-1)


def velocities(chain: Chain | ChainParameters, theta: FloatArray, omega: FloatArray) -> FloatArray:
    """Return the velocities of the bobs [m/s], shape (..., n, 2)."""
    s, c = _sincos(theta)
    vx = np.cumsum(chain.lengths * c * omega, axis=-1)
    vy = np.cumsum(chain.lengths * s * omega, axis=-1)
    return np.stack([vx, vy], axis=-1)


def kinetic_energy(
    chain: Chain | ChainParameters, theta: FloatArray, omega: FloatArray
) -> FloatArray:
    """Return sum_i m_i |v_i|^2 / 2 [J], shape (...). The paper's T leaves the masses out."""
    speed_squared = np.sum(velocities(chain, theta, omega) ** 2, axis=-1)
    return 0.5 * np.sum(chain.masses * speed_squared, axis=-1)


def potential_energy(chain: Chain | ChainParameters, theta: FloatArray) -> FloatArray:
    """Return sum_i m_i g (y_i - y_i(rest)) [J], shape (...): zero where the chain hangs at rest.

    Written with 1 - cos theta = 2 sin^2(theta/2), exact for small angles too.
    """
    lift = 2.0 * _sincos(0.5 * theta)[0] ** 2
    return chain.gravity * np.sum(chain.carried_masses * chain.lengths * lift, axis=-1)


def energy(chain: Chain | ChainParameters, theta: FloatArray, omega: FloatArray) -> FloatArray:
    """Return the total energy above rest [J], shape (...)."""
    return kinetic_energy(chain, theta, omega) + potential_energy(chain, theta)


def _sincos(theta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return sine and cosine, of the shape of `theta`; NumPy's differ between machines."""
    angles = np.array(theta, np.float64, order="C")
    s, c = np.empty_like(angles), np.empty_like(angles)
    sincos_all(angles.reshape(-1), s.reshape(-1), c.reshape(-1))
    return s, c
