"""The listings of the paper's appendix D, read from its source as it stands.

`listings.tex` is that part of the source. Two of the four listings are not Python as printed; they
are mended where Python stops, as little as can be, and each mend is reported.
"""

import ast
import builtins
import math
import re
import textwrap
from collections.abc import Iterator
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np

_LISTING = re.compile(r"\\begin\{lstlisting\}\[[^\]]*\]\n(.*?)\\end\{lstlisting\}", re.DOTALL)


class Listing(NamedTuple):
    """A listing of the paper."""

    printed: str
    mends: tuple[str, ...]  # why Python refuses the printed text, for each line that was mended
    tree: ast.Module  # of the mended text


@cache
def listings() -> tuple[Listing, ...]:
    """Return the four listings."""
    text = files("paper").joinpath("listings.tex").read_text("utf-8")
    return tuple(_mended(code) for code in _LISTING.findall(text))


def _mended(printed: str) -> Listing:
    """Parse a listing, and mend each line at which Python stops."""
    lines, mends = printed.splitlines(), list[str]()
    while True:
        try:
            return Listing(printed, tuple(mends), ast.parse("\n".join(lines)))
        except SyntaxError as error:  # noqa: PERF203 - it says where the next line to mend is
            at = (error.lineno or 1) - 1
            parts = _statements(lines[at])
            if parts:
                mends.append("two statements on one line")
                lines[at : at + 1] = parts
            elif "+!" in lines[at]:  # on a US keyboard "!" is a shifted 1
                mends.append("n+! is no expression")
                lines[at] = lines[at].replace("+!", "+1")
            else:
                raise


def _statements(line: str) -> list[str]:
    """Return two statements that stand on one `line` with nothing but space between, or none."""
    for gap in re.finditer(r"\s{2,}", line.strip()):
        some = [line.strip()[: gap.start()], line.strip()[gap.end() :]]
        if all(map(_parses, some)):
            return [textwrap.indent(one, line[: len(line) - len(line.lstrip())]) for one in some]
    return []


def _parses(text: str) -> bool:
    try:
        ast.parse(text)
    except SyntaxError:
        return False
    return True


def function(number: int, name: str, **names: Any) -> Any:
    """Return the function `name` of a listing, compiled from the paper's text.

    Parameters
    ----------
    number : int
        Of the listing, from 1.
    name : str
        The function, which may be defined inside another.
    names : object
        What else it refers to: the variables of the functions around it.
    """
    tree = listings()[number - 1].tree
    (found,) = (one for one in _functions(tree) if one.name == name)
    space: dict[str, Any] = {"np": np, "math": math, **names}
    module = ast.Module([found], [])
    exec(compile(module, f"listing {number}", "exec"), space)  # noqa: S102 - what the paper prints
    return space[name]


def _functions(tree: ast.AST) -> Iterator[ast.FunctionDef]:
    return (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef))


def _called(nodes: Iterator[ast.AST]) -> set[str]:
    calls = (node for node in nodes if isinstance(node, ast.Call))
    return {call.func.id for call in calls if isinstance(call.func, ast.Name)}


def dead_functions(number: int) -> set[str]:
    """Return the functions of a listing that no call reaches from its outermost statements."""
    tree = listings()[number - 1].tree
    defined = {one.name: one for one in _functions(tree)}
    reached: set[str] = set()
    pending = _called(_outside_functions(tree))
    while pending:
        name = pending.pop()
        if name in defined and name not in reached:
            reached.add(name)
            body = ast.Module(defined[name].body, [])
            pending |= _called(_outside_functions(body))
    return set(defined) - reached


def _outside_functions(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes of `tree` that stand in no function defined in it."""
    for node in ast.iter_child_nodes(tree):
        if not isinstance(node, ast.FunctionDef):
            yield node
            yield from _outside_functions(node)


def undefined_names(number: int) -> set[str]:
    """Return the names that a listing's outermost statements use and none of the four defines."""
    bound, used = set(dir(builtins)), set[str]()
    for k, listing in enumerate(listings(), start=1):
        bound |= {one.name for one in listing.tree.body if isinstance(one, ast.FunctionDef)}
        for node in _outside_functions(listing.tree):
            if isinstance(node, ast.alias):
                bound.add(node.asname or node.name)
            elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                bound.add(node.id)
            elif isinstance(node, ast.Name) and k == number:
                used.add(node.id)
    return used - bound


def simulated_counts() -> range:
    """Return the numbers of pendulums that listing 3's Simulation() runs through."""
    (body,) = (one.body for one in _functions(listings()[2].tree) if one.name == "Simulation")
    space: dict[str, Any] = {}
    for node in body:
        names = {one.id for one in ast.walk(node) if isinstance(one, ast.Name)}
        if isinstance(node, ast.Assign) and names <= {"n", "numberofps"}:
            exec(compile(ast.Module([node], []), "listing 3", "exec"), space)  # noqa: S102
    (loop,) = (node for node in body if isinstance(node, ast.For))
    return eval(compile(ast.Expression(loop.iter), "listing 3", "eval"), space)  # noqa: S307
