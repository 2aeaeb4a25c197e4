"""Every command that a page names is one that the command line and the examples understand."""

import re
import shlex
from pathlib import Path

import pytest

from npend_gym.cli import parsers

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
BLOCK = re.compile(r"```(?:sh|console)\n(.*?)```", re.DOTALL)
OURS = ("npend ", "python examples/")


def commands(page):
    """Return those in blocks, and those within sentences, which may leave out what is required."""
    text = page.read_text("utf-8")
    blocks = "\n".join(BLOCK.findall(text)).replace("\\\n", " ")
    sentences = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    lines = [line.removeprefix("$ ") for line in blocks.splitlines()]
    inline = [" ".join(code.split()) for code in re.findall(r"`([^`]+)`", sentences)]
    for found, whole in ((lines, True), (inline, False)):
        for line in found:
            for command in re.split(r" && | \| ", line):
                if command.startswith(OURS):
                    yield shlex.split(command, comments=True), whole


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_of_the_page_are_understood(page, capsys):
    parser, each = parsers()
    for words, whole in commands(page):
        placeholder = any(re.fullmatch(r"[A-Z]+|\.\.\.", word) for word in words)
        if words[0] == "python":
            script = (ROOT / words[1]).read_text("utf-8")
            options = {word for word in words[2:] if word.startswith("--")} - {"--env"}
            assert all(f'"{option}"' in script for option in options), words
        elif whole and not placeholder:
            parser.parse_args(words[1:])
        elif words[1] in each:
            command = each[words[1]]
            command.load()
            known = re.findall(r"--[\w-]+", command.format_help())
            assert {word for word in words[2:] if word.startswith("--")} <= set(known), words
        else:
            assert placeholder or words[1] in ("--help", "--version"), words
    assert capsys.readouterr().err == ""


def test_the_pages_name_many_commands():
    assert sum(len(list(commands(page))) for page in PAGES) > 200
