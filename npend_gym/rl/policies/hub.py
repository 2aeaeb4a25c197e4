"""The Hugging Face Hub: files that are downloaded from it, once, and kept on this machine."""

from __future__ import annotations

from pathlib import Path, PurePosixPath

from npend_gym._extras import require
from npend_gym.rl.policies.files import is_described

POLICY_FILE = "policy.safetensors"  # of a repository


def download(repo_id: str, filename: str, revision: str | None = None) -> Path:
    """Return where a policy of a repository is kept on this machine, downloaded if it is not yet.

    A .npz of version 0.1 has its description in a .json file beside it, which is kept beside it
    here, from the same commit.

    Raises
    ------
    ImportError
        If the extra "hub" is not installed.
    ValueError
        If the file is no policy.
    OSError
        If it cannot be downloaded.
    """
    hub = require("huggingface_hub", "hub", "policies of the Hugging Face Hub")
    errors = require("huggingface_hub.errors", "hub", "policies of the Hugging Face Hub")
    path, name = (
        Path(hub.hf_hub_download(repo_id, filename, revision=revision)),
        PurePosixPath(filename),
    )
    if path.suffix == ".npz" and not is_described(path):
        commit = path.parents[len(name.parts) - 1].name  # the folder in which the Hub's files stand
        try:
            hub.hf_hub_download(repo_id, str(name.with_suffix(".json")), revision=commit)
        except errors.LocalEntryNotFoundError:
            raise  # without a connection nobody knows whether there is one
        except errors.EntryNotFoundError:
            pass  # reading the policy warns of it
    return path
