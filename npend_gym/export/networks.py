"""Policies as files of PyTorch and ONNX: float32 networks, with their memory as a tensor.

Both have the same inputs and outputs, of B environments side by side:

- ``observation``, float32 (B, k), gives ``action``, float32 (B, joints), within [-1, 1].
- Policies with memory also take ``memory``, float32 (B, length, k + joints), of any numbers at
  first, and ``begins``, bool (B,): where an episode begins. They also give the memory of the next
  step.
"""

from __future__ import annotations

import json
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from npend_gym._extras import require
from npend_gym._files import replacing
from npend_gym._version import __version__
from npend_gym.chain import plain_keywords
from npend_gym.rl.policies.policy import Policy

_OPSET, _IR = 17, 8  # of ONNX 1.12, which every runtime reads


def to_onnx(policy: Policy, path: str | PathLike[str]) -> None:
    """Write a policy as a model of ONNX, for ONNX Runtime and what else reads the format.

    Inputs are "observation" (B, k) and, of a policy with memory, "memory" (B, length, k + joints)
    and "begins" (B,), whether an episode begins. Outputs are "action" (B, joints) and, with memory,
    "next_memory". The properties of the model say for which environment it is made.

    Parameters
    ----------
    policy : Policy
    path : path-like
        Such as "policy.onnx".

    Raises
    ------
    ImportError
        If the extra "export" is not installed.

    Examples
    --------
    >>> from npend_gym.export import to_onnx
    >>> from npend_gym.rl import Policy
    >>> to_onnx(Policy.pretrained("swingup-2"), "policy.onnx")
    """
    onnx = require("onnx", "export", "files of ONNX")
    graph = _Graph(onnx, policy)
    model = onnx.helper.make_model(
        graph.made(),
        producer_name="npend_gym",
        producer_version=__version__,
        opset_imports=[onnx.helper.make_opsetid("", _OPSET)],
        ir_version=_IR,
    )
    onnx.helper.set_model_props(model, described(policy))
    onnx.checker.check_model(model, full_check=True)
    with replacing(Path(path), binary=True) as file:
        file.write(model.SerializeToString())


def to_torch(policy: Policy, path: str | PathLike[str]) -> None:
    """Write a policy as a program of PyTorch, which ``torch.export.load`` reads without npend_gym.

    ``torch.export.load(path).module()`` maps an observation (B, k) to actions (B, joints). That of
    a policy with memory maps (observation, memory, begins) to (action, memory): the memory
    (B, length, k + joints), and whether an episode begins (B,).

    Parameters
    ----------
    policy : Policy
    path : path-like
        Must end in ".pt2".

    Raises
    ------
    ImportError
        If PyTorch is not installed.
    ValueError
        If the path ends otherwise.

    Examples
    --------
    >>> from npend_gym.export import to_torch
    >>> from npend_gym.rl import Policy
    >>> to_torch(Policy.pretrained("swingup-2"), "policy.pt2")
    """
    torch = require("torch", "rl", "programs of PyTorch")
    if Path(path).suffix != ".pt2":
        raise ValueError(f"path must end in .pt2, got {path}")
    module, batch = _module(torch, policy), torch.export.Dim("batch")
    examples = [torch.zeros(2, policy.observed)]
    if policy.has_memory:
        examples += [torch.zeros(2, *policy.scale.shape), torch.ones(2, dtype=torch.bool)]
    program = torch.export.export(
        module, tuple(examples), dynamic_shapes=tuple({0: batch} for _ in examples)
    )
    with replacing(Path(path), binary=True) as file:
        torch.export.save(program, file, extra_files=described(policy))


def described(policy: Policy) -> dict[str, str]:
    """Return what a file says of a policy: texts by name, of JSON but for the version."""
    limits = policy.config.action_limits.tolist() if policy.env else None
    about = {
        "env": plain_keywords(policy.env),
        "dt": policy.config.dt if policy.env else None,
        "action_limits": limits,
        "provenance": policy.provenance,
    }
    return {"npend_gym": __version__} | {k: json.dumps(value) for k, value in about.items()}


