"""Hub: `push_to_hub` and `from_pretrained`, by the conventions of the Hugging Face Hub."""

from __future__ import annotations

import re
import tempfile
from os import PathLike
from pathlib import Path
from typing import Any

from .._types import UserError
from ..training import Run, load
from .shared import EXAMPLES, LOG, PLACES, example_path, save_pretrained

FILES = ("README.md", "*.json", "stats.jsonl", "checkpoints/*.safetensors", "samples/*.png")
"""What is fetched: nothing of it is executable."""
OURS = ("README.md", *PLACES, LOG, "checkpoints/*.safetensors", "samples/*.png")
"""What a run on the hub consists of: what an earlier one left of it goes when another takes its place."""
NAME = re.compile(r"[\w.-]+/[\w.-]+", re.ASCII)


def from_pretrained(
    name: str | PathLike[str], *, revision: str | None = None, device: str = "cpu", trust: bool = False
) -> Run:
    """Open a shared run: a folder, one that comes with the package ("chairs"), or OWNER/NAME on the hub.

    Only the last asks the network, by `huggingface_hub`, which is an extra: pip install 'unproject[hub]'.

    Args:
        name: a folder if there is one of that name.
        revision: on the hub, a branch, tag or commit.
        device: where to put the generator.
        trust: import code outside this package.

    Raises:
        UserError: if there is no such run, or it is no run.

    Examples:
        >>> import unproject as up
        >>> up.from_pretrained("chairs").domain.name
        'volume'
    """
    if Path(name).is_dir():
        return load(Path(name), device=device, trust=trust)
    if str(name) in EXAMPLES:
        return load(example_path(str(name)), device=device, trust=trust)
    if not NAME.fullmatch(str(name)):
        raise UserError(f"{name}: is no folder; give one, OWNER/NAME on the hub, or one of {', '.join(EXAMPLES)}")
    hub = _hub()
    try:
        path = hub.snapshot_download(str(name), revision=revision, allow_patterns=list(FILES))
    except Exception as error:  # of the network, the hub or the disk, in classes of several packages
        raise UserError(f"{name}: cannot be fetched ({_in_one_line(error)}); check the name and the network") from None
    return load(path, device=device, trust=trust)


def push_to_hub(
    run: Run | str | PathLike[str], name: str, *, private: bool = True, trust: bool = False, api: Any = None
) -> str:
    """Share a run on the hub as OWNER/NAME, privately unless said otherwise, and return its address.

    It takes the place of a run that is there, of which no file is left; other files stay.

    Args:
        run: the run, or its directory.
        name: OWNER/NAME; it is made if there is none.
        private: whether only its owner sees it; a place that is there stays as public or private as it is.
        trust: import code outside this package.
        api: a `huggingface_hub.HfApi` (default: one that is logged in as `hf auth login` left it).

    Raises:
        UserError: if the hub cannot be reached or refuses, or what is to be private would be public.

    Examples:
        >>> import unproject as up
        >>> up.push_to_hub("runs/mine", "mine")
        Traceback (most recent call last):
        ...
        unproject._types.UserError: mine: give OWNER/NAME, as the hub knows it
    """
    if not NAME.fullmatch(name):
        raise UserError(f"{name}: give OWNER/NAME, as the hub knows it")
    api = api or _hub().HfApi()
    with tempfile.TemporaryDirectory() as folder:
        shared = save_pretrained(run, Path(folder) / name.rpartition("/")[2], trust)
        card = shared / "README.md"
        card.write_text(card.read_text(encoding="utf-8").replace("OWNER/NAME", name), encoding="utf-8")
        try:
            address = api.create_repo(name, private=private, exist_ok=True)
            if private and not api.repo_info(name).private:  # there before: `private` is of a new one alone
                raise UserError(f"{name}: exists and is public; give --public or another name")
            about = {"commit_message": "A run of unproject", "delete_patterns": list(OURS)}
            api.upload_folder(repo_id=name, folder_path=shared, **about)
        except UserError:
            raise
        except Exception as error:  # of the network, the hub or the disk, in classes of several packages
            raise UserError(f"{name}: cannot be shared ({_in_one_line(error)}); log in by `hf auth login`") from None
    return str(address)


def _hub() -> Any:
    try:
        import huggingface_hub
    except ImportError:
        raise UserError("the hub needs a package more: pip install 'unproject[hub]'") from None
    return huggingface_hub


def _in_one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__
