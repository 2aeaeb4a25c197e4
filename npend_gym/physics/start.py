"""Motions at their beginning: the arguments of `simulate`, checked."""

from __future__ import annotations

from typing import Any

import numpy as np

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain
from npend_gym.compiled.callbacks import Callback
from npend_gym.physics.arguments import check_limits, check_states, check_torque
from npend_gym.physics.equations import States, assembled, slow_start
from npend_gym.physics.functions import NAMES
from npend_gym.physics.integration import check_method
from npend_gym.physics.mechanism import check_lengths, mechanism_of
from npend_gym.physics.motion import Integration, pack_of
from npend_gym.physics.recipe import AT_REST, Function, Recipe, described, drives_of, motion_of
from npend_gym.physics.signals import Signal, varies
from npend_gym.physics.substeps import longest_step

# What stands for a drive that changes in time while the others are checked
_INSTEAD = {"torque": None, "force": 0.0, "pivot_acceleration": AT_REST}


class Start:
    """Motions at their beginning: states and drives of each, checked.

    Parameters
    ----------
    chains : tuple of Chain
        One for all motions, or one for each.
    theta, omega : ndarray
        As `simulate` takes them.
    drives, state : dict
        Torque, force and acceleration of the pivot; and what belongs to a state beside theta and
        omega: by the keywords of `simulate`.
    times : ndarray, shape (T,)
        Instants of the motions [s]; they begin at the first.
    settings : dict
        Those that the method takes.
    method : str
        One of `METHODS`.
    one : bool
        Whether there is one motion, whose results have no leading axis.

    Attributes
    ----------
    states : States
        (B, m)
    recipe : Recipe
    count : int
        B
    is_one : bool
    varying : dict
        Drives that change in time.
    """

    def __init__(
        self, chains: tuple[Chain, ...], theta: FloatArray, omega: FloatArray,
        drives: dict[str, Any], state: dict[str, Any], times: FloatArray,
        settings: dict[str, float], method: str = "dop853", *, one: bool,
    ) -> None:  # fmt: skip
        self.chains: tuple[Chain, ...] = chains
        check_method(method, chains, drives["pivot_acceleration"])
        first = chains[0]
        self._begin = float(times[0])
        self._settings = settings
        self.is_one: bool = one
        self._callbacks = dict[Any, Callback]()  # functions as machine code, for all motions
        self.varying: dict[str, Any] = {name: each for name, each in drives.items() if varies(each)}
        if "force" in self.varying and first.base is None:
            raise ValueError("force acts on a cart: the chain must have base=Cart(mass)")
        constant = drives | {name: _INSTEAD[name] for name in self.varying}
        torque = check_torque(constant.pop("torque"), first.n)
        theta, omega, torque = self._rows(theta, omega, torque)
        check_limits(theta, omega)
        states = assembled(first, theta, omega, torque, short=True, **constant, **state)
        accelerated, mechanism = constant["pivot_acceleration"], states.mechanism
        if accelerated is not None:
            accelerated = np.array(accelerated, float)
        if len(chains) > 1:
            mechanism = mechanism_of(chains, accelerated)
        self.states: States = States(mechanism, *states.rows)
        self.count: int = len(self.states.q)
        force = states.loads[..., first.n] if mechanism.places == 1 else np.zeros(())
        recipe = Recipe(
            method, settings, states.loads[..., : first.n],
            force.copy() if force.ndim else float(force), accelerated,
        )  # fmt: skip
        functions = {name: each if isinstance(each, (Signal, Function)) else Function(each)
                     for name, each in self.varying.items()}  # fmt: skip
        longest: Any = None
        if any(isinstance(each, Function) for each in functions.values()):
            of_each = [longest_step(chain, times) for chain in chains]
            longest = of_each[0] if len(chains) == 1 else np.array(of_each)
        self.recipe: Recipe = recipe._replace(longest_step=longest, **functions)
        chosen = first.stiffness is not None and state["stretch"] is None
        if chosen and (self.varying or len(chains) > 1):
            for k in range(self.count):
                axial = self._axial_start(k)
                self.states.q[k, -first.n :], self.states.u[k, -first.n :] = axial
        if first.stiffness is not None:
            lengths = first.lengths if len(chains) == 1 else mechanism.parameters.lengths
            stretch = self.states.q[:, -first.n :].reshape(theta.shape)
            check_lengths(lengths, stretch, chosen=chosen)

    def _axial_start(self, k: int) -> tuple[FloatArray, FloatArray]:
        """Return the start of springs that carry what acts on motion `k` at the beginning."""
        chain, mechanism = self.chain(k), self.states.mechanism
        n, places = chain.n, mechanism.places
        state = self.states.q[k], self.states.u[k]
        drives = drives_of(mechanism, self.recipe.of_motion(k))
        drives.check_functions(self._begin, *state)

        def rigid(s: FloatArray, q: FloatArray, u: FloatArray) -> States:
            """Return rigid rods in a state, `s` seconds after the beginning."""
            axial = (own[-n:] for own in state)
            whole = (np.hstack(pair)[None] for pair in zip((q, u), axial, strict=True))
            acting = drives.at(self._begin + s, *whole)[0]
            own = mechanism_of([chain], acting[n + 1 :] if places == 2 else None)
            return States(own._replace(springs=None), q, u, acting[: n + (places > 0)])

        first = rigid(np.zeros(1), *(each[:-n] for each in state))
        return slow_start(chain, first, rigid if self.varying else None)

    def _rows(self, *given: FloatArray) -> list[FloatArray]:
        """Return theta, omega and torque, (n,) each for one motion, or (B, n)."""
        n, members = self.chains[0].n, len(self.chains)
        named = dict(zip(("theta", "omega", "torque"), given, strict=True))
        if self.is_one:
            return [
                each if each.shape == (n,) else _checks.vector(name, each.tolist(), n)
                for name, each in named.items()
            ]
        rows = [*check_states(n, **named)]
        if rows[0].ndim == 1:
            rows = [np.tile(values, (members, 1)) for values in rows]
        if rows[0].ndim != 2 or not len(rows[0]) or (members > 1 and len(rows[0]) != members):
            raise ValueError(
                f"theta, omega and torque must have the shape (B, {n})"
                + (f" for B = {members} chains" if members > 1 else "")
                + f", got {rows[0].shape}"
            )
        return rows

    def chain(self, k: int) -> Chain:
        """Return the chain of motion `k`."""
        return self.chains[k if len(self.chains) > 1 else 0]

    def motion(self, members: slice, *, packed: bool) -> Integration:
        """Return some of the motions as a pack, where constants alone drive them, or one."""
        if packed:
            motion = pack_of(self.states, members, self._settings, method=self.recipe.method)
            motion.members = members
            return motion
        k, states = members.start, self.states
        mechanism, state = states.mechanism.of(np.array([k])), np.hstack([states.q[k], states.u[k]])
        own, named = self.recipe.of_motion(k), None if self.is_one else members
        return motion_of(mechanism, state, self._begin, own, self._callbacks, named)

    def described(self) -> dict[str, Any]:
        """Provenance of the motions, when they have been followed."""
        recipe = self.recipe
        made: dict[str, Any] = {} if self.is_one else {"motions": self.count}
        made |= {"method": recipe.method} | recipe.settings
        for name in (*NAMES, "longest_step"):
            value = getattr(recipe, name)
            if np.ndim(value) == 2 and np.all(value == value[0]):
                value = value[0]
            if value is not None and np.ndim(value) < 2:
                made[name] = described(value, ", compiled" if self._callbacks else ", in Python")
        return made