def _module(torch: Any, policy: Policy) -> Any:
    """Return the policy as a module of PyTorch."""
    last, joints = len(policy.weights) - 1, len(policy.biases[-1])
    functions: dict[str, Any] = {"tanh": torch.tanh, "relu": torch.relu}
    functions["clip"] = torch.nn.functional.hardtanh  # to [-1, 1]

    class Network(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            arrays = {"scale": policy.scale}
            arrays |= {} if policy.offset is None else {"offset": policy.offset}
            for k, (weight, bias) in enumerate(zip(policy.weights, policy.biases, strict=True)):
                arrays |= {f"weight{k}": weight, f"bias{k}": bias}
            for name, array in arrays.items():
                self.register_buffer(name, torch.tensor(array))

        def act(self, signal: Any) -> Any:
            signal = (signal if policy.offset is None else signal - self.offset) / self.scale
            if policy.limit < np.inf:
                signal = signal.clip(-policy.limit, policy.limit)
            signal = signal.flatten(1)
            for k in range(last + 1):
                weight, bias = getattr(self, f"weight{k}"), getattr(self, f"bias{k}")
                function = functions[policy.output if k == last else policy.activation]
                signal = function(torch.nn.functional.linear(signal, weight, bias))
            return signal

        def forward(self, observation: Any, memory: Any = None, begins: Any = None) -> Any:
            if memory is None:
                return self.act(observation)
            now, k = observation[:, None], observation.shape[1]
            going = torch.cat([torch.cat([now, memory[:, :1, k:]], 2), memory[:, 1:]], 1)
            start = torch.nn.functional.pad(now, (0, joints)).expand_as(memory)
            frames = torch.where(begins[:, None, None], start, going)
            action = self.act(frames)
            newest = torch.nn.functional.pad(action[:, None], (k, 0))
            return action, torch.cat([newest, frames[:, :-1]], 1)

    return Network().eval()


class _Graph:
    """The nodes and numbers of a model of ONNX, one operation after the other."""

    def __init__(self, onnx: Any, policy: Policy) -> None:
        self._onnx, self._policy = onnx, policy
        self._nodes, self._numbers = list[Any](), list[Any]()

    def made(self) -> Any:
        """Return the graph of the policy."""
        policy, tensor = self._policy, self._onnx.helper.make_tensor_value_info
        number, joints = self._onnx.TensorProto.FLOAT, len(policy.biases[-1])
        inputs = [tensor("observation", number, ["B", policy.observed])]
        outputs = [tensor("action", number, ["B", joints])]
        if policy.has_memory:
            shape = ["B", *policy.scale.shape]
            inputs += [
                tensor("memory", number, shape),
                tensor("begins", self._onnx.TensorProto.BOOL, ["B"]),
            ]
            outputs.append(tensor("next_memory", number, shape))
            self._remember(policy.observed, joints, len(policy.scale))
        else:
            self._act("observation")
        return self._onnx.helper.make_graph(
            self._nodes, "policy", inputs, outputs, initializer=self._numbers
        )

    def _remember(self, k: int, joints: int, length: int) -> None:
        """Act on the frames, which are the memory with the present observation."""
        now = self._do("Unsqueeze", "observation", self._ints(1))
        before = self._do("Slice", "memory", *map(self._ints, ((0, k), (1, k + joints), (1, 2))))
        newest = self._do("Concat", now, before, axis=2)
        older = self._do("Slice", "memory", *map(self._ints, (1, length, 1)))
        going = self._do("Concat", newest, older, axis=1)
        first = self._do("Pad", now, self._ints((0, 0, 0, 0, 0, joints)))
        start = self._do("Concat", *[first] * length, axis=1)
        begins = self._do("Unsqueeze", "begins", self._ints((1, 2)))
        frames = self._do("Where", begins, start, going)
        self._act(frames)
        kept = self._do("Pad", self._do("Unsqueeze", "action", self._ints(1)),
                        self._ints((0, 0, k, 0, 0, 0)))  # fmt: skip
        others = self._do("Slice", frames, *map(self._ints, (0, length - 1, 1)))
        self._do("Concat", kept, others, axis=1, out="next_memory")

    def _act(self, signal: str) -> None:
        """Put the network behind `signal`."""
        policy = self._policy
        if policy.offset is not None:
            signal = self._do("Sub", signal, self._array(policy.offset))
        signal = self._do("Div", signal, self._array(policy.scale))
        if policy.limit < np.inf:
            signal = self._clip(signal, policy.limit)
        signal = self._do("Flatten", signal)
        layers = list(zip(policy.weights, policy.biases, strict=True))
        for weight, bias in layers[:-1]:
            signal = self._do("Gemm", signal, self._array(weight), self._array(bias), transB=1)
            signal = self._do({"tanh": "Tanh", "relu": "Relu"}[policy.activation], signal)
        signal = self._do("Gemm", signal, *map(self._array, layers[-1]), transB=1)
        if policy.output == "tanh":
            self._do("Tanh", signal, out="action")
        else:
            self._clip(signal, 1.0, out="action")

    def _clip(self, signal: str, limit: float, out: str = "") -> str:
        ends = (self._array(np.float32(end)) for end in (-limit, limit))
        return self._do("Clip", signal, *ends, out=out)

    def _do(self, operation: str, *inputs: str, out: str = "", **options: Any) -> str:
        out = out or f"signal{len(self._nodes)}"
        self._nodes.append(self._onnx.helper.make_node(operation, inputs, [out], **options))
        return out

    def _ints(self, values: int | tuple[int, ...]) -> str:
        return self._array(np.atleast_1d(np.array(values, np.int64)))

    def _array(self, array: Any) -> str:
        name = f"number{len(self._numbers)}"
        self._numbers.append(self._onnx.numpy_helper.from_array(np.asarray(array), name))
        return name
