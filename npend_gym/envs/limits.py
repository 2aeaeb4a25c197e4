"""What settings of environments may be at most, and the substeps that their chains need."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from npend_gym import _checks
from npend_gym.chain import Chain, ChainParameters
from npend_gym.envs.modes import Mode
from npend_gym.envs.randomization import Randomization
from npend_gym.envs.settings import ERRORS_OF_MOTORS, FIELDS, HARDWARE, Limit
from npend_gym.physics.substeps import (
    MAX_ROTATION,
    MAX_SUBSTEPS,
    chain_of,
    default_substeps,
    substeps_on_cart,
)

_OF_TORQUES = ("torque_noise", "torque_ripple")  # which the force on a cart has not


def check_seconds(name: str, seconds: float, chain: Chain) -> None:
    """Raise a ValueError for a time in which motors miss a swing: it may be in milliseconds."""
    if seconds >= 1.0 and chain.gravity > 0.0:
        most = math.pi * math.sqrt(chain.total_length / chain.gravity)
        if seconds > most:
            raise ValueError(
                f"{name} must be at most {most:.3g} s, half the period of a pendulum of the "
                "chain's length, so that motors act twice in a swing; "
                f"got {seconds:g} s: {seconds:g} ms are {seconds / 1000.0:g} s"
            )


def check_limits(largest: Mapping[str, float], mode: Mode, dt: float, joints: int) -> None:
    """Raise a ValueError that names the first setting beyond its limit, for `joints` with a motor.

    `largest` has the settings, or the upper ends of their ranges where they are random.
    """
    often = Limit(1.0 / dt, "1/s, one a step; make dt smaller for more")
    for name in HARDWARE:
        limit = often if name == "push_rate" else FIELDS[name].metadata["limit"]
        if limit is not None and largest[name] > limit.value:
            raise ValueError(
                f"{name} must be at most {limit.value:g} {limit.why}; got {largest[name]:g}"
            )
    if (largest["push_rate"] > 0.0) != (largest["push_force"] > 0.0):
        raise ValueError(
            "push_rate and push_force must be given together, because a push needs both; got "
            f"push_rate={largest['push_rate']:g} and push_force={largest['push_force']:g}"
        )
    for name in ERRORS_OF_MOTORS:
        if mode.torque_share == 0.0 and largest[name] > 0.0:
            raise ValueError(
                f"{name} must be left out in mode {mode.name!r}, which has no motor; "
                f"got {largest[name]:g}"
            )
    for name in _OF_TORQUES:
        if joints == 0 and largest[name] > 0.0:
            raise ValueError(
                f"{name} must be left out where no joint has a motor; actuated=(0,) gives one to "
                f"the joint on the cart; got {largest[name]:g}"
            )


def substeps_of_step(
    given: int | None, dt: float, random: Randomization, cart: Mapping[str, Any]
) -> tuple[int, float]:
    """Return the least number of substeps, and the rotation that divides one [rad]."""
    if given is not None:
        return _checks.count("substeps", given, high=MAX_SUBSTEPS), math.inf
    most = 1
    for corner in random.corners:
        chain = chain_of(corner, 0)
        most = max(most, substeps_on_base(default_substeps(chain, dt), chain, dt, random, cart))
    return most, MAX_ROTATION


def substeps_on_base(
    substeps: int, chains: Chain | ChainParameters, dt: float, random: Randomization,
    cart: Mapping[str, Any],
) -> int:  # fmt: skip
    """Return how many substeps chains need on any cart drawn, if on one, or else `substeps`."""
    if cart["base"] != "cart":
        return substeps
    mass = random.ends("cart_mass", cart["cart_mass"])[0]
    damping = random.ends("rail_damping", cart["rail_damping"])[1]
    return substeps_on_cart(substeps, chains, dt, 1.0 / mass, damping)
