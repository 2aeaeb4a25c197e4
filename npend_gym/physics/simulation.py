"""`simulate`: the equations of motion integrated in time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym._provenance import provenance
from npend_gym._threads import Call, check_threads, share_out
from npend_gym.chain import Chain, check_chain
from npend_gym.physics.events import Event, EventFunction, watched
from npend_gym.physics.integration import IntegrationError, check_settings, check_times, count_steps
from npend_gym.physics.mechanism import AXIAL, PIVOT, Mechanism, first_of
from npend_gym.physics.motion import packs_of
from npend_gym.physics.signals import TimeVarying
from npend_gym.physics.start import Start
from npend_gym.physics.trajectory import EVENTS, Trajectory
from npend_gym.physics.watch import Occurrence, Sightings, Watch


def simulate(
    chain: Chain | Sequence[Chain],
    theta: ArrayLike,
    omega: ArrayLike,
    times: ArrayLike,
    *,
    position: ArrayLike = 0.0,
    velocity: ArrayLike = 0.0,
    stretch: ArrayLike | None = None,
    stretch_rate: ArrayLike | None = None,
    torque: ArrayLike | TimeVarying | None = None,
    force: ArrayLike | TimeVarying = 0.0,
    pivot_acceleration: ArrayLike | TimeVarying | None = None,
    method: str = "dop853",
    rtol: float = 1e-10,
    atol: float = 1e-12,
    dt: float | None = None,
    events: Event | EventFunction | Sequence[Event | EventFunction] | None = None,
    threads: int = 1,
) -> Trajectory:
    """Integrate the equations of motion and return the state at the given times.

    Parameters
    ----------
    chain : Chain or sequence of Chain
        One for all motions, or one for each of B, of equally many rods.
    theta, omega : array_like, shape (n,) or (B, n)
        Angles [rad] and angular velocities [rad/s] at ``times[0]``; one number stands for all
        rods. (B, n): B motions, each by steps of its own, and `theta` of the result is (B, T, n).
        Angles that look like degrees, such as 120, bring a warning.
    times : array_like, shape (T,)
        Instants at which the state is wanted [s], increasing.
    position, velocity : float or array_like, shape (B,)
        Position and velocity of the cart at ``times[0]`` [m and m/s], if the chain has one. With
        `pivot_acceleration` they are those of the pivot: one number, sideways; two numbers,
        sideways and up, for all motions; or shape (B, 2). With drag, the motion of the chain
        depends on the velocity of the pivot.
    stretch, stretch_rate : float or array_like, shape (n,) or (B, n), optional
        How much longer than ``chain.lengths`` springs are at ``times[0]`` [m], and its rate [m/s],
        zero where only `stretch` is given. By default springs carry the tensions of rigid rods,
        and so follow them without vibration.
    torque : float, array_like of shape (n,) or (B, n), Signal or callable, optional
        Torque [N m]: a number acts on joint 0, an array on every joint. A `Signal` was sampled in
        time; a function ``torque(t, theta, omega)`` or ``torque(t)`` returns a number or an array
        (n,). In its arguments, which are copies, the other coordinates follow the angles.
        Parameters with a default may follow t.
    force : float, array_like of shape (B,), Signal or callable
        Horizontal force [N] on the cart. A function of t, or of (t, theta, omega), returns a
        number.
    pivot_acceleration : array_like of shape (2,), Signal or callable, optional
        Acceleration of the pivot [m/s^2], sideways and up; nothing else moves the pivot. A function
        as for `force` returns two numbers.
    method : {"dop853", "tsit5", "rk4", "midpoint", "gauss4", "gauss6"}
        "dop853" and "tsit5": orders 8(5,3) and 5(4), with steps chosen to meet `rtol` and `atol`.
        "rk4": order 4, with equal steps between two times, as few as possible but none longer than
        `dt`. "midpoint", "gauss4" and "gauss6": orders 2, 4 and 6, symplectic, with equal steps
        from the first time to the last, for chains without friction.
    rtol, atol : float
        Relative and absolute tolerance of each step (for "dop853" and "tsit5").
    dt : float, optional
        Longest step [s]; all methods but "dop853" and "tsit5" require it. By default these take
        steps of any length: at rest, where the motion has no error, very long ones. Functions limit
        them: see the notes.
    events : Event, callable or list of these, optional
        Events to find: an `Event`, or a function ``event(t, theta, omega)`` whose zeros are the
        events. It may have the attributes `terminal` and `direction` of SciPy's events. Coordinates
        of a cart, a moving pivot or springs follow the angles, so that the last angle is
        ``theta[n - 1]``. See ``t_events`` and ``status`` of `Trajectory`.
    threads : int
        Number of threads that share many motions. Results do not depend on it.

    Returns
    -------
    Trajectory

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule, or a function raises an exception or returns NaN or another
        shape.
    IntegrationError
        If the state diverges, or no step is small enough for the tolerance.

    Notes
    -----
    The equations are the paper's Eq. (eom), solved in O(n) through the rod tensions, or those of
    links, friction, rotors, carts and springs; see `npend_gym.physics.accelerations` and
    docs/extensions.md. The rail bears the reaction of a torque at joint 0. Results have the same
    bits on every machine, if functions of the user do.

    Functions are compiled by Numba where they can be, in about half a second; others are called in
    Python, which takes some microseconds for each evaluation, twelve in a step. A process keeps the
    machine code of 128 functions. It compiles a function again if its code, a default, or a
    variable of the enclosing function or module has changed. Both ways give the same bits if Python
    and machine code agree. Steps end at the instants of a `Signal`.

    No step with a function is longer than three of the intervals between `times`, on average. Nor
    is it longer than 1/12 of the fastest normal mode's period, or 0.5 s without gravity. This holds
    for all methods, derivatives and `Trajectory.at`. Calls of the function are at most 0.27 of a
    step apart. So no pulse is missed that lasts as long as an interval, or 1/47 of that period. For
    shorter pulses give `dt` or a `Signal`.

    The sign of an event is checked at four points of each step. So two zeros that are closer
    together may be missed. Zeros are located to 1e-12 s on the polynomials between steps. Functions
    are checked at four points of every part of a step with the length above. Events do not change
    the steps. A zero at the start is not an event.

    Symplectic steps are those of Gauss and Legendre in coordinates and canonical momenta. The error
    of the energy does not grow in time. docs/howto/long_motions.md says when they are worth it.

    Examples
    --------
    >>> import numpy as np
    >>> from npend_gym import Chain, simulate
    >>> motion = simulate(Chain.uniform(2), 1.0, 0.0, np.linspace(0.0, 10.0, 101))
    >>> motion.theta.shape
    (101, 2)
    >>> motion.positions()[-1, -1].round(4).tolist()
    [-1.4371, -1.3377]
    """
    settings = check_settings(method, rtol, atol, dt)
    threads = check_threads(threads)
    single = isinstance(chain, Chain) or not isinstance(chain, (list, tuple))
    chains = (check_chain(chain),) if single else tuple(cast("Sequence[Chain]", chain))
    angles, speeds = _checks.array("theta", theta), _checks.array("omega", omega)
    one = single and max(angles.ndim, speeds.ndim) < 2
    instants = check_times(times, first_of(chains).n)
    if dt is not None:
        count_steps(instants, settings["dt"])
    drives = {"torque": torque, "force": force, "pivot_acceleration": pivot_acceleration}
    places = {"position": position, "velocity": velocity}
    axial = {"stretch": stretch, "stretch_rate": stretch_rate}
    started = Start(
        chains, angles, speeds, drives, places | axial, instants, settings, method, one=one
    )  # fmt: skip
    watching = watched(events, chains[0])
    seen = [Sightings(len(watching)) for _ in range(started.count if watching else 0)]
    # functions of users are called for one motion after another
    of_any_chain = all(event.alone is not None for event in watching)
    together = not any(event.opaque for event in watching) and (of_any_chain or len(chains) == 1)

    def watch(members: slice) -> Watch:
        return Watch(events, started.chain(members.start), instants, seen[members])

    frames, counts = _follow(started, instants, seen, watch, threads, together=together)
    instants, frames = _until_ends(seen, instants, frames, one=one)
    which = 0 if one else slice(None)  # one motion has no leading axis
    parts: dict[str, Any] = _columns_of(started.states.mechanism, frames[which])
    parts |= _found(seen, chains[0].n, *frames[:, 0].shape, one=one)
    return Trajectory(
        chains[0], instants, provenance=provenance(started.described()), recipe=started.recipe,
        counts=counts[:, which].astype(np.int64) if "rtol" in settings else None,
        chains=chains if len(chains) > 1 else (), **parts,
    )  # fmt: skip


def _follow(
    started: Start, times: FloatArray, seen: list[Sightings], watch: Callable[[slice], Watch],
    threads: int, *, together: bool,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Return the states of all motions at the times, (B, T, 2m), and what was counted, (3, B).

    After the first terminal event of a motion they mean nothing. `watch` returns what looks for
    events in some of them; `seen` has what each of them showed.
    """
    mechanism, count = started.states.mechanism, started.count
    mechanism.check_vibrations(float(times[-1] - times[0]))
    check_times(times, count * mechanism.size)
    packed = not (started.is_one or started.varying) and (together or not seen)
    frames, counts = np.empty((count, times.size, 2 * mechanism.size)), np.zeros((3, count))
    frames[:, 0] = np.hstack(started.states[1:3])

    def follow(members: slice, call: Call, *, packed: bool = packed) -> None:
        motion, most = started.motion(members, packed=packed), members.stop - members.start
        looking = watch(members) if seen else None
        for segment in motion.segments(times, kept=looking is not None):
            frames[members, segment.frames] = segment.states[:most]
            counted, ended = segment.counts.reshape(3, -1)[:, :most], False
            if looking is not None:
                going = [each.end is None for each in seen[members]]
                ended = looking.look(segment.steps)
                for k, (each, steps) in enumerate(zip(seen[members], segment.steps, strict=False)):
                    if each.end is not None:
                        counted[:, k] = steps.counts(each.end.time) if going[k] else 0.0
            counts[:, members] += counted
            if ended or call.stopped:
                return

    def follow_watched(members: slice, call: Call) -> None:
        try:
            follow(members, call)
        except IntegrationError:  # perhaps of a motion that an event had ended
            for k in range(members.start, members.stop):
                seen[k].clear()
                counts[:, k] = 0.0
                follow(slice(k, k + 1), call, packed=False)

    each = [slice(k, k + 1) for k in range(count)]
    parts = packs_of(count, mechanism.kinds) if packed else each
    share_out(parts, threads, follow_watched if packed and seen else follow)
    return frames, counts


