"""The motion of a chain at given times: data, and what follows from it."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import wraps
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import FloatArray
from npend_gym._faces import MethodFromAbove
from npend_gym.chain import Chain, ChainParameters
from npend_gym.physics import energy as _energy
from npend_gym.physics.kernels.methods import METHODS
from npend_gym.physics.recipe import Recipe

EVENTS = ("t_events", "theta_events", "omega_events")
# The parts of a state in their order: all coordinates, then their rates
STATE = ("theta", "position", "stretch", "omega", "velocity", "stretch_rate")

IntArray = NDArray[np.int64]


def _each_chain(method: Callable[[Trajectory], FloatArray]) -> Callable[[Trajectory], FloatArray]:
    """Let a method do for motions of chains that differ: one by one, NaN after their ends."""

    @wraps(method)
    def of_each(self: Trajectory) -> FloatArray:
        if not self.chains:
            return method(self)
        each = [method(self[k]) for k in range(len(self))]
        found = np.full((len(each), self.times.size, *each[0].shape[1:]), np.nan)
        for own, rows, theta in zip(each, found, self.theta, strict=True):
            last = int(np.isfinite(theta).all(axis=1).sum())  # the end stands between two times
            rows[:last] = own[:last]
        return found

    return of_each


@dataclass(frozen=True, eq=False)
class Trajectory:
    """The motion of a chain at given times; it can be pickled, copied and saved with any drive.

    Attributes
    ----------
    chain : Chain
        The chain; for many motions with different chains the first one: see `chains`.
    times : ndarray, shape (T,)
        Instants [s].
    theta, omega : ndarray, shape (T, n)
        Angles [rad], unwrapped, and angular velocities [rad/s].
    position, velocity : ndarray, shape (T,), or (T, 2) where the pivot's acceleration is given
        Of the cart or the pivot [m and m/s]; None where the pivot is at rest.
    stretch, stretch_rate : ndarray, shape (T, n)
        How much longer springs are than ``chain.lengths`` [m], and its rate [m/s]; None where
        rods are rigid.
    provenance : dict
        How the motion was made: versions, method, tolerances, drives.
    recipe : Recipe
        How the steps were taken; `at` and derivatives need it. None if `simulate` did not take them
        on this machine's CPU.
    status : int
        0 where the motion reached the last of the times that were asked for, 1 where a terminal
        event ended it; shape (B,) for many motions.
    t_events, theta_events, omega_events : list
        For each event its instants [s], shape (k,), and the states there, (k, n) each; for many
        motions a list of such arrays.
    counts : ndarray of int, shape (3,) or (3, B)
        Steps taken, steps refused, and steps in which states were interpolated.
    chains : tuple of Chain
        The chain of each motion, if they differ.
    ends : ndarray, shape (B, 1 + 2m)
        For many motions, the instant and the state at which a terminal event ended each. NaN for a
        motion that no event ended; None if no event ended any.

    Notes
    -----
    Positions and velocities of bobs are relative to the pivot, also where it moves. For B motions,
    `theta` and `omega` have the shape (B, T, n), and all derived quantities have the same leading
    axis; `trajectory[k]` is the trajectory of one motion.

    Examples
    --------
    >>> import numpy as np
    >>> from npend_gym import Chain, simulate
    >>> motion = simulate(Chain.uniform(2), 1.0, 0.0, np.linspace(0.0, 2.0, 21))
    >>> motion.positions().shape
    (21, 2, 2)
    >>> theta, omega = motion.at(1.23)
    >>> theta.round(4).tolist()
    [-0.8631, -1.0712]
    """

    chain: Chain
    times: FloatArray
    theta: FloatArray
    omega: FloatArray
    position: FloatArray | None = None
    velocity: FloatArray | None = None
    stretch: FloatArray | None = None
    stretch_rate: FloatArray | None = None
    provenance: dict[str, Any] = field(default_factory=dict[str, Any])
    recipe: Recipe | None = None
    status: Any = 0
    t_events: list[Any] = field(default_factory=list[Any])
    theta_events: list[Any] = field(default_factory=list[Any])
    omega_events: list[Any] = field(default_factory=list[Any])
    counts: IntArray | None = field(default=None, repr=False)
    chains: tuple[Chain, ...] = field(default=(), repr=False)
    ends: FloatArray | None = field(default=None, repr=False)

    if TYPE_CHECKING:
        from npend_gym.physics.dense import at, cart_at
        from npend_gym.physics.sensitivities import gradient, sensitivities
        from npend_gym.physics.trajectory_file import load, save, to_csv
        from npend_gym.report.notebook import animate, plot
        from npend_gym.report.notebook import as_html as _repr_html_
    else:
        at = MethodFromAbove("npend_gym.physics.dense:at")
        cart_at = MethodFromAbove("npend_gym.physics.dense:cart_at")
        sensitivities = MethodFromAbove("npend_gym.physics.sensitivities:sensitivities")
        gradient = MethodFromAbove("npend_gym.physics.sensitivities:gradient")
        save = MethodFromAbove("npend_gym.physics.trajectory_file:save")
        load = MethodFromAbove("npend_gym.physics.trajectory_file:load")
        to_csv = MethodFromAbove("npend_gym.physics.trajectory_file:to_csv")
        plot = MethodFromAbove("npend_gym.report.notebook:plot")
        animate = MethodFromAbove("npend_gym.report.notebook:animate")
        _repr_html_ = MethodFromAbove("npend_gym.report.notebook:as_html")

    @property
    def nfev(self) -> Any:
        """How often the equations were evaluated, as SciPy counts; (B,) for many motions.

        Two more evaluations, after each instant of a `Signal`, are not counted.
        """
        method = "dop853" if self.recipe is None else self.recipe.method
        pairs = zip(METHODS[method].evaluations, self._counted, strict=True)
        return 2 + sum(each * count for each, count in pairs)

    @property
    def steps(self) -> Any:
        """How many steps were taken; (B,) for many motions."""
        return self._counted[0]

    @property
    def refused_steps(self) -> Any:
        """How many steps were rejected and taken shorter; (B,) for many motions."""
        return self._counted[1]

    @property
    def _counted(self) -> IntArray:
        if self.counts is None:
            raise ValueError(
                "steps are counted where a method with tolerances took them, not those of a GPU "
                'or of "rk4", whose steps dt sets'
            )
        return self.counts

    def __getstate__(self) -> dict[str, Any]:
        """State to pickle and copy: without the steps that `at` keeps and can take again."""
        return {name: each for name, each in self.__dict__.items() if name != "_steps"}

    def __len__(self) -> int:
        """Return the number of motions side by side.

        Raises
        ------
        TypeError
            If there is one alone.
        """
        if self.theta.ndim < 3:
            raise TypeError("a trajectory of one motion has no length; len(times) is that of times")
        return len(self.theta)

    def __getitem__(self, k: int) -> Trajectory:
        """Return the motion `k` of many, up to the event that ended it, if one did.

        Its arrays are views of this trajectory where no event ended the motion: copy them before
        you write to them.
        """
        count = len(self)
        if not -count <= operator.index(k) < count:
            raise IndexError(f"motion must be from {-count} to {count - 1}, got {k}")
        status = int(np.broadcast_to(self.status, count)[k])
        last = int(np.isfinite(self.theta[k]).all(axis=1).sum()) if status else None
        end = self.ends[k] if status and self.ends is not None else None
        if end is not None:
            last = int((self.times < end[0]).sum())
        own: dict[str, Any] = {name: [each[k] for each in getattr(self, name)] for name in EVENTS}
        for name in ("times", *STATE):
            many: FloatArray | None = getattr(self, name)
            rows = None if many is None else (many if name == "times" else many[k])[:last]
            if end is not None and rows is not None:
                part, end = np.split(end, [math.prod(rows.shape[1:])])
                rows = np.append(rows, part.reshape(1, *rows.shape[1:]), axis=0)
            own[name] = rows
        return Trajectory(
            self.chains[k] if self.chains else self.chain, **own,
            provenance=self.provenance, status=status,
            recipe=self.recipe and self.recipe.of_motion(k),
            counts=None if self.counts is None else self.counts[:, k],
        )  # fmt: skip

    @property
    def _rods(self) -> Chain | ChainParameters:
        """The chain as rigid rods of the lengths that it has at each instant."""
        return self.chain if self.stretch is None else _energy.stretched(self.chain, self.stretch)

    @_each_chain
    def lengths(self) -> FloatArray:
        """Return the lengths of the rods [m], shape (T, n)."""
        return np.where(np.isnan(self.theta), np.nan, self._rods.lengths)

    @_each_chain
    def positions(self) -> FloatArray:
        """Return the positions of the bobs [m], shape (T, n, 2)."""
        return _energy.positions(self._rods, self.theta)

    @_each_chain
    def centres(self) -> FloatArray:
        """Return the positions of the links' centres of mass [m], shape (T, n, 2)."""
        return _energy.centres(self._rods, self.theta)

    def bodies(self) -> FloatArray:
        """Return `centres` where links are bodies, for pictures; for point masses (T, 0, 2)."""
        if any(map(_energy.has_bodies, self.chains or (self.chain,))):
            return self.centres()
        return np.empty((*self.theta.shape[:-1], 0, 2))

    @_each_chain
    def velocities(self) -> FloatArray:
        """Return the velocities of the bobs [m/s], shape (T, n, 2)."""
        return _energy.velocities_of_motion(
            self.chain, self.theta, self.omega, self.stretch, self.stretch_rate
        )

    @_each_chain
    def kinetic_energy(self) -> FloatArray:
        """Return the kinetic energy [J], shape (T,), including the cart's.

        If the acceleration of the pivot is prescribed, it is relative to the pivot.
        """
        return _energy.kinetic_of_motion(
            self.chain, self.theta, self.omega, self.velocity, self.stretch, self.stretch_rate
        )

    @_each_chain
    def energy(self) -> FloatArray:
        """Return the energy above hanging at rest, with stretched springs [J], shape (T,)."""
        if self.stretch is None:
            potential = _energy.potential_energy(self.chain, self.theta)
        else:
            potential = _energy.potential_of_springs(self.chain, self.theta, self.stretch)
        return self.kinetic_energy() + potential
