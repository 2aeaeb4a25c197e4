"""What changes the parameters of a network: gradients, or least squares."""

# torch's stubs leave parts unknown
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import torch
from torch import nn

_DAMPING = 1e-4  # over the mean of the kernel's diagonal; single precision needs this much
_TRIES = 4  # each with ten times as much
_MOMENTUM = 0.97  # share of the last change in a step
_LARGEST = 0.1  # larger errors count as this one: some states cannot be learned
_MUON_MOMENTUM = 0.95
_ITERATIONS = 5
_A, _B, _C = 3.4445, -4.775, 2.0315  # a quintic that raises small singular values fastest
_TINY = 1e-7  # a smaller norm is none


class Muon(torch.optim.Optimizer):
    """`torch.optim.Muon` for matrices, faster where a processor lacks instructions for bfloat16.

    Muon makes the singular values of a change alike, so that weak directions are learned as fast as
    strong ones (K. Jordan and others, "Muon: An optimizer for hidden layers in neural networks",
    2024). PyTorch's computes in bfloat16. Here the products are of float32, and rounded to
    bfloat16: the changes are the same but for the order of sums.
    """

    def __init__(self, matrices: Iterable[nn.Parameter]) -> None:
        super().__init__(matrices, {"lr": 0.0})

    @torch.no_grad()
    def step(self, closure: Any = None) -> Any:
        """Change the matrices that have gradients."""
        del closure  # other optimizers ask it for new gradients
        for group in self.param_groups:
            for matrix in group["params"]:
                if matrix.grad is None:
                    continue
                state = self.state[matrix]
                if not state:
                    state["momentum_buffer"] = torch.zeros_like(matrix)
                mean = state["momentum_buffer"].lerp_(matrix.grad, 1.0 - _MUON_MOMENTUM)
                change = _even(matrix.grad.lerp(mean, _MUON_MOMENTUM))
                rows, columns = matrix.shape
                matrix.sub_(change, alpha=group["lr"] * math.sqrt(max(1.0, rows / columns)))


def _even(matrix: torch.Tensor) -> torch.Tensor:
    """Return a matrix with about the same singular vectors, and singular values nearer to 1."""
    tall = len(matrix) > matrix.shape[1]
    even = _rounded(matrix.T if tall else matrix)
    even = _rounded(even / _rounded(even.norm()).clamp(min=_TINY))
    for _ in range(_ITERATIONS):  # Newton-Schulz
        gram = _rounded(even @ even.T)
        factor = _rounded(torch.addmm(gram, gram, gram, beta=_B, alpha=_C))
        even = _rounded(torch.addmm(even, factor, even, beta=_A))
    return even.T if tall else even


def _rounded(matrix: torch.Tensor) -> torch.Tensor:
    """Return a matrix rounded to bfloat16; weak directions begin as what this changes."""
    return matrix.bfloat16().to(matrix.dtype)


class Optimizer:
    """Adam for a network, or Muon for its matrices and Adam for the rest.

    A matrix whose rows are the outputs is left to Adam.

    Parameters
    ----------
    network : nn.Module
    learning_rate, muon_learning_rate : float
        Of both; where the latter is 0, Adam learns the matrices too.
    betas : pair of float
        Of Adam.
    """

    changes: tuple[str, ...] = ("parts",)  # in a training run, see its checkpoints

    def __init__(
        self,
        network: nn.Module,
        learning_rate: float,
        muon_learning_rate: float = 0.0,
        betas: tuple[float, float] = (0.9, 0.999),
    ) -> None:
        others = [*network.parameters()]
        matrices: list[nn.Parameter] = []
        if muon_learning_rate > 0.0:
            outputs = len(others[-1])
            matrices = [each for each in others if each.ndim == 2 and len(each) != outputs]
            others = [each for each in others if each.ndim == 1 or len(each) == outputs]
        self.network = network
        self.rates: dict[str, float] = {"adam": learning_rate, "muon": muon_learning_rate}
        self.parts: dict[str, torch.optim.Optimizer] = {
            "adam": torch.optim.Adam(others, betas=betas, fused=True)
        }
        if matrices:
            self.parts["muon"] = Muon(matrices)

    def step(self, share: float) -> None:
        """Change the network, with a share of the learning rates, and forget the gradients."""
        for name, part in self.parts.items():
            part.param_groups[0]["lr"] = share * self.rates[name]
            part.step()
        self.network.zero_grad()


