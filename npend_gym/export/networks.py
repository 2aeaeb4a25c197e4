"""Policies as files of PyTorch and ONNX: float32 networks, with their memory as a tensor."""

from __future__ import annotations

import io
import json
import re
from os import PathLike
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from npend_gym import _checks
from npend_gym._extras import require
from npend_gym._files import replacing
from npend_gym._version import __version__
from npend_gym.export.about import described
from npend_gym.export.feedback import policy_of
from npend_gym.rl.controllers.feedback import StateFeedback
from npend_gym.rl.policies.network import arrays_of
from npend_gym.rl.policies.policy import Policy

_OPSET, _IR = 17, 8  # of ONNX 1.12, which every runtime reads
# Models in the text of ONNX
_WITHOUT_MEMORY = """
<ir_version: $ir, opset_import: ["" : $opset]>
policy (float[B, $k] observation) => (float[B, $joints] action) { $network }
"""
_WITH_MEMORY = """
<ir_version: $ir, opset_import: ["" : $opset]>
policy (float[B, $k] observation, float[B, $length, $entries] memory, bool[B] begins)
  => (float[B, $joints] action, float[B, $length, $entries] next_memory)
<int64[1] at_0 = {0}, int64[1] at_1 = {1}, int64[1] to_end = {$length}, int64[1] to_last = {$older},
 int64[2] axes = {1, 2}, int64[2] from = {0, $k}, int64[2] to = {1, $entries},
 int64[6] behind = {0, 0, 0, 0, 0, $joints}, int64[6] before = {0, 0, $k, 0, 0, 0}>
{
  now = Unsqueeze (observation, at_1)
  taken = Slice (memory, from, to, axes)
  newest = Concat <axis = 2> (now, taken)
  older = Slice (memory, at_1, to_end, at_1)
  going = Concat <axis = 1> (newest, older)
  first = Pad (now, behind)
  shape = Shape (memory)
  start = Expand (first, shape)
  which = Unsqueeze (begins, axes)
  frames = Where (which, start, going)
  $network
  acted = Unsqueeze (action, at_1)
  kept = Pad (acted, before)
  others = Slice (frames, at_0, to_last, at_1)
  next_memory = Concat <axis = 1> (kept, others)
}
"""


def to_onnx(policy: Policy | StateFeedback, path: str | PathLike[str]) -> None:
    """Write a policy as a model of ONNX, for ONNX Runtime and what else reads the format.

    Inputs are "observation" (B, k) and, of a policy with memory, "memory" (B, length, k + joints)
    and "begins" (B,), whether an episode begins. Outputs are "action" (B, joints) and, with memory,
    "next_memory". The properties of the model say for which environment it is made.

    Parameters
    ----------
    policy : Policy or StateFeedback
        Linear feedback, such as that of `npend_gym.rl.lqr`, is written as `policy_of` makes it.
    path : path-like
        Such as "policy.onnx".

    Raises
    ------
    TypeError
        If `policy` is neither.
    ImportError
        If the extra "export" is not installed.

    Examples
    --------
    >>> from npend_gym.export import to_onnx
    >>> from npend_gym.rl import Policy
    >>> to_onnx(Policy.pretrained("swingup-2"), "policy.onnx")
    """
    policy = _as_policy(policy)
    onnx = require("onnx", "export", "files of ONNX")
    k, joints, length = policy.observed, len(policy.biases[-1]), len(policy.scale)
    text = _WITH_MEMORY if policy.has_memory else _WITHOUT_MEMORY
    nodes = _nodes(policy, "frames" if policy.has_memory else "observation")
    fields = {"k": k, "joints": joints, "length": length, "entries": k + joints}
    fields |= {"older": length - 1, "network": "\n".join(nodes), "opset": _OPSET, "ir": _IR}
    model = onnx.parser.parse_model(Template(text).substitute(fields))
    model.producer_name, model.producer_version = "npend_gym", __version__
    numbers = arrays_of(policy) | {"least": np.float32(-1.0), "most": np.float32(1.0)}
    numbers |= {"low": np.float32(-policy.limit), "high": np.float32(policy.limit)}
    for name, array in numbers.items():
        if any(re.search(rf"\b{name}\b", node) for node in nodes):
            model.graph.initializer.append(onnx.numpy_helper.from_array(np.asarray(array), name))
    onnx.helper.set_model_props(model, _texts(policy))
    onnx.checker.check_model(model, full_check=True)
    with replacing(Path(path), binary=True) as file:
        file.write(model.SerializeToString())


def to_torch(policy: Policy | StateFeedback, path: str | PathLike[str]) -> None:
    """Write a policy as a program of PyTorch, which ``torch.export.load`` reads without npend_gym.

    ``torch.export.load(path).module()`` maps an observation (B, k) to actions (B, joints). That of
    a policy with memory maps (observation, memory, begins) to (action, memory): the memory
    (B, length, k + joints), and whether an episode begins (B,).

    Parameters
    ----------
    policy : Policy or StateFeedback
        Linear feedback, such as that of `npend_gym.rl.lqr`, is written as `policy_of` makes it.
    path : path-like
        Must end in ".pt2".

    Raises
    ------
    TypeError
        If `policy` is neither.
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
    policy = _as_policy(policy)
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
    content = io.BytesIO()  # PyTorch ends the process where it cannot write a file
    torch.export.save(program, content, extra_files=_texts(policy))
    with replacing(Path(path), binary=True) as file:
        file.write(content.getbuffer())


def _as_policy(policy: Any) -> Policy:
    """Return the network of a policy, or of linear feedback."""
    if isinstance(policy, StateFeedback):
        return policy_of(policy)
    if not isinstance(policy, Policy):
        raise TypeError(
            "policy must be a Policy, or what rl.lqr, modal_damping or state_feedback returns, got "
            f"{_checks.show(policy)}; to_c writes plans as well"
        )
    return policy


def _texts(policy: Policy) -> dict[str, str]:
    """Metadata of a policy in a file: texts, of JSON but for the version."""
    values = described(policy).items()
    return {name: each if isinstance(each, str) else json.dumps(each) for name, each in values}


def _module(torch: Any, policy: Policy) -> Any:
    """Return the policy as a module of PyTorch."""
    last, joints = len(policy.weights) - 1, len(policy.biases[-1])
    functions: dict[str, Any] = {"tanh": torch.tanh, "relu": torch.relu}
    functions["clip"] = torch.nn.functional.hardtanh  # to [-1, 1]

    class _Exported(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            for name, array in arrays_of(policy).items():
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

    return _Exported().eval()


def _nodes(policy: Policy, given: str) -> list[str]:
    """Return the operations of the network, from what `given` names to the action."""
    shifted = f"shifted = Sub ({given}, offset)"
    nodes = [] if policy.offset is None else [shifted]
    nodes += [f"scaled = Div ({given if policy.offset is None else 'shifted'}, scale)"]
    nodes += ["limited = Clip (scaled, low, high)"] if policy.limit < np.inf else []
    nodes += [f"layer0 = Flatten ({'limited' if policy.limit < np.inf else 'scaled'})"]
    function, last = policy.activation.title(), len(policy.weights) - 1
    for k in range(last + 1):
        nodes += [f"sum{k} = Gemm <transB = 1> (layer{k}, weight{k}, bias{k})"]
        nodes += [f"layer{k + 1} = {function} (sum{k})"] if k < last else []
    ends = ", least, most" if policy.output == "clip" else ""
    return [*nodes, f"action = {policy.output.title()} (sum{last}{ends})"]
