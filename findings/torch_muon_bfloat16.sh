#!/usr/bin/env bash
# PyTorch 2.13.0: `torch.optim.Muon` makes the changes of float32 matrices in bfloat16, and no argument chooses another
# precision. What is left of weak directions is rounding: of a gradient with singular values from 1 to 1e-6, the change
# has 0.1 for the weakest, where the same iteration in float32 has 0.0005. So runs with float32 learn otherwise. On a
# processor with AVX2 but no instructions for bfloat16 the products are slow, too: a step of a matrix of 256 x 256 took
# 286 ms, and 6.9 ms where products of float32 are rounded to bfloat16. For small matrices these have the same bits.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q torch==2.13.0 numpy
"$folder/venv/bin/python" - <<'PYTHON'
import inspect
import time

import torch
from torch.utils._python_dispatch import TorchDispatchMode

A, B, C = 3.4445, -4.775, 2.0315  # the coefficients that Muon takes by default
products = set()


class Watch(TorchDispatchMode):
    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        if func.overloadpacket in (torch.ops.aten.mm, torch.ops.aten.addmm):
            products.update(each.dtype for each in args if isinstance(each, torch.Tensor))
        return func(*args, **(kwargs or {}))


def muon(gradient):
    parameter = torch.nn.Parameter(torch.zeros_like(gradient))
    parameter.grad = gradient
    plain = {"lr": 1.0, "weight_decay": 0.0, "momentum": 0.0, "nesterov": False}
    torch.optim.Muon([parameter], **plain).step()
    return -parameter.detach()


def iterated(gradient, rounded):
    even = rounded(gradient)
    even = rounded(even / rounded(even.norm()))
    for _ in range(5):
        gram = rounded(even @ even.T)
        factor = rounded(torch.addmm(gram, gram, gram, beta=B, alpha=C))
        even = rounded(torch.addmm(even, factor, even, beta=A))
    return even


def to_bfloat16(matrix):
    return matrix.bfloat16().float()


torch.manual_seed(0)
torch.set_num_threads(1)
left, right = (torch.linalg.qr(torch.randn(size, 9))[0] for size in (9, 64))
gradient = left * torch.logspace(0.0, -6.0, 9) @ right.T
with Watch():
    change = muon(gradient)
exact, emulated = iterated(gradient, lambda matrix: matrix), iterated(gradient, to_bfloat16)
weakest = [float(torch.linalg.svdvals(each)[-1]) for each in (change, exact)]
print("a matrix of", gradient.dtype, "is changed by products of", products)
print("weakest direction: {:.4f}, in float32 {:.4f}".format(*weakest))
print("away from float32 products that are rounded:", float((change - emulated).abs().max()))
large, times = torch.randn(256, 256), []
for kind in (muon, lambda each: iterated(each, to_bfloat16)):
    begun = time.perf_counter()
    kind(large)
    times.append(time.perf_counter() - begun)
print("256 x 256 takes {:.1f} ms, with products of float32 {:.1f} ms".format(*(1e3 * each for each in times)))
arguments = set(inspect.signature(torch.optim.Muon).parameters)
assert products == {torch.bfloat16}, "changed"
assert weakest[0] > 0.03 and weakest[1] < 0.003, "changed"
assert not any("dtype" in each or "precision" in each for each in arguments), "changed"
PYTHON
