"""Steps of chains and their gradients, arrays in and arrays out, for the functions of torch."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import Cart, Chain, ChainParameters, check_parameter
from npend_gym.compiled.sincos import MAX_ANGLE
from npend_gym.envs.config import EnvConfig
from npend_gym.physics import DifferentiableEnsemble, StepGradient
from npend_gym.physics.kernels.layout import MAX_SPEED, Rod
from npend_gym.physics.memory import Plan
from npend_gym.physics.substeps import chain_of
from npend_gym.torch.divergence import DivergedError, check_bars

_MAX_ENSEMBLES = 16  # of different sizes, that are kept
_ONE_AT_A_TIME = threading.RLock()  # ensembles are written before each call


class _Lanes(DifferentiableEnsemble):
    """An ensemble whose steps may be cut as those of an environment."""

    rows: ChainParameters | None = None  # those that were written last
    timing: tuple[int, float] | None = None  # least number of substeps, and largest rotation

    def _check_step(self, dt: float, substeps: int | None) -> Plan:
        if self.timing is None:
            return super()._check_step(dt, substeps)
        key = dt, *self.timing
        if key not in self._plans:
            self._plans = {key: self._memory.plan(*key)}
        return self._plans[key]

    def put(self, theta: FloatArray, omega: FloatArray) -> None:
        """Put all members into states, as `set_state` does, but begin no measurements."""
        memory, bounds = self._intact, ((theta, MAX_ANGLE), (omega, MAX_SPEED))
        if not all(np.abs(x).max(initial=0.0) <= limit for x, limit in bounds):  # NaN is not
            self.set_state(slice(None), theta[:, : self.n], omega[:, : self.n])  # names it
        for field, values in ((Rod.THETA, theta), (Rod.OMEGA, omega)):
            memory.fill(memory.per_rod(field), values[:, : self.n])
            if self._has_cart:
                memory.fill(memory.of_base(field), values[:, self.n])

    def reached(self) -> tuple[FloatArray, FloatArray]:
        """Return all coordinates and their rates, (B, m) each."""
        states = self.theta, self.omega
        if not self._has_cart:
            return states
        first, second = (np.column_stack(pair) for pair in zip(states, self.cart, strict=True))
        return first, second


def env_steps(config: EnvConfig, threads: int, pieces: int | None) -> CompiledSteps:
    """Return the steps of an environment, or of the `pieces` into which its motors divide one.

    Loads are on the joints with a motor, or on all with `pieces`, and on the cart.
    """
    chain, n = chain_of(config.randomization.richest, 0), config.n
    if config.cart_mass is not None:
        base = Cart(config.cart_mass, config.rail_damping)
        chain = Chain.from_dict(chain.as_dict() | {"base": base})
    joints: list[int] = config.joints[config.joints < n].tolist() or [0]
    if pieces is not None:
        joints = list(range(n))
    timing = config.min_substeps // (pieces or 1), config.max_rotation
    return CompiledSteps(chain, joints, threads, timing)


class CompiledSteps:
    """Steps of any number of chains of one kind; an ensemble for each number is kept.

    Parameters
    ----------
    chain : Chain
        Of the kind of all chains, and the chain itself where no other parameters are given.
    joints : sequence of int
        Joints with a torque.
    threads : int
    timing : (int, float), optional
        The least number of substeps of a step, and the rotation that divides one [rad], where these
        are not as in `Ensemble.advance`.
    """

    def __init__(
        self,
        chain: Chain,
        joints: Sequence[int] = (0,),
        threads: int = 1,
        timing: tuple[int, float] | None = None,
    ) -> None:
        self.chain, self.joints, self.threads, self.timing = chain, joints, threads, timing
        self._own = chain.repeated(1)
        self._changed: dict[int, tuple[dict[str, FloatArray], ChainParameters]] = {}
        self._ensembles: dict[int, _Lanes] = {}
        self._on_gpu: Any = None

    @property
    def on_gpu(self) -> Any:
        """The same for tensors on a GPU: `DeviceSteps`."""
        if self._on_gpu is None:
            from npend_gym.torch.device_steps import DeviceSteps

            self._on_gpu = DeviceSteps(self.chain, self.joints, self.timing)
        return self._on_gpu

    @property
    def n(self) -> int:
        """Number of rods."""
        return self.chain.n

    def chains(self, size: int, values: Mapping[str, FloatArray]) -> ChainParameters:
        """Return the parameters of chains with some `values`, (size, n) or (size,), by name.

        Raises
        ------
        ValueError
            If one breaks its rule, with the lane.
        """
        if not values:
            return self._own
        last = self._changed.get(size)
        if last is not None and _same(last[0], values):
            return last[1]
        for name, value in values.items():
            _check_lanes(name, value)
        copies = {name: value.copy() for name, value in values.items()}
        rows = self.chain.repeated(size, **copies)
        self._changed = {size: (copies, rows)}
        return rows

    def forward(
        self, rows: ChainParameters, state: Sequence[FloatArray], dt: float, substeps: int | None
    ) -> tuple[FloatArray, FloatArray]:
        """Return all coordinates and rates, (B, m), after a step from `state`: q, u and loads."""
        with _ONE_AT_A_TIME:
            ensemble = self._ensemble(rows, *state[:2])
            try:
                ensemble.advance(dt=dt, substeps=substeps, **self._loads(state[2]))
            except BaseException:
                self._ensembles.clear()  # one that was interrupted cannot be used again
                raise
            lost: list[int] = np.flatnonzero(ensemble.diverged).tolist()
            if lost:
                self._ensembles.clear()  # it would remain so
                raise DivergedError(lost)
            return ensemble.reached()

    def backward(
        self,
        rows: ChainParameters,
        state: Sequence[FloatArray],
        bars: Sequence[FloatArray],
        dt: float,
        substeps: int | None,
        names: Sequence[str],
    ) -> StepGradient:
        """Return the gradient by what a step began with, from `bars`, those by where it led."""
        check_bars(bars)
        with _ONE_AT_A_TIME:
            ensemble = self._ensemble(rows, *state[:2])
            theta_bar, omega_bar = bars
            try:
                return ensemble.step_vjp(
                    dt=dt, substeps=substeps, theta_bar=theta_bar, omega_bar=omega_bar,
                    parameters=names, **self._loads(state[2]),
                )  # fmt: skip
            except BaseException:
                self._ensembles.clear()
                raise

    def _loads(self, inputs: FloatArray) -> dict[str, FloatArray]:
        """Return torques on joints, and the force on a cart, which stands after them."""
        if self.chain.base is None:
            return {"torque": inputs}
        return {"torque": inputs[:, :-1], "force": inputs[:, -1]}

    def _ensemble(self, rows: ChainParameters, theta: FloatArray, omega: FloatArray) -> _Lanes:
        size = len(theta)
        if size not in self._ensembles:
            if len(self._ensembles) == _MAX_ENSEMBLES:
                self._ensembles.pop(next(iter(self._ensembles))).close()
            made = _Lanes(self.chain, size, joints=self.joints, threads=self.threads)
            made.timing, made.rows = self.timing, self._own
            self._ensembles[size] = made
        ensemble = self._ensembles[size]
        if rows is not ensemble.rows:
            lanes = len(rows.masses)
            if size % lanes > 0:
                raise ValueError(f"there are parameters of {lanes} chains for {size} states")
            each = np.resize(np.arange(lanes), size)
            ensemble.set_chain(slice(None), ChainParameters(*(field[each] for field in rows)))
            ensemble.rows = rows
        ensemble.put(theta, omega)
        return ensemble

    def close(self) -> None:
        """End the threads of all ensembles."""
        while self._ensembles:
            self._ensembles.popitem()[1].close()

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_ensembles": {}}


def _same(a: Mapping[str, NDArray[Any]], b: Mapping[str, NDArray[Any]]) -> bool:
    return a.keys() == b.keys() and all(np.array_equal(a[name], b[name]) for name in a)


def _check_lanes(name: str, value: FloatArray) -> None:
    """Refuse a parameter that breaks its rule, and say in which lane and what helps."""
    _checks.choice("parameter", name, ChainParameters._fields)
    try:
        check_parameter(name, _checks.array(name, value))
    except ValueError as error:
        lane = next(k for k, row in enumerate(value) if _is_broken(name, row))
        raise ValueError(
            f"{name} of lane {lane} break their rule: {error}; where an optimiser moves them, let "
            f"it move their logarithm: {name} = log_{name}.exp()"
        ) from error


def _is_broken(name: str, value: FloatArray) -> bool:
    try:
        check_parameter(name, _checks.array(name, value))
    except ValueError:
        return True
    return False
