"""What `benchmarks/peers.py` measures: how fast and how accurate the package is.

A suite is a module with a function `rows(peers)` that yields one comparison after another; `peers`
(`timing.Peers`) leaves out those that are not installed or fail, and says why. The compared jobs
take turns in one run, and the best of several rounds counts. So a noisy machine slows all of them
alike. Only ratios are meant to be quoted.

The suites are not part of the installed package: heyoka and diffrax compile the equations
themselves, so `accuracy.py` has to write the equations a second time, which the package never does.
"""
