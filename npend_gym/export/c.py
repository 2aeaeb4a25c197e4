"""Policies as C: one header, which a microcontroller or a simulator in C compiles."""

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
from npend_gym._files import replacing
from npend_gym._version import __version__
from npend_gym.chain import plain_keywords
from npend_gym.envs.config import EnvConfig
from npend_gym.envs.rows import MAX_CART_ENTRY
from npend_gym.rl.policies.checks import check_env
from npend_gym.rl.policies.policy import Policy

_INDENT = "    "


def to_c(
    policy: Policy, path: str | PathLike[str], prefix: str = "npend", *, relative: bool = False
) -> None:
    """Write a policy as a C99 header, which needs no library and allocates nothing.

    Its functions build the observation from measured angles and velocities, compute the action,
    and turn it into torques. They keep the memory of a policy that has one. The head of the file
    names the environment and the time between two calls.

    Parameters
    ----------
    policy : Policy
    path : path-like
        Of the header, such as "policy.h".
    prefix : str
        Of every name in it: letters, digits and underscores.
    relative : bool
        Whether sensors show the angle of each rod relative to the rod above it, as encoders in the
        joints do.

    Raises
    ------
    ValueError
        If the prefix is no identifier of C, the policy has no environment, or it observes the
        drawn parameters (`observe_context`), which no sensor measures.

    Examples
    --------
    >>> from pathlib import Path
    >>> from npend_gym.export import to_c
    >>> from npend_gym.rl import Policy
    >>> to_c(Policy.pretrained("swingup-2"), "policy.h", prefix="arm")
    >>> "static inline void arm_policy_act(" in Path("policy.h").read_text()
    True
    """
    if not re.fullmatch(r"[A-Za-z]\w*", prefix, re.ASCII):
        raise ValueError(f"prefix must be a letter, then letters, digits or _, got {prefix!r}")
    text = Path(__file__).with_name("policy.h.in").read_text("utf-8")
    fields = _of_network(policy, prefix) | _of_sensors(_config_of(policy))
    fields |= {"p": prefix, "P": prefix.upper(), "about": _about(policy)}
    fields |= {"relative": int(_checks.truth("relative", relative))}
    with replacing(Path(path)) as file:
        file.write(Template(text).substitute(fields))


def _config_of(policy: Policy) -> EnvConfig:
    """Return the settings of a policy's environment, checked for what sensors can show."""
    if not policy.env:
        raise ValueError("env of the policy must say for which environment it is made, got {}")
    check_env(policy.env, policy.observed, len(policy.biases[-1]), trust=True)
    if policy.config.observe_context:
        raise ValueError("observe_context must be False: nobody measures what was drawn")
    return policy.config


def _of_network(policy: Policy, prefix: str) -> dict[str, Any]:
    """Return what the template has of the network."""
    sizes = [policy.scale.size, *(bias.size for bias in policy.biases)]
    layers = zip(policy.weights, policy.biases, strict=True)
    numbers = np.concatenate([np.r_[bias, weight.T.ravel()] for weight, bias in layers])
    shifted = "state->frames[k]"
    if policy.offset is not None:
        shifted = f"(state->frames[k] - {prefix}_offset[k])"
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


def _of_sensors(config: EnvConfig) -> dict[str, Any]:
    """Return what the template has of observations and actions."""
    n = config.n
    parts = [f"{n} sines, {n} cosines" if config.with_sines else f"{n} angles"]
    parts += [f"{n} velocities"] if config.observe_velocities else []
    parts += ["the cart"] if config.has_cart else []
    parts += [f"{n} cosines of the goal"] if config.observes_goals else []
    motors = [f"torque at joint {k}" if k < n else "force on the cart" for k in config.joints]
    return {
        "rods": n,
        "observed": config.observed,
        "entries": ", ".join(parts),
        "joints": config.joints.size,
        "motors": ", ".join(motors),
        "dt": repr(config.dt),
        "limits": _table(config.action_limits),
        "speed_scale": _table(config.speed_scale),
        "speed_limit": _exact(config.speed_limit),
        "sines": int(config.with_sines),
        "velocities": int(config.observe_velocities),
        "cart": int(config.has_cart),
        "goals": int(config.observes_goals),
        "rail": _exact(config.rail or 1.0),
        "cart_limit": _exact(MAX_CART_ENTRY),
        "cart_speed_factor": _exact(config.cart_speed_factor),
        "call": ", ".join([
            "theta", "omega" if config.observe_velocities else "0",
            "cart" if config.has_cart else "0", "goal" if config.observes_goals else "0",
        ]),
    }  # fmt: skip


def _about(policy: Policy) -> str:
    """Return the head of the header: what it is, for which environment, and what made it."""
    lines = [f"A policy, written by npend_gym {__version__}", ""]
    described: dict[str, Mapping[str, Any]] = {
        "Its environment, in SI units": plain_keywords(policy.env),
        "What made it": policy.provenance,
    }
    for title, values in described.items():
        lines += [f"{title}:", *json.dumps(values, indent=2).splitlines(), ""]
    text = "\n".join(" * " + line if line else " *" for line in lines[:-1])
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
