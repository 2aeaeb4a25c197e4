"""Steps of chains as functions of tensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import torch
from torch import Tensor

from npend_gym import _checks
from npend_gym.chain import Chain, ChainParameters, check_chain
from npend_gym.physics.arguments import checked_joints
from npend_gym.physics.ensemble import check_rigid
from npend_gym.torch.autograd import StepFunction, applied, uncompiled
from npend_gym.torch.checks import as_tensors
from npend_gym.torch.compiled_steps import StepCall


@uncompiled
def step(
    chain: Chain,
    theta: Tensor,
    omega: Tensor | float = 0.0,
    torque: Tensor | float = 0.0,
    parameters: Mapping[str, Tensor] | None = None,
    *,
    dt: float,
    substeps: int | None = None,
    joints: Sequence[int] = (0,),
) -> tuple[Tensor, Tensor]:
    """Return the states of chains after a step of `dt` under constant torques.

    The step is that of `npend_gym.physics.Ensemble.advance`, and so are its bits. Gradients by all
    tensors are exact to rounding, and cost about as much as two steps more.

    Parameters
    ----------
    chain : Chain
        Of which all states are, but for `parameters`.
    theta, omega : Tensor, shape (..., m)
        Angles [rad] and angular velocities [rad/s], then position [m] and velocity [m/s] of a cart.
        Leading axes are broadcast.
    torque : Tensor, shape (..., inputs), or float
        Torques on `joints` [N m], then the force on a cart [N].
    parameters : mapping of str to Tensor, optional
        Other values of parameters of the chain, by their names in `Chain`: shape (..., n), of which
        (n,) is one chain for all; (...) for gravity.
    dt : float
        [s]
    substeps : int, optional
        Number of Runge-Kutta steps; by default that of `Ensemble.advance`. How far a step is cut
        counts as given in gradients.
    joints : sequence of int
        Joints with a torque; joint 0 is the pivot.

    Returns
    -------
    theta, omega : Tensor, shape (..., m)
        Of the dtype of the arguments. Steps are computed in float64.

    Raises
    ------
    TypeError
        If a tensor is neither float64 nor float32, or tensors differ in dtype or device.
    ValueError
        If a value breaks its rule.
    DivergedError
        If a chain leaves all bounds in the step.
    NotImplementedError
        Where a gradient is itself differentiated, and in forward mode.

    Notes
    -----
    `torch.func.grad`, `vjp`, `jacrev` and `vmap` work. `torch.compile` leaves a step as it is and
    compiles what stands around it; it cannot with ``fullgraph=True``.

    Examples
    --------
    >>> import torch
    >>> from npend_gym import Chain
    >>> from npend_gym.torch import step
    >>> theta = torch.tensor([0.5, 0.5], dtype=torch.float64, requires_grad=True)
    >>> after, omega = step(Chain.uniform(2), theta, dt=0.1)
    >>> after.sum().backward()
    >>> theta.grad.shape
    torch.Size([2])
    """
    check_rigid(check_chain(chain).stiffness)
    listed = tuple(checked_joints(joints, chain.n))
    given = dict(parameters or {})
    tensors = as_tensors({"theta": theta, "omega": omega, "torque": torque} | given)
    dtype, wide = tensors[0].dtype, [x.to(torch.float64) for x in tensors]
    m = chain.coordinates
    inputs = len(listed) + (chain.base is not None)
    sizes: dict[str, int | None] = {"theta": m, "omega": m, "torque": inputs}
    sizes |= {name: None if name == "gravity" else chain.n for name in given}
    leading, flat = _broadcast(sizes, wide)
    call = StepCall(chain, listed, dt, substeps, names=tuple(given))
    after = applied(StepFunction, call, *flat)
    reached, velocity = (x.reshape(*leading, m).to(dtype) for x in after)
    return reached, velocity


def _broadcast(
    sizes: Mapping[str, int | None], tensors: Sequence[Tensor]
) -> tuple[torch.Size, list[Tensor]]:
    """Return the common leading axes, and the tensors as (B, size); (B,) for a size of None."""
    leads: list[torch.Size] = []
    shaped: list[Tensor] = []
    axes: list[tuple[int, ...]] = [() if size is None else (size,) for size in sizes.values()]
    for name, own, x in zip(sizes, axes, tensors, strict=True):
        if name not in ("theta", "omega", "torque"):
            _checks.choice("parameter", name, ChainParameters._fields)
        rods = x.expand(torch.Size(own)) if x.ndim == 0 else x
        before = rods.ndim - len(own)
        if rods.shape[before:] != own:
            raise ValueError(f"{name} must have the shape (..., {own[0]}), got {tuple(x.shape)}")
        leads.append(rods.shape[:before])
        shaped.append(rods)
    try:
        leading = torch.Size(np.broadcast_shapes(*leads))
    except ValueError as error:
        shapes = ", ".join(
            f"{name} {tuple(x.shape)}" for name, x in zip(sizes, shaped, strict=True)
        )
        raise ValueError(f"leading axes must fit each other, got {shapes}") from error
    if leading.numel() == 0:
        name = next(name for name, lead in zip(sizes, leads, strict=True) if 0 in lead)
        raise ValueError(f"{name} must hold at least one state, got the leading axes {(*leading,)}")
    return leading, [
        x.expand(torch.Size([*leading, *own])).reshape(leading.numel(), *own).contiguous()
        for x, own in zip(shaped, axes, strict=True)
    ]
