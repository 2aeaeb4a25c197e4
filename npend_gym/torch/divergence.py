"""What is raised where steps or their gradients leave all bounds."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from npend_gym import _checks
from npend_gym._checks import FloatArray


class DivergedError(FloatingPointError):
    """Raised where chains leave all bounds in a step, so that there is no gradient.

    Attributes
    ----------
    lanes : list of int
        Which chains.
    step : int or None
        The step of a rollout or an environment, from 1; None of a step alone.
    """

    def __init__(self, lanes: Sequence[int], step: int | None = None) -> None:
        self.lanes, self.step = list(lanes), step
        which = "the step" if step is None else f"step {step}"
        super().__init__(
            f"lanes {_checks.show(self.lanes)} leave all bounds in {which}, where nothing can be "
            "differentiated: take smaller torques, shorter steps or more substeps"
        )

    def in_step(self, step: int) -> DivergedError:
        """Return the error with the number of the step."""
        return DivergedError(self.lanes, step)


def check_bars(bars: Sequence[FloatArray]) -> None:
    """Refuse gradients that a step cannot take back."""
    for bar in bars:
        if not np.all(np.abs(bar) <= _checks.LARGEST):
            lanes = np.flatnonzero(~np.all(np.abs(bar) <= _checks.LARGEST, axis=-1)).tolist()
            largest = float(np.nanmax(np.abs(bar), initial=0.0))
            what = "NaN" if math.isnan(float(bar.sum())) else f"as large as {largest:g}"
            raise FloatingPointError(
                f"the gradient that arrives at a step from behind is {what} in lanes "
                f"{_checks.show(lanes)}: shorten the horizon, or look for what made it so in the "
                "function that is differentiated"
            )
