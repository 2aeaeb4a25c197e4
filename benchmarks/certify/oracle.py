"""The references: Taylor's method of heyoka on the dense equations, in numbers of many digits.

    python benchmarks/evaluate_engines.py --make-references         some minutes; needs heyoka

Every case is computed twice, with other orders, steps and digits. The largest difference of the two
stands beside the result. An error is raised where it exceeds 1e-21, a tenth of the bound.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from decimal import Decimal, localcontext
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from certify.cases import DEFINED, FILE, FORMAT, PARTS, RATES, TIMES, Case
from certify.equations import Array, accelerations

BOUND = 1e-20
DECIMALS = 28
_SHIFT = "1e-14"  # of starts, for derivatives: central differences err by its square
_NO_DERIVATIVE = ("long",)  # 32 flows of eight rods, twice


class Setting(NamedTuple):
    """How to compute: relative error of a step, which sets its order, and bits of a number."""

    tolerance: str
    bits: int


SETTINGS = Setting("1e-31", 140), Setting("1e-36", 160)


def right_side(case: Case) -> list[tuple[Any, Any]]:
    """Return the equations of a case for heyoka; the torques of the joints are its parameters."""
    hy: Any = import_module("heyoka")
    m = case.mechanism.size
    symbols = hy.make_vars(*[f"x{i}" for i in range(2 * m)])
    q, u = np.array(symbols[:m]), np.array(symbols[m:])
    torque = np.array([hy.par[i] for i in range(case.n)])

    class Functions:
        sin, cos = (np.frompyfunc(one, 1, 1) for one in (hy.sin, hy.cos))

    alpha = accelerations(case.mechanism, q, u, torque, Functions)
    return [*zip(symbols[:m], u, strict=True), *zip(symbols[m:], alpha, strict=True)]


class Flow:
    """The motion of a case in numbers of many digits."""

    def __init__(self, case: Case, setting: Setting) -> None:
        hy: Any = import_module("heyoka")
        self.case = case
        self.number: Callable[[Any], Any] = lambda value: hy.real(value, setting.bits)
        nothing = [self.number(0.0)]
        self.method = hy.taylor_adaptive(
            right_side(case), nothing * 2 * case.mechanism.size, pars=nothing * case.n,
            fp_type=hy.real, prec=setting.bits, tol=self.number(setting.tolerance),
            compact_mode=True,
        )  # fmt: skip

    def states(self, signs: Array | float = 0.0, until: float = TIMES[-1]) -> list[Array]:
        """Return the states at TIMES, (2m,) each, of the start moved by `signs` times the shift."""
        method, number, start = self.method, self.number, self.case.start.ravel()
        shifts = [number(x) * number(_SHIFT) for x in np.broadcast_to(signs, start.shape).tolist()]
        method.time = number(0.0)
        method.state[:] = np.array([number(x) for x in start.tolist()]) + np.array(shifts)
        found: list[Array] = []
        for _, end, torque in self.case.intervals:
            if end <= until:
                method.pars[:] = [number(x) for x in torque.tolist()]
                method.propagate_until(number(end))
                found += [method.state.copy()] if end in TIMES else []
        return found

    def derivative(self) -> Array:
        """Return the derivative of the state at 1 s by that at 0 s, (2m, 2m)."""
        width, columns = self.number(_SHIFT) * self.number(2.0), []
        for moved in np.eye(2 * self.case.mechanism.size):
            ahead, behind = (self.states(sign * moved, until=1.0)[0] for sign in (1.0, -1.0))
            columns.append((ahead - behind) / width)
        return np.array(columns).T


def compute(case: Case) -> dict[str, Any]:
    """Return the record of a case with its states and derivative."""
    flows = [Flow(case, setting) for setting in SETTINGS]
    found = [np.array(flow.states()) for flow in flows]
    worst = _difference(*found)
    away = np.array(flows[1].states(1.0)) - found[1]
    record = {key: case.record[key] for key in ("name", "about", "chain", "torque", "start")}
    record["states"] = [
        {"time": str(time)} | _parts(case, y) | {"growth": f"{_largest(off) / float(_SHIFT):.2g}"}
        for time, y, off in zip(TIMES, found[1], away, strict=True)
    ]
    if case.name not in _NO_DERIVATIVE:
        matrices = [flow.derivative() for flow in flows]
        worst = max(worst, _difference(*matrices))
        record["derivative"] = [[_text(one) for one in row] for row in matrices[1]]
    if not worst < BOUND / 10:
        raise ValueError(f"{case.name}: two computations differ by {worst:.1e}")
    return record | {"difference": f"{worst:.0e}"}


def _difference(first: Array, second: Array) -> float:
    pairs = zip(first.ravel(), second.ravel(), strict=True)
    with localcontext(prec=80):
        return float(max(abs(Decimal(str(a)) - Decimal(str(b))) for a, b in pairs))


def _largest(values: Array) -> float:
    return max(abs(float(one)) for one in values)


def _text(number: Any) -> str:
    """Return a number with DECIMALS digits behind the point."""
    with localcontext(prec=80):
        return format(Decimal(str(number)).quantize(Decimal(1).scaleb(-DECIMALS)), "f")


def _parts(case: Case, y: Array) -> dict[str, list[str]]:
    """Return a state (2m,) by the names of its parts."""
    left, record = [_text(one) for one in y], {}
    for name in (*PARTS, *RATES):
        count = len(case.record["start"].get(name, ()))
        if count > 0:
            record[name], left = left[:count], left[count:]
    return record


def make(report: Callable[[str], None]) -> None:
    """Compute all cases and write the file."""
    cases = []
    with ProcessPoolExecutor() as pool:  # what takes longest stands at the end
        for record in pool.map(compute, [Case(one) for one in reversed(DEFINED)]):
            report(f"{record['name']:12s} two computations differ by {record['difference']}")
            cases.insert(0, record)
    write(cases)


def write(cases: Sequence[dict[str, Any]]) -> None:
    """Write the file of the cases."""
    about = {
        "format": FORMAT,
        "error_bound": f"{BOUND:g}",
        "units": "m, kg, s, rad, N",
        "angles": "of each link from the hanging position, counter-clockwise, not relative",
        "method": "heyoka's Taylor method on Lagrange's equations with a dense mass matrix, "
        "twice; `difference` is the largest of any number of the case",
        "computed_with": [setting._asdict() for setting in SETTINGS],
    }
    text = json.dumps(about | {"cases": [*cases]}, indent=1)
    text = re.sub(r"\[[^][{}]*\]", lambda found: " ".join(found[0].split()), text)  # a list a line
    FILE.write_text(text + "\n", encoding="utf-8")