class Spring:
    """SPRING, for a network of layers with hyperbolic tangents between them.

    A step adds the smallest change of all parameters to a part of the last change. The sum takes
    away the errors of a minibatch to first order. So a step solves as many linear equations as the
    minibatch has outputs, whatever the number of parameters (G. Goldshlager, N. Abrahamsen, L. Lin,
    "A Kaczmarz-inspired approach to accelerate the optimization of neural network wavefunctions",
    arXiv:2401.10190). Where targets are a function of the inputs, errors fall much further than
    along gradients. Where targets are noisy, the steps follow the noise.

    Parameters
    ----------
    network : nn.Sequential
        Of `nn.Linear` layers, with `nn.Tanh` between them.
    learning_rate : float
        Share of the change that is made.
    """

    changes: tuple[str, ...] = ("last",)  # in a training run, see its checkpoints

    def __init__(self, network: nn.Sequential, learning_rate: float) -> None:
        self._layers = [each for each in network if isinstance(each, nn.Linear)]
        self._learning_rate = learning_rate
        # the last change of each layer: of weights, with a column of biases
        self.last: list[torch.Tensor] = [
            torch.zeros(len(layer.weight), layer.weight.shape[1] + 1) for layer in self._layers
        ]

    @torch.no_grad()
    def step(
        self, inputs: torch.Tensor, targets: torch.Tensor, weights: torch.Tensor, share: float
    ) -> torch.Tensor:
        """Change the network, with a share of the learning rate; return its outputs before.

        Targets and outputs are (B, outputs), and so are the `weights` of the squares of errors.
        """
        values = [inputs]
        for layer in self._layers[:-1]:
            values.append(torch.tanh(layer(values[-1])))
        outputs = self._layers[-1](values[-1])
        roots = weights.sqrt() / weights.sqrt().mean()
        errors = ((targets - outputs) * roots).clamp(-_LARGEST, _LARGEST).flatten()
        # a row for each output: its gradient is the outer product of these two, layer by layer
        slopes, count = torch.diag_embed(roots).flatten(0, 1), targets.shape[1]
        factors = list[tuple[torch.Tensor, torch.Tensor]]()
        for layer, value in zip(reversed(self._layers), reversed(values), strict=True):
            given = nn.functional.pad(value, (0, 1), value=1.0).repeat_interleave(count, dim=0)
            factors.insert(0, (slopes, given))
            slopes = (slopes @ layer.weight) * (1.0 - given[:, :-1] ** 2)
        kernel, known = torch.zeros(()), torch.zeros(())
        for (slopes, given), last in zip(factors, self.last, strict=True):
            kernel = kernel + (slopes @ slopes.T) * (given @ given.T)
            known = known + ((slopes @ last) * given).sum(dim=1)
        solved = _factor(kernel)
        left = torch.cholesky_solve((errors - _MOMENTUM * known)[:, None], solved)
        parts = zip(self._layers, factors, self.last, strict=True)
        for layer, (slopes, given), last in parts:
            last.mul_(_MOMENTUM).add_((slopes * left).T @ given)
            layer.weight.add_(last[:, :-1], alpha=share * self._learning_rate)
            layer.bias.add_(last[:, -1], alpha=share * self._learning_rate)
        return outputs


def _factor(kernel: torch.Tensor) -> torch.Tensor:
    """Return the Cholesky factor of a kernel with as much damping as it needs."""
    damping = _DAMPING * kernel.diagonal().mean()
    for _ in range(_TRIES):
        kernel.diagonal().add_(damping)
        factor, failed = torch.linalg.cholesky_ex(kernel)
        if not failed:
            return factor
        damping = 10.0 * damping
    raise RuntimeError("the network diverged: spring_learning_rate must be smaller")
