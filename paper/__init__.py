"""The study of one paper: S. Charles, The Lagrangian Mechanics and Pseudo-Periodicity ..., 2019.

`python -m paper --out results` computes every equation, number and claim of the paper again and
judges it, and measures the law of the centre of mass. The folder stands beside the package
`npend_gym` and uses it; it is not part of what is installed.

`claims.ini` has the claims: what the paper says and where, and our text about it. The modules in
`checks` have one check per claim, beside its figures and tables. `period` has our own paper.
"""
