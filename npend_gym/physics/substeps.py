"""How many Runge-Kutta steps a motion needs, from the rates of its chain."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from npend_gym._checks import BoolArray, FloatArray
from npend_gym.chain import STANDARD_GRAVITY, Chain, ChainParameters, check_chain
from npend_gym.physics.mechanism import in_frame_of_pivot, mechanism_of
from npend_gym.theory.modes import any_faster, decay_rate, fastest_frequency

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
# A function of the user's is known only where a step calls it. So the fastest normal mode turns by
# no more than this in a step with one [rad]. Steps of motions that are not at rest are shorter.
LONGEST_PHASE = 0.5
# Nor is a step longer than this many intervals between two times. The instants at which a step
# calls a function are at most GAP of it apart, or it is shorter: no pulse of one interval is lost.
_INTERVALS, GAP = 3.0, 0.27
# How much closer to a limit a rate may be computed to lie than it does, of itself
_ROUNDING = 1e-6
# A chain that is whirled round turns faster than it swings. Substeps in which no rod turns by more
# than this keep the energy of chains under random torques to some 1e-4 in an episode.
MAX_ROTATION = 1.0 / 20.0  # rad


def longest_step(chain: Chain, times: FloatArray) -> float:
    """Return the length [s] that no step of a motion has with a function as a drive or an event.

    It bounds what may be missed between two calls of the function, while the chain is at rest and
    the tolerance allows any step. In it the fastest mode turns by half a radian at most. It is that
    of three intervals between `times` at most, counted as if all were equal.
    """
    intervals = max(1, times.size - 1)
    spacing = float(times[-1] - times[0]) / intervals or math.inf  # of one instant there is none
    return min(_INTERVALS * spacing, LONGEST_PHASE / swinging_rate(chain))


@lru_cache(maxsize=256)
def swinging_rate(chain: Chain) -> float:
    """Return the angular frequency [rad/s] of the fastest mode of rigid rods; 1 without gravity.

    On a cart it is a bound.
    """
    return (fastest_frequency(chain.hung()) or 1.0) * math.sqrt(lighter(chain))


def fastest_rate(chain: Chain) -> float:
    """Return the angular frequency [rad/s] of the fastest normal mode; 1 rad/s without gravity.

    On a cart and with springs it is a bound of it.
    """
    return max(mechanism_of([check_chain(chain)]).axial_rates()[0], swinging_rate(chain))


def fastest_decay(chain: Chain) -> float:
    """Return a bound of the rate [1/s] at which dampers, drag and dry friction act, or 0."""
    rate = mechanism_of([chain]).axial_rates()[1]
    damping = chain.damping + chain.friction / chain.friction_speed  # where friction is steepest
    if np.any(damping) or np.any(chain.drag):
        rate = max(rate, lighter(chain) * decay_rate(chain.hung(), damping, chain.drag))
    if chain.base is not None:
        rate = max(rate, lighter(chain) * chain.base.damping / chain.base.mass)
    return rate


def rate_at_rest(chain: Chain, acceleration: ArrayLike | None) -> float:
    """Return a bound of the rate [1/s] at which small changes of a chain at rest turn or decay.

    Its pivot may have a constant `acceleration` [m/s^2]. The rate is 0 where nothing pulls: rods
    then go on as they go, exactly in any step.
    """
    felt = in_frame_of_pivot(chain, acceleration)
    pulled = felt.gravity > 0.0 or chain.stiffness is not None
    return max(fastest_rate(felt) if pulled else 0.0, fastest_decay(chain))


def lighter(chain: Chain) -> float:
    """Return by how much less inertia a chain may have on its cart than on a pivot at rest.

    A chain of mass m on a cart of mass M has at least M / (M + m) of it.
    """
    return 1.0 if chain.base is None else 1.0 + float(chain.masses.sum()) / chain.base.mass


def default_substeps(chain: Chain, dt: float) -> int:
    """Return the number of Runge-Kutta steps that resolve `dt` seconds of a chain's motion.

    In each the fastest normal mode turns by at most 1/16 rad, and what damping and drag brake
    decays by at most that much; dry friction, at its steepest, by at most 1. There may be more than
    MAX_SUBSTEPS, which `check_default` refuses.
    """
    return max(1, math.ceil(dt * _fastest_rate(chain) / MAX_PHASE))


def check_default(substeps: int, dt: float) -> int:
    """Return a default number of substeps; raise an error if one step would take too many."""
    if substeps > MAX_SUBSTEPS:
        raise ValueError(
            f"dt must be so short that {MAX_SUBSTEPS} substeps resolve the fastest motion of each "
            f"chain, got {dt:g} s, which takes {substeps:.3g} or more: shorten dt, or give substeps"
        )
    return substeps


def substeps_on_cart(
    substeps: int, chains: Chain | ChainParameters, dt: float, inverse_mass: ArrayLike,
    damping: ArrayLike,
) -> int:  # fmt: skip
    """Return how many substeps resolve `dt` on carts, where a pivot at rest needs `substeps`.

    A chain of mass m on a cart of mass M has at least M / (M + m) of the inertia that it has at a
    pivot. So it swings faster by no more than the root of the inverse, and brakes faster by no more
    than the inverse.
    """
    lighter = 1.0 + chains.masses.sum(axis=-1) * np.asarray(inverse_mass)
    brakes = np.any(chains.damping) or np.any(chains.friction) or chains.has_drag
    of_chain = substeps * (lighter if brakes else np.sqrt(lighter))
    of_rail = dt / MAX_PHASE * lighter * np.asarray(inverse_mass) * damping
    return math.ceil(np.maximum(of_chain, of_rail).max())


def substeps_of(chains: ChainParameters, dt: float) -> int:
    """Return the `default_substeps` that the fastest of several chains needs.

    Only chains that may need more than all before are computed one by one: few, because one
    compiled call finds them and those with fast single pendulums come first.

    Raises
    ------
    ValueError
        If it is more than MAX_SUBSTEPS.
    """
    swings = _gravity(chains)[:, None] * chains.carried_masses / (chains.masses * chains.lengths)
    most, left = 0, np.argsort(-swings.max(axis=1), kind="stable")
    while left.size > 0 and most < MAX_SUBSTEPS:
        needed = default_substeps(chain_of(chains, int(left[0])), dt)
        if needed <= most:  # what is left differs from the limit by no more than rounding
            most = _largest(_taken(chains, left), dt, most)
            break
        most, left = needed, left[1:]
        left = left[_may_exceed(_taken(chains, left), most * MAX_PHASE / dt)]
    return check_default(most, dt)


def _largest(chains: ChainParameters, dt: float, least: int) -> int:
    """Return the largest `default_substeps` of all different chains, or `least`."""
    rows = np.hstack([row.reshape(len(row), -1) for row in chains])
    different = np.unique(rows, axis=0, return_index=True)[1].tolist()
    return max(least, *(default_substeps(chain_of(chains, k), dt) for k in different))


def _taken(chains: ChainParameters, members: NDArray[np.int64]) -> ChainParameters:
    return ChainParameters(*(row[members] for row in chains))


def chain_of(chains: ChainParameters, member: int) -> Chain:
    """Return one of several chains."""
    values = {name: row[member] for name, row in chains._asdict().items()}
    return Chain.from_dict(values | {"gravity": float(values["gravity"])})


def _may_exceed(chains: ChainParameters, rate: float) -> BoolArray:
    """Return which chains have a `_fastest_rate` above `rate`, or below it by rounding alone."""
    limit = rate * (1.0 - _ROUNDING)
    damping, drag = _resistance(chains)
    braked = chains.has_bobs & (_braking(chains, damping, drag) > limit)
    return braked | any_faster(chains._replace(gravity=_gravity(chains)), limit, damping, drag)


def _fastest_rate(chain: Chain) -> float:
    """Return the rate [1/s] that the substeps must resolve: of the fastest mode, or of braking."""
    swinging = chain = chain.hung() if chain.base is not None else chain
    if not chain.gravity:
        swinging = Chain.from_dict(chain.as_dict() | {"gravity": STANDARD_GRAVITY})
    damping, drag = _resistance(chain)
    if not chain.has_bobs:
        return max(fastest_frequency(swinging), decay_rate(chain, damping, drag))
    return max(fastest_frequency(swinging), float(_braking(chain, damping, drag)))


def _gravity(chains: Chain | ChainParameters) -> FloatArray:
    """Return gravity, that on Earth where there is none, shape () or (B,)."""
    gravity = np.asarray(chains.gravity)
    return np.where(gravity > 0.0, gravity, STANDARD_GRAVITY)


def _resistance(chains: Chain | ChainParameters) -> tuple[FloatArray, FloatArray]:
    """Return dampers and drag that brake as fast as all that resists, shape (..., n) each."""
    rubbing = _FRICTION * (chains.friction / chains.friction_speed)
    straight = np.logical_or(chains.has_bobs, chains.masses.shape[-1] <= 2)
    folded = np.where(straight, 1.0, _FOLDED)[..., None]
    # drag slows no motion faster than the most slowed bob would be alone; that of the square at the
    # speed of a pendulum as long as the chain that has fallen from upright, its slope 2 |v|
    fallen = 2.0 * np.sqrt(_gravity(chains) * chains.lengths.sum(axis=-1))[..., None]
    return chains.damping + folded * rubbing, chains.drag + 2.0 * fallen * chains.quadratic_drag


def _braking(chains: Chain | ChainParameters, damping: FloatArray, drag: FloatArray) -> FloatArray:
    """Return a bound on the rate [1/s] at which point masses are braked, shape () or (B,)."""
    none = np.zeros_like(chains.masses[..., :1])
    v = np.concatenate([none, 1.0 / chains.masses], axis=-1)
    at_joint = np.concatenate([damping, none], axis=-1)
    # a bound by Gershgorin's circles on the inverse mass matrix times the damping matrix
    joints = at_joint[..., :-1] + at_joint[..., 1:]
    braking = 4.0 * (v[..., :-1] + v[..., 1:]) * joints / chains.lengths**2
    return braking.max(axis=-1) + (drag / chains.masses).max(axis=-1)
