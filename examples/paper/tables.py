"""Tables 1-3 of the paper: in how many ways can e(N) be read, and does any give them.

Run it with `python examples/paper/tables.py`; it takes some seconds. The column N = 100 takes more
than a minute: `python examples/paper/tables.py 5 10 20 100`.
"""

import sys

import numpy as np

from npend_gym.paper import AS_WRITTEN, grid

columns = tuple(int(n) for n in sys.argv[1:]) or (5, 10, 20)

# Every way to compute e that the paper's words and listings leave open, at its starting angles.
result = grid(columns)
print(f"{len(result.readings)} readings of e(N), N = {', '.join(map(str, columns))}")

for title, e in (
    ("printed", result.printed),
    ("the text read literally", result.of(AS_WRITTEN)),
    ("the reading nearest to all that is printed", result.errors[result.nearest]),
):
    print(f"\n{title}:")
    for trial, row in enumerate(e, start=1):
        print(f"  trial {trial}  ", "  ".join(f"{value:.3f}" for value in row))

print(f"\nthe nearest: {result.readings[result.nearest]}")
print(f"it is off by {result.distances[result.nearest]:.3f} where it is off most")

# The trials differ in nothing but their starting angles. Do these differ enough?
needed = result.printed_scatter / result.sensitivity(AS_WRITTEN)
available = np.ptp(result.amplitudes, axis=0)
for n, want, have in zip(columns, needed, available, strict=True):
    print(f"N = {n}: the angles would have to differ by {want:.3f} rad and differ by {have:.3f}")
