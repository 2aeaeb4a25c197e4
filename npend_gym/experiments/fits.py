"""Fitted numbers with their confidence intervals, and the law that is fitted to the amplitude."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray

LAW_FROM, LAW_UP_TO = 10, 1.2  # bobs, rad: where the law of the amplitude is fitted and holds


@dataclass(frozen=True)
class Estimate:
    """A fitted number with the half-width of its 95 % confidence interval."""

    value: float
    error: float

    def __str__(self) -> str:
        return f"{self.value:.4f} +- {self.error:.4f}"


def power_law(x: ArrayLike, y: ArrayLike) -> Estimate:
    """Return the exponent p of the fit y = c x^p, the slope between the logarithms.

    Parameters
    ----------
    x, y : array_like, shape (k,)
        Positive numbers, at least two, of which x are not all equal.

    Returns
    -------
    Estimate
        Its error is NaN where there are only two points.

    Raises
    ------
    ValueError
        If a number is not positive, there are not as many x as y, or fewer than two, or all x are
        equal.

    Examples
    --------
    >>> from npend_gym import experiments
    >>> round(experiments.power_law([1.0, 2.0, 4.0], [1.0, 1.41421, 2.0]).value, 3)
    0.5
    """
    from scipy.stats import linregress  # a third of a second, which no run should wait for first

    xs, ys = (_checks.positive(k, _checks.array(k, v)) for k, v in (("x", x), ("y", y)))
    if xs.shape != ys.shape or xs.ndim != 1 or xs.size < 2:
        raise ValueError(f"x and y must be at least two each, got shapes {xs.shape}, {ys.shape}")
    logs = np.log(xs), np.log(ys)
    if np.ptp(logs[0]) == 0.0:
        raise ValueError(f"x must hold two different numbers, got {_checks.show(xs.tolist())}")
    fit = linregress(*logs)
    error = 0.0 if np.ptp(logs[1]) == 0.0 else fit.stderr  # where SciPy has NaN
    return Estimate(float(fit.slope), float(_student(ys.size - 2) * error))


def estimates(values: FloatArray, covariance: FloatArray, points: int) -> list[Estimate]:
    """Parameters that `curve_fit` found in a number of points, with confidence intervals.

    Examples
    --------
    >>> import numpy as np
    >>> [(one.value, round(one.error, 3)) for one in estimates(np.ones(1), np.eye(1), 3)]
    [(1.0, 4.303)]
    """
    widths = _student(points - len(values)) * np.sqrt(np.diag(covariance))
    return [Estimate(float(v), float(w)) for v, w in zip(values, widths, strict=True)]


def amplitude_factor(amplitude: FloatArray, b: float, d: float) -> FloatArray:
    """Return 1 + b a^2 / (1 + d a^2): the law over its limit of small angles, for angles [rad].

    Examples
    --------
    >>> import numpy as np
    >>> amplitude_factor(np.array([0.0, 1.0]), 0.0625, 0.0).tolist()
    [1.0, 1.0625]
    """
    return 1.0 + b * amplitude**2 / (1.0 + d * amplitude**2)


def _student(freedom: int) -> float:
    from scipy.stats import t as student

    return float(student.ppf(0.975, freedom))
