#!/usr/bin/env bash
# PyTorch 2.13.0: the first call of `torch.func.jvp`, which is not deprecated, warns that `torch.jit.script` is.
# A program that makes warnings errors cannot take a derivative forward, and the trace ends in no line of its own.
# The same derivative backward, by `torch.autograd.grad`, warns of nothing.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q torch==2.13.0 numpy
"$folder/venv/bin/python" - <<'PYTHON'
import warnings

import torch


def square(x):
    return x * x


x = torch.tensor([1.0, 3.0], requires_grad=True)
with warnings.catch_warnings(record=True) as found:
    warnings.simplefilter("always")
    (backward,) = torch.autograd.grad(square(x).sum(), x)
print("backward", backward.tolist(), [str(each.message) for each in found])
assert not found, "changed"
with warnings.catch_warnings(record=True) as found:
    warnings.simplefilter("always")
    _, forward = torch.func.jvp(square, (x.detach(),), (torch.ones(2),))
said = {str(each.message) for each in found if each.category is DeprecationWarning}
print("forward", forward.tolist(), said)
assert forward.tolist() == backward.tolist() == [2.0, 6.0]
assert any("torch.jit.script" in each for each in said), "changed"
PYTHON
