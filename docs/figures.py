"""The figures of the documentation's own pages: `python docs/figures.py` draws them all.

They go to `docs/images`, or to the folder that is given. The others there are copies of what
`npend` draws; the page that shows one names the command.
"""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from npend_gym import Chain, __version__, physics, pseudo_periods, simulate
from npend_gym._checks import FloatArray
from npend_gym._palette import BLACK, BLUE, FAINT, GREEN, ORANGE
from npend_gym.envs import NPendulumEnv
from npend_gym.report import panels, styled
from npend_gym.report.swings_figure import swings_figure

HERE = Path(__file__).parent / "images"


def tension_matrix(chain: Chain, theta: FloatArray) -> FloatArray:
    """Return the matrix (n, n) of Eq. (1), whose unknowns are the tensions."""
    v = np.concatenate([[0.0], 1.0 / chain.masses])
    beside = -np.cos(np.diff(theta)) * v[1:-1]
    return np.diag(v[:-1] + v[1:]) + np.diag(beside, 1) + np.diag(beside, -1)


@styled
def tensions() -> Figure:
    """Draw the forces on a bob in motion, and the matrices of both systems of equations."""
    chain = Chain.uniform(6)
    theta = np.array([0.9, 0.3, 1.1, -0.2, -0.9, 0.4])  # so that no rods overlap
    omega = np.array([2.0, 3.0, 2.0, 3.0, 4.0, 3.0])
    place = simulate(chain, theta, omega, [0.0]).positions()[0]
    tension = physics.tensions(chain, theta, omega)
    figure = Figure(figsize=(8.6, 3.6))
    left, middle, last = figure.subplots(1, 3, width_ratios=(0.7, 1, 1))
    _draw_forces(left, chain, theta, np.vstack([np.zeros(2), place]), tension)
    for axes, system, title in (
        (middle, physics.mass_matrix(chain, theta), "for the angular accelerations"),
        (last, tension_matrix(chain, theta), "for the tensions"),
    ):
        largest = np.abs(system).max()
        shown = np.where(system == 0.0, np.nan, system)
        axes.imshow(shown, cmap="RdBu", vmin=-largest, vmax=largest)
        for (i, j), value in np.ndenumerate(shown):
            if np.isfinite(value):
                dark = abs(value) > 0.6 * largest
                axes.text(
                    j, i, f"{value:.1f}", ha="center", va="center", fontsize=6,
                    color="white" if dark else BLACK,
                )  # fmt: skip
        axes.set(title=title, xticks=[], yticks=[])
        axes.grid(visible=False)
    return figure


def _draw_forces(
    axes: Any, chain: Chain, theta: FloatArray, joints: FloatArray, tension: FloatArray
) -> None:
    rods = np.column_stack([np.sin(theta), -np.cos(theta)])  # e_i, outwards
    across = np.column_stack([np.cos(theta), np.sin(theta)])  # n_i
    for k in range(chain.n):
        axes.plot(*joints[k : k + 2].T, color=FAINT, linewidth=4.0 * tension[k] / tension.max())
        where = joints[k : k + 2].mean(axis=0) + 0.4 * across[k]
        axes.text(*where, f"{tension[k]:.0f} N", fontsize=7, ha="center", va="center")
    axes.plot(*joints[1:].T, "o", color=BLUE, markersize=5)
    axes.plot(*joints[0], "s", color=BLACK, markersize=4)
    bob = 2
    pulls = (
        (r"$T_i$", -tension[bob] * rods[bob], ORANGE, (-4, 8)),
        (r"$T_{i+1}$", tension[bob + 1] * rods[bob + 1], ORANGE, (-30, 6)),
        (r"$m_i g$", np.array([0.0, -chain.masses[bob] * chain.gravity]), GREEN, (5, -4)),
    )
    for name, force, color, beside in pulls:
        tip = joints[bob + 1] + 0.8 / tension[bob] * force
        arrow = {"arrowstyle": "-|>", "color": color, "linewidth": 1.6, "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", tip, joints[bob + 1], arrowprops=arrow)
        axes.annotate(name, tip, xytext=beside, textcoords="offset points", color=color)
    axes.set(
        aspect="equal", xlabel="x [m]", ylabel="y [m]", title="forces on a bob", xlim=(-0.2, 2.6)
    )


