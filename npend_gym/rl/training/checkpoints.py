"""Checkpoints: an interrupted training run goes on from the last one, to the same bits.

An object names in `changes` its attributes that change while it learns. What it is made of besides,
networks and plans and chains, follows from the settings and is made again. A file holds numbers and
texts alone, after their SHA-256: to read it runs no code. What does not follow from these
attributes alone, such as the environments of `ErrorLanes`, an object renews in its method
`restored`.
"""

# torch's stubs leave parts unknown
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
from __future__ import annotations

import copy
import io
import time
from collections import Counter, OrderedDict, deque
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from npend_gym import __version__, _checks
from npend_gym._files import read_checked, write_checked
from npend_gym._progress import bar
from npend_gym.chain import plain_keywords

_SECONDS = 20.0  # between two checkpoints
_SHARE = 0.05  # of the time, at most, for writing them
_PLAIN = bool, int, float, str, type(None)  # in a file as they are
_CONTAINERS = dict, OrderedDict, Counter, list  # the same, where what is in them is
_METHODS = (  # by which objects give their state and take it
    ("state_dict", "load_state_dict"), ("get_state", "set_state"), ("getstate", "setstate"),
)  # fmt: skip


class Checkpoint:
    """The file from which an interrupted training run resumes.

    Parameters
    ----------
    settings : dataclass
        Settings of the run, on which its results depend.
    path : Path, optional
        The file; without one nothing is stored.
    resume : bool
        Whether to resume from this file.
    seconds : float
        Time between two checkpoints.

    Attributes
    ----------
    saved : dict or None
        What the file holds of each part of the run; None at the start of a run.
    is_kept : bool
        Whether the file holds the progress of this run.

    Raises
    ------
    ValueError
        If there is no such file, or it is of other settings or another version of the package, or
        damaged.
    OSError
        If the file cannot be read.
    """

    def __init__(
        self,
        settings: Any,
        path: Path | None = None,
        *,
        resume: bool = False,
        seconds: float = _SECONDS,
    ) -> None:
        used = plain_keywords(asdict(settings))
        env = {f"env {name}": value for name, value in used.pop("env", {}).items()}  # in any order
        self._about = {"version of npend_gym": __version__}
        # plain values print all digits
        self._about |= {name: repr(value) for name, value in (used | env).items()}
        self._path, self._seconds = path, seconds
        self.saved: dict[str, Any] | None = None
        if resume and path is not None:
            self.saved = self._read(path)
        self.is_kept: bool = self.saved is not None

    def _read(self, path: Path) -> dict[str, Any]:
        import torch

        if not path.is_file():
            raise ValueError(f"there is no checkpoint {path} to resume: begin without --resume")
        content = read_checked(path)
        if content is None:
            raise ValueError(
                f"{path} is no checkpoint: it is damaged or of another version, its SHA-256 does "
                "not fit"
            )
        try:
            saved = torch.load(io.BytesIO(content), weights_only=True)
            about, _, _ = (saved[name] for name in ("about", "done", "parts"))
            theirs = {name: str(value) for name, value in about.items()}
        except Exception as error:
            raise ValueError(f"{path} is no checkpoint ({type(error).__name__})") from error
        if theirs != self._about:
            raise ValueError(
                f"{path} has {self._difference(theirs)}: resume with the same options and version, "
                "or begin again with --overwrite in place of --resume"
            )
        return saved

    def _difference(self, theirs: dict[str, str]) -> str:
        ours = self._about
        return ", ".join(
            f"{name} = {theirs.get(name, 'nothing')} where this run has {ours.get(name, 'nothing')}"
            for name in ours | theirs
            if theirs.get(name) != ours.get(name)
        )

    def rounds(
        self, parts: dict[str, Any], last: int, title: str | None, unit: str, first: int = 1
    ) -> Iterator[int]:
        """Yield the numbers of the rounds that are left, up to `last`, and write checkpoints.

        Parameters
        ----------
        parts : dict
            All that changes in a round. A checkpoint is restored into these objects.
        last, first : int
            Numbers of rounds.
        title : str, optional
            Title of the progress display; without it there is none.
        unit : str
            Name of a round in this display.
        """
        done = first - 1
        if self.saved is not None:
            done = self.saved["done"]
            restore(parts, self.saved["parts"])
        rounds = range(done + 1, last + 1)
        written, pause = time.monotonic(), self._seconds
        shown = bar(rounds, title, unit=unit, total=last, initial=done) if title else rounds
        for round_ in shown:
            yield round_
            if self._path is not None and time.monotonic() - written >= pause:
                began = time.monotonic()
                self._write(self._path, parts, round_)
                written = time.monotonic()
                pause = max(self._seconds, (written - began) / _SHARE)

    def _write(self, path: Path, parts: dict[str, Any], done: int) -> None:
        import torch

        saved = {"about": self._about, "done": done, "parts": state_of(parts)}
        torch.save(saved, content := io.BytesIO())  # to a file, it would hide the OSError
        write_checked(path, content.getvalue())
        self.is_kept = True


