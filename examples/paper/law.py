"""The law of the pseudo-period: measure it over N and angle, fit it, compare it with the paper's.

Run it with `python examples/paper/law.py`; 15 s. `python examples/paper/law.py 50` stops at 50
pendulums.
"""

import sys

import numpy as np

from npend_gym import Chain, theory
from npend_gym.experiments import LAW_UP_TO, N_VALUES, count_exponent, fit_law, scan

longest = int(sys.argv[1]) if len(sys.argv) > 1 else max(N_VALUES)
data = scan(tuple(n for n in N_VALUES if n <= longest))

# The median over the bobs has the same ratio to T1, the slowest mode, for every long chain.
print("median pseudo-period / T1")
print("angle [rad]", "".join(f"  N ={n:4d}" for n in data.n_values))
for angle, row in zip(data.amplitudes, data.median, strict=True):
    print(f"{angle:10.3f} ", "".join(f"{ratio:9.4f}" for ratio in row))

# For small angles the ratio needs no measurement: a hanging rope has it in closed form.
print(f"\nlimit of small angles, many bobs: {theory.release_profile(0.5):.4f}")

law = fit_law(data)
print(f"T = {law.limit:.4f} T1 [1 + b a^2/(1 + d a^2)], b = {law.b}, d = {law.d}")
print(f"residuals at most {np.abs(law.residuals).max():.2%}, from 10 bobs, up to {LAW_UP_TO} rad")
print(f"T ~ (N + 1/2)^p with p = {count_exponent(data, 'median', 0)}")

n = int(data.n_values[-1])
ideal = theory.ideal_period(Chain.uniform(n))
for angle in (0.01, np.pi / 4, 1.2):
    paper = ideal * (1.0 + float(theory.amplitude_correction(angle)))
    ours = theory.fundamental_period(Chain.uniform(n)) * float(law.ratio(np.array(angle)))
    print(f"N = {n}, {angle:.3f} rad: the paper's {paper:.2f} s, the law's {ours:.2f} s")
