"""Chains by name: class methods of `Chain`, and the published numbers that they take."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from typing_extensions import Self

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain.cart import Cart
from npend_gym.chain.parameters import MAX_RODS, STANDARD_GRAVITY

ChainT = TypeVar("ChainT", bound="NamedChains")

# A class method of Chain, and its arguments
PRESETS = (
    "acrobot", "realaigym A.0", "realaigym C.1", "multiarm 1", "multiarm 2", "multiarm 3",
    "dm_control acrobot", "dm_control cartpole", "dm_control cartpole 2", "dm_control cartpole 3",
    "cartpole",
)  # fmt: skip

# RealAIGym: masses m [kg], lengths l and centres r [m], inertias about the joint I [kg m^2],
# viscous b [N m s/rad] and dry friction cf [N m] of two joints; inertia of a rotor [kg m^2]
_REALAIGYM = {
    ("A.0", "2.0"): (
        (0.5593806151425046, 0.6043459469186889), (0.3, 0.2), (0.3, 0.18377686083653508),
        (0.053470810264216295, 0.02392374528789766),
        (0.001, 0.001), (0.093, 0.078), 7.659297952841183e-05,
    ),
    ("C.0", "3.0"): (
        (0.6416936775868083, 0.5639360564500752), (0.2, 0.3), (0.2, 0.32126693265850237),
        (0.026710760905753486, 0.05387812962959988),
        (0.001, 0.001), (0.093, 0.078), 9.937281204851094e-05,
    ),
    ("C.1", "1.0"): (
        (0.5234602302310271, 0.6255677234174437), (0.2, 0.3), (0.2, 0.25569305436052964),
        (0.031887199591513114, 0.05086984812807257),
        (0.001, 0.001), (0.16, 0.12), 6.287203962819607e-05,
    ),
    ("C.1", "2.0"): (
        (0.7586436245588385, 0.33693688400430855), (0.2, 0.3), (0.2, 0.4684380078598044),
        (0.042111626356002546, 0.0510352807011669),
        (0.003690870343196907, 0.0006450852127932183),
        (0.17467189894350432, 0.10999997753612206), 6.287203962819607e-05,
    ),
    ("C.1", "3.0"): (
        (0.874595478947918, 0.22041458616752638), (0.2, 0.3), (0.2, 0.3267491550003389),
        (0.03571133360368982, 0.010000000000000002),
        (0.049378979942464735, 0.020040916031588852),
        (0.03314955511059797, 0.03521137546780113), 5.1336718481407864e-05,
    ),
}  # fmt: skip

# MultiArm-Pendulum: masses, lengths, centres, inertias about them, damping, gravity
_MULTIARM = {
    1: ((0.147755,), (0.2,), (0.147585,), (1.09119e-4,), (2.23940e-4,), 9.81001),
    2: (
        (0.093844, 0.137596), (0.172719, 0.2286), (0.108565, 0.116779),
        (4.37530e-4, 1.268829e-3), (2.37143e-4, 1.0e-5), 9.80858,
    ),
    3: (
        (0.258172, 0.279428, 0.118624), (0.1728, 0.2287, 0.2413), (0.16, 0.202939, 0.183709),
        (1.00043e-4, 3.14160e-4, 1.68739e-4), (1.477095e-3, 2.59577e-4, 1.0e-5), 9.80834,
    ),
}  # fmt: skip


class NamedChains:
    """Class methods of `Chain` that return chains by a name or by a rule."""

    if TYPE_CHECKING:

        def __init__(
            self, masses: ArrayLike, lengths: ArrayLike, *further: Any, **parameters: Any
        ) -> None: ...

    @classmethod
    def uniform(
        cls,
        n: int,
        mass: float = 1.0,
        length: float = 1.0,
        gravity: float = STANDARD_GRAVITY,
        damping: float = 0.0,
        drag: float = 0.0,
        quadratic_drag: float = 0.0,
        **parameters: Any,
    ) -> Self:
        """Return a chain of n equal rods, each `length` [m] long with a bob of `mass` [kg].

        `parameters` are further ones of `Chain`: `base`, `stiffness`, ...
        """
        n = _checks.count("n", n, high=MAX_RODS)
        mass = _checks.positive_number("mass", mass)
        length = _checks.positive_number("length", length)
        equal = np.full(n, mass), np.full(n, length)
        return cls(*equal, gravity, damping, drag, quadratic_drag, **parameters)

    @classmethod
    def rods(
        cls,
        masses: ArrayLike,
        lengths: ArrayLike,
        tips: ArrayLike = 0.0,
        **parameters: Any,
    ) -> Self:
        """Return a chain of uniform rods, each with a point mass at its lower end or with none.

        Parameters
        ----------
        masses, lengths : float or array_like, shape (n,)
            Mass [kg] and length [m] of each rod; a rod without mass needs one at its end.
        tips : float or array_like, shape (n,)
            Mass at the lower end of each rod [kg], zero or more.
        **parameters
            Further parameters of `Chain`: `gravity`, `damping`, `friction`, ...

        Raises
        ------
        TypeError, ValueError
            If an argument breaks its rule.
        """
        given = {"masses": masses, "lengths": lengths, "tips": tips}
        arrays = {name: np.atleast_1d(_checks.array(name, value)) for name, value in given.items()}
        n = max(value.size for value in arrays.values())
        rod, length, tip = (_checks.vector(name, given[name], n) for name in given)
        _checks.at_least_zero("masses", rod)
        whole = _checks.positive("masses of rod and tip", rod + _checks.at_least_zero("tips", tip))
        half = 0.5 * _checks.positive("lengths", length)
        centres = length - half * (rod / whole)
        inertias = rod * half**2 / 3.0 + (rod * tip / whole) * half**2  # of the rod, of the pair
        return cls(whole, length, centres=centres, inertias=inertias, **parameters)

    @classmethod
    def acrobot(cls) -> Self:
        """Return the two links of Gymnasium's Acrobot-v1, in its default dynamics, "book".

        Sutton and Barto, *Reinforcement Learning*, section 11.3 of the first edition: masses and
        lengths of 1, centres in the middle, inertias of 1 about them, g = 9.8 m/s^2.
        """
        return cls([1.0, 1.0], [1.0, 1.0], 9.8, centres=0.5, inertias=1.0)

    @classmethod
    def cartpole(cls) -> Self:
        """Return the pole and the cart of Gymnasium's CartPole-v1.

        The pole is a rod of 0.1 kg and 1 m, the cart has 1 kg, and g = 9.8 m/s^2.

        A. G. Barto, R. S. Sutton and C. W. Anderson, *Neuronlike adaptive elements that can solve
        difficult learning control problems*, IEEE Transactions on Systems, Man, and Cybernetics 13
        (1983), 834-846.
        """
        return cls.rods(0.1, 1.0, gravity=9.8, base=Cart(1.0))

    @classmethod
    def realaigym(cls, design: str, model: str | None = None, *, motors: bool = True) -> Self:
        r"""Return a double pendulum of RealAIGym as its authors identified it, Acrobot or Pendubot.

        F. Wiebe and others, *Open Source Dual-Purpose Acrobot and Pendubot Platform*, IEEE Robotics
        and Automation Magazine 31 (2024); repository dfki-ric-underactuated-lab/double_pendulum,
        BSD-3-Clause, `data/system_identification`.

        Parameters
        ----------
        design : "A.0" or "C.1"
            The build of the robot; model 2.0 of A.0, and model 1.0 of C.1, the leaderboard's.
        model : str, optional
            Another model of that design.
        motors : bool
            With the friction and the rotors of the motors, or without, as the leaderboard
            simulates.

        Raises
        ------
        ValueError
            If there is no such model, or if it has a negative inertia about a centre of mass,
            which no body has: C.0 3.0, C.1 2.0 and 3.0 do.

        Notes
        -----
        The published inertias are those about the joints. Its dry friction cf arctan(100 v), v the
        speed of the joint, has here the same limit, pi/2 cf, and the same slope at rest. Its gear
        of 6 turns the second rotor backwards.
        """
        _checks.choice("design", design, tuple(dict.fromkeys(of for of, _ in _REALAIGYM)))
        models = [number for of, number in _REALAIGYM if of == design]
        model = _checks.choice("model", model or models[0], (*models,))
        m, l, r, about_joint, b, cf, rotor = map(np.array, _REALAIGYM[design, model])
        inertias = about_joint - m * r**2
        if np.any(inertias < 0.0):
            raise ValueError(
                f"model {model} of design {design} has a negative inertia about the centre of a "
                f"link, {inertias.min():.3g} kg m^2, which no body has; use A.0 or C.1 without "
                "model"
            )
        if not motors:
            return cls(m, l, centres=r, inertias=inertias)
        gear, dry = np.array([6.0, -6.0]), 0.5 * np.pi * cf
        return cls(
            m, l, damping=b, centres=r, inertias=inertias, friction=dry,
            friction_speed=np.pi / 200.0, armature=rotor * gear**2, gear=gear,
        )  # fmt: skip

    @classmethod
    def multiarm(cls, arms: int) -> Self:
        """Return the pendulum of one, two or three arms of the MultiArm-Pendulum data.

        K. Kaheman and others, *The experimental multi-arm pendulum on a cart*, HardwareX 15 (2023),
        arXiv:2205.06231, as its authors identified it; repository dynamicslab/MultiArm-Pendulum,
        MIT.
        The length of the last arm (the only one, for the single pendulum) changes no motion.

        Parameters
        ----------
        arms : 1, 2 or 3

        Raises
        ------
        TypeError, ValueError
            If `arms` is another number.
        """
        numbers = _MULTIARM[_checks.count("arms", arms, high=3)]
        masses, lengths, centres, inertias, damping, gravity = numbers
        return cls(masses, lengths, gravity, damping, centres=centres, inertias=inertias)

    @classmethod
    def dm_control(cls, domain: str, num_poles: int = 1) -> Self:
        """Return the links of a domain of dm_control's suite, which are capsules.

        Y. Tassa and others, *dm_control: Software and tasks for continuous control*, Software
        Impacts 6 (2020); `suite/acrobot.xml` and `suite/cartpole.xml` there.

        Parameters
        ----------
        domain : "acrobot" or "cartpole"
            "cartpole" has a cart of 1 kg, with a damping of 5e-4 N s/m on its rail.
        num_poles : int
            Number of poles on the cart.

        Raises
        ------
        TypeError, ValueError
            If `domain` is another, or `num_poles` is no count.
        """
        n = _checks.count("num_poles", num_poles, high=MAX_RODS)
        if _checks.choice("domain", domain, ("acrobot", "cartpole")) == "cartpole":
            base = Cart(1.0, damping=5e-4)
            return _capsules(cls, np.full(n, 0.1), np.full(n, 0.045), 2e-6, base)
        return _capsules(cls, np.ones(2), np.array([0.05, 0.049]), 0.05)

    @classmethod
    def preset(cls, name: str) -> Self:
        """Return the chain of a name such as "acrobot" or "realaigym C.1".

        Parameters
        ----------
        name : str
            One of PRESETS: the class method of `Chain`, and its arguments.

        Raises
        ------
        ValueError
            If `name` is another.
        """
        method, *arguments = _checks.choice("the name of a chain", name, PRESETS).split(" ")
        given = [int(argument) if argument.isdigit() else argument for argument in arguments]
        return getattr(cls, method)(*given)


def _capsules(
    cls: type[ChainT],
    masses: FloatArray,
    radii: FloatArray,
    damping: float,
    base: Cart | None = None,
) -> ChainT:
    """Return links that are capsules: rods of 1 m of these radii, with half balls at both ends."""
    balls = masses * 4.0 * radii / (4.0 * radii + 3.0)  # both halves, by volume
    inertias = (masses - balls) * (3.0 * radii**2 + 1.0) / 12.0
    inertias += balls * (0.4 * radii**2 + (3.0 * radii + 2.0) / 8.0)
    lengths = np.ones_like(radii)
    return cls(masses, lengths, damping=damping, centres=0.5, inertias=inertias, base=base)
