"""Event files: the log of a run as TensorBoard reads it.

A file is a series of records: the length of the content (uint64), its masked checksum, the content, and the content's
masked checksum (little-endian), where

    masked(c) = ((c >> 15 | c << 17) + 0xa282ead8) mod 2³²,   c the CRC-32C of the bytes.

The content is a protocol buffer, `Event(wall_time=1: double, step=2: int64, file_version=3: string, summary=5)`, its
summary a list of `Value(tag=1: string, simple_value=2: float)`. Written here, it needs no further package.

References:
    tensorflow/core/lib/io/record_writer.h, tensorflow/core/util/event.proto.
"""

from __future__ import annotations

import math
import struct
import time
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, BinaryIO

FOLDER = "tensorboard"
NAME = "events.out.tfevents.0.unproject"
VERSION = b"brain.Event:2"


@cache
def _table() -> tuple[int, ...]:
    def entry(c: int) -> int:
        for _ in range(8):
            c = c >> 1 ^ (0x82F63B78 if c & 1 else 0)
        return c

    return tuple(map(entry, range(256)))


def crc32c(content: bytes) -> int:
    """Return the CRC-32C (Castagnoli).

    Examples:
        >>> hex(crc32c(b"123456789"))
        '0xe3069283'
    """
    c, table = 0xFFFFFFFF, _table()
    for byte in content:
        c = table[(c ^ byte) & 255] ^ c >> 8
    return c ^ 0xFFFFFFFF


def _masked(content: bytes) -> bytes:
    c = crc32c(content)
    return struct.pack("<I", ((c >> 15 | c << 17) + 0xA282EAD8) & 0xFFFFFFFF)


def record(content: bytes) -> bytes:
    """Return a record."""
    length = struct.pack("<Q", len(content))
    return length + _masked(length) + content + _masked(content)


def _varint(value: int) -> bytes:
    parts = []
    while value > 127:
        parts.append(value & 127 | 128)
        value >>= 7
    return bytes([*parts, value])


def _bytes(field: int, content: bytes) -> bytes:
    return _varint(field << 3 | 2) + _varint(len(content)) + content


def event(wall_time: float, step: int, scalars: Mapping[str, float]) -> bytes:
    """Return an event with these values at a step."""
    values = (_bytes(1, tag.encode()) + b"\x15" + struct.pack("<f", value) for tag, value in scalars.items())
    summary = b"".join(_bytes(1, value) for value in values)
    return b"\x09" + struct.pack("<d", wall_time) + b"\x10" + _varint(step) + _bytes(5, summary)


def scalars_of(line: Mapping[str, Any]) -> dict[str, float]:
    """Return what is drawn of a line of stats.jsonl: its numbers, by the event's name if it is one.

    Examples:
        >>> scalars_of({"step": 3, "seconds": 1.5, "event": "assigned", "loss": 0.5, "views": [1, 2]})
        {'seconds': 1.5, 'assigned/loss': 0.5}
    """
    prefix = f"{line['event']}/" if "event" in line else ""
    fits = {name: v for name, v in line.items() if isinstance(v, (int, float)) and not isinstance(v, bool)}
    named = {name if name == "seconds" else prefix + name: v for name, v in fits.items() if name != "step"}
    return {name: float(v) for name, v in named.items() if math.isfinite(v)}


class EventFile:
    """The event file of a run, made anew when a training begins or goes on: it then holds what stats.jsonl holds.

    Args:
        path: the run directory.
        lines: of stats.jsonl so far.
    """

    def __init__(self, path: Path, lines: Sequence[Mapping[str, Any]]) -> None:
        (path / FOLDER).mkdir(exist_ok=True)
        self.began = time.time() - max((line["seconds"] for line in lines), default=0.0)
        self.stream: BinaryIO = (path / FOLDER / NAME).open("wb")
        self.stream.write(record(b"\x09" + struct.pack("<d", self.began) + _bytes(3, VERSION)))
        for line in lines:
            self.write(line)
        self.stream.flush()

    def write(self, line: Mapping[str, Any]) -> None:
        """Append a line of stats.jsonl."""
        self.stream.write(record(event(self.began + line["seconds"], line["step"], scalars_of(line))))
        self.stream.flush()

    def close(self) -> None:
        self.stream.close()
