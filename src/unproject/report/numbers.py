"""Numbers for the scripts of the page: arrays in base64, and JSON that cannot end its element."""

from __future__ import annotations

import base64
import json
from typing import Any

import numpy as np


def encoded(values: Any, kind: Any) -> str:
    """Return values rounded and clipped to an integer type, little-endian, in base64."""
    info = np.iinfo(kind)
    whole = np.clip(np.rint(np.asarray(values, np.float64)), info.min, info.max)
    return base64.b64encode(whole.astype(np.dtype(kind).newbyteorder("<")).tobytes()).decode()


def json_inside_html(value: Any) -> str:
    """Return JSON that may stand inside <script>: `<`, `>` and `&` are escaped, so that no tag can begin or end there.

    Examples:
        >>> json_inside_html("</script>")
        '"\\\\u003c/script\\\\u003e"'
    """
    text = json.dumps(value, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
