"""Small swings of a fitted chain: the periods of its normal modes, and their errors."""

from __future__ import annotations

import math

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.chain import Chain
from npend_gym.identification.parameters import FitModel, weighs
from npend_gym.identification.uncertainty import Uncertainty
from npend_gym.theory import normal_modes

_STEP = 1e-4  # of a fitted value, in a difference


def small_periods(chain: Chain) -> FloatArray:
    """Return the periods of small swings [s], the slowest first; NaN where nothing swings."""
    if not np.all(weighs(chain)):
        return np.full(chain.n, math.nan)
    return 2.0 * math.pi / normal_modes(chain)[0]


def small_period_errors(model: FitModel, fitted: FloatArray, errors: Uncertainty) -> FloatArray:
    """Return the standard errors of these periods, by those of the fitted values (k,)."""
    slopes = list[FloatArray]()
    for k, size in enumerate(model.scale(model.unpack(fitted)).tolist()):
        above = fitted.copy()
        above[k] += _STEP * size
        chains = [model.possible_chain(model.unpack(values)) for values in (above, fitted)]
        changed = [np.full(model.chain.n, math.nan) if c is None else small_periods(c)
                   for c in chains]  # fmt: skip
        slopes.append((changed[0] - changed[1]) / (_STEP * size))
    slope = np.reshape(slopes, (fitted.size, model.chain.n))
    out = np.sqrt(np.einsum("ki,kl,li->i", slope, errors.covariance, slope))
    out[np.any(np.abs(slope[np.isinf(errors.errors)]) > 0.0, axis=0)] = math.nan
    return out
