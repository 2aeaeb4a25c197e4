"""Steps of chains and their gradients on the processor, for the functions of torch."""

from __future__ import annotations

import threading
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain, ChainParameters, check_parameter
from npend_gym.compiled.sincos import MAX_ANGLE
from npend_gym.physics import DifferentiableEnsemble
from npend_gym.physics.kernels.layout import MAX_SPEED, Rod
from npend_gym.physics.memory import Plan
from npend_gym.torch import device_steps
from npend_gym.torch.checks import DivergedError, check_bars
from npend_gym.torch.device_steps import DeviceSteps

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
        memory, every = self._intact, np.arange(self._coordinates)
        return memory.read_at(Rod.THETA, every), memory.read_at(Rod.OMEGA, every)


class CompiledSteps:
    """Steps of any number of chains of one kind; an ensemble for each number is kept.

    The chains are like `chain` where no other parameters are given. `timing` has the least number
    of substeps, and the rotation that divides one [rad], where these are not as in
    `Ensemble.advance`.
    """

    def __init__(
        self, chain: Chain, joints: Sequence[int] = (0,), threads: int = 1,
        timing: tuple[int, float] | None = None,
    ) -> None:  # fmt: skip
        self.chain: Chain = chain
        self.joints: Sequence[int] = joints
        self.threads: int = threads
        self.timing: tuple[int, float] | None = timing
        self._own = chain.repeated(1)
        self._changed: dict[int, tuple[dict[str, FloatArray], ChainParameters]] = {}
        self._ensembles: dict[int, _Lanes] = {}
        self._on_gpu: DeviceSteps | None = None

    def where(self, tensor: Tensor) -> CompiledSteps | DeviceSteps:
        """The steps for the device of a tensor: `DeviceSteps` on a GPU."""
        if not device_steps.on_gpu(tensor):
            return self
        self._on_gpu = self._on_gpu or DeviceSteps(self.chain, self.joints, self.timing)
        return self._on_gpu

    def chains(self, size: int, values: Mapping[str, FloatArray]) -> ChainParameters:
        """Return the parameters of chains with some `values`, (size, n) or (size,), by name."""
        if not values:
            return self._own
        last = self._changed.get(size)
        if last is not None and _same(last[0], values):
            return last[1]
        for name, value in values.items():
            refusal = _refusal(name, value)
            if refusal is not None:
                lane = next(k for k, row in enumerate(value) if _refusal(name, row) is not None)
                raise ValueError(
                    f"{name} of lane {lane} break their rule: {refusal}; where an optimiser moves "
                    f"them, let it move their logarithm: {name} = log_{name}.exp()"
                ) from refusal
        copies = {name: value.copy() for name, value in values.items()}
        rows = self.chain.repeated(size, **copies)
        self._changed = {size: (copies, rows)}
        return rows

    def forward(
        self, rows: ChainParameters, state: Sequence[Tensor], dt: float, substeps: int | None
    ) -> tuple[Tensor, Tensor]:
        """Return all coordinates and rates, (B, m), after a step from `state`: q, u and loads."""
        with self._lanes_at(rows, state) as (lanes, loads):
            lanes.advance(dt=dt, substeps=substeps, **loads)
            lost: list[int] = np.flatnonzero(lanes.diverged).tolist()
            if lost:  # they would remain so
                raise DivergedError(lost)
            q, u = lanes.reached()
            return torch.from_numpy(q), torch.from_numpy(u)

    def backward(
        self, rows: ChainParameters, state: Sequence[Tensor], bars: Sequence[Tensor], dt: float,
        substeps: int | None, names: Sequence[str],
    ) -> tuple[list[Tensor], dict[str, Tensor]]:  # fmt: skip
        """Return the gradient by `state` and by the parameters that are named, from `bars`.

        These are the gradients by the coordinates and rates to which the step leads.
        """
        theta_bar, omega_bar = (bar.numpy() for bar in bars)
        check_bars([theta_bar, omega_bar])
        with self._lanes_at(rows, state) as (lanes, loads):
            found = lanes.step_vjp(
                dt=dt, substeps=substeps, theta_bar=theta_bar, omega_bar=omega_bar,
                parameters=names, **loads,
            )  # fmt: skip
        of_state = [found.by_theta, found.by_omega, found.by_torque]
        by_name = {name: torch.from_numpy(x) for name, x in found.by_parameters.items()}
        return [torch.from_numpy(x) for x in of_state], by_name

    @contextmanager
    def _lanes_at(
        self, rows: ChainParameters, state: Sequence[Tensor]
    ) -> Generator[tuple[_Lanes, dict[str, FloatArray]]]:
        """Lend the ensemble for states, put into them, and its loads: torques and a cart's force.

        One that an error leaves cannot be used again.
        """
        theta, omega, inputs = (x.numpy() for x in state)
        loads = {"torque": inputs}
        if self.chain.base is not None:
            loads = {"torque": inputs[:, :-1], "force": inputs[:, -1]}
        with _ONE_AT_A_TIME:
            lanes = self._ensemble(rows, theta, omega)
            try:
                yield lanes, loads
            except BaseException:
                self._ensembles.clear()
                raise

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


def _refusal(name: str, value: FloatArray) -> ValueError | None:
    """Return the error of a parameter that breaks its rule, or None."""
    try:
        check_parameter(name, _checks.array(name, value))
    except ValueError as error:
        return error
    return None
