"""What the package says of itself on the index: addresses and README, from one setting.

`repository` in `[tool.hatch.metadata.hooks.custom]` of pyproject.toml decides all addresses. While
it is empty, the metadata have none, and the README on the index has no links into a clone.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

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