@styled
def conventions() -> Figure:
    """Draw from where angles are measured, and what torques at joints turn."""
    theta, radius = np.array([0.55, 1.15, -0.35]), 0.42
    rods = np.column_stack([np.sin(theta), -np.cos(theta)])
    joints = np.vstack([np.zeros(2), np.cumsum(rods, axis=0)])
    figure = Figure(figsize=(7.6, 4.0))
    axes: Any = figure.subplots(1, 2)
    for ax, title in zip(axes, ("angles", "torques"), strict=True):
        ax.plot(*joints.T, color=FAINT, linewidth=5.0, zorder=1)
        ax.plot(*joints[:-1].T, "o", color=BLACK, markersize=5, zorder=3)
        ax.plot(*joints[-1], "o", color=BLUE, markersize=7, zorder=3)
        ax.set(
            aspect="equal", xlim=(-0.8, 2.3), ylim=(-2.7, 0.6), title=title, xticks=[], yticks=[]
        )
        for spine in ax.spines.values():
            spine.set_visible(False)
    for i, angle in enumerate(theta):
        x, y = joints[i]
        axes[0].plot([x, x], [y, y - 0.75], "--", color=BLACK, linewidth=0.8)
        _arc(axes[0], joints[i], radius, -np.pi / 2, -np.pi / 2 + angle, BLUE)
        half = -np.pi / 2 + 0.5 * angle
        name, side = (f"$\\theta_{i}$", "center") if angle > 0.0 else (f"$\\theta_{i}$ < 0", "left")
        place = 1.45 * radius * np.array([np.cos(half), np.sin(half)])
        place += (0.3, 0.1) if angle < 0.0 else (0.0, 0.0)
        axes[0].text(*(joints[i] + place), name, color=BLUE, ha=side, va="center")
    axes[0].text(-0.1, 0.08, "pivot", ha="right")
    for name, to in (("x", (0.5, 0.0)), ("y", (0.0, 0.5))):
        arrow = {"arrowstyle": "-|>", "color": BLACK, "shrinkA": 0, "shrinkB": 0}
        origin = np.array([1.5, -0.1])
        axes[0].annotate("", origin + to, origin, arrowprops=arrow)
        axes[0].text(*(origin + 1.2 * np.array(to)), name, ha="center", va="center")
    for i in range(2):  # on the rod below the joint, and its reaction on what is above
        middle = np.arctan2(rods[i, 1], rods[i, 0])
        _arc(axes[1], joints[i], radius, middle - 0.9, middle + 0.9, ORANGE)
        _beside(axes[1], joints[i] + 0.5 * rods[i], rods[i], rf"$+\tau_{i}$ on rod {i}", ORANGE, 1)
    above = np.arctan2(-rods[0, 1], -rods[0, 0])
    _arc(axes[1], joints[1], radius, above + 0.9, above - 0.9, GREEN)
    _beside(axes[1], joints[1] - 0.4 * rods[0], rods[0], r"$-\tau_1$ on rod 0", GREEN, -1)
    axes[1].text(*(joints[0] + (0.12, 0.12)), "joint 0: the pivot holds")
    axes[1].text(*(joints[1] - (0.12, 0.12)), "joint 1", ha="right", va="top")
    return figure


