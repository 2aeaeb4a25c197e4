"""The method of Dormand and Prince, order 8(5,3), with dense output of order 7.

E. Hairer, S. P. Norsett, G. Wanner, "Solving Ordinary Differential Equations I", section II.5 and
II.10; the coefficients are read from scipy.integrate.DOP853.
"""

from __future__ import annotations

from scipy.integrate import DOP853 as SCIPY

from npend_gym.physics.kernels.pairs import Pair, pair

DOP853: Pair = pair(
    SCIPY.A, SCIPY.B, SCIPY.C, [SCIPY.E5[:-1], SCIPY.E3[:-1]], 7,
    (SCIPY.A_EXTRA, SCIPY.C_EXTRA), SCIPY.D,
)  # fmt: skip
