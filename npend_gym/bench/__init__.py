"""How fast and how accurate the package is beside its peers: what `npend bench` measures.

A suite is a module with a function `rows`, which yields one comparison after another. Peers that
are not installed are left out. What is compared takes turns in one run, and the best of several
rounds counts, so that a noisy machine hurts all alike; only ratios are meant to be quoted.
"""

from __future__ import annotations

SUITES = ("dynamics", "environments", "accuracy")
