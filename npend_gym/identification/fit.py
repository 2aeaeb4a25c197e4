"""`identify`: a chain from measured motion; `prediction_rmse`: how well a chain predicts one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from numpy.typing import ArrayLike

from npend_gym.chain import Chain
from npend_gym.identification.motion import check_motion
from npend_gym.identification.problem import Problem
from npend_gym.identification.result import Identification


def identify(
    times: ArrayLike,
    theta: ArrayLike,
    torque: ArrayLike | None = None,
    *,
    chain: Chain | Mapping[str, Any] | str,
    piece: ArrayLike | None = None,
    fit: Sequence[str] | None = None,
    segment: float | None = None,
    held_out: float = 0.25,
) -> Identification:
    """Fit the parameters of a chain to measured angles, without measured velocities.

    Parameters
    ----------
    times : array_like, shape (T,)
        Instants [s], increasing within a piece; they need no common interval, and may have gaps.
    theta : array_like, shape (T, n), or (T,) for one link
        Absolute angles from hanging [rad], counter-clockwise positive; whole turns do not matter.
    torque : array_like, shape (T, n), or (T,) for joint 0, optional
        Torques at the joints [N m]. Without them the motion is taken as free.
    chain : Chain, dict or str
        What is known: lengths, gravity, masses, friction speed, gears; and the values of what is
        not fitted. It is the scale of free swings, whose data has none.
    piece : array_like of int, shape (T,), optional
        Which recording each row is from; all from one by default.
    fit : sequence of str, optional
        What to fit, of each link: "inertia", "lift", "damping", "friction", "drag",
        "quadratic_drag", "armature", "length" (of all links but the last), "offset" (a measured
        angle less the true one). By default the first four and "quadratic_drag"; with torques
        "armature" too.
    segment : float, optional
        Longest time [s] that is simulated from one first state, which is fitted. By default four
        typical periods of the motion. Less is taken where the motion is too sensitive.
    held_out : float
        Share of the segments, 0 to 0.5, that are not fitted, and judge the fit.

    Returns
    -------
    Identification

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule, or free swings are 100 times as slow or as fast as those of
        the given chain: times in milliseconds are refused.
    RuntimeError
        If no chain with the given lengths moves like the data.

    Warns
    -----
    UserWarning
        If the angles are likely to be degrees or those of joints, lengths are likely to be
        millimetres, the fitted chain moves otherwise than the data, few segments whose errors last
        long determine many values, or a fitted value is none of a pendulum in air.

    Notes
    -----
    A regression of the equations of motion, in which what is fitted is linear, gives first values.
    Multiple shooting refines them: segments of the motion are simulated, each from a first state of
    its own, and their angles fitted by robust least squares, with segments that become longer. Its
    results do not depend on chance. docs/howto/real_pendulum.md has an example.

    Examples
    --------
    >>> import numpy as np
    >>> from npend_gym import Chain, identify, simulate
    >>> times = np.linspace(0.0, 5.0, 501)
    >>> motion = simulate(Chain([1.0], [0.8], damping=0.05), 0.7, 0.0, times)
    >>> found = identify(times, motion.theta, chain=Chain([1.0], [0.8]), fit=["damping"])
    >>> round(float(found.chain.damping[0]), 3)
    0.05
    """
    motion = check_motion(times, theta, torque, piece)
    return Problem(motion, chain, fit, segment, held_out).solve()


def prediction_rmse(
    times: ArrayLike,
    theta: ArrayLike,
    torque: ArrayLike | None = None,
    *,
    chain: Chain | Mapping[str, Any] | str,
    piece: ArrayLike | None = None,
    segment: float | None = None,
) -> float:
    """Return the root mean square error with which a chain predicts measured angles [rad].

    Each segment is simulated from a first state that is fitted to it.

    Parameters
    ----------
    times, theta, torque, piece, segment
        As for `identify`.
    chain : Chain, dict or str
        The chain; nothing of it is fitted.

    Returns
    -------
    float
        Infinite if the chain does not move like the data at all.

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.

    Examples
    --------
    >>> import numpy as np
    >>> from npend_gym import Chain, simulate
    >>> from npend_gym.identification import prediction_rmse
    >>> times = np.linspace(0.0, 2.0, 201)
    >>> chain = Chain.uniform(1)
    >>> theta = simulate(chain, 0.5, 0.0, times).theta
    >>> prediction_rmse(times, theta, chain=chain) < 1e-3
    True
    """
    problem = Problem(check_motion(times, theta, torque, piece), chain, segment=segment)
    fit = problem.stages.judge(problem.stages.model.known, problem.blocks())
    return math.inf if fit is None else fit.rmse
