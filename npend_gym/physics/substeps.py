"""How many Runge-Kutta steps a motion needs, from the rates of its chain."""

from __future__ import annotations

import math

import numpy as np

from npend_gym.chain import STANDARD_GRAVITY, Chain, ChainParameters
from npend_gym.theory.modes import decay_rate, fastest_frequency

MAX_SUBSTEPS = 100_000
# By default a substep is so short that the fastest normal mode turns by no more than this [rad],
# and that what damping and drag brake decays by no more than this. Turning points of a release
# then come out within 1e-6 s of the adaptive method's for the paper's chains up to N = 20.
MAX_PHASE = 1.0 / 16.0
# Dry friction is as steep as a damper only while a joint is nearly at rest, where all else is slow:
# substeps in which it would decay by 1/e follow RealAIGym's C.1 within some 1e-4 rad over 5 s.
_FRICTION = MAX_PHASE
# A torque between two links turns them fastest where the chain is straight; folded chains of three
# or more links had rates up to four times as large.
_FOLDED = 4.0
# A chain that is whirled round turns faster than it swings. Substeps in which no rod turns by more
# than this keep the energy of chains under random torques to some 1e-4 in an episode.
MAX_ROTATION = 1.0 / 20.0  # rad


def default_substeps(chain: Chain, dt: float) -> int:
    """Return the number of Runge-Kutta steps that resolve `dt` seconds of a chain's motion.

    In each the fastest normal mode turns by at most 1/16 rad, and what damping and drag brake
    decays by at most that much; dry friction, at its steepest, by at most 1.
    """
    return max(1, min(MAX_SUBSTEPS, math.ceil(dt * _fastest_rate(chain) / MAX_PHASE)))


def substeps_of(chains: ChainParameters, dt: float) -> int:
    """Return the `default_substeps` that the fastest of several chains needs."""
    rows = np.hstack([row.reshape(len(row), -1) for row in chains])
    different = np.unique(rows, axis=0, return_index=True)[1].tolist()
    return max(default_substeps(chain_of(chains, k), dt) for k in different)


def chain_of(chains: ChainParameters, member: int) -> Chain:
    """Return one of several chains."""
    values = {name: row[member] for name, row in chains._asdict().items()}
    return Chain.from_dict(values | {"gravity": float(values["gravity"])})


def _fastest_rate(chain: Chain) -> float:
    """Return the rate [1/s] that the substeps must resolve: of the fastest mode, or of braking."""
    gravity = chain.gravity or STANDARD_GRAVITY
    swinging = chain if chain.gravity else Chain.from_dict(chain.as_dict() | {"gravity": gravity})
    rubbing = _FRICTION * (chain.friction / chain.friction_speed)
    # drag slows no motion faster than the most slowed bob would be alone; that of the square at the
    # speed of a pendulum as long as the chain that has fallen from upright, its slope 2 |v|
    fallen = 2.0 * math.sqrt(gravity * chain.total_length)
    drag = chain.drag + 2.0 * fallen * chain.quadratic_drag
    if not chain.has_bobs:
        damping = chain.damping + (_FOLDED if chain.n > 2 else 1.0) * rubbing
        return max(fastest_frequency(swinging), decay_rate(chain, damping, drag))
    v = np.concatenate([[0.0], 1.0 / chain.masses])
    at_joint = np.append(chain.damping + rubbing, 0.0)
    # a bound by Gershgorin's circles on the inverse mass matrix times the damping matrix
    braking = 4.0 * (v[:-1] + v[1:]) * (at_joint[:-1] + at_joint[1:]) / chain.lengths**2
    slowing = drag / chain.masses
    return max(fastest_frequency(swinging), float(braking.max()) + float(slowing.max()))
