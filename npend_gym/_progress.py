"""How far long work is: a bar on a terminal; elsewhere a line every ten seconds."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator
from operator import length_hint
from typing import Any

from tqdm import tqdm
from typing_extensions import Self

SECONDS = 10.0  # between two lines
_KNOWN = "{l_bar}{bar}| {n_fmt} of {total_fmt} {unit} [{elapsed}<{remaining}{postfix}]"


def bar(
    items: Iterable[Any] = (),
    title: str | None = None,
    *,
    unit: str,
    total: int | None = None,
    initial: int = 0,
    leave: bool = True,
) -> Any:
    """Return a loop over `items` that shows how far it is, by tqdm's methods.

    Parameters
    ----------
    items : iterable
        It may be left out where `update` is called.
    title : str, optional
        Of the work.
    unit : str
        What items are called.
    total, initial : int
        How many there are, where `items` do not say, and how many were done before.
    leave : bool
        Whether a bar stays on the terminal.
    """
    total = total or length_hint(items) or None
    if not sys.stderr.isatty():
        return _Lines(items, title, unit, total, initial)
    shown: dict[str, Any] = {"unit": unit, "total": total, "initial": initial, "leave": leave}
    shown["bar_format"] = None if total is None else _KNOWN
    return tqdm(items, title, unit_scale=total is not None and total > 9999, **shown)


class _Lines:
    """Lines on the error stream, with those methods of tqdm's bar that are called here."""

    def __init__(
        self, items: Iterable[Any], title: str | None, unit: str, total: int | None, initial: int
    ) -> None:
        self._items, self._unit, self._total, self._done = items, unit, total, initial
        self._title = "" if title is None else f"{title}: "
        self._beside = ""
        self._shown = time.monotonic()

    def __iter__(self) -> Iterator[Any]:
        for item in self._items:
            yield item
            self.update(1)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def set_postfix(self, refresh: bool = True, **values: object) -> None:
        """Show values at the end of a line, from the next on."""
        del refresh
        self._beside = "".join(f", {value} {name}" for name, value in values.items())

    def update(self, count: int) -> None:
        """Count what has been done, and tell where it is time."""
        self._done += count
        if self._done != self._total and time.monotonic() - self._shown >= SECONDS:
            self._shown = time.monotonic()
            of = f" of {self._total}" if self._total else ""
            line = f"{self._title}{self._done}{of} {self._unit}{self._beside}"
            print(line, file=sys.stderr, flush=True)
