r"""The unstable modes of a linear system in steps, and the controller that needs least action.

Nothing but the noise of the sensors disturbs the system, so its stable modes stay at rest. For the
unstable ones the filter and the feedback have closed forms: the Gram matrices of controllability
have the entries 1 / (a_i a_j - 1) of Cauchy's matrix, where a_i is the growth of a mode in a step.
So the gains of ten rods are right to rounding, where a solver of Riccati's equation fails.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import eig, matrix_balance, solve_discrete_lyapunov, solve_triangular

from npend_gym import _checks
from npend_gym._checks import FloatArray

_ROUNDED = 1e-13  # of the balanced matrix: zeros, such as those of a cart, become that large
_LEVELS = 33  # commands that are tried together
_LOST = 10.0  # limits, from which on a command does not come back


def with_lag(a: FloatArray, b: FloatArray, lag: float) -> tuple[FloatArray, FloatArray]:
    """Return A and B with a further state, the output of a motor that lags the command.

    Examples
    --------
    >>> import numpy as np
    >>> a, b = with_lag(np.array([[0.0]]), np.array([[1.0]]), 0.5)
    >>> a.tolist(), b.tolist()
    ([[0.0, 1.0], [0.0, -2.0]], [[0.0], [2.0]])
    """
    if lag == 0.0:
        return a, b
    driven = np.append(np.hstack([a, b]), np.zeros((1, len(a) + 1)), axis=0)
    driven[-1, -1] = -1.0 / lag
    return driven, np.append(np.zeros_like(b), [[1.0 / lag]], axis=0)


def _count_unstable(a: FloatArray) -> int:
    """Return how many eigenvalues have a real part greater than zero beyond rounding.

    Rounding moves an eigenvalue by the rounded norm over the cosine between its eigenvectors.
    """
    balance: Any = matrix_balance
    balanced: FloatArray = balance(a)[0]
    found: Any = eig(balanced, left=True)
    values, left, right = found
    cosines = np.abs(np.sum(left.conj() * right, axis=0))
    return int(np.sum(values.real * cosines > _ROUNDED * np.linalg.norm(balanced)))


@dataclass(frozen=True, eq=False)
class UnstableModes:
    """The unstable modes of a system, each scaled so that an action of 1 drives it by 1.

    Attributes
    ----------
    poles, growth : ndarray, shape (k,)
        Poles [1/s], increasing, and the factors of growth in a step.
    to_modes, from_modes : ndarray, shapes (k, states) and (states, k)
        Left and right eigenvectors.
    outputs : ndarray, shape (m, k)
        The positions that are measured.
    """

    poles: FloatArray
    growth: FloatArray
    to_modes: FloatArray
    from_modes: FloatArray
    outputs: FloatArray

    @classmethod
    def of(cls, a: FloatArray, b: FloatArray, dt: float, lag: float) -> UnstableModes:
        """Return the unstable modes of x' = a x + b u, u being held for `dt`; or say why not.

        Parameters
        ----------
        a, b : ndarray, shapes (2m, 2m) and (2m, 1)
        dt, lag : float
            Length of a step, and time constant of the motor [s].
        """
        measured, count, largest = len(a) // 2, _count_unstable(a), np.abs(b).max()
        a, b = with_lag(a, b, lag)
        found: Any = eig(a, left=True)
        values, left, right = found
        kept = np.argsort(values.real)[len(values) - count :]  # that of a lag is stable
        poles = values.real[kept]
        if kept.size == 0 or np.any(values.imag[kept]) or np.any(np.diff(poles) < 1e-9 * poles[-1]):
            raise ValueError(
                "a must have unstable poles that are real and differ, as an upright chain has; "
                f"got the eigenvalues {_checks.show(values.tolist())}"
            )
        left, right = left.real[:, kept].T, right.real[:, kept]
        left = left / np.einsum("ki,ik->k", left, right)[:, None]
        drive = (left @ b)[:, 0] * np.expm1(poles * dt) / poles
        if np.any(np.abs(drive) <= 1e-12 * np.abs(left).max(axis=1) * largest * dt):
            raise ValueError("b must drive every unstable mode of a: this motor does not")
        from_modes = right * drive
        growth, to_modes = np.exp(poles * dt), left / drive[:, None]
        return cls(poles, growth, to_modes, from_modes, from_modes[:measured])

    def error_covariance(self) -> FloatArray:
        """Return the covariance of Kalman's estimate after a measurement, for noise of 1, (k, k).

        Its inverse is the information of all measurements up to now.
        """
        gram = self.outputs.T @ self.outputs / (1.0 - 1.0 / np.outer(self.growth, self.growth))
        size = 1.0 / np.sqrt(np.diag(gram))
        return np.linalg.inv(gram * np.outer(size, size)) * np.outer(size, size)

    def news(self, delay: float) -> FloatArray:
        """Return the covariance, (k, k), by which estimates change in a step, for noise of 1.

        They are estimates of the state after `delay` [s].
        """
        late = np.exp(self.poles * delay)
        change = np.outer(self.growth, self.growth) - 1.0
        return change * self.error_covariance() * np.outer(late, late)

    def gain(self) -> FloatArray:
        """Return the feedback of the least mean squared action, (k,): it mirrors the poles."""
        a = self.growth
        return np.array([(a[i] - 1.0 / a[i]) * math.prod(
            (a[i] - 1.0 / a[j]) / (a[i] - a[j]) for j in range(a.size) if j != i
        ) for i in range(a.size)])  # fmt: skip

    def mean_square(self, news: FloatArray) -> float:
        """Return the mean squared action of `gain`, the trace of S times `news`.

        S solves Riccati's equation: S_ij = gain_i gain_j prod(a)^2 / (a_i a_j - 1).
        """
        a, gain = self.growth, self.gain()
        riccati = np.outer(gain, gain) / (np.outer(a, a) - 1.0) * float(np.prod(a)) ** 2
        return float(np.sum(riccati * news))

    def return_level(self, news: FloatArray) -> float:
        """Return the command from which the system just returns, cut off at 1, without noise.

        It starts in the mean of the states with that command. The coordinates are those of Takenaka
        and Malmquist: S is the identity there, and nothing cancels.
        """
        a = self.growth
        b, passed, matrix = np.sqrt(a * a - 1.0), np.ones(a.size), np.diag(a)
        to_modes = np.zeros_like(matrix)
        for j in range(a.size):
            to_modes[:, j] = passed * b[j] / (a * a[j] - 1.0)
            passed = passed * (a - a[j]) / (a * a[j] - 1.0)
            for i in range(j + 1, a.size):
                matrix[i, j] = b[i] * b[j] * math.prod(a[j + 1 : i])
        drive = b * np.append(1.0, np.cumprod(a[:-1]))
        gain = drive @ matrix / float(np.prod(a)) ** 2
        half = np.asarray(solve_triangular(to_modes, news, lower=True), np.float64)
        driven = np.asarray(solve_triangular(to_modes, half.T, lower=True), np.float64)
        closed = matrix - np.outer(drive, gain)
        spread = np.asarray(solve_discrete_lyapunov(closed, driven), np.float64)
        return _just_returning(matrix, drive, gain, spread @ gain / float(gain @ spread @ gain))


def _just_returning(
    matrix: FloatArray, drive: FloatArray, gain: FloatArray, start: FloatArray
) -> float:
    """Return the multiple of a state from which the cut off command just brings it back."""
    low, high = 1.0, _LOST
    for _ in range(2):
        levels = np.linspace(low, high, _LEVELS)
        state = levels * start[:, None]
        lost, undecided = np.zeros(_LEVELS, np.bool_), np.ones(_LEVELS, np.bool_)
        while undecided.any():
            command = gain @ state
            lost |= np.abs(command) > _LOST
            undecided &= ~lost & (np.sum(state * state, axis=0) > 1e-6)
            state = matrix @ state - np.outer(drive, np.clip(command, -1.0, 1.0))
            state[:, ~undecided] = 0.0
        first = max(int(np.argmax(lost)), 1)
        low, high = levels[first - 1], levels[first]
    return float(0.5 * (low + high))
