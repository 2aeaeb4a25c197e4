"""Policies and controllers as C: one header, which a microcontroller or a simulator compiles."""

from __future__ import annotations

import json
import re
import textwrap
from collections.abc import Iterable, Mapping
from os import PathLike
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym._files import replacing
from npend_gym.envs.config import EnvConfig
from npend_gym.envs.rows import MAX_CART_ENTRY
from npend_gym.export.about import Feedback, described
from npend_gym.rl.controllers.feedback import StateFeedback
from npend_gym.rl.controllers.tracking import PlannedTransition
from npend_gym.rl.policies.checks import check_env
from npend_gym.rl.policies.policy import Policy

_INDENT = "    "


def to_c(
    policy: Policy | Feedback,
    path: str | PathLike[str],
    prefix: str = "npend",
    *,
    relative: bool = False,
) -> None:
    """Write a policy or a controller as a C99 header, which needs no library, allocates nothing.

    Its functions turn measured angles and velocities into torques, and estimate velocities as
    `VelocityEstimator` does. They keep the memory of a policy that has one, and the time of a
    plan. The head of the file names the environment and the time between two calls.

    Parameters
    ----------
    policy : Policy or controller
        Controllers are those of `npend_gym.rl.lqr`, `modal_damping`, `state_feedback` (with a
        gain of your own), `planned_swing_up` and `planned_transition`.
    path : path-like
        Of the header, such as "policy.h".
    prefix : str
        Of every name in it: letters, digits and underscores.
    relative : bool
        Whether sensors show the angle of each rod relative to the rod above it, as encoders in the
        joints do.

    Raises
    ------
    TypeError
        If it is neither a policy nor such a controller.
    ValueError
        If the prefix is no identifier of C, or the policy has no environment. If it observes the
        drawn parameters (`observe_context`), which no sensor measures. If the actions of the
        controller are discrete (`torque_levels`).

    Notes
    -----
    A controller in C clips its actions, as the environment does. Also along a plan it takes
    deviations of angles without whole turns, so that encoders of one turn will do.

    Examples
    --------
    >>> from pathlib import Path
    >>> from npend_gym.envs import EnvConfig
    >>> from npend_gym.export import to_c
    >>> from npend_gym.rl import Policy, lqr
    >>> to_c(Policy.pretrained("swingup-2"), "policy.h", prefix="arm")
    >>> "static inline void arm_policy_act(" in Path("policy.h").read_text()
    True
    >>> to_c(lqr(EnvConfig(n=2, mode="balance")), "lqr.h", prefix="lqr")
    >>> "static inline void lqr_controller_act(" in Path("lqr.h").read_text()
    True
    """
    is_text = isinstance(prefix, str)  # pyright: ignore[reportUnnecessaryIsInstance]
    if not (is_text and re.fullmatch(r"[A-Za-z]\w*", prefix, re.ASCII)):
        raise ValueError(f"prefix must be a letter, then letters, digits or _, got {prefix!r}")
    if isinstance(policy, Policy):
        kind, config = "policy", _config_of(policy)
        fields = _of_network(policy, prefix) | _of_observations(config, prefix)
    else:
        kind, config = "controller", _config_of_controller(policy)
        fields = _of_table(policy, config)
    fields |= _of_hardware(config) | {"kind": kind, "KIND": kind.upper()}
    fields |= {"p": prefix, "P": prefix.upper(), "about": _about(kind, described(policy))}
    fields |= {"relative": int(_checks.truth("relative", relative))}
    fields["body"] = _filled(kind, fields).rstrip()
    with replacing(Path(path)) as file:
        file.write(_filled("header", fields))


def _filled(name: str, fields: Mapping[str, Any]) -> str:
    """Return a template of this folder with its fields."""
    text = Path(__file__).with_name(f"{name}.h.in").read_text("utf-8")
    return Template(text).substitute(fields)


def _config_of(policy: Policy) -> EnvConfig:
    """Return the settings of a policy's environment, checked for what sensors can show."""
    if not policy.env:
        raise ValueError("env of the policy must say for which environment it is made, got {}")
    check_env(policy.env, policy.observed, len(policy.biases[-1]))
    if policy.config.observe_context:
        raise ValueError("observe_context must be False, because sensors do not measure it")
    return policy.config


def _config_of_controller(controller: Any) -> EnvConfig:
    """Return the settings of a controller's environment, checked for what the header computes."""
    if not isinstance(controller, (StateFeedback, PlannedTransition)):
        raise TypeError(
            "policy must be a Policy, or a controller of lqr, modal_damping, state_feedback, "
            f"planned_swing_up or planned_transition, got {_checks.show(controller)}: "
            "rl.state_feedback(config, K) makes one of a gain of your own"
        )
    config = controller.config
    if config.torque_levels is not None:
        raise ValueError(
            "torque_levels must be left out: torques in C are not discrete; got "
            f"{config.torque_levels}"
        )
    return config


