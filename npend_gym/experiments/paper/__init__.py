"""The source paper, audited: every equation, number and claim computed anew and judged.

Each module has functions that compute, and `findings()`, which yields a `Finding` for every key
that `CONTENTS` gives to that module, as soon as it is known. Results that figures share with
findings are cached by the functions that compute them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from importlib import import_module

from npend_gym.experiments.paper.finding import Finding, Verdict

__all__ = ["CONTENTS", "MODULES", "Finding", "Verdict", "audit", "in_order", "selected"]

MODULES = ("equations", "linear", "periods", "tables", "integrators", "chaos", "law")

# The paper's sections in order; in each, key of a finding -> module that computes it
CONTENTS: dict[str, dict[str, str]] = {
    "Abstract": {},
    "1 Introduction and preliminaries": {},
    "2 The Euler-Lagrange equations": {},
    "3 Linearization and pseudo-periodicity": {},
    "4 Higher-order corrections": {},
    "5 Procedure and simulation": {},
    "6 Conclusion": {},
    "A The Euler-Lagrange equations derived": {},
    "B The equations linearized": {},
    "C Runge-Kutta": {},
    "D Kane's method and listings": {},
}


def _modules_by_key() -> dict[str, str]:
    return {key: module for section in CONTENTS.values() for key, module in section.items()}


def selected(only: Sequence[str] | None = None) -> list[str]:
    """Return the keys, in the paper's order, that `only` names: by key or by module; all if None.

    Raises
    ------
    ValueError
        If `only` names what is neither.
    """
    modules = _modules_by_key()
    if only is None:
        return list(modules)
    unknown = [name for name in only if name not in modules and name not in MODULES]
    if unknown:
        raise ValueError(
            f"only must name findings or modules ({', '.join((*MODULES, *modules))}); "
            f"got {', '.join(unknown)}"
        )
    return [key for key, module in modules.items() if key in only or module in only]


def audit(only: Sequence[str] | None = None, *, kane_n: int = 5) -> Iterator[Finding]:
    """Yield the findings that `only` names (see `selected`), each as soon as it is computed.

    Parameters
    ----------
    only : sequence of str, optional
    kane_n : int
        Largest chain whose equations are derived by Kane's method; the time grows fast.
    """
    keys = selected(only)
    modules = _modules_by_key()
    options = {"integrators": {"kane_n": kane_n}}
    for name in MODULES:
        if any(modules[key] == name for key in keys):
            module = import_module(f"{__name__}.{name}")
            for finding in module.findings(**options.get(name, {})):
                if finding.key in keys:
                    yield finding


def in_order(findings: Iterable[Finding]) -> list[Finding]:
    """Return `findings` in the order of the paper."""
    keys = selected()
    return sorted(findings, key=lambda finding: keys.index(finding.key))
