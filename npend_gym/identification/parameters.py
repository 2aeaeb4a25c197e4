"""What the motion of a chain determines, and chains that have these values.

The equations of motion contain the masses, centres and inertias of the links only through 2 n
numbers: with h_i = m_i c_i + l_i sum_{k>i} m_k ("lift") and J_i = I_i + m_i c_i^2 +
l_i^2 sum_{k>i} m_k ("inertia", the diagonal of the mass matrix), they read

    sum_j W_ij (cos(theta_i - theta_j) alpha_j + sin(theta_i - theta_j) omega_j^2)
        + g h_i sin theta_i = tau_i - tau_{i+1},    W_ii = J_i,  W_ij = l_i h_j for i < j,

linear in J and h, and in damping, dry friction, drag of the air and armature, which add to the
torques and to W. Measured angles may have an offset each beside these: the zero of an encoder. The
coupling of links, l_i h_j, distinguishes g from h. Without it one of g, h and J must be known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from npend_gym import _checks
from npend_gym._checks import BoolArray, FloatArray
from npend_gym.chain import STANDARD_GRAVITY, Chain, ChainParameters
from npend_gym.chain.inertia import link_inertia

UNITS = {
    "inertia": "kg m^2",
    "lift": "kg m",
    "damping": "N m s/rad",
    "friction": "N m",
    "drag": "N s/m",
    "quadratic_drag": "N s^2/m^2",
    "armature": "kg m^2",
    "length": "m",
    "gravity": "m/s^2",
    "offset": "rad",
}
QUANTITIES = tuple(UNITS)
(INERTIA, LIFT, DAMPING, FRICTION, DRAG, QUADRATIC_DRAG, ARMATURE, LENGTH, GRAVITY,
 OFFSET) = range(len(QUANTITIES))  # fmt: skip
_RESISTING = QUANTITIES[DAMPING:LENGTH]  # they are parameters of `Chain` too
DEFAULT_FIT = ("inertia", "lift", "damping", "friction", "quadratic_drag")
OPTIONAL = DAMPING, FRICTION, QUADRATIC_DRAG, ARMATURE  # of the default, where data support them
_LEAST = 1e-9  # inertia of a link, of the largest one
MARGIN = 1e-3  # by which a mass exceeds the smallest one that its link can have


def values_of(chain: Chain) -> FloatArray:
    """Return the values of a chain, rows as in `QUANTITIES`, shape (10, n); offsets are zero.

    Gravity fills its row.
    """
    inertia = np.diag(link_inertia(chain))
    resisting = [getattr(chain, name) for name in _RESISTING]
    gravity = np.full(chain.n, chain.gravity)
    return np.array([inertia, chain.lift, *resisting, chain.lengths, gravity, np.zeros(chain.n)])


@dataclass(frozen=True, eq=False)
class FitModel:
    """Which values of a chain are fitted, and what is known of it."""

    # with gravity, friction speed and gears, and the masses as far as they are possible
    chain: Chain
    known: FloatArray  # the values that are not fitted, (10, n), rows as in `QUANTITIES`
    free: BoolArray  # which values are fitted, (10, n)

    @property
    def names(self) -> list[str]:
        """The fitted values by name, such as "inertia0" or "gravity", in the order of `pack`."""
        places = np.argwhere(self.free).tolist()
        return [QUANTITIES[row] + f"{link}" * (row != GRAVITY) for row, link in places]

    @property
    def units(self) -> list[str]:
        """The units of the fitted values."""
        return [UNITS[QUANTITIES[row]] for row, _ in np.argwhere(self.free)]

    def pack(self, values: FloatArray) -> FloatArray:
        """Return the fitted ones of values (..., 10, n), shape (..., k)."""
        return values[..., self.free]

    def unpack(self, fitted: FloatArray) -> FloatArray:
        """Return all values, those that are not fitted as they are known, shape (..., 10, n)."""
        out = np.tile(self.known, (*fitted.shape[:-1], 1, 1))
        out[..., self.free] = fitted
        return out

    def fixed(self, values: FloatArray) -> FitModel:
        """Return the model that has `values`, (10, n), and fits none."""
        return FitModel(self.chain, values, np.zeros_like(self.free))

    @property
    def lower(self) -> FloatArray:
        """The least fitted values: nothing drives a joint that has no motor, shape (k,)."""
        least = np.full(self.free.shape, -np.inf)
        least[[INERTIA, *range(DAMPING, OFFSET)]] = 0.0
        return least[self.free]

    def scale(self, values: FloatArray) -> FloatArray:
        """Return sizes of the fitted values that matter to the motion, shape (k,)."""
        inertia = np.abs(values[INERTIA])
        # the lift of a balanced wheel is zero but for noise
        lift = max(np.abs(values[LIFT]).max(), (inertia / self.chain.lengths).max())
        gravity = self.chain.gravity or STANDARD_GRAVITY
        rate = np.sqrt(gravity / self.chain.lengths.mean())
        sizes = np.ones(self.free.shape)
        sizes[[INERTIA, ARMATURE]], sizes[LIFT] = inertia, lift
        sizes[DAMPING], sizes[FRICTION] = inertia * rate, inertia * rate**2
        sizes[DRAG] = sizes[DAMPING] / self.chain.lengths**2
        sizes[QUADRATIC_DRAG] = inertia / self.chain.lengths**3
        sizes[LENGTH], sizes[GRAVITY] = self.chain.lengths, gravity
        return sizes[self.free]

    def possible_chain(self, values: FloatArray) -> Chain | None:
        """Return the chain that has `values`, (10, n), with the masses of `chain` where possible.

        None if no masses give the links positive inertias, or no chain takes values so large.
        """
        masses, lengths = possible_masses(self.chain, values), values[LENGTH]
        if masses is None:
            return None
        below = _carried(masses)
        centres = (values[LIFT] - lengths * below) / masses
        inertias = values[INERTIA] - masses * centres**2 - below * lengths**2
        inertias[np.abs(inertias) < 1e-12 * values[INERTIA]] = 0.0  # rounding
        if np.any(inertias < 0.0) or np.any(np.abs([*values, inertias]) > _checks.LARGEST):
            return None
        given = {"masses": masses, "lengths": lengths, "centres": centres, "inertias": inertias}
        given |= _resisting(values) | {"gravity": values[GRAVITY, 0]}
        kept = (name for name in ChainParameters._fields if name not in given)
        return Chain(**given, **{name: getattr(self.chain, name) for name in kept})

    def directions(self, chain: Chain) -> dict[str, FloatArray]:
        """Return how parameters of `chain` change with what is fitted, by name, (K, n) each.

        The shape for gravity is (K,).

        The K values are those of `names`, but for the offsets at their end. Masses do not change:
        the motion does not depend on them where inertias and lifts are given.
        """
        places = np.argwhere(self.free[:OFFSET])
        names = "centres", "inertias", *_RESISTING, *["lengths"] * bool(self.free[LENGTH].any())
        out = {name: np.zeros((len(places), chain.n)) for name in names}
        if self.free[GRAVITY, 0]:
            out["gravity"] = (places[:, 0] == GRAVITY).astype(np.float64)
        below = _carried(chain.masses)
        for k, (row, link) in enumerate(places.tolist()):
            if row == LIFT:
                out["centres"][k, link] = 1.0 / chain.masses[link]
                out["inertias"][k, link] = -2.0 * chain.centres[link]
            elif row == LENGTH:
                out["lengths"][k, link] = 1.0
                out["centres"][k, link] = -below[link] / chain.masses[link]
                out["inertias"][k, link] = (
                    2.0 * below[link] * (chain.centres[link] - chain.lengths[link])
                )
            elif row != GRAVITY:
                name = "inertias" if row == INERTIA else QUANTITIES[row]
                out[name][k, link] = 1.0
        return out

    def chain_errors(
        self, chain: Chain, errors: FloatArray, covariance: FloatArray
    ) -> dict[str, FloatArray]:
        """Return standard errors of parameters of `chain`, by those of what is fitted.

        NaN where the data do not determine a parameter: `errors` of what it depends on are
        infinite, and the covariance does not contain that.
        """
        out = dict[str, FloatArray]()
        for name, slope in self.directions(chain).items():
            own = slice(len(slope))
            variance = np.einsum("k...,kl,l...->...", slope, covariance[own, own], slope)
            lost = slope[np.isinf(errors[own])].any(axis=0)
            out[name] = np.where(lost, np.nan, np.sqrt(variance))
        return out

    def chain_of(self, values: FloatArray) -> Chain:
        """Return the `possible_chain`; ValueError if there is none.

        It is the given chain but for gravity and what resists, where nothing else is fitted.
        """
        if not self.free[[INERTIA, LIFT, LENGTH]].any():
            changed = _resisting(values) | {"gravity": float(values[GRAVITY, 0])}
            return Chain.from_dict(self.chain.as_dict() | changed)
        chain = self.possible_chain(values)
        if chain is None:
            raise ValueError(
                "chain must have lengths that fit the motion: with those given no links of "
                f"positive inertia have inertia {values[INERTIA]} kg m^2 and lift {values[LIFT]} "
                "kg m"
            )
        return chain


def _resisting(values: FloatArray) -> dict[str, FloatArray]:
    """Return the parameters of `Chain` that resist motion, of values (10, n)."""
    rows = values[DAMPING:LENGTH]
    return dict(zip(_RESISTING, np.where(rows < _checks.SMALLEST, 0.0, rows), strict=True))


def _carried(masses: FloatArray) -> FloatArray:
    """Return the mass below each link."""
    return np.cumsum(masses[::-1])[::-1] - masses


def possible_masses(chain: Chain, values: FloatArray) -> FloatArray | None:
    """Return masses for which no link with these values, (10, n), has a negative inertia.

    Those of the chain if they are possible; otherwise the same factor reduces all of them, but
    none below the least that its link can have. None if nothing is possible.

    Notes
    -----
    I_i >= 0 is m_i >= (h_i - l_i b)^2 / (J_i - l_i^2 b), b being the mass below link i, and
    J_i > l_i^2 b. The least masses, found from the last link up, leave the most room above.
    """
    inertia, lift, lengths = values[INERTIA], values[LIFT], values[LENGTH]
    if np.any(lengths < _checks.SMALLEST):
        return None
    smallest = _LEAST * max(inertia.max(), np.abs(lift * lengths).max())

    def masses(factor: float) -> FloatArray | None:
        out, below = np.empty(chain.n), 0.0
        for i in reversed(range(chain.n)):
            room = inertia[i] - below * lengths[i] ** 2 * (1.0 + MARGIN)
            if not room > smallest:
                return None
            least = (lift[i] - lengths[i] * below) ** 2 / room * (1.0 + MARGIN)
            out[i] = max(factor * chain.masses[i], least, _checks.SMALLEST)
            below += out[i]
        return out

    whole = masses(1.0)
    if whole is not None or masses(0.0) is None:
        return whole
    low, high = 0.0, 1.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if masses(middle) is None else (middle, high)
    return masses(low)


def weighs(chain: Chain) -> BoolArray:
    """Return which links gravity turns, shape (n,): neither it nor their lift is zero.

    The lift of a balanced rod, or a flywheel, is zero but for rounding. That of link 0 sets the
    scale of free swings, if it is not zero.
    """
    levers = np.abs(chain.centres).sum() + chain.lengths.sum()
    return chain.gravity * np.abs(chain.lift) > chain.gravity * _LEAST * levers * chain.masses.sum()


def new_model(
    chain: Chain, fit: Sequence[str] | None, *, driven: bool, moved: bool = False
) -> FitModel:
    """Return the model that fits the quantities `fit` of all links, as far as data can tell them.

    Without torques one value sets the scale and is kept: the lift of link 0, or its inertia
    where there is no gravity, or this lift is zero. The armature of joint 0 adds to the inertia of
    link 0 alone, and the length of the last link changes nothing but drag. Without gravity no angle
    tells an offset, and no torque a length. `moved` says whether the pivot moves.
    """
    default = DEFAULT_FIT + ("armature",) * driven
    names = default if fit is None else fit
    free = np.zeros((len(QUANTITIES), chain.n), np.bool_)
    for name in names:
        free[QUANTITIES.index(_checks.choice("fit", name, QUANTITIES))] = True
    free[ARMATURE, 0] &= not free[INERTIA, 0]
    if chain.gravity == 0.0:
        free[OFFSET] = free[LENGTH] = free[LIFT, 0] = False
    if not weighs(chain)[0]:
        free[[INERTIA, ARMATURE], 0] &= driven
    free[LIFT, 0] &= driven
    free[LENGTH, -1] = free[GRAVITY, 1:] = False
    if free[GRAVITY, 0]:
        _check_gravity(chain, free, driven=driven, moved=moved)
    if not free.any():
        raise ValueError(
            f"fit must name something that the data can tell, of {', '.join(QUANTITIES)}; got "
            f"{_checks.show(names)}"
        )
    return FitModel(chain, values_of(chain), free)


def _check_gravity(chain: Chain, free: BoolArray, *, driven: bool, moved: bool) -> None:
    """Refuse gravity beside values in proportion to which alone the motion determines it."""
    if chain.gravity == 0.0:
        raise ValueError("gravity of the chain must be above 0, a first value to be fitted, got 0")
    if weighs(chain)[1:].any():
        beside = (LENGTH,) if free[LIFT].any() else ()
    else:
        beside = (LIFT,) if driven else (INERTIA, ARMATURE)
    named = [QUANTITIES[row] for row in beside if free[row].any()]
    if named and not moved:
        only = "product" if named == ["lift"] else "ratio"
        raise ValueError(
            f'fit must not name "gravity" beside "{named[0]}", because this motion determines only '
            f"their {only}: give one of them with the chain, or move the pivot and measure its "
            "position"
        )
