"""The Hugging Face Hub: files that are downloaded from it, once, and kept on this machine."""

from __future__ import annotations

from pathlib import Path

from npend_gym._extras import require

POLICY_FILE = "policy.safetensors"  # of a repository


def download(repo_id: str, filename: str, revision: str | None = None) -> Path:
    """Return where a file of a repository is kept on this machine, downloaded if it is not yet.

    Raises
    ------
    ImportError
        If the extra "hub" is not installed.
    OSError
        If the file cannot be downloaded.
    """
    hub = require("huggingface_hub", "hub", "policies of the Hugging Face Hub")
    return Path(hub.hf_hub_download(repo_id, filename, revision=revision))
