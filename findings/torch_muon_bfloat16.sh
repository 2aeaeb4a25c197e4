#!/usr/bin/env bash
# PyTorch 2.13.0: `torch.optim.Muon` makes the changes of float32 matrices in bfloat16. They are some 1 % away from the
# same iteration in float32. On a processor with AVX2 but no instructions for bfloat16 the products are slow, too: seen
# were 286 ms for a matrix of 256 x 256, and 6.9 ms in float32. No argument chooses the precision.
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


def iterated(matrix):
    even = matrix / matrix.norm()
    for _ in range(5):
        gram = even @ even.T
        even = A * even + (B * gram + C * gram @ gram) @ even
    return even


torch.manual_seed(0)
torch.set_num_threads(1)
parameter = torch.nn.Parameter(torch.zeros(256, 256))
parameter.grad = torch.randn(256, 256)
options = {"lr": 1.0, "weight_decay": 0.0, "momentum": 0.0, "nesterov": False}
optimizer = torch.optim.Muon([parameter], **options)
with Watch():
    optimizer.step()
exact = iterated(parameter.grad)
away = float((parameter.detach() + exact).norm() / exact.norm())
print("a matrix of", parameter.dtype, "is changed by products of", products, f"{away:.1%} away")
times = []
for change in (optimizer.step, lambda: iterated(parameter.grad)):
    begun = time.perf_counter()
    change()
    times.append(time.perf_counter() - begun)
print("a step takes {:.1f} ms, in float32 {:.1f} ms".format(*(1e3 * each for each in times)))
arguments = set(inspect.signature(torch.optim.Muon).parameters)
assert products == {torch.bfloat16}, "changed"
assert 1e-3 < away < 0.1, "changed"
assert not any("dtype" in each or "precision" in each for each in arguments), "changed"
PYTHON
