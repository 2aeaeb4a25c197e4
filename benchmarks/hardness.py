"""How much noise, rounding, delay and lag an upright chain survives, beside `theory.hardness`.

    python benchmarks/hardness.py --out results/hardness.csv

lets the linear controller of least action keep chains of 1 to 10 rods upright, in the environment.
It finds by halving what half of 64 held-out episodes of 20 s survive. Every row of the file is
written when it is known. What is in the file already is not measured again, so it can be
interrupted. `--publish` measures nothing: it puts rows, table and figure into `docs/`.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from csv_tables import publish_table, read_rows
from matplotlib.figure import Figure
from scipy.linalg import expm, solve_discrete_are

from npend_gym import Cart, Chain, theory
from npend_gym.envs import EnvConfig
from npend_gym.physics import linearise
from npend_gym.report import panels, styled, write_csv, write_figure
from npend_gym.rl import HELD_OUT, rollout
from npend_gym.theory import with_lag
from npend_gym.tools import BLUE, FAINT, ORANGE, FloatArray, machine

DOCS = Path(__file__).parents[1] / "docs"
PAGE = DOCS / "notes" / "how_hard.md"
BASES, RODS = ("pivot", "cart"), range(1, 11)
SENSED = ("noise", "resolution")
LABELS = {"task": "strong motor", "weak": "weak motor"}
QUANTITIES = {"noise": "rad", "resolution": "rad", "delay": "s", "lag": "s"}
MOTORS = {"weak": 0.005, "weaker": 0.0005, "task": 1.0}  # times the limit in the tasks
WEAK = {"noise": "weak", "resolution": "weak", "delay": "weaker", "lag": "weaker"}
SUBSTEPS = {"delay": 32, "lag": 32}  # within a step the motor changes from substep to substep
SHARE = 0.1  # of the largest noise, with which delay and lag are found
CENTRING = 0.03  # 1/s, how fast a cart comes back to the middle of its rail
WIDTH = 2.0  # the search begins within this factor of the theory
HALVINGS = 5
LOWEST = 1e-3  # of the theory, below which nothing is looked for; nor above 1 / LOWEST
EPISODES = 64


def env_of(base: str, n: int, motor: str) -> dict[str, Any]:
    """Return the keywords of an environment, with a rail that does not end."""
    keywords: dict[str, Any] = {
        "mode": "balance", "observation": "sincos", "observe_velocities": False,
    }  # fmt: skip
    if base == "pivot":
        torque = EnvConfig(mode="balance", n=n).max_torque
        return keywords | {"n": n, "max_torque": MOTORS[motor] * torque}
    chain = Chain.rods(np.full(n, 0.1), 1.0, gravity=9.8, base=Cart(1.0))  # CartPole's at n = 1
    force = MOTORS[motor] * 10.0
    return keywords | {"chain": chain, "base": "cart", "max_force": force, "rail": 1000.0}


def system(config: EnvConfig) -> tuple[FloatArray, FloatArray, float]:
    """Return A, B and the limit of the upright chain."""
    joints = () if config.has_cart else (0,)
    return *linearise(config.chain, np.pi, joints=joints), float(config.action_limits[0])


@cache
def theory_of(base: str, n: int) -> theory.Hardness:
    """Return the theory with the motor of the tasks; a weaker one takes off noise alone."""
    a, b, limit = system(EnvConfig(**env_of(base, n, "task")))
    return theory.hardness(a, b, limit=limit, share=SHARE)


def held(a: FloatArray, b: FloatArray, duration: float) -> tuple[FloatArray, FloatArray]:
    """Return the map of the state over some time, and that of an action that is held."""
    block = np.zeros((len(a) + 1,) * 2)
    block[:-1] = np.hstack([a, b])
    moved = expm(block * duration)
    return moved[:-1, :-1], moved[:-1, -1]


class Balancer:
    """The controller of least action, which knows the noise, the delay and the lag.

    It sees the angles as the sensors show them. The environment shows the place of a cart exactly,
    so the controller adds the same noise [m] or rounding to it. A cart is centred by a weak
    feedback: of a system with a spring that pushes the cart away, the controller pulls it back.
    """

    def __init__(
        self, config: EnvConfig, noise: float, resolution: float, delay: float, lag: float
    ) -> None:
        self._config, self._noise, self._resolution = config, noise, resolution
        a, b, limit = system(config)
        design = theory.least_action(a, b, limit=limit, dt=config.dt, delay=delay, lag=lag)
        self._gain, self._correct = -design.feedback, design.estimator
        if config.has_cart:
            self._centre(config, delay, lag)
        a, b = with_lag(a, limit * b, lag)
        whole, share = divmod(delay / config.dt, 1.0)
        self._whole = int(whole)  # actions that are on their way
        older, newer = share * config.dt, (1.0 - share) * config.dt
        self._step, self._first_part = held(a, b, config.dt), held(a, b, older)
        self._last_part = held(a, b, newer)

    def _centre(self, config: EnvConfig, delay: float, lag: float) -> None:
        """Let the controller bring a cart back to the middle of its rail."""
        a, b, limit = system(config)
        spring = np.zeros(len(a))
        mass = float(config.chain.masses.sum()) + config.chain.base.mass
        spring[config.n] = CENTRING**2 * mass / limit
        pushed = a + limit * b @ spring[None]
        design = theory.least_action(pushed, b, limit=limit, dt=config.dt, delay=delay, lag=lag)
        size = design.feedback.size  # with the output of the motor, which is known
        self._gain = np.append(spring, np.zeros(size - len(spring))) - design.feedback
        outputs, noise = np.eye(config.n + 1, len(a)), np.eye(config.n + 1)
        shaken = np.zeros_like(a)
        shaken[2 * config.n + 1, 2 * config.n + 1] = CENTRING**4 * config.dt**2  # of its velocity
        spread = solve_discrete_are(held(a, b, config.dt)[0].T, outputs.T, shaken, noise)
        correct = np.linalg.solve(outputs @ spread @ outputs.T + noise, outputs @ spread).T
        self._correct = np.append(correct, np.zeros((size - len(a), config.n + 1)), axis=0)

    def reset(self, num_envs: int) -> None:
        """Forget all: the chains stand upright at rest."""
        self._state = np.zeros((num_envs, len(self._correct)))
        self._past = np.zeros((self._whole + 2, num_envs))  # the latest action comes first
        self._rng, self._begun = np.random.default_rng(0), False

    def __call__(self, observation: Any, info: Mapping[str, Any]) -> FloatArray:
        """Return the actions."""
        if self._begun:
            halfway = self._moved(self._state, self._past[self._whole + 1], self._first_part)
            self._state = self._moved(halfway, self._past[self._whole], self._last_part)
        measured = self._measured(np.asarray(observation, np.float64), info)
        expected = self._state[:, : measured.shape[1]]
        self._state = self._state + (measured - expected) @ self._correct.T
        ahead = self._moved(self._state, self._past[self._whole], self._first_part)
        for action in self._past[: self._whole][::-1]:
            ahead = self._moved(ahead, action, self._step)
        action = np.clip(ahead @ self._gain, -1.0, 1.0)
        self._past, self._begun = np.concatenate([action[None], self._past[:-1]]), True
        return action[:, None]

    @staticmethod
    def _moved(state: FloatArray, action: FloatArray, part: tuple[FloatArray, FloatArray]) -> Any:
        """Return the states after a part of a step with held actions."""
        return state @ part[0].T + np.outer(action, part[1])

    def _measured(self, seen: FloatArray, info: Mapping[str, Any]) -> FloatArray:
        """Return the angles from upright, and the place of a cart with errors."""
        n = self._config.n
        angles = np.arctan2(-seen[:, :n], -seen[:, n : 2 * n])
        if not self._config.has_cart:
            return angles
        place = info["cart_position"] + self._noise * self._rng.normal(size=len(seen))
        if self._resolution > 0.0:
            place = self._resolution * np.round(place / self._resolution)
        return np.column_stack([angles, place])


def survivors(keywords: dict[str, Any], errors: Mapping[str, float], episodes: int) -> float:
    """Return the share of held-out episodes that last, with these errors of sensors and motor."""
    noise, resolution, delay, lag = (errors.get(name, 0.0) for name in QUANTITIES)
    config = EnvConfig(**keywords)
    keywords = keywords | {
        "angle_noise": noise, "angle_resolution": resolution, "motor_lag": lag,
        "action_delay": delay / config.dt,
    }  # fmt: skip
    envs = gym.make_vec("NPendulum-v0", num_envs=episodes, **keywords)
    upright = {"theta": np.pi, "omega": 0.0}
    if config.has_cart:
        upright |= {"cart_position": 0.0, "cart_velocity": 0.0}
    last = np.ones(episodes, np.bool_)
    balancer = Balancer(config, noise, resolution, delay, lag)
    for running, _, _, info in rollout(balancer, envs, HELD_OUT, upright):
        last = np.where(running, info["success"], last)
        if np.count_nonzero(last) < 0.4 * episodes:
            break
    envs.close()
    return float(last.mean())


def found_by_halving(share: Callable[[float], float]) -> float:
    """Return the largest factor whose share is a half or more; 0 where there is none."""
    low, high = 1.0 / WIDTH, WIDTH
    while share(low) < 0.5:
        low, high = 0.5 * low, low
        if low < LOWEST:
            return 0.0
    while share(high) >= 0.5:
        low, high = high, 2.0 * high
        if high > 1.0 / LOWEST:
            raise ValueError(f"half of the episodes last at {1.0 / LOWEST:g} times the theory")
    for _ in range(HALVINGS):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if share(middle) >= 0.5 else (low, middle)
    return math.sqrt(low * high)


def measured(base: str, n: int, motor: str, quantity: str) -> dict[str, Any]:
    """Return a row: what the theory says, and what half of the episodes survive."""
    keywords = env_of(base, n, motor) | {"substeps": SUBSTEPS.get(quantity)}
    found, scale = theory_of(base, n), MOTORS[motor]
    of_sensors = quantity in SENSED
    expected = float(getattr(found, quantity)) * (scale if of_sensors else 1.0)
    fixed = {} if of_sensors else {"noise": SHARE * scale * found.noise}
    start = time.process_time()

    def share(factor: float) -> float:
        return survivors(keywords, fixed | {quantity: factor * expected}, EPISODES)

    factor = found_by_halving(share)
    return {
        "base": base, "rods": n, "motor": motor, "quantity": quantity,
        "unit": QUANTITIES[quantity], "theory": expected, "measured": factor * expected,
        "ratio": round(factor, 3), "fastest_pole": float(found.poles[-1]),
        "pole_sum": found.pole_sum, "bits_per_second": found.bits_per_second,
        "static_delay": found.static_delay, "episodes": EPISODES, "seed": HELD_OUT,
        "seconds": round(time.process_time() - start, 1), "machine": machine(),
    }  # fmt: skip


def cells() -> list[tuple[str, int, str, str]]:
    """Return what is measured; delay and lag need noise that the strong motor may not survive."""
    kinds = [*((motor, quantity) for quantity, motor in WEAK.items()), *product(["task"], SENSED)]
    return [(base, n, *kind) for kind, base, n in product(kinds, BASES, RODS)]


def of_row(row: Mapping[str, Any]) -> tuple[str, int, str, str]:
    """Return which cell a row is of."""
    return row["base"], row["rods"], row["motor"], row["quantity"]


def by_cell(rows: Sequence[Mapping[str, Any]]) -> dict[tuple[str, int, str, str], Any]:
    """Return the rows by what they are of."""
    return {of_row(row): row for row in rows}


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return limits, and measured over theory, as a table in Markdown."""
    found = by_cell(rows)
    heads = [
        "base", "rods", "fastest pole [1/s]", "bits/s", "noise [rad]", "resolution [rad]",
        "delay [s]", "lag [s]", "static delay [s]", *QUANTITIES, "noise, strong motor",
    ]  # fmt: skip
    lines = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for base, n in product(BASES, RODS):
        first = found[base, n, "weak", "noise"]
        cells = [base, str(n), f"{first['fastest_pole']:.1f}"]
        cells.append(f"{first['bits_per_second']:.0f}")
        for name, weak in WEAK.items():
            motor = "task" if name in SENSED else weak
            cells.append(f"{found[base, n, motor, name]['theory']:.2g}")
        cells.append(f"{first['static_delay']:.2g}")
        cells += [f"{found[base, n, motor, name]['ratio']:.2f}" for name, motor in WEAK.items()]
        cells.append(f"{found[base, n, 'task', 'noise']['ratio']:.2f}")
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


