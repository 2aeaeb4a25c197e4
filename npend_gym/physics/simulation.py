"""`simulate`: the equations of motion integrated in time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym._provenance import provenance
from npend_gym._threads import MAX_THREADS, Call, share_out
from npend_gym.chain import Chain, check_chain
from npend_gym.physics.arguments import check_settings
from npend_gym.physics.events import Event, EventFunction, Watch, watched
from npend_gym.physics.integration import check_times
from npend_gym.physics.many import Packs, frames_of_packs, stacked
from npend_gym.physics.recipe import motion_of
from npend_gym.physics.signals import TimeVarying
from npend_gym.physics.start import Start
from npend_gym.physics.trajectory import Trajectory, columns_of


@_checks.keywords_moved(
    cart_mass="of the chain: Chain(..., base=Cart(mass))",
    rail_damping="of the chain: Chain(..., base=Cart(mass, damping))",
    stiffness="of the chain: Chain(..., stiffness=...)",
    axial_damping="of the chain: Chain(..., axial_damping=...)",
    pivot_velocity="named velocity",
    device="a function of its own: npend_gym.physics.simulate_on_device(...)",
)
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
        Of the cart at ``times[0]`` [m and m/s], if the chain has one. With `pivot_acceleration`
        those of the pivot, also as two numbers, sideways and up: where there is drag, the motion
        of the chain depends on its velocity.
    stretch, stretch_rate : float or array_like, shape (n,) or (B, n), optional
        How much longer than ``chain.lengths`` springs are at ``times[0]`` [m], and its rate [m/s],
        zero where only `stretch` is given. By default springs carry the tensions of rigid rods,
        and so follow them without vibration.
    torque : float, array_like of shape (n,) or (B, n), Signal or callable, optional
        Torque [N m]: a number acts on joint 0, an array on every joint. A `Signal` was sampled in
        time; a function ``torque(t, theta, omega)`` returns a number or an array (n,), and must
        not write into its arguments, in which the other coordinates follow the angles.
    force : float, array_like of shape (B,), Signal or callable
        Horizontal force [N] on the cart; of a function of t, or of (t, theta, omega), a number.
    pivot_acceleration : array_like of shape (2,), Signal or callable, optional
        Acceleration of the pivot [m/s^2], sideways and up, which nothing else moves; of a function
        as for `force`, two numbers.
    method : {"dop853", "rk4"}
        "dop853": order 8(5,3), with steps chosen to meet `rtol` and `atol`. "rk4": order 4, with
        equal steps between two times, as few as possible but none longer than `dt`.
    rtol, atol : float
        Relative and absolute tolerance of each step (for "dop853").
    dt : float, optional
        Longest step [s]; "rk4" requires it. By default "dop853" takes steps of any length: at rest,
        where the motion has no error, very long ones.
    events : Event, callable or list of these, optional
        What is looked for: an `Event`, or a function ``event(t, theta, omega)`` whose zeros are
        wanted, with the attributes `terminal` and `direction` of SciPy's, if any. See
        ``t_events`` and ``status`` of `Trajectory`.
    threads : int
        That share many motions. No result depends on it.

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
    docs/extensions.md. The rail bears the reaction of a torque at joint 0. Results are the same
    bits on every machine, where functions of the user's are.

    Functions are compiled by Numba where they can be (once, in about a second); others are called
    in Python, which takes some microseconds for each evaluation, twelve in a step. Both give the
    same bits where Python and machine code do. Steps end at the instants of a `Signal`.

    The sign of an event is looked at in four places of each step, so two zeros that are nearer to
    each other may be missed; zeros are located to 1e-12 s on the polynomials between steps. A
    motion that begins at a zero is no event there.

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
    threads = _checks.count("threads", threads, high=MAX_THREADS)
    single = isinstance(chain, Chain) or not isinstance(chain, (list, tuple))
    chains = (check_chain(chain),) if single else tuple(cast("Sequence[Chain]", chain))
    own = [_checks.array("theta", theta), _checks.array("omega", omega)]
    one = single and max(each.ndim for each in own) < 2
    instants = check_times(times, check_chain(chains[0] if chains else None).n)
    drives = {"torque": torque, "force": force, "pivot_acceleration": pivot_acceleration}
    places = {"position": position, "velocity": velocity}
    axial = {"stretch": stretch, "stretch_rate": stretch_rate}
    begin = float(instants[0])
    started = Start(chains, own[0], own[1], drives, places | axial, begin, one=one)
    looked_for = watched(events, chains[0])
    if one:
        return _simulate_one(started, 0, instants, settings, events)
    if not started.varying and not looked_for:
        return _simulate_packs(started, instants, settings, threads)
    each: list[Trajectory | None] = [None] * started.count

    def follow(k: int, call: Call) -> None:
        if not call.stopped:
            each[k] = _simulate_one(started, k, instants, settings, events)

    share_out(range(started.count), threads, follow)
    return stacked([motion for motion in each if motion is not None], started)


def _simulate_one(
    started: Start, k: int, times: FloatArray, settings: dict[str, float], events: Any
) -> Trajectory:
    """Return one motion, until the last of the times or the first terminal event."""
    chain, mechanism, recipe = started.chain(k), started.one(k), started.recipe(settings, k)
    mechanism.check_vibrations(float(times[-1] - times[0]))
    state = np.concatenate([started.q[k], started.u[k]])
    motion = motion_of(mechanism, state, float(times[0]), recipe, started.callbacks)
    found = watched(events, chain)
    frames, counts, watch = np.empty((times.size, state.size)), np.zeros(3), Watch(found, chain)
    frames[0] = state
    for segment in motion.segments(times, kept=bool(found)):
        frames[segment.frames] = segment.states
        counts += segment.counts
        end = None if segment.steps is None else watch.look(segment.steps)
        if end is not None:
            before = times < end.time
            times = np.append(times[before], end.time)
            frames = np.concatenate([frames[: times.size - 1], [end.state]])
            break
    made = started.described(recipe) | motion.drives.as_dict()
    parts: dict[str, Any] = columns_of(mechanism, frames) | watch.as_dict()
    return Trajectory(
        chain, times, provenance=provenance(made), recipe=recipe,
        counts=counts.astype(np.int64) if "rtol" in settings else None, **parts,
    )  # fmt: skip


def _simulate_packs(
    started: Start, times: FloatArray, settings: dict[str, float], threads: int
) -> Trajectory:
    """Return many motions that nothing drives but constants, in packs."""
    mechanism, recipe = started.mechanism, started.recipe(settings)
    mechanism.check_vibrations(float(times[-1] - times[0]))
    packs = Packs(mechanism, np.hstack([started.q, started.u]), started.loads, settings)
    frames, counts = frames_of_packs(packs, times, threads)
    made: dict[str, Any] = {"motions": started.count} | started.described(recipe)
    if np.all(started.loads == started.loads[0]):
        made["torque"] = started.loads[0, : mechanism.n].tolist()
    parts: dict[str, Any] = dict(columns_of(mechanism, frames))
    return Trajectory(
        started.chains[0], times, **parts, provenance=provenance(made),
        status=np.zeros(started.count, np.int64), recipe=recipe,
        counts=None if counts is None else counts.astype(np.int64),
        chains=started.chains if len(started.chains) > 1 else (),
    )  # fmt: skip
