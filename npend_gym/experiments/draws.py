"""The draw of a trial, the same in the release experiment, in campaigns and in mode "passive".

Trial t (from 0) of seed s starts where the environment does that is reset with seed s + t:

    start = amplitude + spread * np.random.Generator(np.random.Philox(key=s + t)).random()

It depends on nothing else: not on N, on the other trials, or on how they are divided among workers.
So trial t of every chain starts from the same angle, and seeds that differ by less than the number
of trials share trials.
"""

from __future__ import annotations

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym._streams import Purpose
from npend_gym.compiled.philox import first_units, keys_of


def starts(seed: int, first: int, count: int, amplitude: float, spread: float) -> FloatArray:
    """Return the starting angles of trials `first` to `first` + `count` - 1, counted from 0.

    Parameters
    ----------
    seed : int
        At least 0.
    first, count : int
    amplitude, spread : float
        A trial starts at `amplitude` plus one draw from [0, spread) [rad].

    Returns
    -------
    ndarray, shape (count,)
        [rad]

    Examples
    --------
    >>> from npend_gym import experiments
    >>> experiments.starts(0, 0, 3, 0.785, 0.017).round(3).tolist()
    [0.785, 0.79, 0.793]
    """
    keys = keys_of(_checks.count("seed", seed, low=0) + first, count)
    return amplitude + spread * first_units(keys, step=0, purpose=Purpose.START, episode=0)
