"""`simulate`: the equations of motion integrated in time."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import cycle
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._threads import MAX_THREADS
from npend_gym.chain import Chain, check_chain
from npend_gym.physics.adaptive import Motion
from npend_gym.physics.arguments import check_settings
from npend_gym.physics.driving import Signal, drive_of
from npend_gym.physics.events import Event, EventFunction
from npend_gym.physics.integration import check_times
from npend_gym.physics.kernels.dynamics import arrays_of
from npend_gym.physics.many import check_many, simulate_many, stacked
from npend_gym.physics.single import Conditions, is_law, simulate_one
from npend_gym.physics.trajectory import Trajectory

Law = Signal | Callable[..., Any]


def simulate(
    chain: Chain | Sequence[Chain],
    theta: ArrayLike,
    omega: ArrayLike,
    times: ArrayLike,
    *,
    torque: ArrayLike | Law | None = None,
    pivot_acceleration: ArrayLike | Law | None = None,
    cart_mass: float | None = None,
    force: float | Law = 0.0,
    rail_damping: float = 0.0,
    pivot_velocity: ArrayLike = 0.0,
    stiffness: ArrayLike | None = None,
    axial_damping: ArrayLike = 0.0,
    stretch: ArrayLike | None = None,
    stretch_rate: ArrayLike | None = None,
    method: str = "dop853",
    rtol: float = 1e-10,
    atol: float = 1e-12,
    dt: float | None = None,
    events: Event | EventFunction | Sequence[Event | EventFunction] | None = None,
    threads: int = 1,
    device: str = "cpu",
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
    torque : float, array_like of shape (n,) or (B, n), Signal or callable, optional
        Torque [N m]: a number acts on joint 0, an array on every joint. A `Signal` was sampled in
        time; a function ``torque(t, theta, omega)`` returns a number or an array (n,), and must
        not write into its arguments.
    pivot_acceleration : array_like of shape (2,), Signal or callable, optional
        Acceleration of the pivot [m/s^2], sideways and up; of a function of t, two numbers.
    cart_mass : float, optional
        Mass [kg] of a cart that carries the pivot along a horizontal rail; see `Trajectory.cart`.
        The rail bears the reaction of a torque at joint 0.
    force : float, Signal or callable
        Horizontal force [N] on the cart; of a function of t, a number.
    rail_damping : float
        Viscous damping of the cart on its rail [N s/m].
    pivot_velocity : float or array_like, shape (2,)
        Velocity of the pivot at ``times[0]`` [m/s], sideways and up; a number: sideways. The motion
        of the chain depends on it where there is drag, or damping on the rail.
    stiffness : float or array_like, shape (n,), optional
        Of rods that stretch [N/m]: massless springs between point masses, for a pivot at rest. By
        default rods are rigid, which is the limit of stiff ones; they take fewer steps.
    axial_damping : float or array_like, shape (n,)
        Viscous damping of the springs along their length [N s/m].
    stretch, stretch_rate : float or array_like, shape (n,), optional
        How much longer than ``chain.lengths`` the springs are at ``times[0]`` [m], and its rate
        [m/s], zero where only `stretch` is given. By default springs carry the tensions of rigid
        rods, and so follow them without vibration.
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
        ``t_events`` and `status` of `Trajectory`.
    threads : int
        That share the motions of a large B. No result depends on it.
    device : {"cpu", "cuda"}
        "cuda": many motions side by side on a GPU, by method "rk4", of rigid rods on a pivot at
        rest. `torque` may then have the shape (B, n) too. Needs the extra "cuda".

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
    links, friction, rotors and a pivot that moves, solved in O(n) as articulated bodies; see
    `npend_gym.physics.accelerations` and docs/extensions.md. Results are the same bits on every
    machine, where functions of the user's are.

    Functions are compiled by Numba where they can be (once, in about a second); others are called
    in Python, which takes some microseconds for each of twelve evaluations in a step. Both give the
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
    given = Conditions(
        torque, pivot_acceleration, cart_mass, force, rail_damping, pivot_velocity, stiffness,
        axial_damping, stretch, stretch_rate, events,
    )  # fmt: skip
    if _checks.choice("device", device, ("cpu", "cuda")) == "cuda":
        return _on_device(chain, theta, omega, times, settings, given)
    if not isinstance(chain, (list, tuple)):
        chain = check_chain(chain)
        states = _checks.array("theta", theta), _checks.array("omega", omega)
        if max(each.ndim for each in states) < 2:
            return simulate_one(chain, theta, omega, times, settings, given)
    chains = (chain,) if isinstance(chain, Chain) else tuple(chain)
    instants = check_times(times, check_chain(chains[0] if chains else None).n)
    law, fixed = is_law(torque), cast("Any", torque)
    parameters, states = check_many(chains, theta, omega, None if law else fixed)
    if "rtol" in settings and not given.beyond_torque and not law:
        return simulate_many(chains, parameters, states, instants, settings, threads)
    each = [
        simulate_one(own, a, b, instants, settings, given if law else given._replace(torque=c))
        for own, a, b, c in zip(cycle(chains), *states, strict=False)
    ]
    return stacked(each, chains if len(chains) > 1 else ())


def _on_device(
    chain: Chain | Sequence[Chain],
    theta: ArrayLike,
    omega: ArrayLike,
    times: ArrayLike,
    settings: dict[str, float],
    given: Conditions,
) -> Trajectory:
    """Return many motions from a GPU; see `simulate`."""
    if not isinstance(chain, Chain):
        raise TypeError(
            f'chain must be one Chain with device "cuda", got {type(chain).__name__}: '
            "simulate others one after another"
        )
    if "rtol" in settings or given.beyond_torque or is_law(given.torque):
        raise ValueError(
            'device "cuda" takes method "rk4", constant torques and rigid rods on a pivot at rest: '
            'use device "cpu" for anything else'
        )
    from npend_gym.physics.gpu_simulation import simulate_on_device

    instants = check_times(times, check_chain(chain).n)
    return simulate_on_device(chain, theta, omega, instants, given.torque, **settings)


def motion_of(trajectory: Trajectory) -> Motion:
    """Return the motion of rigid rods on a pivot at rest that a trajectory was made from.

    Raises
    ------
    ValueError
        If it was not made by `simulate` with "dop853".
    """
    made, chain = trajectory.integration, trajectory.chain
    if made is None or made.method != "dop853":
        raise ValueError('at() needs a trajectory made by simulate(..., method="dop853")')
    if trajectory.pivot.moves or trajectory.springs is not None:
        raise ValueError("at() of a trajectory from a file needs rigid rods on a pivot at rest")
    state = np.concatenate([trajectory.theta[0], trajectory.omega[0]])
    ends = float(trajectory.times[0]), float(trajectory.times[-1])
    tolerances = made.settings["rtol"], made.settings["atol"], made.settings.get("dt", math.inf)
    drive = drive_of(chain.n, chain.n, made.torque, 0.0, None)
    return Motion(arrays_of(chain.repeated(1)), state, drive, *tolerances, ends, chain.n)
