"""The arguments of a command, from the signatures and docstrings of what they fill.

A command is a function, `run`. Its positional parameters are arguments, and those by keyword are
options; so are the parameters, or the fields, of what its module names in FILLS. Name, type,
default, unit and help come from there, so that each stands in one place. The source is read and
not imported: help and completion would wait for Numba.
"""

from __future__ import annotations

import argparse
import ast
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

from npend_gym.cli import values

# Option of a parameter, where it has another name, and its short form
_SPELLED = {"n_values": "n", "as_json": "json", "settings": "set", "for_engine": "for"}
_SHORT = {"--n": "-n", "--out": "-o", "--seed": "-s", "--amplitude": "-a", "--trials": "-t"}
# Annotation of a parameter: what reads its text, and its placeholder, in which X stands for the
# unit or the name
_READERS: dict[str, tuple[Any, str]] = {
    "int": (int, "X"),
    "float": (float, "X"),
    "str": (str, "X"),
    "Path": (values.path, "X"),
    "Path | str": (values.folder, "X"),
    "Sequence[Path]": (values.path, "X"),
    "Sequence[int]": (values.integers, "X,..."),
    "int | Sequence[int]": (values.integers, "X,..."),
    "Sequence[str]": (values.texts, "NAME,..."),
    "str | Sequence[str]": (values.texts, "NAME,..."),
    "ArrayLike": (values.numbers, "X,..."),
    "float | Sequence[float]": (values.numbers, "X,..."),
    "float | Sequence[PerRod]": (values.numbers_per_rod, "X[:X...],..."),
    "Chain | Mapping[str, Any] | str": (values.chain_argument, "NAME|FILE"),
    "Mapping[str, str]": (values.columns, "NAME=COLUMN,..."),
    "Sequence[tuple[str, Any]]": (values.setting, "NAME=VALUE"),
}
_ANGLES = {
    "float": (values.angle, "X"),
    "float | Sequence[float]": (values.angles, "X,..."),
    "tuple[float, float]": (values.angles, "X,X"),
}
# Of a docstring: names, type and text of a parameter
_ENTRY = re.compile(r"^([\w*, ]+?) : (.+)\n((?: {4}.*\n|\n)+)", re.MULTILINE)


class _Settings(argparse.Action):
    """Collects NAME=VALUE; a name that comes again raises an error."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option_string: Any = None) -> None:
        """Keep one more."""
        del parser, option_string
        given: list[tuple[str, Any]] = getattr(namespace, self.dest, [])
        if values[0] in dict(given):
            raise argparse.ArgumentError(self, f"must have each name once, got {values[0]} twice")
        setattr(namespace, self.dest, [*given, values])


class _List(argparse.Action):
    """Stores a list; an option that comes again raises an error, and does not replace it."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option_string: Any = None) -> None:
        """Store the values."""
        del parser, option_string
        if hasattr(namespace, self.dest):  # it has no default
            raise argparse.ArgumentError(self, "must be given once: join its values by commas")
        setattr(namespace, self.dest, values)


class _Parameter(NamedTuple):
    """A parameter of a function, or a field of a class."""

    name: str
    kind: str  # its annotation
    default: str | None  # as text; None where a value must be given
    by_keyword: bool
    noun: str = ""  # its type in the docstring
    text: str = ""  # the first sentence about it


def add_options(
    parser: argparse.ArgumentParser, run: str, fills: Mapping[str, Sequence[str]]
) -> None:
    """Add the arguments of a command, `run`, named as "module:function".

    `fills` has what else options fill, "module:function" or "module:class", with the names of its
    parameters; an empty sequence stands for all.
    """
    for each in _parameters(run):
        if each.text:  # others are described by what they fill
            _add(parser, each)
    for source, names in fills.items():
        for each in _parameters(source):
            if each.name in names or not names:
                _add(parser, each._replace(by_keyword=True))


def spelled(name: str) -> str:
    """Return the option of a parameter."""
    return f"--{_SPELLED.get(name, name)}".replace("_", "-")


def with_options(message: str) -> str:
    """Return a message with the options of parameters whose names are no words."""
    for name in _SPELLED:
        message = message.replace(name, spelled(name)) if "_" in name else message
    return message


