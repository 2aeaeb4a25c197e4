"""Is it chaos? Follow a small change of the start along the motion of a released chain.

Run it with `python examples/paper/chaos.py`; a number, `python examples/paper/chaos.py 20`, is the
length of each run in periods of the slowest mode.
"""

import sys

import numpy as np

from npend_gym import Chain, theory
from npend_gym.chaos import tangent_growth

periods = float(sys.argv[1]) if len(sys.argv) > 1 else 100.0

# A regular motion lets neighbours part in proportion to time, so that the estimate falls as
# ln t / t. In a chaotic one they part exponentially, and it settles on the Lyapunov exponent.
print("largest Lyapunov exponent [1/s], estimated after a quarter, half and all of the run")
for angle in (np.pi / 4, 2.0):
    for n in (1, 2, 3, 5):
        if n == 1 and angle > 1.0:
            continue  # one pendulum is never chaotic
        chain = Chain.uniform(n)
        duration = periods * theory.fundamental_period(chain)
        run = tangent_growth(chain, angle, duration=duration)
        estimates = " ".join(f"{run.exponent(part):8.4f}" for part in (0.25, 0.5, 1.0))
        regular = np.log(run.times[-1]) / run.times[-1]
        print(f"N = {n} from {angle:.3f} rad: {estimates}   regular would be {regular:.4f}")
