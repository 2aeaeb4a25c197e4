"""What changes the parameters of a network along their gradients."""

# torch's stubs leave parts unknown
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
from __future__ import annotations

import torch
from torch import nn


class Optimizer:
    """Adam for a network, or Muon for its matrices and Adam for the rest.

    Muon makes the singular values of a change of a matrix alike, so that weak directions are
    learned as fast as strong ones (K. Jordan and others, "Muon: An optimizer for hidden layers in
    neural networks", 2024). A matrix whose rows are the outputs is left to Adam.

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
            self.parts["muon"] = torch.optim.Muon(matrices, weight_decay=0.0)

    def step(self, share: float) -> None:
        """Change the network, with a share of the learning rates, and forget the gradients."""
        for name, part in self.parts.items():
            part.param_groups[0]["lr"] = share * self.rates[name]
            part.step()
        self.network.zero_grad()
