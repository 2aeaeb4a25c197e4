"""Check the English: sentences that are too long, and phrases that readers stumbled over.

A heading of a docstring that was wrapped into its paragraph is found too.

It reads Markdown and, in Python files, docstrings and the texts of errors. `[tool.prose]` of
pyproject.toml has the limits and the phrases. Run it with `python .ci/prose.py`, or with files.
"""

from __future__ import annotations

import ast
import inspect
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).parents[1]
RULES = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["prose"]
SAID = {".py": RULES["phrases"], ".md": RULES["phrases"] + RULES["of-pages"]}
Passage = tuple[int, str]  # the number of its line, and a paragraph or an item of a list

FENCED = re.compile(
    r"^([ \t]*)(`{3,}|:{3,}).*?^\1\2[ \t]*$|\$\$.*?\$\$|\A---$.*?^---$|<!--.*?-->",
    re.DOTALL | re.MULTILINE,
)
CODE = re.compile(r"``.+?``|`[^`]*`|\$[^$]+\$|<[^>]+>", re.DOTALL)
WORD = re.compile(r"[A-Za-z]{2}|^[aAIX]$")  # numbers and symbols are none
# Of a sentence, or of a part that stands alone
END = re.compile(r"(?<=[\w)}\]\"'*%][.!?;:])[)*\"'\]]*\s+")


def markdown(text: str) -> Iterator[Passage]:
    """Return the passages of a page, without code, formulas and tables."""
    yield from passages(FENCED.sub(lambda found: "\n" * found[0].count("\n"), text))


def python(text: str) -> Iterator[Passage]:
    """Return the passages of docstrings, and the texts of errors."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            if isinstance(node.value.value, str):
                for line, passage in passages(docstring(node.value.value)):
                    yield node.lineno + line - 1, passage
        elif isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
            for said in node.exc.args:
                yield said.lineno, words_of(said)


def words_of(node: ast.expr) -> str:
    """Return the text of a string or an f-string, with "X" for what is filled in."""
    if isinstance(node, ast.Constant):
        return str(node.value)
    if isinstance(node, ast.JoinedStr):
        return "".join(words_of(each) for each in node.values)
    if isinstance(node, ast.BinOp):
        return words_of(node.left) + words_of(node.right)
    return "X"


def docstring(text: str) -> str:
    """Return a docstring without headings of sections, names of parameters, examples and tables."""
    kept, example, table = list[str](), False, False
    lines = inspect.cleandoc(text).split("\n")
    for line, after in zip(lines, [*lines[1:], ""], strict=True):
        bare = line.strip()
        example = bool(bare) and (example or bare.startswith((">>>", "npend ", "python ")))
        if re.fullmatch(r"=[= ]+", bare):
            table = bool(after.strip())
        heading = re.fullmatch(r"-{3,}", after.strip()) or re.fullmatch(r"-{3,}", bare)
        parameter = re.fullmatch(r"[\w*`, ]+ : .*", bare)
        kept.append("" if example or table or heading or parameter else line)
    return "\n".join(kept)


def passages(text: str) -> Iterator[Passage]:
    """Return paragraphs and items of lists with the numbers of their lines."""
    number, lines, indent = 0, list[str](), 0
    for k, line in enumerate([*text.split("\n"), ""], start=1):
        here = len(line) - len(line.lstrip())
        item = re.match(r"\s*([-*+]|\d+\.)\s+", line)
        if lines and (not line.strip() or item or here != indent):
            yield number, " ".join(lines)
            lines = []
        if line.strip() and not line.lstrip().startswith(("|", "#")):
            number = number if lines else k
            indent = len(item[0]) if item else here
            lines.append(line.strip())


def findings(path: Path) -> Iterator[str]:
    """Return what a file breaks, a line each."""
    read = python if path.suffix == ".py" else markdown
    phrases = re.compile(rf"\b(?:{'|'.join(SAID[path.suffix])})\b", re.IGNORECASE)
    for line, passage in read(path.read_text("utf-8")):
        text = re.sub(r"!?\[([^\]]*)\](\([^)]*\))?", r"\1", CODE.sub("X", passage))
        for sentence in END.split(text):
            words = [word for word in sentence.split() if WORD.search(word)]
            if len(words) > RULES["words"]:
                yield f"{path}:{line}: {len(words)} words: {sentence}"
        if lost := re.search(r"\S+ -{4,}", text):
            yield f'{path}:{line}: the heading "{lost[0]}" is not on a line of its own'
        for found in phrases.finditer(text):
            yield f'{path}:{line}: "{found[0]}" in: {text[max(0, found.start() - 50) :][:110]}'


def too_long() -> Iterator[str]:
    """Return the pages with more words than allowed, and say if all together have more."""
    limits = RULES["pages"]
    for name in files(limits["of-each"]):
        if (words := count(name)) > limits["each"]:
            yield f"{ROOT / name}: {words} words, at most {limits['each']}"
    if (words := sum(map(count, files(limits["of-all"])))) > limits["all"]:
        yield f"{' '.join(limits['of-all'])}: {words} words, at most {limits['all']}"


def count(name: str) -> int:
    """Return the number of words as `wc -w` counts them, with code and tables."""
    return len((ROOT / name).read_text("utf-8").split())


def files(patterns: list[str]) -> list[str]:
    """Return the names of files that git knows."""
    listed = subprocess.check_output(["git", "ls-files", *patterns], cwd=ROOT, text=True)
    return listed.splitlines()


def main(given: list[str]) -> int:
    """Print the findings in the given files, or in all; return 1 if there are some."""
    given = [Path(os.path.relpath(name, ROOT)).as_posix() for name in given]
    if unknown := set(given).difference(files([])):
        print(f"git must know each file, got {', '.join(sorted(unknown))}", file=sys.stderr)
        return 2
    names = [name for name in files(RULES["files"]) if name not in RULES["exclude"]]
    chosen = [name for name in names if not given or name in given]
    found = [finding for name in chosen for finding in findings(ROOT / name)]
    found += too_long()
    print("".join(f"{finding}\n" for finding in found).replace(f"{ROOT}/", ""), end="")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