class Stopwatch:
    """Processor time that a run has taken, also before it was resumed."""

    changes: tuple[str, ...] = ("seconds",)

    def __init__(self) -> None:
        self._began = time.process_time()

    @property
    def seconds(self) -> float:
        """Processor time since the start of the run [s]."""
        return time.process_time() - self._began

    @seconds.setter
    def seconds(self, seconds: float) -> None:
        self._began = time.process_time() - seconds


def state_of(part: Any, name: str = "parts") -> Any:
    """State of a part of a run that changes, as tensors, numbers, texts, lists and dicts.

    A tuple stands for another type: its name, and what is kept of it.
    """
    import torch

    kind = type(part)
    if kind in _PLAIN:
        return part
    if (kind is np.ndarray or issubclass(kind, np.generic)) and not part.dtype.hasobject:
        np.save(file := io.BytesIO(), part, allow_pickle=False)
        written = torch.frombuffer(file.getbuffer(), dtype=torch.uint8)
        return "array" if kind is np.ndarray else "number", written
    if isinstance(part, torch.Tensor):
        return ("tensor", part) if kind is torch.Tensor else (kind.__name__, part.detach())
    if isinstance(part, dict):
        # a copy has the versions that torch adds to the state of a network
        inside: Any = copy.copy(part) if kind in _CONTAINERS else {**part}
        for key, each in part.items():
            if any(type(k) not in _PLAIN for k in (key if type(key) is tuple else [key])):
                raise TypeError(f"keys of {name} must be numbers or texts, got {key!r}")
            inside[key] = state_of(each, f"{name}[{key!r}]")
    elif isinstance(part, list | tuple | deque):
        inside = [state_of(each, f"{name}[{k}]") for k, each in enumerate(part)]
        if isinstance(part, tuple):
            return "named tuple" if hasattr(part, "_make") else "tuple", inside
    elif isinstance(part, np.random.Generator):
        inside = state_of(part.bit_generator.state, name)
    elif methods := _methods(part):
        inside = state_of(methods[0](), name)
    elif hasattr(part, "changes"):
        inside = {each: state_of(getattr(part, each), f"{name}.{each}") for each in part.changes}
    else:
        raise TypeError(
            f"{name} must be something that a checkpoint can store, or list what to store in "
            f"`changes`, got the {kind.__name__} {_checks.show(part)}"
        )
    return inside if kind in _CONTAINERS else (kind.__name__, inside)


def _methods(part: Any) -> tuple[Callable[[], Any], Callable[[Any], Any]] | None:
    """Functions that read and restore the state of an object; None where it has none."""
    for names in _METHODS:
        if all(hasattr(part, name) for name in names):
            return getattr(part, names[0]), getattr(part, names[1])
    return None


def _unmarked(saved: Any) -> tuple[str | None, Any]:
    """Return the name of a type that `state_of` has given, or None, and what it kept."""
    return saved if type(saved) is tuple and type(saved[0]) is str else (None, saved)


def restore(part: Any, saved: Any, name: str = "parts") -> Any:
    """Bring a part of a run into a state; return it, or what is to take its place.

    Items of lists, tuples and dicts that `part` has not are made again, where they are no objects.
    A NamedTuple is then a tuple.
    """
    import torch

    kind, inside = _unmarked(saved)
    if kind in ("array", "number"):
        array = np.load(io.BytesIO(inside.numpy().tobytes()), allow_pickle=False)
        return array if kind == "array" else array[()]
    if kind not in (None, "tensor", "tuple", "named tuple", own := type(part).__name__):
        raise ValueError(
            f"{name} must be a {kind} before `rounds`, as it is in the checkpoint, got "
            f"{_checks.show(part)}"
        )
    fits = kind == own or (kind is None and type(inside) not in (*_PLAIN, list))
    if fits and isinstance(part, np.random.Generator):
        part.bit_generator.state = restore(None, inside)
    elif fits and (methods := _methods(part)):
        methods[1](restore(None, inside))
    elif fits and hasattr(part, "changes"):
        for each, value in inside.items():
            setattr(part, each, restore(getattr(part, each, None), value, f"{name}.{each}"))
        if hasattr(part, "restored"):
            part.restored()
    elif isinstance(inside, dict):
        into = part if isinstance(part, dict) else {}
        made = copy.copy(inside)
        for key, each in inside.items():
            made[key] = restore(into.get(key), each, f"{name}[{key!r}]")
        if into is not part:
            return made
        part.clear()
        part.update(made)
    elif isinstance(inside, list):
        found = [*part] if isinstance(part, list | tuple | deque) else []
        found += [None] * (len(inside) - len(found))
        made = [restore(*pair, name) for pair in zip(found, inside, strict=False)]
        if kind != "tuple" and (make := getattr(part, "_make", None)):
            return make(made)
        if kind in ("tuple", "named tuple"):
            return tuple(made)
        if not isinstance(part, list | deque):
            return made
        part.clear()
        part.extend(made)
    elif isinstance(part, np.ndarray) and kind is None and isinstance(inside, torch.Tensor):
        return inside.numpy()
    elif (
        isinstance(part, torch.Tensor)
        and isinstance(inside, torch.Tensor)
        and (part.requires_grad or isinstance(part, torch.nn.Parameter))
    ):
        with torch.no_grad():  # an optimizer has this very tensor
            part.copy_(inside)
    else:
        return inside
    return part
