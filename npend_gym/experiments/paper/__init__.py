"""The source paper, audited: every equation, number and claim computed anew and judged.

Each module has functions that compute, and `findings()`, which yields a `Finding` for every key
that `CONTENTS` gives to that module, as soon as it is known. Results that figures share with
findings are cached by the functions that compute them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from difflib import get_close_matches
from importlib import import_module

from npend_gym import _checks
from npend_gym.experiments.paper.finding import Finding, Verdict

__all__ = ["CONTENTS", "KANE_N", "MODULES", "Finding", "Verdict", "audit", "in_order", "selected"]

KANE_N = 6  # the largest chain that Kane's method is tried on by default: some seconds
MODULES = (
    "pendulum", "equations", "derivation", "linear", "frequencies", "series", "integrators",
    "listings", "kane", "periods", "procedure", "tables", "law", "chaos",
)  # fmt: skip

# The paper's sections in order; in each, module that computes a finding and the finding's key
_CONTENTS = {
    "1 Introduction and preliminaries": """
        pendulum history, pendulum torque, pendulum pendulum-equation, pendulum one-radian,
        pendulum small-swing, pendulum single-period, pendulum isochrony, pendulum cubic-error,
        pendulum nonlinear""",
    "2 The Euler-Lagrange equations": """
        frequencies beats, chaos chaos-energy, chaos attracting-point, procedure figure-2,
        listings rods, equations coordinates, equations kinetic-energy, equations two-bodies,
        equations two-bodies-small, equations velocities, equations lagrange-left,
        equations lagrange-right, equations expanded, equations eom, equations ours""",
    "3 Linearization and pseudo-periodicity": """
        chaos no-solution, linear matrices, linear quadratic-term, linear modes, linear jacobian,
        frequencies determinant, frequencies normal-frequencies, frequencies carried-mass,
        frequencies period, frequencies period-equal, law factor, law sqrt-scaling""",
    "4 Higher-order corrections": """
        linear initial-conditions, pendulum elliptic, series amplitude-series, series series-taylor,
        series series-value, law period-law, law coincidence""",
    "5 Procedure and simulation": """
        kane kane-order, procedure pseudo-complete, law readings, law which-average,
        procedure sigma, tables trials, law trial-equation, procedure window, listings frames,
        procedure figure-4, procedure figure-5, procedure figure-6, procedure figure-7,
        procedure stochastic, procedure central-mean, integrators truncation, procedure one-point,
        law small-angles, tables amplitudes, tables table-1, tables table-2, tables table-3,
        tables tables-together, tables tables-scatter, tables e-at-5, tables e-exponential,
        tables e-truncation, chaos chaos-errors, integrators first-order-system,
        integrators rk4-orders, integrators taylor, integrators local-error,
        integrators curvature, series circular-bound, series e-hat, series e-hat-value,
        series series-diverges,
        tables e-threshold, periods t0-formula, periods dt-fraction-1, periods dt-fraction-2,
        periods dt-fraction-3, periods dt-random, periods t0-digits, periods dt-table-1,
        periods dt-table-2, periods dt-table-3, periods t-digits, frequencies better-with-n""",
    "6 Conclusion": """
        pendulum third-order, law verified, pendulum one-pendulum, pendulum right-angle,
        chaos chaos-n, kane run-time, kane log-time""",
    "A The Euler-Lagrange equations derived": """
        derivation rate-x-by-angle, derivation rate-y-by-angle, derivation height-by-angle,
        derivation force, derivation pi-max, derivation rates-by-velocity,
        derivation height-by-velocity, derivation momentum, derivation momentum-by-speeds,
        derivation momentum-rate""",
    "B The equations linearized": "linear expansions, linear linearised, linear by-row",
    "C Fourth-order Runge-Kutta": "integrators rk4-formula",
    "D Kane's method and the listings": """
        kane kane-listing, listings get-xy, listings simulation, listings estimator,
        procedure listing-4, periods error-bars""",
}

# section -> key of a finding -> module
CONTENTS: dict[str, dict[str, str]] = {
    section: {key: module for module, key in (entry.split() for entry in entries.split(","))}
    for section, entries in _CONTENTS.items()
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
    for name in only:
        if name not in modules and name not in MODULES:
            near = get_close_matches(name, [*MODULES, *modules], cutoff=0.0)
            raise ValueError(
                f"only must name findings or modules of the audit, such as {', '.join(near)}; "
                f"got {_checks.show(name)}"
            )
    return [key for key, module in modules.items() if key in only or module in only]


def audit(only: Sequence[str] | None = None, *, kane_n: int = KANE_N) -> Iterator[Finding]:
    """Return an iterator over the findings that `only` names, each computed when asked for.

    They come as they are computed; `in_order` sorts them.

    Parameters
    ----------
    only : sequence of str, optional
        Keys of findings or names of modules, see `selected`.
    kane_n : int
        Largest chain whose equations are derived by Kane's method; the time grows fast.

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.
    ImportError
        If SymPy is not installed and a finding needs it.
    """
    kane_n = _checks.count("kane_n", kane_n, low=4, high=30)
    return _computed(selected(only), {"kane": {"kane_n": kane_n}})


def _computed(keys: list[str], options: dict[str, dict[str, int]]) -> Iterator[Finding]:
    modules = _modules_by_key()
    for name in MODULES:
        wanted = {key for key in keys if modules[key] == name}
        if wanted:
            module = import_module(f"{__name__}.{name}")
            for finding in module.findings(**options.get(name, {})):
                if finding.key in wanted:
                    wanted.remove(finding.key)
                    yield finding
                    if not wanted:
                        break


def in_order(findings: Iterable[Finding]) -> list[Finding]:
    """Return `findings` in the order of the paper."""
    keys = selected()
    return sorted(findings, key=lambda finding: keys.index(finding.key))
