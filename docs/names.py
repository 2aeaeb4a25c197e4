"""The page of all public names, for readers of a clone: `python docs/names.py` writes it.

It reads the source and imports nothing, so that no extra needs to be installed.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "reference" / "names.md"
FACES = (
    "", "chain", "physics", "theory", "chaos", "identification", "envs", "rl", "rl.training",
    "torch", "export", "experiments", "report", "render", "tools",
)  # fmt: skip
HEAD = """\
# All names, with their arguments

![A chain of three links with its angles and torques](../images/conventions.png)

- **Angles** are absolute. `theta[i]` turns rod `i` counter-clockwise from hanging straight down
  [rad], whatever the rods above do. Upright is pi. `x` points to the right, `y` upwards, and the
  pivot is at (0, 0).
- **Rods and joints** count from 0 at the pivot. Joint `i` is the upper end of rod `i`.
- **Torques** turn counter-clockwise where they are positive [N m]. At joint 0 the pivot turns
  rod 0. At joint `i` a motor turns rod `i` by `+torque[i]`, and rod `i - 1` by `-torque[i]`.
- **A force** on a cart is positive to the right [N].
- **Units** are SI.

`python docs/names.py` writes this page from the source. `help(name)` has the whole description, and
the pages beside this one have it on the site.
"""


def main() -> None:
    """Write the page."""
    PAGE.write_text(page(), encoding="utf-8")


def page() -> str:
    """Return the text of the page."""
    seen: set[tuple[Path, str]] = set()
    return "\n".join([HEAD, *(line for face in FACES for line in _section(face, seen))])


def _section(face: str, seen: set[tuple[Path, str]]) -> Iterator[str]:
    """Yield the lines of one package; `seen` are the names that another one has."""
    yield f"## npend_gym{'.' * bool(face)}{face}\n"
    stub = ROOT.joinpath("npend_gym", *face.split("."), "__init__.pyi")
    for imported in ast.parse(stub.read_text("utf-8")).body:
        if not isinstance(imported, ast.ImportFrom) or imported.module is None:
            continue
        for alias in imported.names:
            name = alias.asname or alias.name
            path = _file(imported.module)
            if (path, name) not in seen:
                yield from _described(path, alias.name)
            seen.add((path, name))
    yield ""


def _file(module: str) -> Path:
    path = ROOT.joinpath(*module.split("."))
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")


def _described(path: Path, name: str) -> Iterator[str]:
    """Yield the lines of what a module calls by a name; none of names from elsewhere."""
    if not path.exists():
        return
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.ClassDef) and node.name == name:
            yield from _of_class(path, node)
        elif isinstance(node, ast.FunctionDef) and node.name == name:
            yield _line("", node.name, _arguments(node.args), node)
        elif isinstance(node, ast.ImportFrom) and name in {one.name for one in node.names}:
            yield from _described(_file(node.module or ""), name)
        else:
            continue
        return


def _parts(path: Path, node: ast.ClassDef) -> list[ast.FunctionDef]:
    """Return the methods of a class, and after them those of its bases in the package."""
    methods = [one for one in node.body if isinstance(one, ast.FunctionDef)]
    module = ast.parse(path.read_text("utf-8")).body
    homes = {
        alias.name: _file(one.module)
        for one in module
        if isinstance(one, ast.ImportFrom) and one.module and one.module.startswith("npend_gym")
        for alias in one.names
    } | {one.name: path for one in module if isinstance(one, ast.ClassDef)}
    for one in node.bases:
        base = ast.unparse(one.value if isinstance(one, ast.Subscript) else one)
        if base not in homes:
            continue
        for other in ast.parse(homes[base].read_text("utf-8")).body:
            if isinstance(other, ast.ClassDef) and other.name == base:
                known = {one.name for one in methods}
                methods += [one for one in _parts(homes[base], other) if one.name not in known]
    return methods


def _of_class(path: Path, node: ast.ClassDef) -> Iterator[str]:
    """Yield the lines of a class and of its methods."""
    methods = _parts(path, node)
    made = next((one for one in methods if one.name == "__init__"), None)
    given = _arguments(made.args, bound=True) if made else _fields(node)
    yield _line("", node.name, given, node)
    for one in methods:
        if one.name.startswith("_") or not ast.get_docstring(one):
            continue
        ways = {ast.unparse(way) for way in one.decorator_list}
        is_value = any("property" in way for way in ways)
        given = None if is_value else _arguments(one.args, bound="staticmethod" not in ways)
        yield _line("  ", f".{one.name}", given, one)


def _fields(node: ast.ClassDef) -> str | None:
    """Return the fields of a dataclass or a named tuple as arguments; None of other classes."""
    ways = " ".join(map(ast.unparse, [*node.decorator_list, *node.bases]))
    if "dataclass" not in ways and "NamedTuple" not in ways:
        return None
    shown: list[str] = []
    for one in node.body:
        if isinstance(one, ast.AnnAssign) and isinstance(one.target, ast.Name):
            plain = one.value is None or isinstance(one.value, (ast.Constant, ast.Name, ast.Tuple))
            default = "" if one.value is None else f"={ast.unparse(one.value) if plain else '...'}"
            if not one.target.id.startswith("_") and "ClassVar" not in ast.unparse(one.annotation):
                shown.append(one.target.id + default)
    return ", ".join(shown)


def _arguments(given: ast.arguments, *, bound: bool = False) -> str:
    """Return arguments with their defaults, without types; without the first if it is `bound`."""
    for one in [*given.posonlyargs, *given.args, *given.kwonlyargs, given.vararg, given.kwarg]:
        if one is not None:
            one.annotation = None
    text = ast.unparse(given)
    return re.sub(r"^\w+(, |$)", "", text) if bound else text


def _line(indent: str, name: str, given: str | None, node: ast.AST) -> str:
    """Return the item of a name: its arguments, and the first sentence of its description."""
    about = ast.get_docstring(node) or ""  # type: ignore[arg-type]
    first = re.split(r"(?<=\.)\s", " ".join(about.partition("\n\n")[0].split()))[0]
    return f"{indent}- `{name}{'' if given is None else f'({given})'}`: {first}"


if __name__ == "__main__":
    main()
