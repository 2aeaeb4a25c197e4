"""The environments' step for a browser: its kernels as WebAssembly, and where the numbers stand."""

from __future__ import annotations

import math
from typing import Any

from npend_gym._checks import FloatArray
from npend_gym.chain import Chain, ChainParameters
from npend_gym.compiled.wasm import wasm_module
from npend_gym.envs.config import EnvConfig
from npend_gym.envs.kernels import step_one
from npend_gym.envs.rows import NUMBER_OF, Episode, Flag, Output, Setting, Task, Wiring
from npend_gym.envs.starts import begin_one
from npend_gym.physics.kernels.layout import RK4, Member, Rod, Timing, Turn
from npend_gym.physics.kernels.link_terms import BASE_AT, count_terms
from npend_gym.physics.kernels.member_rows import new_model
from npend_gym.physics.kernels.rk4 import RK4_ROWS
from npend_gym.physics.mechanism import mechanism_of
from npend_gym.physics.substeps import (
    MAX_PHASE,
    MAX_ROTATION,
    default_substeps,
    substeps_on_cart,
)

_RODS = "float64[:, :, ::1]"


def step_module(chain: Chain) -> bytes:
    """Return the WebAssembly module of one environment with chains of the kind of `chain`.

    Point masses, links, and machines or carts have modules of their own. A module exports
    `begin_one` and `step_one`, to be called as `wasm_module` says. The first call for a kind on a
    machine compiles, for about a minute.
    """
    terms = len(_model_of(chain))
    model = f"UniTuple({_RODS}, {terms})" if terms else "none"
    # `members`, `rods`, model and record of one chain
    memory = f"float64[:, ::1], {_RODS}, {model}, UniTuple({_RODS}, 1)"
    return wasm_module(
        {
            begin_one: f"void({memory}, float64[:, ::1])",
            step_one: f"void({memory}, float64[:, ::1], float32[:, ::1], float64[:, ::1], "
            "boolean[:, ::1], float64[::1], float64[:, ::1], none, none, none, float64[::1], "
            "float64[:, ::1])",
        }
    )


def step_layout(chain: Chain) -> dict[str, Any]:
    """Return the rows, or entries, of the arrays that the kernels take, by their names.

    "Member" has the rows of Episode and Setting too. The number of rows of the scratch follows, and
    rows and columns of each array of the model that `chain` needs.
    """
    fields = Rod, Turn, Timing, Output, Flag, Task, Wiring
    layout: dict[str, Any] = {
        type(each).__name__.removesuffix("Fields"): each._asdict() for each in fields
    }
    layout["Member"] = Member._asdict() | Episode._asdict() | Setting._asdict()
    layout["Parameter"] = {name: row for row, name in enumerate(ChainParameters._fields)}
    terms = [list(part.shape[1:]) for part in _model_of(chain)]
    return layout | {"scratchRows": RK4 + RK4_ROWS, "terms": terms}


def _model_of(chain: Chain) -> tuple[FloatArray, ...]:
    """Return the arrays of the model, (1, rows, columns) each, with the base alone written."""
    own, base = chain.repeated(1), mechanism_of([chain]).base
    return new_model(count_terms(own, base), chain.n, 1, 1, base) or ()


def step_chain(chain: Chain) -> dict[str, Any]:
    """Return the parameters of a chain as plain numbers, by the names of `ChainParameters`.

    An infinite gear ratio is None. Beside them stand `hasBobs` and `rate`, substeps over 16 [1/s],
    and of a chain on a cart its mass `cart` and the rows `base` of `link_terms.Base`.
    """
    plain = {name: row[0].tolist() for name, row in chain.repeated(1)._asdict().items()}
    plain["gear"] = [None if math.isinf(gear) else gear for gear in plain["gear"]]
    substeps, cart = default_substeps(chain, 1.0), chain.base
    if cart is not None:
        substeps = substeps_on_cart(substeps, chain, 1.0, 1.0 / cart.mass, cart.damping)
        plain |= {"cart": cart.mass, "base": _model_of(chain)[BASE_AT].ravel().tolist()}
    return plain | {"hasBobs": chain.has_bobs, "rate": MAX_PHASE * substeps}


def step_constants(config: EnvConfig) -> dict[str, Any]:
    """Return the constants of the physics and of the task that a step receives.

    Substeps are chosen by `phase` and `rotation` [rad]. The "torque" of the task is its limit over
    `Chain.lifting_energy`.
    """
    task = {
        "mode": NUMBER_OF[type(config.mode)],
        "dt": config.dt,
        "hold": config.mode.hold,
        "torque": config.max_torque / config.chain.lifting_energy,
        "speedLimit": config.speed_limit,
        "spread": config.spread,
    }
    return {"phase": MAX_PHASE, "rotation": MAX_ROTATION, "task": task}