def _add(parser: argparse.ArgumentParser, parameter: _Parameter) -> None:
    option, (name, kind, default, by_keyword, noun, text) = spelled(parameter.name), parameter
    shown = f" (default {default})" if default and "default" not in text else ""
    about: dict[str, Any] = {"help": (text[:1].lower() + text[1:] + shown).replace("%", "%%")}
    if kind == "bool":
        about["action"] = "store_true"
    elif kind.startswith("Literal"):
        about["choices"] = re.findall(r"'(\w+)'", kind)
    else:
        unit = re.search(r"\[([^][]+)\]", text)
        is_angle = unit is not None and unit[1] == "rad" and kind in _ANGLES
        about["type"], placeholder = (_ANGLES if is_angle else _READERS)[kind]
        if kind not in ("str", "Path", "Path | str", "Sequence[Path]"):
            noun = "N" if "int" in kind else "NUMBER"
        elif noun == "str":
            noun = option[2:]
        word = (unit[1].replace(" ", "") if unit else noun).upper()
        about["metavar"] = placeholder.replace("X", word)
    if about.get("type") is values.setting:
        about["action"] = _Settings
    elif by_keyword and ",..." in about.get("metavar", ""):
        about["action"] = _List
    if by_keyword:
        short = [_SHORT[option]] if option in _SHORT else []
        parser.add_argument(*short, option, dest=name, required=default is None, **about)
    elif default is not None:
        parser.add_argument(name, nargs="?", default=None, **about)
    else:
        parser.add_argument(name, nargs="+" if kind.startswith("Sequence") else None, **about)


@cache
def _parameters(source: str) -> list[_Parameter]:
    """Return the parameters of "module:function" or "module:class", or the fields of the class."""
    module, _, name = source.partition(":")
    node: Any = next(each for each in tree(module).body if getattr(each, "name", None) == name)
    texts = _documented(ast.get_docstring(node) or "")
    made = [each for each in node.body if getattr(each, "name", None) == "__init__"]
    given = _fields(node) if isinstance(node, ast.ClassDef) else _arguments(node.args)
    return [
        _Parameter(
            each,
            ast.unparse(annotation).removesuffix(" | None"),
            None if default is None else _shown(module, default),
            by_keyword,
            *texts.get(each, ()),
        )
        for each, annotation, default, by_keyword in (_arguments(made[0].args) if made else given)
        if annotation is not None
    ]


def _fields(node: ast.ClassDef) -> Iterable[tuple[str, Any, Any, bool]]:
    for each in node.body:
        if isinstance(each, ast.AnnAssign) and isinstance(each.target, ast.Name):
            yield each.target.id, each.annotation, each.value, True


def _arguments(given: ast.arguments) -> Iterable[tuple[str, Any, Any, bool]]:
    defaults = dict(zip(reversed(given.args), reversed(given.defaults), strict=False))
    yield from ((one.arg, one.annotation, defaults.get(one), False) for one in given.args)
    for one, default in zip(given.kwonlyargs, given.kw_defaults, strict=True):
        yield one.arg, one.annotation, default, True


def _documented(docstring: str) -> dict[str, tuple[str, str]]:
    """Return the type, and the first sentence, of every parameter in a docstring."""
    found: dict[str, tuple[str, str]] = {}
    for names, kind, text in _ENTRY.findall(docstring + "\n"):
        sentence = " ".join(text.split("\n\n")[0].split()).partition(". ")[0]
        about = kind.partition(",")[0], sentence.replace("`", "").removesuffix(".")
        found |= dict.fromkeys(re.findall(r"\w+", names), about)
    return found


def _shown(module: str, default: Any) -> str:
    """Return a default as a user would write it; nothing for what is left out or off."""
    text = ast.unparse(default)
    if text in ("None", "False", "Path()"):
        return ""
    text = re.sub(r"\b_?[A-Z][A-Z_]+\b", lambda name: _assigned(module, name[0]), text)
    return re.sub(r"math\.|Path|[ ()']", "", text)


def _assigned(module: str, name: str) -> str:
    """Value of a constant in a module, or in the module that it is imported from."""
    for each in tree(module).body:
        if isinstance(each, ast.Assign) and ast.unparse(each.targets[0]) == name:
            return _shown(module, each.value)
        if isinstance(each, ast.ImportFrom) and name in (one.name for one in each.names):
            return _assigned(str(each.module), name)
    raise LookupError(f"{module} has no {name}")


@cache
def tree(module: str) -> ast.Module:
    """Return the source of a module; of a package its stub."""
    path = Path(str(getattr(find_spec(module), "origin", "")))
    stub = path.with_suffix(".pyi")
    return ast.parse((stub if stub.exists() else path).read_text("utf-8"))
