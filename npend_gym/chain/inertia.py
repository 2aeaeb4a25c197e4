"""The inertia of chains as matrices: M = W cos(theta_i - theta_j) + C, entry by entry."""

from __future__ import annotations

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.chain.model import Chain


def link_inertia(chain: Chain) -> FloatArray:
    """Return W [kg m^2], shape (n, n), the mass matrix of the straight chain without rotors.

    W_ij = l_i h_j where link j is below link i, with h the chain's `lift`, and W_ii = I_i + m_i
    c_i^2 + l_i^2 sum_{k>i} m_k; l_i l_j sum_{k >= max(i, j)} m_k for point masses.
    """
    l, c = chain.lengths, chain.centres
    at_the_end = c == l
    carried = np.where(at_the_end, chain.carried_masses, chain.lift / l)
    lower = np.maximum.outer(np.arange(chain.n), np.arange(chain.n))
    return np.outer(l, l) * carried[lower] + np.diag(chain.inertias + chain.masses * c * (c - l))


def rotor_inertia(chain: Chain) -> FloatArray:
    """Return C [kg m^2], shape (n, n), the mass matrix of the rotors: no angle changes it.

    Rotor j has the energy armature_j ((1/gear_j - 1) omega_{j-1} + omega_j)^2 / 2.
    """
    turns = np.eye(chain.n) + np.diag((1.0 / chain.gear - 1.0)[1:], k=-1)  # of rotor j, by link i
    return turns.T @ (chain.armature[:, None] * turns)
