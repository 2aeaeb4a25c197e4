"""Models of Stable-Baselines3 and SBX as the numbers of a `Policy`."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from npend_gym import _checks
from npend_gym._provenance import provenance
from npend_gym.rl.evaluation.models import check_space
from npend_gym.rl.evaluation.normalisation import check_statistics, trained_through
from npend_gym.rl.evaluation.settings import EnvLike, env_of, setting_of

_ACTIVATIONS = {"Tanh": "tanh", "ReLU": "relu"}  # by the class of torch.nn
_RENORM_EPSILON = 0.001  # of BatchRenorm in SBX and sb3-contrib


def policy_fields(model: Any, env: EnvLike | None) -> dict[str, Any]:
    """Return the attributes of the `Policy` that acts as a model does, see `Policy.from_sb3`."""
    if not hasattr(model, "policy"):
        raise TypeError(f"model must be one of Stable-Baselines3, got {_checks.show(model)}")
    trained_in = getattr(model, "get_env", lambda: None)()
    if env is None and trained_in is None:
        raise ValueError(
            "env must be given for a model without its environment: from_sb3(model, env), with "
            "the id or the keywords of gym.make_vec"
        )
    setting = setting_of(trained_in if env is None else env)
    config = setting.config
    if config.goal_env:
        raise ValueError("goal_env must be False, because policies observe one array")
    network = _network_of(model)
    scale, offset = np.ones(config.observed, np.float32), None
    limit = np.inf
    wrappers = setting.wrappers or trained_through(model, config)
    for wrapper in wrappers:
        statistics: Any = getattr(wrapper, "obs_rms", None)
        if type(wrapper).__name__ != "VecNormalize" or isinstance(statistics, dict):
            raise ValueError(
                f"the model must observe through VecNormalize alone, got {type(wrapper).__name__}: "
                "evaluate and robustness take the model itself"
            )
        if wrapper.norm_obs:
            scale = np.sqrt(statistics.var + wrapper.epsilon).astype(np.float32)
            offset, limit = statistics.mean.astype(np.float32), float(wrapper.clip_obs)
    check_statistics(model, wrappers)
    check_space(model, config, wrappers)
    made = {"algorithm": type(model).__name__, "timesteps": int(model.num_timesteps)}
    return network | {
        "scale": scale,
        "offset": offset,
        "limit": limit,
        "env": env_of(config),
        "provenance": provenance(made, model.seed),
    }


def _network_of(model: Any) -> dict[str, Any]:
    """Return the layers that map observations to the mean action, as attributes of `Policy`."""
    policy, name = model.policy, type(model).__name__
    extractor = type(getattr(policy, "features_extractor", None)).__name__
    if hasattr(policy, "lstm_actor"):
        raise _not_layers(name, "an LSTM")
    if extractor not in ("FlattenExtractor", "NoneType"):
        raise _not_layers(name, extractor)
    if not hasattr(model.action_space, "low"):
        raise _not_layers(name, "discrete actions")
    low, high = model.action_space.low, model.action_space.high
    if np.any(low != -1.0) or np.any(high != 1.0):
        raise _not_layers(name, f"actions from {_checks.show(low)} to {_checks.show(high)}")
    if hasattr(policy, "actor_state"):
        return _jax_layers(policy, name)
    return _torch_layers(policy, name)


def _torch_layers(policy: Any, name: str) -> dict[str, Any]:
    """Return the layers of a policy of Stable-Baselines3 or sb3-contrib."""
    if hasattr(policy, "mlp_extractor"):
        modules: list[Any] = [*policy.mlp_extractor.policy_net, policy.action_net]
    elif not hasattr(policy, "actor"):  # ARS of sb3-contrib
        modules = [*getattr(policy, "action_net", ())]
    else:
        last = policy.actor.mu
        one = type(last).__name__ == "Linear"
        modules = [*getattr(policy.actor, "latent_pi", ()), *([last] if one else last)]
    kinds = [type(module).__name__ for module in modules]
    if policy.squash_output and kinds[-1:] == ["Tanh"]:  # a layer in TD3 and ARS
        modules, kinds = modules[:-1], kinds[:-1]
    plain = [kind for kind in kinds if kind != "BatchRenorm1d"]  # of CrossQ, before layers
    linear, between = plain[::2], set(plain[1::2])
    if set(linear) != {"Linear"} or plain[-1] != "Linear" or not between <= set(_ACTIVATIONS):
        raise _not_layers(name, ", ".join(kinds) or type(policy).__name__)
    if any(a == "BatchRenorm1d" and b != "Linear" for a, b in pairwise(kinds)):
        raise _not_layers(name, ", ".join(kinds))
    if len(between) > 1:
        raise _not_layers(name, "two kinds of activations")
    layers: list[tuple[Any, Any]] = []
    norm: Any = None
    for module, kind in zip(modules, kinds, strict=True):
        of = {k: v.detach().cpu().numpy().copy() for k, v in module.state_dict().items()}
        if kind == "BatchRenorm1d":
            norm = of["scale"], of["bias"], of["ra_mean"], of["ra_var"]
        elif kind == "Linear":  # those of ARS may have no bias
            weight = of["weight"]
            layers.append(_folded(weight, of.get("bias", np.zeros(len(weight), "f4")), norm))
            norm = None
    return _fields(layers, _ACTIVATIONS[between.pop()] if between else "tanh", policy)


def _jax_layers(policy: Any, name: str) -> dict[str, Any]:
    """Return the layers of a policy of SBX."""
    actor, state = policy.actor, policy.actor_state
    activation = actor.activation_fn.__name__
    numbers = state.params.get("params", state.params)
    if unknown := {key.rpartition("_")[0] for key in numbers} - {"Dense", "BatchRenorm", "log"}:
        raise _not_layers(name, ", ".join(sorted(unknown)))
    if activation not in _ACTIVATIONS.values():
        raise _not_layers(name, activation)
    layers: list[tuple[Any, Any]] = []
    norm: Any = None
    for k in range(len(actor.net_arch) + 1):  # the next one is of the deviation
        if getattr(actor, "use_batch_norm", False):
            shown, seen = numbers[f"BatchRenorm_{k}"], state.batch_stats[f"BatchRenorm_{k}"]
            parts = shown["scale"], shown["bias"], seen["mean"], seen["var"]
            norm = [*map(np.asarray, parts)]
        dense = numbers[f"Dense_{k}"]
        layers.append(_folded(np.array(dense["kernel"]).T, np.array(dense["bias"]), norm))
    return _fields(layers, activation, policy)


def _folded(weight: Any, bias: Any, norm: Any) -> tuple[Any, Any]:
    """Return the weight and bias of a layer with the normalisation before it within them."""
    if norm is None:
        return weight, bias
    scale, shift, mean, variance = norm
    factor = scale / np.sqrt(variance + _RENORM_EPSILON)
    return weight * factor, bias + weight @ (shift - mean * factor)


def _fields(layers: list[tuple[Any, Any]], activation: str, policy: Any) -> dict[str, Any]:
    weights, biases = zip(*layers, strict=True)
    return {
        "weights": [np.ascontiguousarray(weight) for weight in weights],
        "biases": [*biases],
        "activation": activation,
        "output": "tanh" if policy.squash_output else "clip",
    }


def _not_layers(name: str, what: str) -> ValueError:
    return ValueError(
        f"model must be linear layers with tanh or ReLU between them, got {name} with {what}: "
        "evaluate and robustness take the model itself"
    )
