"""The equations of motion: accelerations, tensions and mass matrix of any state of a chain.

In M(theta) alpha = f (the paper's Eq. (eom)) every rod is coupled to every other, but the tension
of a rod is coupled to those of its neighbours only. `accelerations` and `tensions` therefore solve
a tridiagonal system, in O(n) operations a state and without M, which
`npend_gym.physics.kernels.tensions` derives. Links with inertia are articulated bodies, solved in
as few operations by `npend_gym.physics.kernels.recursion`, as are all other mechanisms.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from typing_extensions import TypedDict, Unpack

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain, check_chain
from npend_gym.physics.arguments import check_limits, check_states, check_torque
from npend_gym.physics.energy import sincos, velocities
from npend_gym.physics.kernels.dynamics import derivative, new_work
from npend_gym.physics.kernels.link_terms import Base
from npend_gym.physics.kernels.states import solve_states
from npend_gym.physics.mechanism import (
    Mechanism,
    check_axial_start,
    check_lengths,
    mechanism_of,
)

_DIFFERENCE = 1e-5  # of the time in which the state changes: T' is a difference over that


class States(NamedTuple):
    """States of a chain, checked, with leading axes (...)."""

    mechanism: Mechanism
    q: FloatArray  # (..., m)
    u: FloatArray  # (..., m)
    loads: FloatArray  # (..., n), with a cart or a moving pivot (..., n + 1): its force [N]

    @property
    def rows(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """All without leading axes, a row for each state."""
        q, u, loads = (each.reshape(-1, each.shape[-1]) for each in (self.q, self.u, self.loads))
        return q, u, loads


class StateKeywords(TypedDict, total=False):
    """What belongs to a state beside angles, velocities and torques: see `accelerations`."""

    force: ArrayLike
    position: ArrayLike
    velocity: ArrayLike
    stretch: ArrayLike | None
    stretch_rate: ArrayLike | None
    pivot_acceleration: ArrayLike | None


def states_of(
    chain: Chain,
    theta: ArrayLike,
    omega: ArrayLike,
    torque: ArrayLike | None = None,
    **more: Unpack[StateKeywords],
) -> States:
    """Return the states that the arguments of `accelerations` describe.

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule, or is unknown.
    """
    n, known = check_chain(chain).n, StateKeywords.__annotations__
    for name in more:
        if name not in known:
            raise TypeError(
                f"a state has no keyword {name!r}{_checks.nearest(name, known)} It has "
                f"{', '.join(known)}"
            )
    angles, speeds, torques = check_states(
        n, theta=theta, omega=omega, torque=check_torque(torque, n)
    )
    check_limits(angles, speeds)
    return assembled(chain, angles, speeds, torques, **more)


def assembled(
    chain: Chain,
    angles: FloatArray,
    speeds: FloatArray,
    torques: FloatArray,
    *,
    force: ArrayLike = 0.0,
    position: ArrayLike = 0.0,
    velocity: ArrayLike = 0.0,
    stretch: ArrayLike | None = None,
    stretch_rate: ArrayLike | None = None,
    pivot_acceleration: ArrayLike | None = None,
    short: bool = False,
) -> States:
    """Do as `states_of` with angles, velocities and torques (..., n) that have been checked.

    Springs without length are no error where `short` is true.
    """
    accelerated = None
    if pivot_acceleration is not None:
        accelerated = _pair("pivot_acceleration", pivot_acceleration)
    mechanism = mechanism_of([chain], accelerated)
    leading, places = angles.shape[:-1], mechanism.places
    given = {"position": position, "velocity": velocity, "force": force}
    if places != 1:
        for name, value in given.items():
            none = type(value) is float and value == 0.0  # as nearly all are
            if not none and np.any(_checks.array(name, value)) and (places == 0 or name == "force"):
                raise ValueError(
                    f"{name} is that of a cart: the chain must have base=Cart(mass), got "
                    f"{_checks.show(value)}"
                )
    q, u, loads = [angles], [speeds], torques
    if places:
        for half, name in ((q, "position"), (u, "velocity")):
            half.append(_of_base(name, given[name], (*leading, places)))
        pushed = _checks.broadcast("force", force, leading) if places == 1 else np.zeros(leading)
        loads = np.concatenate([torques, pushed[..., None]], axis=-1)
    axial = check_axial_start(chain, stretch, stretch_rate, angles.shape)
    if chain.stiffness is not None:
        if axial is None:
            rigid = mechanism._replace(springs=None)
            first, second = (np.concatenate(half, axis=-1) for half in (q, u))
            axial = slow_start(chain, States(rigid, first, second, loads))
        if not short:
            check_lengths(chain.lengths, axial[0], chosen=stretch is None)
        q, u = [*q, axial[0]], [*u, axial[1]]
    return States(mechanism, np.concatenate(q, axis=-1), np.concatenate(u, axis=-1), loads)


def _pair(name: str, value: ArrayLike) -> FloatArray:
    given = _checks.array(name, value)
    if given.shape != (2,):
        raise ValueError(f"{name} must be two numbers, sideways and up, got {_checks.show(given)}")
    return given


def _of_base(name: str, value: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    """Return position or velocity of the base, (..., places): one number is sideways."""
    given = _checks.array(name, value)
    if shape[-1] == 2 and given.ndim == 0:
        given = np.array([float(given), 0.0])
    if shape[-1] == 1 and given.shape == shape[:-1]:
        given = given[..., None]
    if given.ndim != 1 or len(shape) == 1:
        return _checks.broadcast(name, given, shape)
    if given.shape != shape[-1:]:
        pair = " or two (sideways and up)," if shape[-1] == 2 else ""
        raise ValueError(
            f"{name} must be one number{pair} or an array of shape {shape}, got shape {given.shape}"
        )
    return np.array(np.broadcast_to(given, shape))


def accelerations(
    chain: Chain,
    theta: ArrayLike,
    omega: ArrayLike,
    torque: ArrayLike | None = None,
    **more: Unpack[StateKeywords],
) -> FloatArray:
    """Return the accelerations of all coordinates, in O(n) operations a state.

    Parameters
    ----------
    chain : Chain
    theta, omega : array_like, shape (..., n)
        Angles [rad] and angular velocities [rad/s]; one number stands for all rods, and leading
        axes (instants of a trajectory, say) stand for as many states.
    torque : float or array_like, shape (..., n), optional
        Torque on the joints [N m]: a number acts on joint 0, an array on every joint.
    **more
        For a cart: `force` [N], `position` [m] and `velocity` [m/s], shape (...). For springs:
        `stretch` [m] and `stretch_rate` [m/s], shape (..., n); by default springs follow rigid
        rods. For any chain: `pivot_acceleration`, two numbers [m/s^2].

    Returns
    -------
    ndarray, shape (..., m)
        Accelerations of the angles [rad/s^2], then of the cart [m/s^2], then of the stretches
        [m/s^2]. With `pivot_acceleration` the two numbers of the pivot replace the cart's.

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.

    Examples
    --------
    >>> from npend_gym import Cart, Chain, physics
    >>> physics.accelerations(Chain.uniform(3), [0.1, 0.2, 0.3], 0.0).round(4).tolist()
    [0.9035, -1.9112, -1.8829]
    >>> physics.accelerations(Chain.uniform(1, base=Cart(1.0)), 0.0, 0.0, force=2.0).tolist()
    [-2.0, 2.0]
    """
    states = states_of(chain, theta, omega, torque, **more)
    return _solve(states)[0]


def right_hand_side(chain: Chain) -> Callable[[float, FloatArray], FloatArray]:
    """Compiled right-hand side of the equations of motion, for integrators of other libraries.

    Parameters
    ----------
    chain : Chain
        Of any kind, without drives.

    Returns
    -------
    callable
        A function of a time [s], which has no effect, and a state (2m,): coordinates, then their
        rates. It returns the rates of the state as a new array. Coordinates are the angles [rad],
        then the position of a cart [m], then the stretches of springs [m]. It checks no argument.

    Examples
    --------
    >>> from scipy.integrate import solve_ivp
    >>> from npend_gym import Chain
    >>> from npend_gym.physics import right_hand_side
    >>> f = right_hand_side(Chain.uniform(1))
    >>> solve_ivp(f, (0.0, 1.0), [0.1, 0.0], rtol=1e-10, atol=1e-12).y[0, -1].round(4).item()
    -0.1
    """
    mechanism = mechanism_of([chain])
    arrays, work = mechanism.arrays(), new_work(mechanism.size)
    loads = np.zeros(mechanism.size)

    def rates(_t: float, state: FloatArray) -> FloatArray:
        slope = np.empty(state.size)
        derivative(state, loads, arrays, work, slope)
        return slope

    return rates


def tensions(
    chain: Chain,
    theta: ArrayLike,
    omega: ArrayLike,
    torque: ArrayLike | None = None,
    **more: Unpack[StateKeywords],
) -> FloatArray:
    """Return the tensions of the rods [N], positive where a rod pulls, in O(n) operations a state.

    The tension of a link with mass is the force along it in its upper joint. Parameters and shapes
    are as for `accelerations`.

    Returns
    -------
    ndarray, shape (..., n)

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.

    Examples
    --------
    >>> from npend_gym import Chain, physics
    >>> physics.tensions(Chain.uniform(3), 0.0, 0.0).round(2).tolist()
    [29.43, 19.62, 9.81]
    """
    return _tensions(chain, states_of(chain, theta, omega, torque, **more))


def _tensions(chain: Chain, states: States) -> FloatArray:
    mechanism, n = states.mechanism, chain.n
    if mechanism.springs is not None:
        stiffness, damping = mechanism.springs
        return stiffness[0] * states.q[..., -n:] + damping[0] * states.u[..., -n:]
    alpha, tension = _solve(states)
    if chain.is_ideal and mechanism.places == 0:
        return tension
    return _joint_forces(chain, states, alpha)


def _joint_forces(chain: Chain, states: States, alpha: FloatArray) -> FloatArray:
    """Return the forces along the links in their upper joints [N], by Newton's law."""
    n, places, mechanism = chain.n, states.mechanism.places, states.mechanism
    theta, omega = states.q[..., :n], states.u[..., :n]
    s, c = sincos(theta)
    along, across = np.stack([s, -c], axis=-1), np.stack([c, s], axis=-1)
    turned = alpha[..., :n, None] * across - (omega**2)[..., None] * along
    base = np.zeros((*theta.shape[:-1], 1, 2))
    moving = np.zeros_like(base)
    if places:
        base[..., 0, :places] = alpha[..., n : n + places]
        moving[..., 0, :places] = states.u[..., n : n + places]
    if places == 2 and mechanism.base is not None:
        base[..., 0, :] = mechanism.base[[Base.ACROSS, Base.UP], 0]
    tips = base + np.cumsum(chain.lengths[:, None] * turned, axis=-2)
    centres = tips + (chain.centres - chain.lengths)[:, None] * turned
    force = chain.masses[:, None] * (centres + np.array([0.0, chain.gravity]))
    if chain.has_drag:
        speeds = moving + velocities(chain, theta, omega)
        size = np.linalg.norm(speeds, axis=-1)
        force = force + (chain.drag + chain.quadratic_drag * size)[..., None] * speeds
    hanging = np.cumsum(force[..., ::-1, :], axis=-2)[..., ::-1, :]
    return -np.sum(hanging * along, axis=-1)


