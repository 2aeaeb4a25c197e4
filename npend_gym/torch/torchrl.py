"""TorchRLEnv: the differentiable environments as TorchRL wants them."""

from __future__ import annotations

from typing import Any, cast

import torch
from gymnasium.vector import AutoresetMode
from typing_extensions import Unpack

from npend_gym._extras import CPU_TORCH
from npend_gym.envs import EnvKeywords
from npend_gym.torch.env import DifferentiableVectorEnv

try:
    from tensordict import TensorDict, TensorDictBase
    from torchrl.data import Bounded, Categorical, Composite, Unbounded
    from torchrl.envs import EnvBase
except ImportError as _error:
    raise ImportError(
        f"TorchRLEnv needs TorchRL: pip install torchrl ({CPU_TORCH})", name="torchrl"
    ) from _error


class TorchRLEnv(EnvBase):
    """A `DifferentiableVectorEnv` as an environment of TorchRL, with gradients through rollouts.

    Parameters
    ----------
    num_envs, max_episode_steps, dtype, threads, **keywords
        As for `DifferentiableVectorEnv`. TorchRL itself resets sub-environments that are done.

    Attributes
    ----------
    env : DifferentiableVectorEnv
        Whose `detach` cuts the graph.
    """

    def __init__(
        self,
        num_envs: int = 1,
        *,
        max_episode_steps: int | None = 1000,
        dtype: torch.dtype = torch.float64,
        threads: int = 1,
        **keywords: Unpack[EnvKeywords],
    ) -> None:
        if "autoreset_mode" in keywords:
            raise TypeError(
                "TorchRLEnv takes no keyword 'autoreset_mode': TorchRL resets what is done itself"
            )
        env = DifferentiableVectorEnv(
            num_envs, max_episode_steps=max_episode_steps, dtype=dtype, threads=threads,
            autoreset_mode=AutoresetMode.DISABLED, **keywords,
        )  # fmt: skip
        self.env: DifferentiableVectorEnv = env
        if env.config.goal_env:
            raise ValueError(
                "goal_env must be False for TorchRLEnv, whose observation is one tensor; "
                "DifferentiableVectorEnv takes it"
            )
        super().__init__(device=torch.device("cpu"), batch_size=torch.Size([env.num_envs]))
        specs: Any = self  # properties of TorchRL, which has no types
        batch, column = torch.Size([env.num_envs]), torch.Size([env.num_envs, 1])
        space: Any = env.config.observation_space
        bound = torch.from_numpy(space.high).to(dtype).expand(env.num_envs, -1)
        observation = Bounded(-bound, bound, dtype=dtype)
        specs.observation_spec = Composite(observation=observation, shape=batch)
        actions: Any = env.config.action_space
        if actions.shape == ():
            specs.action_spec = Categorical(int(actions.n), shape=batch)
        else:
            shape = torch.Size([env.num_envs, env.action_size])
            specs.action_spec = Bounded(-1.0, 1.0, shape, dtype=dtype)
        specs.reward_spec = Unbounded(column, dtype=dtype)
        flag = Categorical(2, shape=column, dtype=torch.bool)
        flags = {"done": flag, "terminated": flag.clone(), "truncated": flag.clone()}
        specs.done_spec = Composite(flags, shape=batch)
        self._seed: int | None = None

    def _reset(self, tensordict: TensorDictBase | None = None, **kwargs: Any) -> TensorDictBase:
        del kwargs
        options: dict[str, Any] = {}
        if tensordict is not None and "_reset" in tensordict:
            options["reset_mask"] = tensordict["_reset"].reshape(-1)
        observation, _ = self.env.reset(seed=self._seed, options=options)
        self._seed = None
        none = torch.zeros(self.env.num_envs, 1, dtype=torch.bool)
        flags = {"done": none, "terminated": none.clone(), "truncated": none.clone()}
        return TensorDict({"observation": observation, **flags}, batch_size=self.batch_size)

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        action = cast("torch.Tensor", tensordict["action"])
        observation, reward, terminated, truncated, _ = self.env.step(action)
        values = {
            "reward": reward, "terminated": terminated, "truncated": truncated,
            "done": terminated | truncated,
        }  # fmt: skip
        columns = {name: value[:, None] for name, value in values.items()}
        return TensorDict({"observation": observation, **columns}, batch_size=self.batch_size)

    def _set_seed(self, seed: int | None) -> None:
        self._seed = seed