@styled
def figure(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Draw the largest noise against the number of rods, and what was measured over the theory."""
    found = by_cell(rows)
    drawn = Figure(figsize=(7.6, 3.4))
    left, right = panels(drawn, 1, 2)
    for base, color in zip(BASES, (BLUE, ORANGE), strict=True):
        for motor, line, mark in (("task", "-", "s"), ("weak", "--", "o")):
            of = [found[base, n, motor, "noise"] for n in RODS]
            name = f"{base}, {LABELS[motor]}"
            left.plot(RODS, [row["theory"] for row in of], line, color=color, label=name)
            left.plot(RODS, [row["measured"] for row in of], mark, color=color, markersize=4)
        for quantity, mark in zip(QUANTITIES, "osx^", strict=True):
            ratios = [found[base, n, WEAK[quantity], quantity]["ratio"] for n in RODS]
            right.plot(RODS, ratios, mark, color=color, markersize=4, label=f"{quantity}, {base}")
    right.axhspan(0.8, 1.2, color=FAINT, alpha=0.4, linewidth=0.0)
    left.set(yscale="log", xlabel="rods", ylabel="noise of the angles [rad]", xticks=RODS)
    left.set_title("lines: theory, marks: measured")
    left.legend(fontsize=7)
    right.set(xlabel="rods", ylabel="measured / theory", xticks=RODS, ylim=(0.4, 1.6))
    right.set_title("weak motor")
    right.legend(fontsize=6, ncols=2)
    return drawn


def publish(rows: Sequence[Mapping[str, Any]]) -> None:
    """Put rows, table and figure into the documentation, where every cell has its row."""
    missing = [cell for cell in cells() if cell not in by_cell(rows)]
    if missing:
        raise SystemExit(f"{len(missing)} cells must be measured first, such as {missing[0]}")
    shown, drawn = table(rows), figure(rows)
    write_csv(DOCS / "results" / "hardness.csv", rows)
    write_figure(DOCS / "images" / "hardness.png", drawn)
    publish_table(PAGE, "| base |", shown)


def main() -> None:
    """Measure what is missing and write the file after every row, or publish it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("results/hardness.csv"))
    parser.add_argument("--quantities", nargs="+", choices=QUANTITIES, default=list(QUANTITIES))
    parser.add_argument("--publish", action="store_true", help="in docs/")
    arguments = parser.parse_args()
    rows = read_rows(arguments.out)
    if arguments.publish:
        publish(rows)
        return
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    done = {of_row(row) for row in rows}
    for cell in cells():
        if cell not in done and cell[3] in arguments.quantities:
            rows.append(measured(*cell))
            write_csv(arguments.out, rows)
            print(*cell, rows[-1]["theory"], rows[-1]["ratio"], flush=True)


if __name__ == "__main__":
    main()