def slow_start(
    chain: Chain,
    rigid: States,
    later: Callable[[FloatArray, FloatArray, FloatArray], States] | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Return the stretch and its rate with which springs follow rigid rods, and do not ring.

    They carry the tensions T that rigid rods have in these states: stretch T/k, its rate T'/k. What
    is left of vibration along the rods decreases as 1/k^2. Where loads change in time,
    ``later(s, q, u)`` has those after `s` seconds, in the state (q, u).
    """
    alpha, n = _solve(rigid)[0], chain.n
    speeds, gains = np.abs(rigid.u[..., :n]), np.abs(alpha[..., :n])
    pace = np.maximum(speeds, np.sqrt(gains)).max(axis=-1, keepdims=True)
    h = _DIFFERENCE / np.where(pace > 0.0, pace, 1.0)

    def tensions_after(s: FloatArray, acting: Callable[..., States] | None = None) -> FloatArray:
        q, u = rigid.q + (s * rigid.u + 0.5 * s * s * alpha), rigid.u + s * alpha
        return _tensions(chain, acting(s, q, u) if acting else rigid._replace(q=q, u=u))

    rate = (tensions_after(h) - tensions_after(-h)) / (2.0 * h)
    if later is not None:  # a drive may begin now, and change fast
        g = np.minimum(h, _DIFFERENCE)
        first, second = (tensions_after(s, later) - tensions_after(s) for s in (g, 2.0 * g))
        rate = rate + (4.0 * first - second) / (2.0 * g)
    rate = rate / (stiffness := np.asarray(chain.stiffness))
    return (_tensions(chain, rigid) - chain.axial_damping * rate) / stiffness, rate


def _solve(states: States) -> tuple[FloatArray, FloatArray]:
    """Return accelerations (..., m) and tensions (..., n): one compiled call for all states."""
    mechanism, shape = states.mechanism, states.q.shape
    n, size = mechanism.n, mechanism.size
    alpha, tension = np.empty(shape), np.empty((*shape[:-1], n))
    solve_states(
        *states.rows, mechanism.arrays(), new_work(size), alpha.reshape(-1, size),
        tension.reshape(-1, n),
    )  # fmt: skip
    return alpha, tension
