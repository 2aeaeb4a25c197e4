"""Steps of chains and their gradients on the processor, for the functions of torch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym._threads import Crew
from npend_gym.chain import Chain, ChainParameters, check_parameter
from npend_gym.envs import EnvConfig
from npend_gym.physics.arguments import check_limits
from npend_gym.physics.calls import Cut
from npend_gym.physics.kernels.link_terms import count_terms
from npend_gym.physics.mechanism import mechanism_of
from npend_gym.physics.step import Chains, Reached, State, take, vjp
from npend_gym.torch.checks import DivergedError, check_bars


@dataclass(frozen=True, eq=False)
class StepCall:
    """How a step is taken; no tensor is in it."""

    chain: Chain
    joints: tuple[int, ...]
    dt: float
    substeps: int | None = None  # as for `Ensemble.advance`
    max_rotation: float | None = None  # where substeps are as those of an environment
    names: tuple[str, ...] = ()  # of the parameters that are tensors
    own: Chains | None = None  # the chains where no parameter is a tensor
    crew: Crew = field(default_factory=Crew)

    def chains(self, size: int, values: Sequence[Tensor]) -> Chains:
        """Return the chains of this step, refused where values break their rule."""
        if self.own is not None:
            return self.own
        raw = tuple(value.cpu().numpy().tobytes() for value in values)
        return _chains_with(self.chain, self.names, size, raw) if raw else _chains_alike(self.chain)

    def cut(self, chains: Chains) -> Cut:
        """Return how the step is cut."""
        if self.max_rotation is not None and self.substeps is not None:
            return Cut(self.dt, self.substeps, self.max_rotation)
        return chains.cut(self.dt, self.substeps)


def call_of(
    config: EnvConfig, joints: Sequence[int], pieces: int, rows: ChainParameters, crew: Crew
) -> StepCall:
    """Return how an environment takes a piece of a step of chains with the parameters `rows`."""
    chain, cut = config.with_all_features, (config.min_substeps // pieces, config.max_rotation)
    own = _chains_of(chain, rows)
    return StepCall(chain, tuple(joints), config.dt / pieces, *cut, own=own, crew=crew)


def _chains_of(chain: Chain, rows: ChainParameters | None = None) -> Chains:
    """Return `chain`, or others of its kind, for steps."""
    own, base = chain.repeated(1), mechanism_of([chain]).base
    return Chains(own if rows is None else rows, count_terms(own, base), base)


@lru_cache(maxsize=64)
def _chains_alike(chain: Chain) -> Chains:
    return _chains_of(chain)


@lru_cache(maxsize=8)  # one step after another has the same, in several threads
def _chains_with(chain: Chain, names: tuple[str, ...], size: int, raw: tuple[bytes, ...]) -> Chains:
    """Return chains with other values of parameters, (size, n) or (size,), as bytes."""
    values = {
        name: np.frombuffer(each).reshape((size,) if name == "gravity" else (size, chain.n))
        for name, each in zip(names, raw, strict=True)
    }
    _check(values)
    return _chains_of(chain, chain.repeated(size, **values))


def _check(values: Mapping[str, FloatArray]) -> None:
    """Raise an error that names the first chain whose parameters break their rule."""
    for name, value in values.items():
        refusal = _refusal(name, value)
        if refusal is not None:
            lane = next(k for k, row in enumerate(value) if _refusal(name, row) is not None)
            raise ValueError(
                f"{name} of chain {lane} break their rule: {refusal}; where an optimiser moves "
                f"them, let it move their logarithm: {name} = log_{name}.exp()"
            ) from refusal


def _refusal(name: str, value: FloatArray) -> ValueError | None:
    """Return the error of a parameter that breaks its rule, or None."""
    try:
        check_parameter(name, _checks.array(name, value))
    except ValueError as error:
        return error
    return None


def forward(call: StepCall, chains: Chains, state: Sequence[Tensor]) -> tuple[Tensor, Tensor]:
    """Return all coordinates and rates, (B, m), after a step from `state`: q, u and loads."""
    begin = _state(call, state)
    reached = take(chains, begin, call.cut(chains), call.crew)
    _check_reached(reached, begin, call)
    q, u = reached.states
    return torch.from_numpy(q), torch.from_numpy(u)


def backward(
    call: StepCall, chains: Chains, state: Sequence[Tensor], bars: Sequence[Tensor],
    names: Sequence[str],
) -> tuple[list[Tensor], dict[str, Tensor]]:  # fmt: skip
    """Return the gradient by `state` and by the parameters that are named, from `bars`.

    These are the gradients by the coordinates and rates to which the step leads.
    """
    begin, back = _state(call, state), [bar.numpy() for bar in bars]
    found = vjp(chains, begin, call.cut(chains), back, names, call.crew)
    reached, by_state, by_loads, by_name = found
    if reached.lost.any():
        check_bars(back)
    _check_reached(reached, begin, call)
    of_state = [torch.from_numpy(x) for x in (*by_state, by_loads)]
    return of_state, {name: torch.from_numpy(x) for name, x in by_name.items()}


def _state(call: StepCall, state: Sequence[Tensor]) -> State:
    inputs = call.joints if call.chain.base is None else (*call.joints, call.chain.n)
    q, u, loads = (x.numpy() for x in state)
    return State(q, u, loads, np.array(inputs, np.int64))


def _check_reached(reached: Reached, begin: State, call: StepCall) -> None:
    """Raise an error where a step began, or led, out of bounds."""
    if not reached.lost.any():
        return
    n, motors = call.chain.n, len(call.joints)
    theta, omega = begin.q[:, :n], begin.u[:, :n]
    torque, force = begin.loads[:, :motors], begin.loads[:, motors:]
    for name, x in (("theta", theta), ("omega", omega), ("torque", torque), ("force", force)):
        _checks.array(name, x)
    check_limits(theta, omega)
    raise DivergedError(np.flatnonzero(reached.lost).tolist())
