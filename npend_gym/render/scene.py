"""What a picture of a chain shows, checked."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from npend_gym import _checks
from npend_gym._checks import FloatArray


@dataclass(frozen=True, eq=False)
class Scene:
    """What one picture shows; (0, 0) is the pivot, or the middle of the rail; y points upwards."""

    positions: FloatArray  #: far ends of the rods, from the pivot to the tip, of shape (n, 2) [m]
    reach: float  #: length of the chain, or rail [m]; the disc of this radius is always in view
    time: float = 0.0  #: [s]
    energy: float = 0.0  #: above rest [J]
    pseudo_period: float = 0.0  #: [s]; zero: not measured yet
    completed: int = 0  #: number of bobs whose pseudo-period is complete
    torque: float = 0.0  #: at `joint` over its limit, in [-1, 1]; counter-clockwise is positive
    caption: str = ""  #: one line of text
    trace: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    """Earlier positions of the tip, oldest first, of shape (k, 2) [m]."""
    marks: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    """Places to be dotted, such as turning points, of shape (k, 2) [m]."""
    centres: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    """Centres of mass of links that are bodies, of shape (n, 2) [m]; none of point masses."""
    joint: int = 0  #: the joint with the motor; 0 is the pivot
    rail: float = 0.0  #: half the length of the rail of a cart [m]; zero: there is no cart
    cart: float = 0.0  #: where the cart, and so the pivot, is on it [m]
    force: float = 0.0  #: on the cart over its limit, in [-1, 1]; to the right is positive
    push: float = 0.0  #: on the tip over the largest one, in [-1, 1]; to the right is positive

    def __post_init__(self) -> None:
        for name, least in (("positions", 1), ("trace", 0), ("marks", 0), ("centres", 0)):
            object.__setattr__(self, name, _points(name, getattr(self, name), least))
        if len(self.centres) not in (0, len(self.positions)):
            raise ValueError(
                f"centres must have a place for each of the {len(self.positions)} links, or none, "
                f"got {len(self.centres)}"
            )
        _checks.positive_number("reach", self.reach)
        _checks.number("time", self.time)
        _checks.number("energy", self.energy)
        _checks.nonnegative_number("pseudo_period", self.pseudo_period)
        _checks.nonnegative_number("rail", self.rail)
        _checks.number("cart", self.cart)
        _checks.count("completed", self.completed, low=0, high=len(self.positions))
        for name in ("torque", "force", "push"):
            if abs(_checks.number(name, getattr(self, name))) > 1.0:
                raise ValueError(f"{name} must be between -1 and 1, got {getattr(self, name)!r}")
        _checks.count("joint", self.joint, low=0, high=len(self.positions) - 1)
        if not str.isprintable(self.caption):
            raise ValueError(
                f"caption must be one printable line, got {_checks.show(self.caption)}"
            )


def _points(name: str, value: object, least: int) -> FloatArray:
    out = _checks.array(name, value)
    if out.ndim != 2 or out.shape[1] != 2 or len(out) < least:
        raise ValueError(f"{name} must have shape (n, 2), n >= {least}, got shape {out.shape}")
    out.setflags(write=False)
    return out
