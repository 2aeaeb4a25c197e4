"""The rows and entries, by name, of the arrays that the environments' kernels work on."""

from __future__ import annotations

from typing import NamedTuple

from npend_gym.envs.modes import Balance, Calm, Mode, Passive, Quantities, SwingUp, Transition
from npend_gym.physics.kernels.layout import Member


class EpisodeFields(NamedTuple):
    """Rows of the ensemble's `members` that belong to the environments.

    In a mode with goals the last 2 n rows are the cosines, +-1, of each rod in the equilibrium near
    which the episode started, and in that which is its goal.
    """

    START_ENERGY: int = len(Member)  # J, at the start of the episode
    MEAN_SQUARED_ACTION: int = len(Member) + 1  # of the last step, 0 to 1
    STARTING: int = len(Member) + 2  # 1 where an episode starts: the call judges it as new
    OBSERVED: int = len(Member) + 3  # 1 where a call that only observes is to write
    MAX_TORQUE: int = len(Member) + 4  # N m of the action 1
    PER_ENERGY: int = len(Member) + 5  # 1/J, of the energy that lifts the chain upright
    PER_LENGTH: int = len(Member) + 6  # 1/m, of the chain's length
    # 1/(kg m): height of the centre of mass, 0 to 1, over sum carried * (1 - cos)
    PER_LIFT: int = len(Member) + 7
    IDEAL_PERIOD: int = len(Member) + 8  # s; 0 where it does not apply
    HAS_BOBS: int = len(Member) + 9  # 1 where it does: point masses on massless rods
    EPISODE: int = len(Member) + 10  # number of the episode of this seed, from 0
    STEPS: int = len(Member) + 11  # of the episode
    STEPS_HELD: int = len(Member) + 12  # instants in a row at which the goal was met
    AMPLITUDE: int = len(Member) + 13  # rad, of a release
    MAX_FORCE: int = len(Member) + 14  # N of the action 1, on a cart
    CART_MASS: int = len(Member) + 15  # kg
    RAIL_DAMPING: int = len(Member) + 16  # N s/m


Episode = EpisodeFields()
EPISODE_ROWS = len(Episode)


class OutputFields(NamedTuple):
    """Rows of `outputs`, an entry for each lane.

    After these follow n rows each of pseudo-periods (0.0 where not complete), angles and angular
    velocities; QUANTITIES rows where Python judges and in modes with goals; the cosines of the
    angles in these.
    """

    TIME: int = 0  # s
    ENERGY: int = 1  # J
    ENERGY_ERROR: int = 2
    PSEUDO_PERIOD: int = 3  # s
    IDEAL_PERIOD: int = 4  # s
    TIP_HEIGHT: int = 5  # m
    COMPLETED: int = 6
    CART_POSITION: int = 7  # m; this and the next are written where there is a cart
    CART_VELOCITY: int = 8  # m/s
    PSEUDO_PERIOD_COM: int = 9  # s; 0 where not complete, or not measured
    REWARD: int = 10  # of a step: it is no part of the info


Output = OutputFields()


class FlagFields(NamedTuple):
    """Rows of `flags`, a truth for each lane."""

    MEASURED: int = 0  # a bob has completed its pseudo-period
    DIVERGED: int = 1
    SUCCESS: int = 2
    TERMINATED: int = 3  # this and the next belong to a step, and are no part of the info
    TRUNCATED: int = 4


Flag = FlagFields()
QUANTITIES = len(Quantities._fields) - 2  # all but angles and angular velocities


class TaskFields(NamedTuple):
    """Entries of `task`: what is the same for all lanes.

    The actuated joints follow, and then a factor of each observed angular velocity.
    """

    MODE: int = 0  # number of a built-in mode; 0: Python judges
    MAX_STEPS: int = 1  # of an episode; infinite: any number
    HOLD_STEPS: int = 2  # over which the goal must have held
    FORM: int = 3  # of the observation
    SPEED_LIMIT: int = 4  # to which observed angular velocities are clipped
    SPARSE: int = 5  # 1: the reward is 1 where the goal is met, else 0
    GOALS: int = 6  # 1: each episode has a goal of its own
    OBSERVED_GOALS: int = 7  # 1: which is observed after the angular velocities
    RAIL: int = 8  # m, to each side of the middle; 0: there is no cart
    PER_CART_SPEED: int = 9  # s/m, by which its observed velocity is multiplied


Task = TaskFields()


ANGLES, SINCOS = 0.0, 1.0  # forms of the observation
MAX_CART_ENTRY = 2.0  # to which a cart's place and velocity are clipped in observations


class ModeNumbers(NamedTuple):
    """The built-in modes, as `Task.MODE` knows them."""

    PASSIVE: int = 1
    SWING_UP: int = 2
    BALANCE: int = 3
    CALM: int = 4
    TRANSITION: int = 5


MODE_NUMBERS = ModeNumbers()
NUMBER_OF: dict[type[Mode], int] = dict(
    zip((Passive, SwingUp, Balance, Calm, Transition), MODE_NUMBERS, strict=True)
)
