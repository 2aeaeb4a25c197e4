"""The map of chaos: over a plane of starting angles, when a rod first turns over."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from npend_gym import _checks, _files
from npend_gym._checks import FloatArray
from npend_gym._provenance import provenance
from npend_gym.chain import Chain
from npend_gym.chaos import flip_times

_ROWS = 10  # of starts, in a part that is kept as it is done
_MAX_SIZE = 20_000
_PI = math.pi


@dataclass(frozen=True)
class FlipMap:
    """Releases of a double pendulum at rest, from a grid of its two angles.

    Parameters
    ----------
    size : int
        Starts along each side; the map has size times size.
    centre : (float, float)
        First and second angle in the middle [rad].
    width : float
        Of the square [rad]; 2 pi is all there is.
    duration : float
        How long each release is followed [s].
    masses, lengths : float or (float, float)
        Of the chain [kg, m].
    gravity : float
        [m/s^2].
    rtol : float
        As for `npend_gym.chaos.flip_times`.

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.
    """

    size: int = 1000
    centre: tuple[float, float] = (0.0, 0.0)
    width: float = 2.0 * _PI
    duration: float = 10.0
    masses: Any = 1.0
    lengths: Any = 1.0
    gravity: float = 9.81
    rtol: float = 1e-9

    def __post_init__(self) -> None:
        """Check the arguments."""
        _checks.count("size", self.size, high=_MAX_SIZE)
        centre = _checks.vector("centre", self.centre, 2)
        width = _checks.positive_number("width", self.width)
        if np.any(np.abs(centre) + 0.5 * width > 2.0 * _PI):
            raise ValueError(
                "centre and width must keep the angles within two half turns of hanging, "
                f"got {_checks.show(centre.tolist())} and {width:g}"
            )
        _checks.positive_number("duration", self.duration)
        object.__setattr__(self, "centre", tuple(centre.tolist()))

    @property
    def chain(self) -> Chain:
        """The double pendulum."""
        masses, lengths = (np.broadcast_to(each, 2) for each in (self.masses, self.lengths))
        return Chain(masses, lengths, gravity=self.gravity)

    def axes(self) -> tuple[FloatArray, FloatArray]:
        """Return the first and the second angles [rad], (size,) each: the middles of pixels."""
        steps = (np.arange(self.size) + 0.5) / self.size - 0.5
        return self.centre[0] + self.width * steps, self.centre[1] + self.width * steps

    def as_dict(self) -> dict[str, Any]:
        """Return the arguments as plain numbers and lists, ready for JSON."""
        return asdict(self) | {"centre": list(self.centre)}

    def run(
        self,
        out: Path,
        *,
        threads: int = 1,
        progress: Callable[[Iterable[int]], Iterable[int]] = iter,
    ) -> FloatArray:
        """Compute the map and write ``map.npz``; what a run before left undone is gone on with.

        Parameters
        ----------
        out : Path
            A folder. Parts of the map stand in a folder of it until all are done.
        threads : int
            That share the starts. No result depends on it.
        progress : callable
            Wraps the numbers of the parts that are still to do.

        Returns
        -------
        ndarray, shape (size, size)
            Instants [s], a row for each second angle; NaN where no rod turns over. Angles beyond a
            half turn are taken less whole turns.

        Raises
        ------
        OSError
            If the folder cannot be written to.
        """
        text = json.dumps(self.as_dict(), sort_keys=True)
        parts = out / f"parts-{hashlib.sha256(text.encode()).hexdigest()[:12]}"
        parts.mkdir(parents=True, exist_ok=True)
        count, (first, second) = math.ceil(self.size / _ROWS), self.axes()
        turned = [(each + _PI) % (2.0 * _PI) - _PI for each in (first, second)]
        left = [k for k in range(count) if self._part(parts, k) is None]
        for k in progress(left):
            rows = turned[1][k * _ROWS : (k + 1) * _ROWS]
            starts = np.stack(np.broadcast_arrays(turned[0], rows[:, None]), axis=-1)
            times = flip_times(
                self.chain, starts, duration=self.duration, rtol=self.rtol, threads=threads
            )
            with _files.replacing(parts / f"{k}.npz", binary=True) as file:
                np.savez_compressed(file, times=times)
        done = [part for k in range(count) for part in [self._part(parts, k)] if part is not None]
        result = np.concatenate(done)
        about = json.dumps(provenance(self.as_dict()))
        with _files.replacing(out / "map.npz", binary=True) as file:
            np.savez_compressed(file, times=result, first=first, second=second, about=about)
        for k in range(count):
            (parts / f"{k}.npz").unlink(missing_ok=True)
        parts.rmdir()
        return result

    def _part(self, parts: Path, k: int) -> FloatArray | None:
        """Return a part that is whole, or None."""
        shape = (min(_ROWS, self.size - k * _ROWS), self.size)
        try:
            arrays = _files.read_arrays(parts / f"{k}.npz", 2 * 8 * shape[0] * shape[1] + 4096)
            times = arrays["times"]
        except (OSError, ValueError, KeyError):
            return None
        return times if (times.dtype, times.shape) == (np.float64, shape) else None
