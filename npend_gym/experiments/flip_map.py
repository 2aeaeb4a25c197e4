"""The map of chaos: over a plane of starting angles, when a rod first turns over."""

from __future__ import annotations

import hashlib
import json
import logging
import math
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks, _files
from npend_gym._checks import FloatArray
from npend_gym._provenance import provenance
from npend_gym._threads import check_threads
from npend_gym._version import __version__
from npend_gym.chain import Chain
from npend_gym.chaos import flip_times
from npend_gym.physics.arguments import check_rtol

_MAP, _PART = "map.npz", ".float64"
_ABOUT = 1 << 16  # bytes, at most, of what says which map a file belongs to
_log = logging.getLogger(__name__)

_ROWS = 10  # of starts, in a part that is kept as it is done
_MAX_SIZE = 20_000


def _written(write: Callable[[], object]) -> None:
    """Write a file; a second time where another run of the map has ended and removed it."""
    try:
        write()
    except FileNotFoundError:
        write()


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
        Width of the square [rad]; 2 pi covers all angles.
    duration : float
        How long each release is followed [s].
    masses : float or (float, float)
        Masses of the bobs [kg].
    lengths : float or (float, float)
        Lengths of the rods [m].
    gravity : float
        Acceleration of gravity [m/s^2].
    rtol : float
        Relative tolerance of the integration. See `npend_gym.chaos.flip_times`.

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.
    """

    size: int = 1000
    centre: tuple[float, float] = (0.0, 0.0)
    width: float = 2.0 * math.pi
    duration: float = 10.0
    masses: ArrayLike = 1.0
    lengths: ArrayLike = 1.0
    gravity: float = 9.81
    rtol: float = 1e-9

    def __post_init__(self) -> None:
        """Check the arguments."""
        size = _checks.count("size", self.size, high=_MAX_SIZE)
        centre = _checks.vector("centre", self.centre, 2)
        width = _checks.positive_number("width", self.width)
        if (largest := float(np.abs(centre).max()) + 0.5 * width) > math.tau:
            raise ValueError(
                "centre and width must keep the angles within two half turns of hanging, "
                f"got {_checks.show(centre.tolist())} and {width:g}: angles are radians "
                f"({_checks.converts(largest - 0.5 * width)})"
            )
        numbers = {name: _checks.number(name, getattr(self, name)) for name in ("gravity", "rtol")}
        duration = _checks.positive_number("duration", self.duration)
        plain = {"size": size, "centre": tuple(centre.tolist()), "width": width}
        for name, value in (plain | {"duration": duration} | numbers).items():
            object.__setattr__(self, name, value)
        for name in ("masses", "lengths"):
            given = _checks.vector(name, getattr(self, name), 2)
            plain = tuple(given.tolist()) if np.ndim(getattr(self, name)) else float(given[0])
            object.__setattr__(self, name, plain)
        check_rtol(self.rtol)
        _ = self.chain  # has the rules of its parameters

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
        out: Path | str,
        *,
        threads: int = 1,
        progress: Callable[[Iterable[int]], Iterable[int]] = iter,
        tell: Callable[[str], object] = _log.warning,
    ) -> FloatArray:
        """Compute the map and write ``map.npz``. An interrupted or killed run resumes.

        Every part says which map and which version of the package made it; other parts are not
        used. If ``map.npz`` is this map, made by the same version, it is read and not computed
        again.

        Parameters
        ----------
        out : Path or str
            A folder. Parts of the map are in a subfolder until all are done.
        threads : int
            Number of threads that share the starts. Results do not depend on it.
        progress : callable
            Wraps the numbers of the parts that are still to do.
        tell : callable
            Called with a line if files of an earlier run are used, or cannot be used. By default
            the line goes to the log.

        Returns
        -------
        ndarray, shape (size, size)
            Instants [s], a row for each second angle; NaN where no rod turns over. Angles beyond
            half a turn are reduced by whole turns.

        Raises
        ------
        ValueError, TypeError
            If threads breaks its rule.
        OSError
            If the folder cannot be written to.
        """
        out, threads = Path(out), check_threads(threads)
        text = json.dumps(self.as_dict(), sort_keys=True)
        parts = out / f"parts-{hashlib.sha256(text.encode()).hexdigest()[:12]}"
        finished = self._finished(out)
        if finished is not None:
            tell(f"{out / _MAP} is this map already, by the same version: it is not computed again")
            self._remove_parts(out, parts)
            return finished
        _files.make_folder(parts)
        result = np.empty((self.size, self.size))
        (first, second), unusable = self.axes(), 0
        left: list[int] = []
        turned = [
            np.where(np.abs(each) < math.pi, each, (each + math.pi) % math.tau - math.pi)
            for each in (first, second)
        ]
        for k in range(self._count):
            part = self._part(parts, k)
            if part is None:
                left.append(k)
                unusable += any(parts.glob(f"{k}-*{_PART}"))
            else:
                result[self._rows(k)] = part
        if unusable:
            tell(
                f"{parts}: {unusable} part(s) are damaged, or of another map or version of "
                f"npend_gym (this is {__version__}): they are computed again"
            )
        for k in progress(left):
            starts = np.stack(
                np.broadcast_arrays(turned[0], turned[1][self._rows(k), None]), axis=-1
            )
            times = flip_times(
                self.chain, starts, duration=self.duration, rtol=self.rtol, threads=threads
            )
            result[self._rows(k)] = times
            owner, place = self._about(part=k), parts / f"{k}"
            _written(partial(_files.write_part, owner, place, times.tobytes(), _PART))
        about = json.dumps(provenance(self.as_dict()))

        def write_map() -> None:
            with _files.replacing(out / _MAP, binary=True) as file:
                np.savez_compressed(file, times=result, first=first, second=second, about=about)

        _written(write_map)
        self._remove_parts(out, parts)
        return result

    @property
    def _count(self) -> int:
        """The number of parts."""
        return math.ceil(self.size / _ROWS)

    def _rows(self, k: int) -> slice:
        """Return the rows of the map that part `k` has."""
        return slice(k * _ROWS, min(self.size, (k + 1) * _ROWS))

    def _about(self, **more: int) -> str:
        """Settings that determine the numbers of this map, or of a part of it."""
        about = {"version": __version__, "arguments": self.as_dict()} | more
        return json.dumps(about, sort_keys=True)

    def _part(self, parts: Path, k: int) -> FloatArray | None:
        """Return a part that is whole and of this map, or None."""
        rows = self._rows(k)
        size = 8 * (rows.stop - rows.start) * self.size
        for path in parts.glob(f"{k}-*{_PART}"):
            data = _files.read_part(self._about(part=k), path, size)
            if data is not None and len(data) == size:
                return np.frombuffer(data).reshape(-1, self.size)
        return None

    def _finished(self, out: Path) -> FloatArray | None:
        """Return the map that a run before has finished, or None."""
        shape = self.size, self.size
        try:
            arrays = _files.read_arrays(out / _MAP, 2 * 8 * math.prod(shape) + _ABOUT)
            times, about = arrays["times"], _files.parse_json(str(arrays["about"]))
            made = {"version": about["version"], "arguments": about["arguments"]}
        except (OSError, ValueError, TypeError, KeyError):
            return None
        is_own = json.dumps(made, sort_keys=True) == self._about()
        return times if is_own and (times.dtype, times.shape) == (np.float64, shape) else None

    def _remove_parts(self, out: Path, parts: Path) -> None:
        """Remove the parts of a finished map, and what a kill has left half-written."""
        left = (*parts.glob(f"*{_PART}"), *parts.glob(".*.part"), *out.glob(f".{_MAP}.*.part"))
        for path in left:
            _files.remove(path)
        with suppress(OSError):  # a file of somebody else is in it, or it is not there
            parts.rmdir()
