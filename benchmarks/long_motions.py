"""The energy of a chain over a million periods, and work against precision, by several methods.

    python benchmarks/long_motions.py --out benchmarks/results

needs heyoka and MuJoCo, which plays the model that `Chain.to_mjcf` writes. Chains of one bob and
of two swing freely from 1 rad, or from 0.75 and 0.25 rad. `drift` is the error of the energy
after more and more periods, in units of the energy to lift the chain.
`precision` is the largest error of an angle after 100 s, beside heyoka in extended precision, and
the processor time.
All of them run one after another on one core. `--figure` draws both.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from certify.cases import Case
from certify.equations import energy
from certify.oracle import right_side
from certify.runners import chain_of, from_joints, to_joints
from matplotlib.figure import Figure

from npend_gym import simulate
from npend_gym.report import panels, styled, write_csv
from npend_gym.tools import AMBER, BLACK, BLUE, GREEN, ORANGE, PINK, SKY, machine

Row = dict[str, Any]
Play = Callable[[np.ndarray], np.ndarray]  # from instants to states (T, 2, n)
STARTS = {1: (1.0,), 2: (0.75, 0.25)}
PERIODS = {1: 2.14, 2: 2.66}  # s, about, of the slowest swing
EQUAL = "midpoint", "gauss4", "gauss6", "rk4"
DRIFT = [  # method, steps in a period or the tolerance
    ("gauss4", 20), ("rk4", 20), ("dop853", 1e-10), ("heyoka", 2e-16), ("MuJoCo RK4", 20),
    ("MuJoCo Euler", 20), ("midpoint", 20), ("gauss6", 20), ("tsit5", 1e-8),
]  # fmt: skip
PRECISION = [
    *((method, 20 * 2**k) for method in EQUAL for k in range(6)),
    *((method, 10.0**-k) for method in ("dop853", "tsit5", "heyoka") for k in range(4, 15, 2)),
    *((f"MuJoCo {name}", 20 * 4**k) for name in ("RK4", "Euler") for k in range(4)),
]
COLORS = {
    "midpoint": SKY, "gauss4": BLUE, "gauss6": GREEN, "rk4": AMBER, "dop853": BLACK,
    "tsit5": "#888888", "heyoka": PINK, "MuJoCo RK4": ORANGE, "MuJoCo Euler": "#8B4513",
}  # fmt: skip


def case_of(n: int) -> Case:
    """Return the chain and its start, as the runners of `certify` take them."""
    each = [str(1)] * n
    chain: Any = {
        "gravity": "9.8125", "masses": each, "lengths": each, "centres": each,
        "inertias": ["0"] * n, "damping": ["0"] * n, "drag": ["0"] * n, "stiffness": None,
        "axial_damping": ["0"] * n, "cart_mass": None, "cart_damping": "0",
    }  # fmt: skip
    start = {"theta": [str(each) for each in STARTS[n]], "omega": ["0"] * n}
    return Case({"name": f"{n} swinging", "chain": chain, "start": start})


def player(case: Case, method: str, setting: float) -> tuple[Play, float | None]:
    """Return what plays a case by a method, and the length of its steps, if all are equal."""
    n = len(case.mechanism.masses)
    dt = PERIODS[n] / setting if setting >= 1.0 else None

    def ours(times: np.ndarray) -> np.ndarray:
        how: Any = {"rtol": setting, "atol": setting} if dt is None else {"dt": dt * (1 + 1e-9)}
        motion = simulate(chain_of(case), *case.start, times, method=method, **how)
        return np.stack([motion.theta, motion.omega], axis=1)

    def by_heyoka(times: np.ndarray) -> np.ndarray:
        steps = import_module("heyoka").taylor_adaptive(
            right_side(case), [0.0] * 2 * n, pars=[0.0] * n, tol=setting
        )
        steps.state[:], states = case.start.ravel(), []
        for t in times.tolist():
            steps.propagate_until(t)
            states.append(steps.state.reshape(2, n).copy())
        return np.array(states)

    def by_mujoco(times: np.ndarray) -> np.ndarray:
        mj: Any = import_module("mujoco")
        model = mj.MjModel.from_xml_string(chain_of(case).to_mjcf(timestep=dt))
        kind = method.removeprefix("MuJoCo ").upper()
        model.opt.integrator = getattr(mj.mjtIntegrator, f"mjINT_{kind}")
        data, states, done = mj.MjData(model), [], 0
        data.qpos[:], data.qvel[:] = (to_joints(case, values) for values in case.start)
        for count in np.rint(times / dt).astype(int).tolist():
            mj.mj_step(model, data, nstep=count - done)
            done = count
            states.append([from_joints(case, each) for each in (data.qpos, data.qvel)])
        return np.array(states)

    if method == "heyoka":
        return by_heyoka, None
    return (by_mujoco if method.startswith("MuJoCo") else ours), dt


def drift(n: int, periods: float, made: str) -> Iterator[Row]:
    """Yield the errors of the energy at instants that grow as powers."""
    case = case_of(n)
    below = np.cumsum(case.mechanism.masses[::-1])[::-1]
    lifted = 2.0 * case.mechanism.gravity * float(below @ case.mechanism.lengths)
    for method, setting in DRIFT:
        play, dt = player(case, method, setting)
        instants = PERIODS[n] * 10.0 ** np.linspace(0.0, np.log10(periods), 60)
        step = PERIODS[n] / 20 if dt is None else dt
        times = step * np.unique(np.append(0.0, np.rint(instants / step)))
        play(times[:3])
        begin = time.process_time()
        states = play(times)
        seconds = time.process_time() - begin
        energies = np.array([energy(case.mechanism, *state) for state in states])
        errors = (energies - energies[0]) / lifted
        print(f"{n} {method:14}{seconds:8.1f} s, at the end {errors[-1]:.1e}", flush=True)
        yield from [
            {"suite": "drift", "n": n, "method": method, "setting": setting,
             "periods": round(t / PERIODS[n], 3), "error": float(error), "seconds": seconds,
             "made_by": made}
            for t, error in zip(times[1:], errors[1:], strict=True)
        ]  # fmt: skip


def precision(n: int, made: str) -> list[Row]:
    """Return errors after 100 s, and what they cost."""
    case, rows, times = case_of(n), list[Row](), np.array([0.0, 100.0])
    hy: Any = import_module("heyoka")
    exact = hy.taylor_adaptive(
        right_side(case), np.zeros(2 * n, np.longdouble), pars=np.zeros(n, np.longdouble),
        fp_type=np.longdouble,
    )  # fmt: skip
    exact.state[:] = case.start.ravel()
    exact.propagate_until(np.longdouble(100.0))
    for method, setting in PRECISION:
        play, dt = player(case, method, setting)
        ends = times if dt is None else np.array([0.0, dt * np.ceil(100.0 / dt)])
        if dt is not None:
            ends[1] = 100.0
            play, _ = player(case, method, PERIODS[n] / (100.0 / np.ceil(100.0 / dt)))
        play(np.array([0.0, ends[1] / 10.0]))
        taken = []
        for _ in range(3):
            begin = time.process_time()
            states = play(ends)
            taken.append(time.process_time() - begin)
        error = float(np.abs(states[-1, 0] - exact.state[:n]).max())
        rows.append({"suite": "precision", "n": n, "method": method, "setting": setting,
                     "periods": round(100.0 / PERIODS[n], 3), "error": error,
                     "seconds": min(taken), "made_by": made})  # fmt: skip
        print(f"{n} {method:14}{setting:10.3g}{error:10.1e}{min(taken):10.4f} s", flush=True)
    return rows


@styled
def drawn(rows: list[Row]) -> Figure:
    """Draw the errors of the energy, and work against precision."""
    figure = Figure(figsize=(9.0, 3.8))
    left, right = panels(figure, 1, 2)
    for method, color in COLORS.items():
        own = [row for row in rows if row["method"] == method]
        found = [row for row in own if row["suite"] == "drift" and row["n"] == 1]
        if found:
            errors = np.maximum.accumulate(np.abs([row["error"] for row in found]))
            left.plot([row["periods"] for row in found], errors, color=color)
        points = [row for row in own if row["suite"] == "precision" and row["n"] == 2]
        right.plot([row["seconds"] for row in points], [row["error"] for row in points], "o-",
                   color=color, markersize=3, label=method)  # fmt: skip
    left.set(xscale="log", yscale="log", xlabel="periods", ylabel="largest error of the energy",
             title="one bob, from 1 rad", ylim=(1e-16, 10.0))  # fmt: skip
    right.set(xscale="log", yscale="log", xlabel="processor time [s]", ylabel="error [rad]",
              title="two bobs, 100 s", ylim=(1e-14, 10.0))  # fmt: skip
    figure.legend(*right.get_legend_handles_labels(), loc="outside right center", fontsize=7)
    return figure


def main() -> None:
    """Measure, write the table and, if wanted, the figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--periods", type=float, nargs=2, default=[1e6, 1e4])
    parser.add_argument("--figure", type=Path)
    chosen = parser.parse_args()
    made = machine()
    rows = precision(2, made)
    for n, periods in zip((2, 1), chosen.periods[::-1], strict=True):
        for row in drift(n, periods, made):  # what is measured is kept if the rest is interrupted
            rows.append(row)
            write_csv(chosen.out / "long_motions.csv", rows)
    if chosen.figure:
        drawn(rows).savefig(chosen.figure, dpi=150)


if __name__ == "__main__":
    main()
