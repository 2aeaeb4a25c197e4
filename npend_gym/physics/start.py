"""Motions at their beginning: the arguments of `simulate`, checked."""

from __future__ import annotations

from typing import Any

import numpy as np

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain
from npend_gym.compiled.callbacks import Callback
from npend_gym.physics.arguments import check_limits, check_states, check_torque
from npend_gym.physics.drives import drives_of
from npend_gym.physics.equations import assembled, slow_start
from npend_gym.physics.functions import NAMES
from npend_gym.physics.mechanism import Mechanism, mechanism_of
from npend_gym.physics.recipe import AT_REST, Function, Recipe
from npend_gym.physics.signals import Signal, varies


class Start:
    """Motions at their beginning: mechanism, state and drives of each, checked."""

    def __init__(
        self,
        chains: tuple[Chain, ...],
        theta: FloatArray,
        omega: FloatArray,
        drives: dict[str, Any],
        state: dict[str, Any],
        begin: float,
        *,
        one: bool,
    ) -> None:
        self.chains, first = chains, chains[0]
        self.callbacks = dict[Any, Callback]()  # functions as machine code, for all motions
        self.varying = {name: each for name, each in drives.items() if varies(each)}
        if "force" in self.varying and first.base is None:
            raise ValueError("force acts on a cart: the chain must have base=Cart(mass)")
        accelerated = drives["pivot_acceleration"]
        if "pivot_acceleration" in self.varying:
            accelerated = AT_REST
        constant = {name: None if name in self.varying else drives[name] for name in drives}
        constant["force"] = 0.0 if "force" in self.varying else drives["force"]
        torque = check_torque(constant["torque"], first.n)
        theta, omega, torque = self._rows(theta, omega, torque, one=one)
        check_limits(theta, omega)
        given: dict[str, Any] = {"force": constant["force"], "pivot_acceleration": accelerated}
        states = assembled(first, theta, omega, torque, **given, **state)
        self.mechanism = states.mechanism
        pair = None if accelerated is None else np.asarray(accelerated, float)
        if len(chains) > 1:
            self.mechanism = mechanism_of(chains, pair)
        self.accelerated = pair
        size = self.mechanism.size
        self.q, self.u = states.q.reshape(-1, size), states.u.reshape(-1, size)
        self.loads = states.loads.reshape(-1, states.loads.shape[-1])
        self.count = len(self.q)
        chosen = first.stiffness is not None and state["stretch"] is None
        if chosen and (self.varying or len(chains) > 1):
            for k in range(self.count):
                self.q[k, -first.n :], self.u[k, -first.n :] = self._axial_start(k, begin)

    def _axial_start(self, k: int, begin: float) -> tuple[FloatArray, FloatArray]:
        """Return the start of springs that carry what acts on motion `k` at the beginning."""
        n, places = self.chains[0].n, self.mechanism.places
        nothing = dict(zip(NAMES, (np.zeros(n), 0.0, None), strict=True))
        drives = drives_of(n, places > 0, nothing | self.varying)
        drives.check_functions(begin, self.q[k], self.u[k])
        acting = drives.at(np.array([begin]), self.q[k : k + 1], self.u[k : k + 1])[0]
        acting[: self.loads.shape[1]] += self.loads[k]
        shaken = "pivot_acceleration" in self.varying
        return slow_start(
            self.chain(k), self.q[k, :n], self.u[k, :n], acting[:n],
            acting[n] if places == 1 else 0.0, self.u[k, n : n + places],
            acting[n + 1 :] if shaken else self.accelerated,
        )  # fmt: skip

    def _rows(
        self, theta: FloatArray, omega: FloatArray, torque: FloatArray, *, one: bool
    ) -> tuple[FloatArray, ...]:
        """Return theta, omega and torque, (n,) each for one motion, or (B, n)."""
        n, members = self.chains[0].n, len(self.chains)
        if one:
            named = {"theta": theta, "omega": omega, "torque": torque}
            rows = [
                each if each.shape == (n,) else _checks.vector(name, each.tolist(), n)
                for name, each in named.items()
            ]
        else:
            rows = [*check_states(n, theta=theta, omega=omega, torque=torque)]
            if rows[0].ndim == 1:
                rows = [np.tile(values, (members, 1)) for values in rows]
            if rows[0].ndim != 2 or not len(rows[0]) or (members > 1 and len(rows[0]) != members):
                raise ValueError(
                    f"theta, omega and torque must have the shape (B, {n})"
                    + (f" for B = {members} chains" if members > 1 else "")
                    + f", got {rows[0].shape}"
                )
        return tuple(rows)

    def chain(self, k: int) -> Chain:
        """Return the chain of motion `k`."""
        return self.chains[k if len(self.chains) > 1 else 0]

    def one(self, k: int) -> Mechanism:
        """Return the mechanism of motion `k`."""
        return self.mechanism.of(np.array([k]))

    def recipe(self, settings: dict[str, float], k: int | None = None) -> Recipe:
        """Return how the steps of motion `k`, or of all, are taken."""
        n, rows = self.chains[0].n, slice(None) if k is None else k
        loads = self.loads[rows]
        on_cart = self.mechanism.places == 1
        given: dict[str, Any] = {
            "torque": loads[..., :n].copy(),
            "force": 0.0 if not on_cart else loads[..., n].copy() if k is None else float(loads[n]),
            "pivot_acceleration": self.accelerated,
        }
        for name, each in self.varying.items():
            given[name] = each if isinstance(each, (Signal, Function)) else Function(each)
        return Recipe("dop853" if "rtol" in settings else "rk4", settings, **given)

    def described(self, recipe: Recipe) -> dict[str, Any]:
        """Return what made a motion, for its provenance."""
        return {"method": recipe.method, **recipe.settings} | {
            name: _plain(value)
            for name in NAMES
            for value in [getattr(recipe, name)]
            if value is not None and not varies(value) and np.ndim(value) < 2
        }


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else value
