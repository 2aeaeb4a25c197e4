"""Chains by name, or by what a bench gives: class methods of `Chain`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from typing_extensions import Self

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain.balls import ball_parameters
from npend_gym.chain.cart import Cart
from npend_gym.chain.parameters import MAX_RODS, STANDARD_GRAVITY
from npend_gym.chain.published import MULTIARM, REALAIGYM

ChainT = TypeVar("ChainT", bound="NamedChains")

# A class method of Chain, and its arguments
PRESETS = (
    "acrobot", "realaigym A.0", "realaigym C.1", "multiarm 1", "multiarm 2", "multiarm 3",
    "dm_control acrobot", "dm_control cartpole", "dm_control cartpole 2", "dm_control cartpole 3",
    "cartpole",
)  # fmt: skip


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

        `parameters` are further parameters of `Chain`: `base`, `stiffness`, ...
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
            Further parameters of `Chain`: `gravity`, `damping`, `friction`, ...; `centres` and
            `inertias` replace those of uniform rods.

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
        computed: dict[str, Any] = {"centres": centres, "inertias": inertias}
        return cls(whole, length, **computed | parameters)

    @classmethod
    def spheres(
        cls,
        n: int,
        radius: ArrayLike,
        spacing: ArrayLike,
        density: ArrayLike,
        *,
        fixed: bool = True,
        gravity: float = STANDARD_GRAVITY,
        fluid_density: float = 0.0,
        viscosity: float = 0.0,
        drag_coefficient: float = 0.0,
        **parameters: Any,
    ) -> Self:
        r"""Return a chain of n solid balls on massless rods or strings, in vacuum or in a fluid.

        Parameters
        ----------
        n : int
            Number of balls.
        radius : float or array_like, shape (n,)
            Radius of each ball [m].
        spacing : float or array_like, shape (n,)
            Distance of the centre of each ball from the centre of the ball above, and of the first
            from the pivot [m]. The chain bends at these centres.
        density : float or array_like, shape (n,)
            Density of each ball [kg/m^3]; in a fluid the same for all.
        fixed : bool
            Whether each ball turns with the rod above it, with the inertia 2/5 m r^2 of a solid
            ball. Otherwise no ball turns, as on bearings at their centres: point masses.
        gravity : float
            Acceleration of gravity [m/s^2].
        fluid_density : float
            Density of a fluid at rest around the balls [kg/m^3]: buoyancy and added mass, see the
            notes.
        viscosity : float
            Dynamic viscosity of the fluid [Pa s]: `drag` is Stokes' drag, 6 pi viscosity radius.
        drag_coefficient : float
            Drag coefficient of a ball in fast flow, about 0.4: `quadratic_drag` is half of it,
            times the density of the fluid and the cross-section. With Stokes' drag the whole
            coefficient is 24 / Re + `drag_coefficient`.
        **parameters
            Further parameters of `Chain` except `lengths`, which are `spacing`. They override those
            of balls: `damping`, `base`, `inertias` of hollow balls, ...

        Raises
        ------
        TypeError, ValueError
            If an argument breaks its rule, balls overlap, or balls in a fluid have unequal
            densities or rise in it.

        Notes
        -----
        In an ideal fluid a ball of mass m that displaces m_f has the weight (m - m_f) g and the
        inertia m + m_f/2; the fluid adds no inertia against turning (K. McKee and A. Czarnecki,
        arXiv:1901.00557). Balls of equal density move, and pull at the pivot, exactly as a chain
        with the masses m + m_f/2 under the gravity g (density - fluid_density) / (density +
        fluid_density / 2): these are `masses` and `gravity` of the chain. The model ignores the
        flow that one ball causes at another, of the order of (radius / spacing)^3, walls, and the
        history of the flow.

        Examples
        --------
        >>> from npend_gym import Chain
        >>> steel = Chain.spheres(3, radius=0.01, spacing=0.1, density=7800.0)
        >>> steel.masses.round(5).tolist()
        [0.03267, 0.03267, 0.03267]
        >>> in_water = Chain.spheres(3, 0.01, 0.1, 7800.0, fluid_density=1000.0, viscosity=1e-3)
        >>> round(in_water.gravity, 4)
        8.0371
        """
        if "lengths" in parameters:
            raise TypeError(
                "lengths must be left out, because those of spheres are their spacing: give "
                f"spacing={_checks.show(parameters['lengths'])}"
            )
        balls = ball_parameters(
            _checks.count("n", n, high=MAX_RODS), radius, spacing, density, gravity=gravity,
            fluid_density=fluid_density, viscosity=viscosity, drag_coefficient=drag_coefficient,
        )  # fmt: skip
        turning = {} if _checks.truth("fixed", fixed) else {"inertias": 0.0}
        return cls(**balls | turning | parameters)

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
        The published inertias are about the joints. The dry friction cf arctan(100 v), v the speed
        of the joint, has here the same limit, pi/2 cf, and the same slope at rest. Its gear of 6
        turns the second rotor backwards.
        """
        _checks.choice("design", design, tuple(dict.fromkeys(of for of, _ in REALAIGYM)))
        models = [number for of, number in REALAIGYM if of == design]
        model = _checks.choice("model", models[0] if model is None else model, (*models,))
        m, l, r, about_joint, b, cf, rotor = map(np.array, REALAIGYM[design, model])
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
        MIT. The length of the last arm (the only one, for the single pendulum) does not change the
        motion.

        Parameters
        ----------
        arms : 1, 2 or 3

        Raises
        ------
        TypeError, ValueError
            If `arms` is another number.
        """
        numbers = MULTIARM[_checks.count("arms", arms, high=3)]
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
            If `domain` is another text, or `num_poles` is not a count, or not 1 for "acrobot".
        """
        n = _checks.count("num_poles", num_poles, high=MAX_RODS)
        if _checks.choice("domain", domain, ("acrobot", "cartpole")) == "cartpole":
            base = Cart(1.0, damping=5e-4)
            return _capsules(cls, np.full(n, 0.1), np.full(n, 0.045), 2e-6, base)
        if n != 1:
            raise ValueError(f"num_poles must be left out for acrobot, which has no cart; got {n}")
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
            If `name` is not one of PRESETS.
        """
        method, *arguments = _checks.choice("the name of a chain", name, PRESETS).split(" ")
        given = [int(argument) if argument.isdigit() else argument for argument in arguments]
        return getattr(cls, method)(*given)


for _method in vars(NamedChains).values():
    if isinstance(_method, classmethod):  # Python's errors name the class that users know
        _method.__func__.__qualname__ = f"Chain.{_method.__func__.__name__}"


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
