"""The table of the environments' info: each key with its type, unit, meaning, and when it is there.

From a row of this table follow the row that kernels write (`rows.Output`, `rows.Flag` and
`rows.Block`), the info of both environments, its masks and its documentation.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Generic, NamedTuple, TypeVar, get_args, get_origin

from typing_extensions import (  # a TypedDict of Python 3.10 cannot be generic
    NotRequired,
    TypedDict,
    get_type_hints,
)

from npend_gym._checks import FloatArray

_Real = TypeVar("_Real")
_Count = TypeVar("_Count")
_Truth = TypeVar("_Truth")


class Key(NamedTuple):
    """What the table says of a key beside its type."""

    unit: str
    text: str
    when: str = ""  # an attribute of `EnvConfig` that is true where the key is there; "": always
    read: bool = False  # whether `Outputs` reads it, an array (B, k), which no kernel writes


class Info(TypedDict, Generic[_Real, _Count, _Truth]):
    """What `reset` and `step` return beside the observation, always with the same keys.

    ``Info[float, int, bool]`` is that of the single environment. In the vector environment each
    value is an array with a leading axis of B, and each key has a bool mask (B,) named ``_key``:
    that of Gymnasium's `SyncVectorEnv`, True where the sub-environment has an info.
    There is no NaN in it, and every array is new: no later step writes to it.
    """

    time: Annotated[_Real, Key("s", "time since the start of the episode")]
    energy: Annotated[_Real, Key("J", "energy above hanging at rest")]
    energy_error: Annotated[_Real, Key(
        "1", "relative error of the energy: the energy minus that at the start minus the work of "
        "torques, damping and drag, over the larger of the two energies",
    )]  # fmt: skip
    tip_height: Annotated[_Real, Key("m", "height of the tip above the pivot")]
    theta: Annotated[FloatArray, Key(
        "rad", "angles from the downward vertical, not wrapped, shape (n,)"
    )]  # fmt: skip
    omega: Annotated[FloatArray, Key("rad/s", "angular velocities, shape (n,)")]
    diverged: Annotated[_Truth, Key(
        "", "whether the state has left all bounds; the last finite state is kept then"
    )]  # fmt: skip
    success: NotRequired[Annotated[_Truth, Key(
        "", "whether the goal of the mode has held without interruption for the mode's `hold` "
        "seconds; absent where a mode of your own defines neither `achieved` nor `failed`",
        when="mode.defines_success",
    )]]  # fmt: skip
    bobs_completed: NotRequired[Annotated[_Count, Key(
        "1", "with `measure_periods`: number of bobs whose pseudo-period is complete",
        when="measure_periods",
    )]]  # fmt: skip
    pseudo_period: NotRequired[Annotated[_Real, Key(
        "s", "with `measure_periods`: mean pseudo-period of the completed bobs; 0.0 before the "
        "first",
        when="measure_periods",
    )]]  # fmt: skip
    pseudo_periods: NotRequired[Annotated[FloatArray, Key(
        "s", "with `measure_periods`: pseudo-period of each bob, shape (n,), by the definition "
        '"bob" of `npend_gym.pseudo_periods`; 0.0 where not complete',
        when="measure_periods",
    )]]  # fmt: skip
    pseudo_period_com: NotRequired[Annotated[_Real, Key(
        "s", "with `measure_periods`: pseudo-period of the chain's centre of mass, the definition "
        '"com" of `npend_gym.pseudo_periods`; 0.0 where not complete. On a cart: relative to it',
        when="measure_periods",
    )]]  # fmt: skip
    ideal_period: NotRequired[Annotated[_Real, Key(
        "s", "with `measure_periods`: the paper's T0 of the chain; 0.0 without gravity, and for "
        "links, to which T0 does not apply",
        when="measure_periods",
    )]]  # fmt: skip
    torque: NotRequired[Annotated[FloatArray, Key(
        "N m", "with motors: the torque of each in the last step, shape (joints,), in the order of "
        "the action; of the motor of a cart its force [N]. It is the mean over the step of what "
        "the motor exerted, with its limit, delay, lag, noise and ripple, and without pushes. 0.0 "
        "at the start",
        when="joints.size",
    )]]  # fmt: skip
    context: NotRequired[Annotated[FloatArray, Key(
        "", "with `randomize`: the numbers drawn for this episode, (k,), by "
        "`EnvConfig.context_names`",
        when="context_names", read=True,
    )]]  # fmt: skip
    goal: NotRequired[Annotated[FloatArray, Key(
        "rad", "in a mode with goals: the angles, 0 or pi, that the rods are to reach, shape (n,)",
        when="mode.has_goals", read=True,
    )]]  # fmt: skip
    cart_position: NotRequired[Annotated[_Real, Key(
        "m", "with a cart: its place, from the middle of the rail",
        when="has_cart",
    )]]  # fmt: skip
    cart_velocity: NotRequired[Annotated[_Real, Key(
        "m/s", "with a cart", when="has_cart"
    )]]  # fmt: skip


def _table() -> Mapping[str, tuple[Any, Key]]:
    """Return type and row of each key, as `Info` has them."""
    table: dict[str, tuple[Any, Key]] = {}
    for name, hint in get_type_hints(Info, include_extras=True).items():
        kind, key = get_args(get_args(hint)[0] if get_origin(hint) is NotRequired else hint)
        table[name] = kind, key
    return table


TABLE = _table()
# The keys by what kernels write for them: a number, or a truth, of each environment, or a number of
# a rod or a motor
NUMBERS = [name for name, (kind, _) in TABLE.items() if kind in (_Real, _Count)]
COUNTS = [name for name, (kind, _) in TABLE.items() if kind is _Count]
TRUTHS = [name for name, (kind, _) in TABLE.items() if kind is _Truth]
OF_RODS = [
    name for name, (_, key) in TABLE.items() if name not in NUMBERS + TRUTHS and not key.read
]


def _described(name: str, key: Key) -> str:
    unit = f" [{key.unit}]" if key.unit not in ("", "1") else ""
    return f"    {name}\n        {key.text[0].upper()}{key.text[1:]}{unit}."


if Info.__doc__:  # python -OO has none
    _rows = [_described(name, key) for name, (_, key) in TABLE.items()]
    Info.__doc__ += "\n".join(["\n    Attributes\n    ----------", *_rows, "    "])
