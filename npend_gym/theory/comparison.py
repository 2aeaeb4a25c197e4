"""The models that measured pseudo-periods are compared with."""

from __future__ import annotations

import math
from contextlib import suppress
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym.chain import Chain, check_chain
from npend_gym.theory.closed_forms import (
    amplitude_correction,
    ideal_period,
    large_n_com_period,
    pendulum_factor,
)
from npend_gym.theory.modes import fundamental_period
from npend_gym.theory.small_releases import com_period

_LAW_UP_TO = 2000  # unequal rods: the modes of more take minutes


class Models(NamedTuple):
    """Models of the pseudo-period of a released chain [s]; NaN where one does not apply.

    No model applies without gravity, to springs or to chains on a cart. The paper's models do not
    apply to links.

    Attributes
    ----------
    ideal : float
        The paper's T0, see `ideal_period`.
    corrected : float
        T0 times one plus the amplitude correction of a single pendulum.
    fundamental : float
        T1, the period of the slowest normal mode, see `fundamental_period`.
    law : float
        Pseudo-period of the centre of mass: T(N, a) of `large_n_com_period` for equal rods, and
        `com_period` for other chains. NaN for other chains with more than 2000 rods, or with
        frequencies 10^6 apart.
    """

    ideal: float
    corrected: float
    fundamental: float
    law: float


def models(chain: Chain, angle: ArrayLike) -> Models:
    """Return the models of the pseudo-period of `chain`, released from `angle` [rad].

    For an array `angle`, the corrections of its entries are averaged.

    Examples
    --------
    >>> import numpy as np
    >>> from npend_gym import Chain, theory
    >>> [round(float(period), 4) for period in theory.models(Chain.uniform(5), np.pi / 4)]
    [4.4857, 4.665, 3.9076, 4.0233]
    """
    angle = _checks.array("angle", angle)
    if not angle.size or not np.all(np.abs(angle) < math.pi):
        given = _checks.show(angle.tolist())
        raise ValueError(f"angle must be one or more, between -pi and pi, got {given}")
    if not check_chain(chain).is_hung:
        return Models(*[math.nan] * len(Models._fields))
    ideal = ideal_period(chain) if chain.has_bobs else math.nan
    corrected = ideal * (1.0 + float(amplitude_correction(angle).mean()))
    small = math.nan
    if chain.is_uniform and chain.gravity > 0.0:
        small = float(large_n_com_period(chain.n, 0.0, float(chain.lengths[0]), chain.gravity))
    elif chain.n <= _LAW_UP_TO:
        with suppress(ValueError):  # frequencies too far apart to be sampled
            small = float(com_period(chain))
    law = small * float(pendulum_factor(angle).mean())
    return Models(ideal, corrected, fundamental_period(chain), law)