def _of_network(policy: Policy, prefix: str) -> dict[str, Any]:
    """Values of the template for the network."""
    sizes = [policy.scale.size, *(bias.size for bias in policy.biases)]
    layers = zip(policy.weights, policy.biases, strict=True)
    numbers = np.concatenate([np.r_[bias, weight.T.ravel()] for weight, bias in layers])
    shifted = "observation[seen]"
    if policy.offset is not None:
        shifted = f"(observation[seen] - {prefix}_offset[k])"
    scaled = f"{shifted} / {prefix}_scale[k]"
    limited = f"{prefix}_clip({scaled}, {_exact(policy.limit)}f)"
    functions = {"clip": f"{prefix}_clip(sum[i], 1.0f)", "relu": "sum[i] < 0.0f ? 0.0f : sum[i]"}
    functions["tanh"] = f"{prefix}_tanh(sum[i])"
    activation, output = functions[policy.activation], functions[policy.output]
    is_last = f"layer == {prefix.upper()}_LAYERS - 1"
    offset = "" if policy.offset is None else _table(policy.offset.ravel(), "f")
    return {
        "frames": len(np.atleast_2d(policy.scale)),
        "remembered": len(policy.biases[-1]) if policy.has_memory else 0,
        "layers": len(policy.weights),
        "sizes": ", ".join(map(str, sizes)),
        "widest": max(sizes),
        "scale": _table(policy.scale.ravel(), "f"),
        "offset": offset and f"static const float {prefix}_offset[] = {{{offset}}};\n",
        "numbers": _table(numbers, "f"),
        "scaled": scaled if np.isinf(policy.limit) else limited,
        "function": output if activation == output else f"{is_last} ? {output} : {activation}",
    }


def _of_observations(config: EnvConfig, prefix: str) -> dict[str, Any]:
    """Values of the template for observations."""
    n, speed, scale = config.n, "speed", ""
    if np.any(config.speed_scale != 1.0):
        speed, values = f"speed / {prefix}_speed_scale[i]", _table(config.speed_scale)
        scale = f"static const double {prefix}_speed_scale[] = {{{values}}}; /* rad/s */\n"
    parts = [f"{n} sines, {n} cosines" if config.with_sines else f"{n} angles"]
    parts += [f"{n} velocities"] if config.observe_velocities else []
    parts += ["the cart"] if config.has_cart else []
    parts += [f"{n} cosines of the goal"] if config.observes_goals else []
    return {
        "observed": config.observed,
        "entries": ", ".join(parts),
        "speed_scale": scale,
        "speed": speed,
        "speed_limit": _exact(config.speed_limit),
        "sines": int(config.with_sines),
        "velocities": int(config.observe_velocities),
        "goals": int(config.observes_goals),
        "rail": _exact(config.rail or 1.0),
        "cart_limit": _exact(MAX_CART_ENTRY),
        "cart_speed_factor": _exact(config.cart_speed_factor),
        "call": ", ".join([
            "theta", "omega" if config.observe_velocities else "0",
            "cart" if config.has_cart else "0", "goal" if config.observes_goals else "0",
        ]),
    }  # fmt: skip


def _of_table(controller: Feedback, config: EnvConfig) -> dict[str, Any]:
    """Values of the template for a controller: in each row a state, actions and gains."""
    if isinstance(controller, StateFeedback):
        rows, phases, wait = [_row_of(controller)], "the state that is held", 0
    else:
        states, actions = controller.nominal
        steps = zip(states[:-1], actions, controller.gains, strict=True)
        rows = [np.concatenate([state, action, gain.ravel()]) for state, action, gain in steps]
        rows = [_row_of(controller.hold_start), *rows, _row_of(controller.hold_goal)]
        phases = "the start that is held, the steps of the plan, the goal that is held"
        wait = round(controller.settle / config.dt)
    return {
        "coordinates": config.state_size // 2,
        "rows": len(rows),
        "phases": phases,
        "wait": wait,
        "table": ",".join(f" {{{_table(row)}}}" for row in rows),
        "call": "theta, omega, cart" if config.has_cart else "theta, omega, 0",
    }


def _row_of(held: StateFeedback) -> FloatArray:
    """Return the row of a controller that holds a state, with the actions zero."""
    return np.concatenate([held.rest, np.zeros(len(held.gain)), held.gain.ravel()])


def _of_hardware(config: EnvConfig) -> dict[str, Any]:
    """Values of the templates for motors and sensors."""
    n = config.n
    motors = [f"torque at joint {k}" if k < n else "force on the cart" for k in config.joints]
    return {
        "rods": n,
        "joints": config.joints.size,
        "motors": ", ".join(motors),
        "motor": int(config.joints[0]),
        "dt": repr(config.dt),
        "limits": _table(config.action_limits),
        "cart": int(config.has_cart),
    }


def _about(kind: str, about: Mapping[str, Any]) -> str:
    """Return the head of the header: what it is, for which environment, and what made it."""
    values = {name: value for name, value in about.items() if name != "npend_gym"}
    lines = [f"A {kind}, written by npend_gym {about['npend_gym']}", ""]
    lines += ["Its environment, in SI units, and what made it:"]
    lines += json.dumps(values, indent=2).splitlines()[1:-1]
    text = "\n".join(" * " + line if line else " *" for line in lines)
    return text.removeprefix(" * ").replace("*/", "* /").replace("/*", "/ *")


def _exact(number: float) -> str:
    """Return a number as a hexadecimal constant of C: its bits."""
    return re.sub(r"\.?0*p", "p", float(number).hex())


def _table(numbers: Iterable[float], suffix: str = "") -> str:
    """Return the numbers as lines of constants."""
    text = ", ".join(_exact(number) + suffix for number in numbers)
    return "\n" + textwrap.fill(
        text, 100, initial_indent=_INDENT, subsequent_indent=_INDENT, break_on_hyphens=False
    )
