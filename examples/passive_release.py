"""Release a chain of pendulums and time its bobs: the paper's experiment in a few lines.

Run it with `python examples/passive_release.py`; it prints a table and draws `release.png`.
"""

import sys

import numpy as np
from matplotlib.figure import Figure

from npend_gym import Chain, pseudo_periods, simulate, theory

START = np.pi / 4  # every rod starts 45 degrees from the vertical, at rest

print("  N   measured    paper's T0   slowest mode T1   [s]")
for n in (1, 2, 5, 10, 20, 100):
    chain = Chain.uniform(n)  # n bobs of 1 kg on rods of 1 m

    # The time each bob needs for one back-and-forth: its horizontal velocity reverses twice.
    periods = pseudo_periods(chain, START)

    # The paper's model, 2 pi sqrt(n l/g), treats the bobs as if they did not pull on each other.
    # The slowest normal mode is the exact answer for small swings of the whole chain.
    model, mode = theory.ideal_period(chain), theory.fundamental_period(chain)
    print(f"{n:3d} {periods.mean():10.4f} {model:13.4f} {mode:17.4f}")

# Watch one chain: where is each bob of a chain of ten, while it swings once?
chain = Chain.uniform(10)
times = np.linspace(0.0, theory.fundamental_period(chain), 13)
motion = simulate(chain, START, 0.0, times)

# Nothing takes energy out, so the sum of kinetic and potential energy must stay the same.
energy = motion.energy()
print(f"energy changes by {np.abs(energy / energy[0] - 1).max():.0e} of itself")

figure = Figure(figsize=(5, 5))
axes = figure.add_subplot()
for frame, place in enumerate(motion.positions()):  # place has shape (10, 2)
    x, y = np.vstack([[0.0, 0.0], place]).T  # the pivot first
    axes.plot(x, y, "o-", markersize=3, color=str(0.85 - 0.065 * frame))  # later is darker
axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title="Ten pendulums, one swing")
target = sys.argv[1] if len(sys.argv) > 1 else "release.png"
figure.savefig(target, dpi=150)
print("drawn:", target)
