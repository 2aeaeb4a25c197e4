"""The paper's free release from environment steps alone, for Gymnasium users.

Run it with `python examples/passive_env.py`; it prints a table and draws `passive_env.png`.
"""

import sys

import gymnasium as gym
import numpy as np
from matplotlib.figure import Figure

import npend_gym  # noqa: F401  registers the environments with Gymnasium

TRIALS = 3  # one row of every array each; up to 0.017 rad is added to their start at pi/4
LIMIT = 4000  # steps of 0.01 s

figure = Figure(figsize=(10, 4.2), layout="constrained")
left, right = figure.subplots(1, 2)

print("  N  measured mean   over trials   ideal   error   completed")
for n in (5, 10, 20, 100):
    options = {"n": n, "max_episode_steps": LIMIT}
    envs = gym.make_vec("npend/Release-v1", num_envs=TRIALS, **options)
    _, info = envs.reset(seed=0)
    wait, truncated = (
        np.zeros(TRIALS, np.int64),
        np.zeros(TRIALS, bool),
    )  # there is no motor: 0 means wait
    while info["bobs_completed"].min() < n and not truncated.any():
        _, _, _, truncated, info = envs.step(wait)
    trials, ideal = info["pseudo_period"], info["ideal_period"][0]  # means over the bobs; model
    mean, done = trials.mean(), f"{info['bobs_completed'].sum()}/{n * TRIALS}"
    row = f"{n:3d} {mean:11.4f} s   +- {trials.std(ddof=1):.4f} s {ideal:8.4f}"
    print(f"{row} {ideal / mean - 1:6.1%} {done:>10s}")
    bobs = info["pseudo_periods"][0]  # of the first trial; 0 where a bob has not completed
    left.plot(np.full(n, n), np.where(bobs > 0.0, bobs, np.nan), "_", color="#56A0CC", ms=10)
    left.plot(np.full(TRIALS, n), trials, "o", color="#0072B2")

grid = np.geomspace(4, 125)
left.plot(grid, 2 * np.pi * np.sqrt(grid / 9.81), color="#D55E00", label=r"$2\pi\sqrt{N l/g}$")
left.plot([], [], "o", color="#0072B2", label="measured, mean over the bobs")
left.plot([], [], "_", color="#56A0CC", ms=10, label="measured, each bob")
left.set(xscale="log", yscale="log", xlabel="number of pendulums N", ylabel="pseudo-period [s]")
left.set_xticks([5, 10, 20, 100], ["5", "10", "20", "100"])
left.set_yticks([2, 5, 10, 20], ["2", "5", "10", "20"])
left.set(title="Free release from 45 degrees", xlim=(4, 125), ylim=(2, 25))
left.minorticks_off()
left.legend(loc="lower right")

# Three pendulums released from high up: where does the tip go? The angles in info are not wrapped.
env = gym.make("npend/Release-v1", n=3)
theta = [env.reset(options={"theta": [2.0, 2.0, 2.0]})[1]["theta"]]
theta += [env.step(0)[-1]["theta"] for _ in range(1000)]  # the episode of 10 s
x, y = np.sin(theta).cumsum(1).T, -np.cos(theta).cumsum(1).T  # of each bob, from the pivot on
path = right.scatter(x[-1], y[-1], c=np.linspace(0, 10, len(theta)), s=4, linewidths=0)
right.plot([0, *x[:, 0]], [0, *y[:, 0]], "o-", color="black")
right.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title="Path of a triple pendulum's tip")
figure.colorbar(path, label="time [s]", shrink=0.8)
figure.savefig(target := sys.argv[1] if len(sys.argv) > 1 else "passive_env.png", dpi=150)
print("drawn:", target)
