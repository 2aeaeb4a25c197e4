"""`identify`: a chain from measured motion; `prediction_rmse`: how well a chain predicts one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from numpy.typing import ArrayLike

from npend_gym.chain import Chain
from npend_gym.identification.motion import check_motion
from npend_gym.identification.moving_pivot import with_position
from npend_gym.identification.problem import FitProblem
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
    position: ArrayLike | None = None,
) -> Identification:
    """Fit the parameters of a chain to measured angles, without measured velocities.

    Parameters
    ----------
    times : array_like, shape (T,)
        Instants [s], increasing within a piece; they need no common interval, and may have gaps.
    theta : array_like, shape (T, n), or (T,) for one link
        Absolute angles from hanging [rad], counter-clockwise positive; whole turns do not matter.
    torque : array_like, shape (T, n), or (T,) for joint 0, optional
        Torques at the joints [N m], measured at `times` and linear between them. For commands that
        are held until the next row, give the mean of each and the one before. Without torques the
        motion is taken as free.
    chain : Chain, dict or str
        Known values: lengths, gravity, masses, friction speed, gears, and all that is not fitted.
        Of fitted values it has first ones.
        It sets the scale of free swings, whose data has none: lift0 is kept, or inertia0 where
        gravity or lift0 is zero.
    piece : array_like of int, shape (T,), optional
        Which recording each row is from; all from one by default.
    fit : sequence of str, optional
        What to fit, of each link: "inertia", "lift", "damping", "friction", "drag",
        "quadratic_drag", "armature", "length" (of all links but the last), "offset" (an angle of
        `theta` minus the true one); of the chain, "gravity". All named terms are fitted. By default
        inertia and lift, and as many of damping, friction, "quadratic_drag" and (with torques)
        armature as the data support. Offsets of free swings below 20 degrees are fitted then, with
        a warning, if they make errors much smaller.
    segment : float, optional
        Longest time [s] simulated from one initial state, which is fitted; at least 20 rows. By
        default four typical periods of the motion, or less if the motion is too sensitive.
    held_out : float
        Share of the segments, 0 to 0.5, that are held out to test the fit; they are evenly spaced.
        A single segment is fitted.
    position : array_like, shape (T,), optional
        Measured positions [m], at `times`, of a pivot or a cart that was moved sideways.

    Returns
    -------
    Identification

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule, or free swings are 100 times as slow or as fast as those of
        the given chain: times in milliseconds are refused. If the angles fit much better as
        degrees, angles of joints, angles from upright or from an axis that points sideways, or
        angular velocities. If they fit much better with shorter times, as from slow motion.
    RuntimeError
        If no chain with the given lengths moves like the data, or the fitted one is not a pendulum:
        centres ten lengths from their joint, ten times the given mass, or ten times the period of
        the data.

    Warns
    -----
    UserWarning
        If the angles are likely to be degrees, or lengths centimetres or millimetres. If a piece
        has no 20 rows without a gap, or there is no segment to hold out. If the fitted chain moves
        differently from the data, or few segments with persistent errors determine many values. If
        a fitted value is unlikely for a pendulum in air, or for times in seconds. If times were
        rounded: they are taken as evenly spaced.

    Notes
    -----
    A regression of the equations of motion, which are linear in the fitted values, gives first
    values. Multiple shooting refines them: it simulates segments of the motion, each from its own
    initial state. Robust least squares fits their angles, with segments that become longer. Its
    results do not depend on chance. docs/howto/real_pendulum.md has an example.

    Leave-one-out cross-validation decides which terms the data support: it predicts each segment
    from the others, without the held-out ones. The fit has the fewest terms whose squared errors
    are within one standard error of the smallest. `Identification.left_out` names the other terms.
    If few segments with persistent errors cannot distinguish terms, all are fitted.

    Gravity is fitted beside inertia and lift where links of given lengths hang on each other, or
    the pivot moves. Free swings of one link determine only its ratio to inertia0, and torques its
    product with lift0: the other is then kept as given. Its standard error does not contain errors
    of the given values.

    Examples
    --------
    >>> import numpy as np
    >>> from npend_gym import Chain, identify, simulate
    >>> times = np.linspace(0.0, 10.0, 501)
    >>> motion = simulate(Chain([1.0], [0.8], damping=0.05), 0.7, 0.0, times)
    >>> found = identify(times, motion.theta, chain=Chain([1.0], [0.8]), fit=["damping"])
    >>> round(float(found.chain.damping[0]), 3)
    0.05
    """
    motion = with_position(check_motion(times, theta, torque, piece), position)
    return FitProblem(motion, chain, fit, segment, held_out).solve()


def prediction_rmse(
    times: ArrayLike,
    theta: ArrayLike,
    torque: ArrayLike | None = None,
    *,
    chain: Chain | Mapping[str, Any] | str,
    piece: ArrayLike | None = None,
    segment: float | None = None,
    position: ArrayLike | None = None,
) -> float:
    """Return the root mean square error with which a chain predicts measured angles [rad].

    Each segment is simulated from an initial state that is fitted to it.

    Parameters
    ----------
    times, theta, torque, piece, segment, position
        As for `identify`.
    chain : Chain, dict or str
        The chain, which is not fitted.

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
    motion = with_position(check_motion(times, theta, torque, piece), position)
    problem = FitProblem(motion, chain, segment=segment)
    fit = problem.stages.judge(problem.stages.model.known, problem.blocks())
    return math.inf if fit is None else fit.rmse
