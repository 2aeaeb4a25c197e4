"""For which processors machine code is made, and may run here."""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false
from __future__ import annotations

import os
from functools import cache

import llvmlite
from llvmlite import binding

from npend_gym.compiled.sources import PACKAGE

SHIPPED = PACKAGE / "machine_code"  # what a wheel may bring, as `hatch_build.py` makes it
# Processors that wheels have machine code for, the best first, and the features that they need
LEVELS = {
    "x86-64-v4": {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl", "avx2", "bmi2", "fma"},
    "x86-64-v3": {"avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe"},
}


@cache
def processor() -> str:
    """Return for which processor machine code is made: the user's choice, or this one.

    For this one also by which compiler, since a newer one may make faster code.
    """
    name, features = (os.environ.get(f"NUMBA_CPU_{each}") for each in ("NAME", "FEATURES"))
    if name:
        return made_for(name, features or "")
    features = binding.get_host_cpu_features().flatten()
    return made_for(binding.get_host_cpu_name(), f"{features} {llvmlite.__version__}")


def made_for(name: str, features: str = "") -> str:
    """Return a text for a processor of this system, by which files of machine code are named."""
    return f"{binding.get_process_triple()} {name} {features}"


@cache
def levels() -> list[str]:
    """Return for which processors shipped machine code may be made to run here, the best first."""
    if os.environ.get("NUMBA_CPU_NAME") or not SHIPPED.is_dir():
        return []
    if "x86_64" not in binding.get_process_triple():
        return [made_for("generic")]
    features = binding.get_host_cpu_features()
    return [
        made_for(level)
        for level, needed in LEVELS.items()
        if all(features.get(each) for each in needed)
    ]
