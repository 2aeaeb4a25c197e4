"""Reference cases by which a simulation engine is judged on chains of rods.

`references.json` has twelve chains, with their starts and their states after 1, 5 and 10 s to
1e-20. README.md describes the format. `oracle.py` computed it from the equations in `equations.py`,
which share nothing with the package. `runners.py` and `jax_runners.py` play the cases in engines.
"""
