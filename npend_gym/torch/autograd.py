"""The functions of torch over the compiled steps: forward, backward, and under vmap."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import torch
from torch import Tensor
from torch.autograd import Function

from npend_gym.compiled.sincos import sincos_all
from npend_gym.torch import compiled_steps, device_steps
from npend_gym.torch.compiled_steps import StepCall

_F = TypeVar("_F", bound=Callable[..., Any])

_TWICE = (
    "a step can be differentiated once, not twice: the kernels have no second derivatives. Leave "
    "out create_graph=True and nested torch.func.grad; Jacobians of gradients can be had from "
    "differences of gradients"
)
_FORWARD_MODE = (
    "a step has no forward-mode derivative in torch: use torch.func.vjp or jacrev in place of jvp, "
    "jacfwd or hessian, or npend_gym.physics.DifferentiableEnsemble.step_jacobian, which is exact "
    "and gives whole Jacobians"
)


def uncompiled(function: _F) -> _F:
    """Let torch.compile leave `function` as it is, and compile what stands around its calls."""
    return torch.compiler.disable(function)  # type: ignore[return-value]


def applied(function: Any, *inputs: Any) -> Any:
    """Return ``function.apply(*inputs)``, whose type torch leaves open."""
    return function.apply(*inputs)


def _device_of(tensor: Tensor) -> Any:
    """Return the module that takes steps where a tensor is."""
    return device_steps if device_steps.on_gpu(tensor) else compiled_steps


class StepFunction(Function):
    """Theta and omega (B, n) after a step, float64, from theta, omega, torque and parameters."""

    @staticmethod
    def forward(call: StepCall, *inputs: Tensor) -> tuple[Tensor, Tensor]:
        """Take the step."""
        inputs = tuple(x.detach() for x in inputs)
        chains = call.chains(len(inputs[0]), inputs[3:])
        return _device_of(inputs[0]).forward(call, chains, inputs[:3])

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: Any) -> None:
        """Keep what the step began with."""
        del output
        ctx.call = inputs[0]
        ctx.save_for_backward(*inputs[1:])

    @staticmethod
    def backward(ctx: Any, *bars: Tensor) -> tuple[Tensor | None, ...]:
        """Take a gradient back through the step."""
        needed = tuple(ctx.needs_input_grad[4:])
        return None, *applied(StepBack, ctx.call, needed, *bars, *ctx.saved_tensors)

    @staticmethod
    def jvp(ctx: Any, *tangents: Tensor) -> Any:
        """Refuse."""
        raise NotImplementedError(_FORWARD_MODE)

    @staticmethod
    def vmap(info: Any, in_dims: tuple[Any, ...], *args: Any) -> Any:
        """Take the steps of all samples at once, side by side."""
        call, *inputs = args
        folded = _folded(info.batch_size, in_dims[1:], inputs)
        return _unfolded(info.batch_size, applied(StepFunction, call, *folded))


class StepBack(Function):
    """The gradient by what a step began with, from that by where it led."""

    @staticmethod
    def forward(call: StepCall, needed: tuple[bool, ...], *inputs: Tensor) -> tuple[Tensor, ...]:
        """Take the gradient back."""
        inputs = tuple(x.detach() for x in inputs)
        chains = call.chains(len(inputs[0]), inputs[5:])
        names = [name for name, need in zip(call.names, needed, strict=True) if need]
        steps = _device_of(inputs[0])
        of_state, by_name = steps.backward(call, chains, inputs[2:5], inputs[:2], names)
        parameters = zip(call.names, inputs[5:], strict=True)
        return *of_state, *(by_name.get(name, torch.zeros_like(x)) for name, x in parameters)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: Any) -> None:
        """Keep nothing."""

    @staticmethod
    def backward(ctx: Any, *bars: Tensor) -> Any:
        """Refuse."""
        raise NotImplementedError(_TWICE)

    @staticmethod
    def jvp(ctx: Any, *tangents: Tensor) -> Any:
        """Refuse."""
        raise NotImplementedError(_TWICE)

    @staticmethod
    def vmap(info: Any, in_dims: tuple[Any, ...], *args: Any) -> Any:
        """Take the gradients of all samples back at once, side by side."""
        call, needed, *inputs = args
        folded = _folded(info.batch_size, in_dims[2:], inputs)
        return _unfolded(info.batch_size, applied(StepBack, call, needed, *folded))


class SinCos(Function):
    """Sines and cosines with the bits of the kernels, float64."""

    @staticmethod
    def forward(angles: Tensor) -> tuple[Tensor, Tensor]:
        """Return sine and cosine of every angle."""
        x = angles.detach().contiguous()
        s, c = torch.empty_like(x), torch.empty_like(x)
        if device_steps.on_gpu(x):
            device_steps.write_sincos(*(each.reshape(-1) for each in (x, s, c)))
        else:
            sincos_all(*(each.numpy().reshape(-1) for each in (x, s, c)))
        return s, c

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: tuple[Tensor, Tensor]) -> None:
        """Keep sines and cosines."""
        del inputs
        ctx.save_for_backward(*output)

    @staticmethod
    def backward(ctx: Any, *bars: Tensor) -> Tensor:
        """Return the gradient by the angles."""
        s, c = ctx.saved_tensors
        return bars[0] * c - bars[1] * s


# torch asks for the signature in every call, and to find it takes as long as a short step
for _function in (StepFunction, StepBack, SinCos):
    _function.forward.__signature__ = inspect.signature(_function.forward)  # type: ignore[attr-defined]


def _folded(size: int, dims: Sequence[int | None], inputs: Sequence[Tensor]) -> list[Tensor]:
    """Return tensors of a batch of calls, (size * B, ...), as those of one call."""
    moved = (
        x.expand(size, *x.shape) if dim is None else x.movedim(dim, 0)
        for dim, x in zip(dims, inputs, strict=True)
    )
    return [x.flatten(0, 1) for x in moved]


def _unfolded(size: int, outputs: Sequence[Tensor]) -> tuple[Any, Any]:
    """Results of `_folded` calls, with the batch in front."""
    apart = tuple(x.reshape(size, len(x) // size, *x.shape[1:]) for x in outputs)
    return apart, (0,) * len(apart)
