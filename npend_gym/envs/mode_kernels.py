"""The formulas of the built-in modes, compiled, and one kernel that judges by a mode's number."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from npend_gym.compiled.jit import spliced_kernel
from npend_gym.compiled.packs import where
from npend_gym.envs.modes import Mode, Quantities, left_rail, rail_factor
from npend_gym.envs.rows import NUMBER_OF

left_rail_kernel: Any = spliced_kernel(left_rail)
rail_factor_kernel: Any = spliced_kernel(rail_factor)


@spliced_kernel
def never(_: None, quantities: Quantities[Any]) -> Any:
    """Return False for each lane."""
    return quantities.height != quantities.height


@spliced_kernel
def _no_mode(_: int, quantities: Quantities[Any]) -> tuple[Any, Any, Any]:
    """Return what stands where Python judges: no reward, no failure, no success."""
    no = never(None, quantities)
    return 0.0 * quantities.height, no, no


def _dispatch(modes: Sequence[type[Mode]]) -> Any:
    """Return a kernel: number of a mode, quantities -> reward, failed, achieved.

    Formulas are compiled as they stand, with None as their `self`. They are spliced: as functions,
    each would be compiled on its own first, for longer than the formula takes.
    """
    if not modes:
        return _no_mode
    first, others = modes[0], _dispatch(modes[1:])
    number, always_achieved = NUMBER_OF[first], first.achieved is Mode.achieved
    reward: Any = spliced_kernel(first.reward)
    failed: Any = never if first.failed is Mode.failed else spliced_kernel(first.failed)
    achieved: Any = never if always_achieved else spliced_kernel(first.achieved)

    @spliced_kernel
    def judge(mode: int, quantities: Quantities[Any]) -> tuple[Any, Any, Any]:
        if mode != number:
            return others(mode, quantities)
        has_failed = failed(None, quantities)
        # `Mode.achieved`: the goal is met unless the episode has failed
        unless = where(has_failed, 0.0, 1.0) > 0.0
        met = unless if always_achieved else achieved(None, quantities)
        return reward(None, quantities), has_failed, met

    return judge


judged: Any = _dispatch(list(NUMBER_OF))
