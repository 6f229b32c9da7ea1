"""Public collections by name: fetched by pooch, checked, and put in place whole.

The checksum is that of what a gzipped file unpacks to, because mirrors pack again.
"""

from __future__ import annotations

import gzip
import hashlib
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from .._files import atomic_path
from .._types import UserError

PIECE, TIMEOUT = 2**18, 30


@dataclass(frozen=True)
class PublicCollection:
    """Where gzipped files lie, and the SHA-256 of what each unpacks to, which no repacking changes."""

    mirrors: tuple[str, ...]
    files: Mapping[str, str]
    licence: str


PUBLIC = {
    "mnist": PublicCollection(
        ("https://ossci-datasets.s3.amazonaws.com/mnist/", "https://storage.googleapis.com/cvdf-datasets/mnist/"),
        {
            "train-images-idx3-ubyte.gz": "ba891046e6505d7aadcbbe25680a0738ad16aec93bde7f9b65e87a2fc25776db",
            "train-labels-idx1-ubyte.gz": "65a50cbbf4e906d70832878ad85ccda5333a97f0f4c3dd2ef09a8a9eef7101c5",
            "t10k-images-idx3-ubyte.gz": "0fa7898d509279e482958e8ce81c8e77db3f2f8254e26661ceb7762c4d494ce7",
            "t10k-labels-idx1-ubyte.gz": "ff7bcfd416de33731a308c3f266cc351222c34898ecbeaf847f06e48f7ec33f2",
        },
        "Y. LeCun and C. Cortes, CC BY-SA 3.0",
    )
}


def get(
    name: str, folder: Path, mirror: str | None = None, say: Callable[[str], None] = lambda line: None
) -> tuple[Path, ...]:
    """Fetch a public collection into a folder; files that are there and right are not fetched again.

    Args:
        name: of `PUBLIC`.
        folder: made if it is missing.
        mirror: an address to take the files from, in place of the known ones.
        say: is called with a line for each file.

    Raises:
        UserError: for an unknown name, if nobody answers, or if the content is not the expected one.
    """
    if name not in PUBLIC:
        raise UserError(f"data get {name}: there is no such collection; choose {' or '.join(PUBLIC)}")
    collection = PUBLIC[name]
    folder.mkdir(parents=True, exist_ok=True)
    for file, digest in collection.files.items():
        if (folder / file).exists() and _content(folder / file) == digest:
            say(f"{folder / file}: is there already")
            continue
        _fetch(folder / file, digest, (mirror,) if mirror else collection.mirrors)
        say(f"{folder / file}: {(folder / file).stat().st_size / 1e6:.1f} MB, checked")
    return tuple(folder / file for file in collection.files)


def _fetch(target: Path, digest: str, mirrors: tuple[str, ...]) -> None:
    reasons = []
    for mirror in mirrors:
        try:
            return _download(f"{mirror.rstrip('/')}/{target.name}", target, digest)
        except (OSError, ValueError) as error:  # pooch's and requests' are among them
            reasons.append(f"{mirror}: {' '.join(str(error).split())[:160]}")
    raise UserError(
        f"{target}: could not be fetched ({'; '.join(reasons)}); check the network and try again, name another address "
        "in UNPROJECT_MIRROR, or put the file there yourself"
    )


def _download(address: str, target: Path, digest: str) -> None:
    # It takes a second to import, and only this needs it.
    import pooch

    with atomic_path(target) as temporary:
        pooch.HTTPDownloader(timeout=TIMEOUT, chunk_size=PIECE)(address, str(temporary), None)
        if _content(temporary) != digest:
            raise ValueError("what it sent is not the file it should be")


def _content(path: Path) -> str:
    """The SHA-256 of what a gzipped file unpacks to; of nothing if it is damaged."""
    digest = hashlib.sha256()
    try:
        with gzip.open(path) as file:
            while piece := file.read(PIECE):
                digest.update(piece)
    except (OSError, EOFError, zlib.error):
        return ""
    return digest.hexdigest()
