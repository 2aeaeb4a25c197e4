"""Write a policy for programs that are not Python.

A C99 header needs no library and allocates nothing: it builds observations of measured angles and
velocities, and acts. Files of ONNX and PyTorch have the network, with its memory as a tensor. See
docs/howto/export.md.

Examples
--------
  npend export swingup-2 --to c -o policy.h
  npend export mine.npz --to c --prefix arm --relative -o arm.h
  npend export swingup-3-robust --to torch -o policy.pt2
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from npend_gym.cli.common import OK, prepare_file, show_file

FILLS = {"npend_gym.cli.evaluate:run": ("trust",)}
_SUFFIXES = {"c": ".h", "onnx": ".onnx", "torch": ".pt2"}


def run(
    policy: str,
    *,
    to: Literal["c", "onnx", "torch"],
    out: Path,
    prefix: str | None = None,
    relative: bool = False,
    trust: bool = False,
) -> int:
    """Write the file; return the exit code.

    Parameters
    ----------
    policy : policy
        The name of a policy in the package, or a file (.npz).
    to : format
        What is written: a header in c, a model of onnx, or a program of torch.
    out : file
        File to write, .h, .onnx or .pt2; folders that are missing are made.
    prefix : name, optional
        What the names in the header begin with (default npend).
    relative : bool
        Sensors show the angle of each rod relative to the rod above it.
    """
    from npend_gym import export
    from npend_gym.rl.policies.shipped import find_policy

    if to != "c" and (relative or prefix is not None):
        raise ValueError(f"--{'relative' if relative else 'prefix'} is for --to c")
    loaded = find_policy(policy, trust=trust)
    prepare_file(out, (_SUFFIXES[to],))
    if to == "c":
        export.to_c(loaded, out, "npend" if prefix is None else prefix, relative=relative)
    else:
        {"onnx": export.to_onnx, "torch": export.to_torch}[to](loaded, out)
    show_file(out)
    return OK