def _until_ends(
    seen: list[Sightings], times: FloatArray, frames: FloatArray, *, one: bool
) -> tuple[FloatArray, FloatArray]:
    """Return times and states up to the terminal events; of many motions NaN follows their own."""
    ends = [each.end for each in seen]
    side = "left" if one else "right"  # one motion gets the instant of its end beside the others
    lasts = [
        times.size if end is None else int(np.searchsorted(times, end.time, side)) for end in ends
    ]
    if one and ends and ends[0] is not None:
        time, state = ends[0]
        before = frames[:, : lasts[0]]
        return np.append(times[: lasts[0]], time), np.append(before, state[None, None], axis=1)
    for own, last in zip(frames, lasts, strict=False):
        own[last:] = np.nan
    last = max(lasts, default=times.size)
    return times[:last], frames[:, :last]


def _found(seen: list[Sightings], n: int, count: int, width: int, *, one: bool) -> dict[str, Any]:
    """Events found in each of `count` motions, by the names of `Trajectory`.

    `width` is that of a state, 2m.
    """
    found = [each.as_dict(n, width) for each in seen]
    ended = [each.end is not None for each in seen] or [False] * count
    if one:
        return {"status": int(ended[0])} | {name: own[name] for own in found for name in EVENTS}
    each = {name: zip(*(own[name] for own in found), strict=True) for name in EVENTS}
    lists = {name: [list(of_event) for of_event in own] for name, own in each.items()}
    none = Occurrence(np.nan, np.full(width, np.nan))
    ends = np.array([np.append(*(each.end or none)) for each in seen]) if any(ended) else None
    return {"status": np.array(ended, np.int64), "ends": ends} | lists


def _columns_of(mechanism: Mechanism, frames: FloatArray) -> dict[str, FloatArray]:
    """Return the parts of states (..., 2m) by the names of `Trajectory`."""
    n, m, places = mechanism.n, mechanism.size, mechanism.places
    q, u = frames[..., :m], frames[..., m:]
    parts = {"theta": q[..., :n].copy(), "omega": u[..., :n].copy()}
    if places:
        at = n if places == 1 else slice(n, n + 2)
        parts |= zip(PIVOT, (q[..., at].copy(), u[..., at].copy()), strict=True)
    if mechanism.springs is not None:
        parts |= zip(AXIAL, (q[..., -n:].copy(), u[..., -n:].copy()), strict=True)
    return parts
