"""Checkpoints: an interrupted training run goes on from the last one, to the same bits.

An object names in `changes` its attributes that change while it learns. What it is made of besides,
networks and plans and chains, follows from the settings and is made again. A file holds numbers and
texts alone: to read it runs no code. What does not follow from these attributes alone, such as the
environments of `ErrorLanes`, an object renews in its method `restored`.
"""

# torch's stubs leave parts unknown
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from npend_gym import __version__
from npend_gym._files import replacing
from npend_gym._progress import bar

_SECONDS = 20.0  # between two checkpoints
_SHARE = 0.05  # of the time, at most, for writing them


class Checkpoint:
    """Where a training run keeps what it needs to go on.

    Parameters
    ----------
    settings : dataclass
        Those of the run; with others its numbers would be others.
    path : Path, optional
        The file; without one nothing is kept.
    resume : bool
        Whether to go on from this file.
    seconds : float
        Time between two checkpoints.

    Attributes
    ----------
    saved : dict or None
        What the file holds of each part of the run; None at the start of a run.

    Raises
    ------
    ValueError
        If there is no such file, or it is of other settings or another version of the package.
    """

    def __init__(
        self,
        settings: Any,
        path: Path | None = None,
        *,
        resume: bool = False,
        seconds: float = _SECONDS,
    ) -> None:
        # texts, so that a tuple is what it was
        self._about = {"version": __version__, "settings": repr(asdict(settings))}
        self._path, self._seconds = path, seconds
        self.saved: dict[str, Any] | None = None
        if resume and path is not None:
            self.saved = self._read(path)

    def _read(self, path: Path) -> dict[str, Any]:
        import torch

        if not path.is_file():
            raise ValueError(f"there is no checkpoint {path} to resume: begin without --resume")
        try:
            saved = torch.load(path, weights_only=True)
            about, _, _ = (saved[name] for name in ("about", "done", "parts"))
            pairs = [(name, str(about[name]), value) for name, value in self._about.items()]
        except Exception as error:
            raise ValueError(f"{path} is no checkpoint ({type(error).__name__})") from error
        for name, theirs, ours in pairs:
            if theirs != ours:
                raise ValueError(
                    f"{path} has the {name} {theirs}, this run has {ours}: resume with the same "
                    "options and version, or begin again without --resume"
                )
        return saved

    def rounds(
        self, parts: dict[str, Any], last: int, title: str | None, unit: str, first: int = 1
    ) -> Iterator[int]:
        """Yield the numbers of the rounds that are left, up to `last`, and write checkpoints.

        Parameters
        ----------
        parts : dict
            All that changes in a round. A checkpoint is restored into these very objects.
        last, first : int
            Numbers of rounds.
        title : str, optional
            Of what is shown of the progress; without it nothing is.
        unit : str
            What a round is called there.
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

        with replacing(path, binary=True) as file:
            torch.save({"about": self._about, "done": done, "parts": state_of(parts)}, file)


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


def state_of(part: Any) -> Any:
    """Return what changes in a part of a run, as tensors, numbers, texts, lists and dicts."""
    import torch

    if isinstance(part, torch.nn.Module | torch.optim.Optimizer):
        return part.state_dict()
    if isinstance(part, torch.Generator):
        return part.get_state()
    if isinstance(part, np.random.Generator):
        return dict(part.bit_generator.state)
    if isinstance(part, np.ndarray):
        return torch.from_numpy(part.copy())
    if hasattr(part, "get_state"):  # environments
        records = part.get_state()
        return torch.from_numpy(records.view(np.uint8).copy())
    if hasattr(part, "changes"):
        return {name: state_of(getattr(part, name)) for name in part.changes}
    if isinstance(part, dict):
        return {name: state_of(each) for name, each in part.items()}
    if isinstance(part, list | tuple):
        return [state_of(each) for each in part]
    return part.item() if isinstance(part, np.generic) else part


def restore(part: Any, saved: Any) -> Any:
    """Bring a part of a run into a state; return it, or what is to take its place."""
    import torch

    if isinstance(part, torch.nn.Module | torch.optim.Optimizer):
        part.load_state_dict(saved)
    elif isinstance(part, torch.Generator):
        part.set_state(saved)
    elif isinstance(part, np.random.Generator):
        part.bit_generator.state = saved
    elif isinstance(part, np.ndarray):
        return saved.numpy()
    elif hasattr(part, "get_state"):
        part.set_state(saved.numpy().view(part.get_state().dtype))
    elif hasattr(part, "changes"):
        for name, value in saved.items():
            setattr(part, name, restore(getattr(part, name), value))
        if hasattr(part, "restored"):
            part.restored()
    elif isinstance(part, dict):
        part.update({name: restore(part[name], value) for name, value in saved.items()})
    elif isinstance(part, list):
        part[:] = saved
    elif isinstance(part, tuple):
        return type(part)(*saved)  # a NamedTuple
    else:
        return saved
    return part
