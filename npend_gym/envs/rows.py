"""The rows and entries, by name, of the arrays that the environments' kernels work on."""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Sequence
from typing import Any, NamedTuple

from npend_gym.envs.info import NUMBERS, OF_RODS, TRUTHS
from npend_gym.envs.modes import MODES, Mode, Quantities
from npend_gym.envs.settings import OF_LANES
from npend_gym.physics.kernels.layout import Member, Rod


def _named(name: str, names: Sequence[str]) -> Any:
    """Return a NamedTuple for rows; with NamedTuples kernels read names as constants."""
    return namedtuple(name, names, module=__name__)  # noqa: PYI024  # pyright: ignore[reportUntypedNamedTuple]


class EpisodeFields(NamedTuple):
    """Rows of the ensemble's `members`, after those of `Member`."""

    START_ENERGY: int = len(Member)  # J, at the start of the episode
    MEAN_SQUARED_ACTION: int = len(Member) + 1  # of the last step, 0 to 1
    STARTING: int = len(Member) + 2  # 1 where an episode starts: the call judges it as new
    OBSERVED: int = len(Member) + 3  # 1 where a call that only observes is to write
    PER_ENERGY: int = len(Member) + 4  # 1/J, of the energy that lifts the chain upright
    PER_LENGTH: int = len(Member) + 5  # 1/m, of the chain's length
    # 1/(kg m): height of the centre of mass, 0 to 1, over sum carried * (1 - cos)
    PER_LIFT: int = len(Member) + 6
    IDEAL_PERIOD: int = len(Member) + 7  # s; 0 where it does not apply
    HAS_BOBS: int = len(Member) + 8  # 1 where it does: point masses on massless rods
    EPISODE: int = len(Member) + 9  # number of the episode of this seed, from 0
    STEPS: int = len(Member) + 10  # of the episode
    STEPS_HELD: int = len(Member) + 11  # instants in a row at which the goal was met


Episode: EpisodeFields = EpisodeFields()

# Rows of `members`, after those of `Episode`: the keywords that each sub-environment has a value of
SettingFields: Any = _named("SettingFields", OF_LANES)
Setting: Any = SettingFields(*(len(Member) + len(Episode) + k for k in range(len(OF_LANES))))
ROWS = len(Episode) + len(Setting)  # of `members`, after those of `Member`


class PoseFields(NamedTuple):
    """Rows of the ensemble's `rods`, after those of `Rod`, in modes with goals.

    Each is the cosine, +-1, of every rod in an equilibrium.
    """

    START: int = len(Rod)  # near which the episode started
    GOAL: int = len(Rod) + 1  # which is to be reached


Pose: PoseFields = PoseFields()

# Rows of `outputs` and of `flags`, an entry for each environment: what the table of the info says,
# and what a step returns beside the info
OutputFields: Any = _named("OutputFields", [*map(str.upper, NUMBERS), "REWARD"])
FlagFields: Any = _named("FlagFields", [*map(str.upper, TRUTHS), "TERMINATED", "TRUNCATED"])
Output: Any = OutputFields(*range(len(OutputFields._fields)))
Flag: Any = FlagFields(*range(len(FlagFields._fields)))

# Blocks of n + 1 rows of `outputs` after those of `Output`, for rods or motors. The last, written
# where Python judges and in modes with goals, has the first OF_LANE of `Quantities`
BlockFields: Any = _named("BlockFields", [*map(str.upper, OF_RODS), "COSINES", "QUANTITIES"])
Block: Any = BlockFields(*range(len(BlockFields._fields)))
OF_LANE = Quantities._fields.index("theta")  # quantities that are one number of an environment


def first_row(block: int, n: int) -> int:
    """Return the first row of a `Block` for chains of n rods."""
    return len(Output) + block * (n + 1)


class TaskFields(NamedTuple):
    """Entries of `task`: what is the same for all sub-environments."""

    MODE: int = 0  # number of a built-in mode; 0: Python judges
    MAX_STEPS: int = 1  # of an episode; infinite: any number
    HOLD_STEPS: int = 2  # over which the goal must have held
    SPEED_LIMIT: int = 3  # to which observed angular velocities are clipped
    SPARSE: int = 4  # 1: the reward is 1 where the goal is met, else 0
    GOALS: int = 5  # 1: each episode has a goal of its own
    RAIL: int = 6  # m, to each side of the middle; 0: there is no cart
    PER_CART_SPEED: int = 7  # s/m, by which its observed velocity is multiplied
    UPRIGHTNESS: int = 8  # below which a rod has fallen: the cosine of `max_tilt`; -inf: none
    OBSERVES: int = 9  # 1: nothing moves; the call observes, in groups with a lane to be OBSERVED
    SENSED: int = 10  # 1: sensors that are not ideal observe afterwards
    RAIL_WEIGHT: int = 11  # by what share the reward is smaller at an end of the rail
    PIECES: int = 12  # of a step, in which motors act one after the other
    NOISY: int = 13  # motors with noise and ripple, the first ones
    # Columns after each block of an observation, see `EnvConfig.columns`; 0: it is not observed
    AFTER_ANGLES: int = 14
    AFTER_SINES: int = 15
    AFTER_COSINES: int = 16
    AFTER_SPEEDS: int = 17
    AFTER_CART: int = 18
    AFTER_GOALS: int = 19


Task: TaskFields = TaskFields()


class WiringFields(NamedTuple):
    """Rows of `wiring`, (n + 1) entries: what is the same for all lanes, of motors and rods."""

    JOINT: int = 0  # of each motor, in the order of `actions`; n is a cart
    PER_SPEED: int = 1  # s/rad, by which the observed angular velocity of a rod is multiplied


Wiring: WiringFields = WiringFields()


MAX_CART_ENTRY = 2.0  # to which a cart's place and velocity are clipped in observations


# The built-in modes, as `Task.MODE` knows them
NUMBER_OF: dict[type[Mode], int] = {mode: row + 1 for row, mode in enumerate(MODES.values())}
