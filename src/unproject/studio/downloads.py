"""Downloads: what an exporter writes, as one file: several are packed into a .zip."""

from __future__ import annotations

import io
import re
import tempfile
import zipfile
from pathlib import Path
from urllib.parse import quote

from torch import Tensor

from .. import export
from .._types import UserError
from ..domains import Domain
from .answers import Answer


def exported(domain: Domain, x: Tensor, to: str, name: str) -> Answer:
    """Answer with samples (N, ...) in a format of their domain.

    Raises:
        UserError: if it has no such format, or nothing is to be seen of the samples.
    """
    if to not in domain.exporters:
        raise UserError(f"to={to[:40]}: there is no such format; choose from {', '.join(domain.exporters)}")
    if bool(domain.empty(x).all()):
        raise UserError("nothing is to be seen of this one, so that it has no file; choose another")
    name = plain(name)
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / (name if to in export.MATERIAL_FORMATS else f"{name}.{to}")
        domain.write(x, to, target)
        return _packed(Path(folder), name)


def _packed(folder: Path, name: str) -> Answer:
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    if len(files) == 1:
        return attachment(files[0].read_bytes(), name + files[0].suffix)
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in files:
            archive.write(file, file.relative_to(folder))
    return attachment(content.getvalue(), f"{name}.zip")


def attachment(content: bytes, name: str) -> Answer:
    """Answer with a file that the browser stores: whatever is in it, it is never shown as a page."""
    name = plain(name)
    latin = name.encode("ascii", "replace").decode().replace("?", "_")
    further = "" if name.isascii() else f"; filename*=UTF-8''{quote(name)}"  # RFC 6266
    headers = {"Content-Disposition": f'attachment; filename="{latin}"{further}'}
    return Answer(content, "application/octet-stream", headers=headers)


def plain(name: str) -> str:
    """Return a name that every system takes, and that ends no line of a header.

    Examples:
        >>> plain('../a "chair"')
        'a-chair'
        >>> plain("椅子 1")
        '椅子-1'
    """
    return re.sub(r"[^\w.-]+", "-", name).strip("-.") or "sample"
