"""Networks of PyTorch that are trained."""

# torch's stubs leave parts unknown
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
from __future__ import annotations

from typing import cast

import torch
from torch import nn


def network(inputs: int, outputs: int, hidden: int, last_gain: float) -> nn.Sequential:
    """Return a PyTorch network of two hidden tanh layers with orthogonal weights."""
    layers: list[nn.Module] = []
    for width_in, width_out, gain in (
        (inputs, hidden, 2**0.5), (hidden, hidden, 2**0.5), (hidden, outputs, last_gain)
    ):  # fmt: skip
        layer = nn.Linear(width_in, width_out)
        nn.init.orthogonal_(layer.weight, gain)
        nn.init.zeros_(layer.bias)
        layers += [layer, nn.Tanh()]
    return nn.Sequential(*layers[:-1])


class Committee(nn.ModuleList):
    """Networks of one shape, and their mean."""

    def of_each(self, inputs: torch.Tensor) -> torch.Tensor:
        """Return the output of each network for inputs of its own, (networks, B, inputs)."""
        return torch.stack([net(own) for net, own in zip(self, inputs, strict=True)])

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        """Return the mean of the outputs for the same inputs, (B, inputs)."""
        return torch.stack([net(inputs) for net in self]).mean(dim=0)

    @torch.no_grad()
    def as_one(self) -> nn.Sequential:
        """Return the mean as one network, whose hidden layers are as wide as all together."""
        count, layers = len(self), list[nn.Module]()
        nets = cast("list[nn.Sequential]", [*self])
        of_nets = [[each for each in net if isinstance(each, nn.Linear)] for net in nets]
        for k, alike in enumerate(zip(*of_nets, strict=True)):
            weights, biases = (
                [getattr(each, name) for each in alike] for name in ("weight", "bias")
            )
            if k == 0:
                weight, bias = torch.cat(weights), torch.cat(biases)
            elif k < len(of_nets[0]) - 1:
                weight, bias = torch.block_diag(*weights), torch.cat(biases)
            else:
                weight, bias = torch.cat(weights, dim=1) / count, torch.stack(biases).mean(dim=0)
            layer = nn.Linear(weight.shape[1], weight.shape[0])
            layer.weight.copy_(weight)
            layer.bias.copy_(bias)
            layers += [layer, nn.Tanh()]
        return nn.Sequential(*layers[:-1])
