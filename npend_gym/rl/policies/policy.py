"""Small trained policies as plain numbers: saved and loaded without executing anything."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym._extras import require
from npend_gym.chain import plain_keywords
from npend_gym.rl.policies.checks import check_about, check_env, check_trust
from npend_gym.rl.policies.files import (
    POLICY_FILE,
    Float32Array,
    pretrained_path,
    read_policy,
    write_policy,
)
from npend_gym.rl.policies.history import History
from npend_gym.rl.policies.network import (
    USUAL,
    arrays_of,
    check_functions,
    check_network,
    dense_layers,
    forward,
    layers_of,
    numbers_of,
)

if TYPE_CHECKING:
    from npend_gym.envs.config import EnvConfig


@dataclass(frozen=True, repr=False, eq=False)
class Policy:
    """A network from observations to the mean action, in NumPy.

    `env` names its observation, most often "sincos"; the default of ``npend/...`` is "scaled"::

        policy = Policy.pretrained("swingup-2")
        env = gym.make("npend/SwingUp-v1", **policy.env)

    A policy with memory acts on its last observations, each with the action that it took before
    it. It acts in the environments of one vector environment at a time: `reset` makes it forget.

    Two policies are equal if their numbers and their `env` are.

    Attributes
    ----------
    scale : ndarray, float32, shape (k,), or (length, k + joints) with memory
        Divisor of the network's inputs: observations, or the frames of a `History`.
    weights : list of ndarray, float32, shapes (outputs, inputs)
    biases : list of ndarray, float32, shapes (outputs,)
    env : dict
        Keywords of the environment that the policy is made for; "max_episode_steps" may be one.
    provenance : dict
        How the policy was made: settings, versions, its evaluation.
    offset : ndarray, float32, shape of `scale`, optional
        Is subtracted from observations before they are divided.
    limit : float
        Inputs of the network are clipped to [-limit, limit].
    activation : str
        Between the layers: "tanh" or "relu".
    output : str
        What bounds the actions: "clip" or "tanh".

    Raises
    ------
    ValueError
        If `limit`, `activation` or `output` is none of these, or `provenance` has a name that is
        reserved in files: "env", "network" or "crc32"; if the layers do not fit each other, `scale`
        or `env`, or a signal in them may overflow.
    TypeError
        If a keyword in `env` has the wrong type.

    Examples
    --------
    >>> import gymnasium as gym
    >>> from npend_gym import rl
    >>> policy = rl.Policy.pretrained("swingup-1")
    >>> envs = gym.make_vec("npend/SwingUp-v1", num_envs=3, **policy.env)
    >>> observation, info = envs.reset(seed=0)
    >>> policy(observation, info).shape
    (3, 1)
    """

    scale: Float32Array
    weights: list[Float32Array]
    biases: list[Float32Array]
    env: dict[str, Any] = field(default_factory=dict[str, Any])
    provenance: dict[str, Any] = field(default_factory=dict[str, Any])
    offset: Float32Array | None = None
    limit: float = math.inf
    activation: str = "tanh"
    output: str = "clip"
    _history: History | None = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        functions = check_functions(self._functions)
        object.__setattr__(self, "limit", functions["limit"])  # no scalar of NumPy
        check_about(self.env, self.provenance)
        for name, numbers in numbers_of(self).items():
            object.__setattr__(self, name, numbers)
        check_network((self.scale, self.weights, self.biases), self.offset, functions)
        history = History(self.scale.shape, len(self.biases[-1])) if self.scale.ndim == 2 else None
        object.__setattr__(self, "_history", history)
        if self.env:
            check_env(plain_keywords(self.env), self.observed, len(self.biases[-1]))

    @property
    def _functions(self) -> dict[str, Any]:
        """How the network acts, where that is not usual."""
        return {k: getattr(self, k) for k, v in USUAL.items() if getattr(self, k) != v}

    def _key(self) -> tuple[Any, ...]:
        """Return the network: its numbers, by their shapes and bytes, and its functions."""
        numbers = ((array.shape, array.tobytes()) for array in arrays_of(self).values())
        return (*numbers, self.limit, self.activation, self.output)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Policy):
            return NotImplemented
        return self._key() == other._key() and plain_keywords(self.env) == plain_keywords(other.env)

    def __hash__(self) -> int:
        return hash(self._key())

    def __repr__(self) -> str:
        sizes = [self.scale.size, *map(len, self.biases)]
        return f"Policy({'-'.join(map(str, sizes))}, env={self.env})"

    @property
    def observed(self) -> int:
        """Number of entries of an observation."""
        return self.scale.shape[-1] - (len(self.biases[-1]) if self.has_memory else 0)

    @property
    def has_memory(self) -> bool:
        """Whether it acts on more than the present observation."""
        return self._history is not None

    def reset(self, num_envs: int = 1) -> None:
        """Forget what was observed: the next call begins episodes in `num_envs` environments."""
        if self._history is not None:
            self._history.reset(_checks.count("num_envs", num_envs))

    def __call__(
        self, observation: Float32Array, info: Mapping[str, Any] | None = None
    ) -> Float32Array:
        """Return the actions within [-1, 1].

        Parameters
        ----------
        observation : ndarray, shape (..., k)
            With memory (B, k), of the same B environments as in the call before; or (k,), of one.
        info : mapping, optional
            Where ``info["time"]`` is 0 an episode begins, and a policy with memory forgets what was
            before. Without it that is left to `reset`. It also shows whether the observation is
            "scaled" or "sincos", which have as many entries. Without it the array shows that, if it
            is the one that an environment returned last, and no copy.

        Returns
        -------
        ndarray, float32, shape (..., joints)
            Rounded from sums in float64, so that the order of a processor's sums hardly ever shows.

        Raises
        ------
        ValueError
            If the observation is not of the policy's environment, as its size or `info` shows, or a
            policy with memory is called with other environments.
        """
        if np.shape(observation)[-1:] != (self.observed,):
            raise ValueError(
                f"observation must have {self.observed} entries, got {np.shape(observation)}: make "
                "the environment with the policy's keywords, gym.make(..., **policy.env)"
            )
        if self.env:
            from npend_gym.rl.policies.observations import check_observation  # heavy

            check_observation(self.config, observation, info)
        observation = np.asarray(observation, np.float32)
        if self._history is None:
            return forward(self, self._layers, observation)
        frames = self._history.remember(np.atleast_2d(observation), info)
        action = forward(self, self._layers, frames)
        self._history.act(action)
        return action[0] if np.ndim(observation) == 1 else action

    def act(self, theta: ArrayLike, omega: ArrayLike, **others: Any) -> Float32Array:
        """Return the actions within [-1, 1] for angles and velocities that were measured.

        Parameters
        ----------
        theta, omega : array_like, shape (n,) or (B, n)
            Angles [rad] and angular velocities [rad/s].
        **others
            `relative`, `cart_position`, `cart_velocity` and `goal`, as for `observation_of`.

        Returns
        -------
        ndarray, float32, shape (joints,) or (B, joints)
            Torques over ``policy.config.action_limits``. A policy with memory must be called once
            in every step, `dt`, after `reset`.

        Examples
        --------
        >>> from npend_gym.rl import Policy
        >>> Policy.pretrained("balance-1").act([3.1], [0.0]).shape
        (1,)
        """
        from npend_gym.rl.policies.observations import observation_of  # heavy

        return self(observation_of(self.config, theta, omega, **others))

    @cached_property
    def config(self) -> EnvConfig:
        """The settings of the environment that the policy is made for."""
        from npend_gym.envs.config import EnvConfig  # heavy

        return EnvConfig(**self.env)

    @cached_property
    def _layers(self) -> list[tuple[FloatArray, FloatArray]]:
        return layers_of(self)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the policy to a file: numbers, `env` and `provenance`.

        Parameters
        ----------
        path : path-like
            Ends in ".safetensors". After an error, an earlier file is unchanged.

        Raises
        ------
        ValueError
            If it ends otherwise, `env` or `provenance` is nested deeper than 32, or the file would
            have more than 20 MB.
        TypeError
            If `env` or `provenance` has a value that JSON cannot hold, such as NaN or a mode that
            is an object.
        """
        about = {"env": plain_keywords(self.env)} | self.provenance
        if self._functions:
            about["network"] = self._functions
        write_policy(Path(path), arrays_of(self), about)

    @classmethod
    def from_sb3(cls, model: Any, env: Any = None) -> Policy:
        """Return the policy that acts as a model of Stable-Baselines3 does, deterministically.

        The normalisation of its `VecNormalize` becomes part of the policy.

        Parameters
        ----------
        model
            PPO, SAC, TD3, TQC, CrossQ or ARS, say, of this library, sb3-contrib or SBX. Actions
            must be continuous, and layers linear with tanh or ReLU between them.
        env : optional
            As for `evaluate`, its environment; by default that of the model's training.

        Raises
        ------
        ValueError
            If the model is not such a network, observes through other wrappers, or lacks an
            environment or statistics. `load` of Stable-Baselines3 leaves them out without ``env=``.
        """
        from npend_gym.rl.policies.from_sb3 import policy_fields  # heavy

        return cls(**policy_fields(model, env))

    @classmethod
    def load(cls, path: str | PathLike[str], *, trust: bool = False) -> Policy:
        """Read what `save` wrote, and check all of it; no code of a file is run.

        Parameters
        ----------
        path : path-like
        trust : bool
            Whether the file may name a mode of yours, "package.module:Class", whose module is then
            imported.

        Raises
        ------
        ValueError
            If the file is damaged, too large or no .safetensors file; if its names, types, shapes
            or numbers are not those of a policy; or if the policy does not fit its environment.
        """
        path = Path(path)
        arrays, about = read_policy(path)
        env = about.pop("env")
        try:
            functions = check_functions(about.pop("network", {}))
            offset = arrays.pop("offset", None)
            check_trust(env, trust=trust)
            return cls(*dense_layers(arrays), env, about, offset, **functions)
        except (ValueError, TypeError) as error:
            raise ValueError(f"{path} is no policy: {error}") from error

    @classmethod
    def from_hub(
        cls,
        repo_id: str,
        filename: str = POLICY_FILE,
        *,
        revision: str | None = None,
        trust: bool = False,
    ) -> Policy:
        """Load a policy from the Hugging Face Hub; it is downloaded once and kept.

        The file holds numbers and text. No part of it is executed, whoever wrote it.

        Parameters
        ----------
        repo_id : str
            "user/name".
        filename : str
            Of a file that `save` wrote, in the repository.
        revision : str, optional
            Branch, tag or commit; by default the newest.
        trust : bool
            As for `load`.

        Raises
        ------
        ImportError
            If the extra "hub" is not installed.
        ValueError, OSError
            If the file is no policy, or cannot be downloaded.
        """
        hub = require("huggingface_hub", "hub", "policies of the Hugging Face Hub")
        file = hub.hf_hub_download(repo_id, filename, revision=revision)
        return cls.load(file, trust=trust)

    @classmethod
    def pretrained(cls, name: str) -> Policy:
        """Load a policy that comes with the package, such as "swingup-2"."""
        return cls.load(pretrained_path(name))
