"""What the package says of itself on the index, and the machine code that a wheel may bring.

NPEND_GYM_MACHINE_CODE names processors as LLVM does, such as "x86-64-v3,x86-64-v4". A wheel that is
built with it has machine code of what most programs use, and compiles nothing at their start.

`repository` in `[tool.hatch.metadata.hooks.custom]` of pyproject.toml decides all addresses. While
it is empty, the metadata have none, and the README on the index has no links into a clone.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from hatchling.metadata.plugin.interface import MetadataHookInterface

LINK = re.compile(r"(!?)\[((?:!?\[[^\]]*\]\([^)]*\)|[^\[\]])*)\]\((?!https?:|#)([^)]*)\)")


def addresses(repository: str) -> dict[str, str]:
    """Return the addresses of a repository such as "https://github.com/OWNER/npend_gym"."""
    if not repository:
        return {}
    found = re.fullmatch(r"https://github\.com/([^/]+)/([^/]+)", repository)
    if found is None:
        raise ValueError(f"repository must be https://github.com/OWNER/NAME, got {repository!r}")
    owner, name = found.groups()
    return {
        "Homepage": repository,
        "Documentation": f"https://{owner}.github.io/{name}",
        "Source": repository,
        "Issues": f"{repository}/issues",
        "Changelog": f"{repository}/blob/main/CHANGELOG.md",
    }


def readme(text: str, repository: str) -> str:
    """Return a README whose links and pictures are absolute, or left out without a repository."""

    def absolute(found: re.Match[str]) -> str:
        picture, shown, path = found.groups()
        shown = LINK.sub(absolute, shown)  # a picture may be a link
        if repository:
            return f"{picture}[{shown}]({repository}/{'raw' if picture else 'blob'}/main/{path})"
        return "" if picture else shown

    return LINK.sub(absolute, text)


class Addresses(MetadataHookInterface):
    """Fills in the README, and the addresses where there are some."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Add what the setting decides."""
        repository = self.config.get("repository", "").rstrip("/")
        text = (Path(self.root) / "README.md").read_text("utf-8")
        metadata["readme"] = {"content-type": "text/markdown", "text": readme(text, repository)}
        if repository:
            metadata["urls"] = addresses(repository)


class MachineCode(BuildHookInterface):  # type: ignore[type-arg]
    """Compiles the kernels into the wheel, for processors that the user names."""

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        names = os.environ.get("NPEND_GYM_MACHINE_CODE", "").split(",")
        self.processors = [name.strip() for name in names if name.strip()]
        self.folder = ""

    def dependencies(self) -> list[str]:
        """Return what compiling needs: what the package needs."""
        return self.metadata.core.dependencies if self.processors else []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile into a folder that the wheel takes."""
        del version
        if not self.processors:
            return
        self.folder = tempfile.mkdtemp()
        for name in self.processors:
            chosen = {"NUMBA_CPU_NAME": name, "NUMBA_CPU_FEATURES": ""}
            paths = {"NUMBA_CACHE_DIR": self.folder, "PYTHONPATH": self.root}
            subprocess.run(
                [sys.executable, "-c", "from npend_gym.cli import main; main(['compile'])"],
                env=os.environ | chosen | paths, check=True,
            )  # fmt: skip
        build_data["force_include"][self.folder] = "npend_gym/machine_code"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the folder."""
        del version, build_data, artifact_path
        if self.folder:
            shutil.rmtree(self.folder, ignore_errors=True)