def _arc(axes: Any, centre: FloatArray, radius: float, a: float, b: float, color: str) -> None:
    """Draw an arc from one direction to another, with a head at its end."""
    along = np.linspace(a, b, 40)[:, None]
    path = centre + radius * np.hstack([np.cos(along), np.sin(along)])
    axes.plot(*path[:-3].T, color=color, linewidth=1.6, zorder=2)
    arrow = {"arrowstyle": "-|>", "color": color, "linewidth": 1.6, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", path[-1], path[-4], arrowprops=arrow)


def _beside(
    axes: Any, place: FloatArray, rod: FloatArray, text: str, color: str, side: int
) -> None:
    across = side * np.array([-rod[1], rod[0]])
    align = "left" if across[0] > 0.0 else "right"
    axes.text(*(place + 0.5 * across), text, color=color, ha=align, va="center")


@styled
def definitions() -> Figure:
    """Draw what the definitions look at, for one bob of a release, and where each completes."""
    chain, start, bob = Chain.uniform(5), np.pi / 4, 2
    times = np.linspace(0.0, 15.0, 1501)
    motion = simulate(chain, start, 0.0, times)
    height = motion.positions()[:, bob, 1]
    of_com = np.cos(motion.theta) * motion.omega @ chain.lift / chain.masses.sum()
    signals = (
        ("bob", "horizontal velocity\nof the bob [m/s]", motion.velocities()[:, bob, 0]),
        ("link", "angular velocity\nof its rod [rad/s]", motion.omega[:, bob]),
        ("height", "height over\nthe start [m]", height - height[0]),
        ("com", "horizontal velocity of\nthe centre of mass [m/s]", of_com),
    )
    figure = Figure(figsize=(7.0, 6.9))
    rows = panels(figure, 4, 1, sharex=True)
    for axes, (definition, label, signal) in zip(rows, signals, strict=True):
        period = pseudo_periods(chain, start, definition=definition)[bob]
        axes.axhline(0.0, color=BLACK, linewidth=0.6)
        axes.plot(times, signal, color=BLUE)
        axes.set(ylabel=label)
        if np.isnan(period):
            axes.set_title(f'"{definition}": not completed')
            continue
        axes.axvline(period, color=ORANGE)
        axes.plot(period, 0.0, "o", color=ORANGE)
        axes.set_title(f'"{definition}": {period:.4f} s')
    rows[-1].set(xlabel="time since the release [s]", xlim=(0.0, times[-1]))
    figure.align_ylabels(rows)
    return figure


@styled
def tolerance() -> Figure:
    """Draw how the errors follow the tolerance, where the motion is regular and where it is not."""
    times = np.linspace(0.0, 10.0, 101)
    tolerances = 10.0 ** -np.arange(3.0, 14.0)
    figure = Figure(figsize=(7.2, 3.2))
    axes = panels(figure, 1, 2)
    for ax, start, name in zip(axes, (np.pi / 4, 2.0), ("pi/4", "2 rad"), strict=True):
        chain = Chain.uniform(10)
        best = simulate(chain, start, 0.0, times, rtol=1e-14, atol=1e-16)
        runs = [simulate(chain, start, 0.0, times, rtol=r, atol=0.01 * r) for r in tolerances]
        angles = [np.abs(run.theta - best.theta).max() for run in runs]
        energies = [np.abs(run.energy() / best.energy()[0] - 1.0).max() for run in runs]
        ax.plot(tolerances, angles, "o-", color=BLUE, markersize=4, label="angles [rad]")
        ax.plot(tolerances, energies, "s-", color=GREEN, markersize=4, label="energy, relative")
        ax.plot(tolerances, tolerances, "--", color=FAINT, label="rtol")
        ax.set(xscale="log", yscale="log", xlabel="rtol", title=f"ten rods from {name}, 10 s")
        ax.set_ylim(1e-16, 1e3)
    axes[0].set_ylabel("largest error")
    axes[0].legend()
    return figure


@styled
def noise_and_delay() -> Figure:
    """Draw what late and slow motors do to a rod, and what sensors show of its angle."""
    figure = Figure(figsize=(7.6, 3.0))
    left, right = panels(figure, 1, 2)
    wheel = {"n": 1, "gravity": 0.0, "max_torque": 1.0, "dt": 0.05}
    actions = np.repeat([1.0, 0.0, -1.0, 0.0], 8)[:, None]
    times = wheel["dt"] * np.arange(1 + len(actions))
    for label, color, keywords in (
        ("ideal", BLACK, {}),
        ("action_delay=2.5", BLUE, {"action_delay": 2.5}),
        ("and motor_lag=0.1", ORANGE, {"action_delay": 2.5, "motor_lag": 0.1}),
    ):
        env = NPendulumEnv(**wheel, **keywords)
        infos = [env.reset(seed=0, options={"theta": 0.0, "omega": 0.0})[1]]
        infos += [env.step(action)[-1] for action in actions]
        left.plot(times, [info["omega"][0] for info in infos], color=color, label=label)
    left.set(xlabel="time [s]", ylabel="angular velocity [rad/s]", title="motors")
    left.legend(fontsize=7)
    sensors = {"observation_delay": 2, "angle_noise": 0.02, "angle_resolution": 0.1}
    env = NPendulumEnv(n=1, mode="passive", dt=0.05, **sensors)
    shown = [env.reset(seed=0, options={"theta": 0.8, "omega": 0.0})]
    shown += [(observation, info) for observation, *_, info in (env.step(0) for _ in range(60))]
    times = 0.05 * np.arange(len(shown))
    right.plot(times, [info["theta"][0] for _, info in shown], color=BLACK, label="true")
    observed = [observation[0] for observation, _ in shown]
    right.plot(times, observed, ".", color=ORANGE, markersize=4, label="observed")
    right.set(xlabel="time [s]", ylabel="angle [rad]", title="sensors")
    right.legend(fontsize=7)
    return figure


def tutorial() -> Figure:
    """Return the figure that the reader of the tutorial draws, by the code that is shown there."""
    return figure_of_page("tutorial", 2)


def loop_timing() -> Figure:
    """Return the figure of the control loop, by the code of the page: its timing is measured."""
    return figure_of_page("bench_to_controller")


def figure_of_page(page: str, blocks: int | None = None) -> Figure:
    """Return the figure that the code of a page draws, or the first blocks of it."""
    text = (HERE.parent / f"{page}.md").read_text(encoding="utf-8")
    names: dict[str, Any] = {}
    examples, before = HERE.parents[1].resolve() / "examples", Path.cwd()
    with TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            Path("examples").symlink_to(examples)
            for code in re.findall(r"```python\n(.*?)```", text, re.DOTALL)[:blocks]:
                exec(code, names)  # noqa: S102
        finally:
            os.chdir(before)
    return names["figure"]


@styled
def class_experiment() -> Figure:
    """Draw what the last release of the class shows, by the code of the page."""
    page = (HERE.parent / "howto" / "class_experiment.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    data = HERE.parents[1] / "examples" / "data"
    names: dict[str, Any] = {"print": lambda *_: None}
    exec(code.replace("examples/data", data.as_posix()), names)  # noqa: S102
    figure = Figure(figsize=(7.2, 4.4))
    above, below = panels(figure, 2, 1, sharex=True)
    rows, period = names["number"] == names["k"], names["found"][-1]
    since = names["time"][rows] - names["time"][rows][names["held"]] - names["dt"] / 2.0
    above.plot(since, names["force"][rows], ".", color=BLUE, markersize=3)
    above.axvline(0.0, color=FAINT)
    above.axvline(period, color=ORANGE)
    above.annotate("the thread burns", (0.0, 4.5), (8, 0), textcoords="offset points")
    above.set(ylabel="force on the pivot [N]")
    t, momentum = names["t"], names["momentum"]
    half = np.interp(0.0, momentum[t < 0.7 * period][40:], t[t < 0.7 * period][40:])
    below.plot(t, momentum, color=BLUE)
    below.axhline(0.0, color=BLACK, linewidth=0.6)
    below.axvline(period, color=ORANGE)
    below.plot([half, period], [0.0, 0.0], "o", color=ORANGE)
    below.annotate(f"T = {period:.3f} s", (period, 0.2), (8, 0), textcoords="offset points")
    below.set(ylabel="momentum [kg m/s]", xlabel="time since the release [s]")
    figure.align_ylabels([above, below])
    return figure


def swings() -> Figure:
    """Draw the swings that the page measures, by the code of the page."""
    page = (HERE.parent / "howto" / "measure_g.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    names: dict[str, Any] = {"print": lambda *_: None}
    before = Path.cwd()
    with TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            exec(code, names)  # noqa: S102
        finally:
            os.chdir(before)
    return swings_figure(names["found"])


FIGURES = {
    "swings": swings,
    "conventions": conventions,
    "tensions": tensions,
    "definitions": definitions,
    "tolerance": tolerance,
    "noise_and_delay": noise_and_delay,
    "tutorial": tutorial,
    "class_experiment": class_experiment,
    "loop_timing": loop_timing,
}


def main() -> None:
    """Draw all figures."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else HERE
    folder.mkdir(parents=True, exist_ok=True)
    for name, draw in FIGURES.items():
        path = folder / f"{name}.png"
        draw().savefig(path, metadata={"Software": f"npend_gym {__version__}"})
        print("drawn:", path)


if __name__ == "__main__":
    main()
