"""How `tools/fuzz.py` damages files: bytes anywhere, and what formats hold, with lengths and sums made to fit again.

A mutation is a function (content, rng) → content. Those of a format take a container apart, mutate what is in it, and
put it together so that it is read further than its first checksum.
"""

from __future__ import annotations

import gzip
import io
import json
import re
import struct
import zipfile
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np

Rng = np.random.Generator
Mutation = Callable[[bytes, Rng], bytes]

INTEGERS = (0, 1, 2, 127, 128, 255, 256, 2**15, 2**16 - 1, 2**16, 2**24, 2**31 - 1, 2**31, 2**32 - 1)
TOKENS = (
    "nan", "inf", "-inf", "1e999", "-1", "0", "1", "1e38", "1e-320", "99999999999", "9223372036854775808", "", "a", "1/0",
    "0x10", "\u00e9", "\x00", "\x1b[31m", "1 2", "1//", "-0", "3000", "70000", "../x", "%s", '"', "\n", "1" * 5000,
)  # fmt: skip
VALUES: tuple[Any, ...] = (
    None, True, False, 0, 1, -1, 3, 2**31, 2**63, 2**63 - 1, -(2**63), 10**30, 10**400, 0.5, 1e308, -1e308, 1e-320,
    float("nan"), float("inf"), float("-inf"), "", "x", "nan", "unproject.training.run:load", "os:system", "\x00", "\x1b[0m",
    "\ud800", "x" * 5000, [], {}, [[]], [1, 2], ["x"], {"a": 1}, {"path": "x"}, {"path": "/dev/zero"}, {"call": 1},
)  # fmt: skip


def of(rng: Rng, options: Any) -> Any:
    return options[int(rng.integers(len(options)))]


# Bytes


def flip(data: bytes, rng: Rng) -> bytes:
    """Some bits are others: one, or up to one byte in fifty."""
    changed = bytearray(data)
    for _ in range(int(rng.integers(1, 2 + len(data) // int(of(rng, (50, 500, 5000)))))):
        changed[int(rng.integers(len(data)))] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def number(data: bytes, rng: Rng) -> bytes:
    """A length, most often near the beginning, is another: one, two, four or eight bytes of either order."""
    size, order = of(rng, "BHIQ"), of(rng, "<>")
    reach = max(1, min(len(data), int(of(rng, (32, 128, 512, len(data))))))
    packed = struct.pack(order + size, int(of(rng, INTEGERS)) % 2 ** (8 * struct.calcsize(size)))
    at = int(rng.integers(reach))
    return data[:at] + packed + data[at + len(packed) :]


def cut(data: bytes, rng: Rng) -> bytes:
    return data[: int(rng.integers(len(data)))]


def insert(data: bytes, rng: Rng) -> bytes:
    at = int(rng.integers(len(data) + 1))
    return data[:at] + rng.bytes(int(rng.integers(1, 65))) + data[at:]


def drop(data: bytes, rng: Rng) -> bytes:
    at = int(rng.integers(len(data)))
    return data[:at] + data[at + int(rng.integers(1, 65)) :]


def repeat(data: bytes, rng: Rng) -> bytes:
    start, end = sorted(rng.integers(len(data) + 1, size=2))
    return data[:end] + data[start:end] * int(of(rng, (1, 2, 20) if end - start < 4096 else (1,))) + data[end:]


def noise(data: bytes, rng: Rng) -> bytes:
    return of(rng, (b"", b"\0" * 64, rng.bytes(200), data[:12] + rng.bytes(100), b"\xff" * 4096, b"{}", b"\n"))


BYTES: tuple[Mutation, ...] = (flip, flip, number, number, cut, insert, drop, repeat)


def bytewise(data: bytes, rng: Rng) -> bytes:
    """One to three of the above."""
    if rng.random() < 0.03:
        return noise(data, rng)
    for _ in range(int(rng.integers(1, 4))):
        data = of(rng, BYTES)(data, rng) if data else data
    return data


# Text


def tokens(data: bytes, rng: Rng) -> bytes:
    """Numbers and words are others."""
    text = data.decode("latin-1")
    found = list(re.finditer(r"[-+.\w]+", text[:200_000]))
    if not found:
        return data
    near = found[: int(of(rng, (12, len(found))))]
    for match in sorted({of(rng, near) for _ in range(int(rng.integers(1, 4)))}, key=re.Match.start, reverse=True):
        text = text[: match.start()] + of(rng, TOKENS) + text[match.end() :]
    return text.encode("utf-8", "surrogatepass")


def lines(data: bytes, rng: Rng) -> bytes:
    """A line is missing, there twice, elsewhere, or cut."""
    rows = data.split(b"\n")
    at = int(rng.integers(min(len(rows), int(of(rng, (8, len(rows)))))))
    what = int(rng.integers(4))
    row = rows.pop(at)
    if what == 1:
        rows[at:at] = [row] * int(of(rng, (2, 3, 100)))
    elif what == 2:
        rows.insert(int(rng.integers(len(rows) + 1)), row)
    elif what == 3:
        rows.insert(at, row[: int(rng.integers(len(row) + 1))])
    return b"\n".join(rows)


def textual(data: bytes, rng: Rng) -> bytes:
    return of(rng, (tokens, tokens, tokens, lines, bytewise))(data, rng)


# JSON


def parts_of(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The paths of all values within a JSON value."""
    children = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [path, *(found for key, child in children for found in parts_of(child, (*path, key)))]


def changed(value: Any, rng: Rng, values: tuple[Any, ...] = VALUES) -> Any:
    """A copy with one part replaced, removed, renamed or repeated."""
    value = json.loads(json.dumps(value))
    path = of(rng, parts_of(value))
    if not path:
        return of(rng, values)
    parent = value
    for key in path[:-1]:
        parent = parent[key]
    what, key = int(rng.integers(8)), path[-1]
    if what == 0:
        del parent[key]
    elif what == 1 and isinstance(parent, dict):
        parent[of(rng, ("", "x", "type", "call", f"{key}x", "0"))] = parent.pop(key)
    elif what == 2:
        parent[key] = [parent[key]] * int(of(rng, (1, 2, 300)))
    else:
        parent[key] = of(rng, values)
    return value


def structured(data: bytes, rng: Rng) -> bytes:
    """JSON with one to three parts changed; at times nested very deep, or no JSON."""
    chance = rng.random()
    if chance < 0.15:
        return textual(data, rng)
    if chance < 0.2:
        return deep(data, rng)
    value = json.loads(data)
    for _ in range(int(rng.integers(1, 4))):
        value = changed(value, rng)
    return json.dumps(value).encode()


def deep(data: bytes, rng: Rng) -> bytes:
    """A number becomes a list of lists of lists."""
    many = int(of(rng, (50, 990, 5000, 200_000)))
    nested = b"[" * many + b"]" * many if rng.random() < 0.5 else b'{"a":' * many + b"1" + b"}" * many
    found = list(re.finditer(rb"(?<=: )[-\d.]+", data))
    if not found:
        return nested
    match = of(rng, found)
    return data[: match.start()] + nested + data[match.end() :]


def json_lines(data: bytes, rng: Rng) -> bytes:
    """Lines of JSON, of which one is changed."""
    rows = data.split(b"\n")
    at = int(rng.integers(len(rows)))
    rows[at] = structured(rows[at], rng) if rows[at] else bytewise(b'{"step": 1}', rng)
    return b"\n".join(rows) if rng.random() < 0.8 else lines(data, rng)


# Containers


def gzipped(inner: Mutation) -> Mutation:
    def mutation(data: bytes, rng: Rng) -> bytes:
        return gzip.compress(inner(gzip.decompress(data), rng), 1) if rng.random() < 0.8 else bytewise(data, rng)

    return mutation


DTYPES = (
    "|u1",
    "|b1",
    "|i1",
    "<u2",
    ">i4",
    "<i8",
    "<f2",
    "<f4",
    ">f8",
    "<f16",
    "<c8",
    "|S3",
    "<U2",
    "|O",
    "|V8",
    "<M8[s]",
    "|x9",
)
SHAPES = (
    (), (0,), (1,), (3,), (2, 0, 4), (4, 16, 16), (4, 1, 16, 16), (4, 16, 16, 3), (1, 3, 1, 1), (2, 16, 16, 16), (2, 8, 4, 4), (1,) * 8,
    (1,) * 40, (2**31,), (2**40, 1, 1), (2**63, 2), (-1, 16, 16), (100_000, 1, 1), (1, 100_000, 1), (1, 1, 100_000), (3, 40_000, 2),
)  # fmt: skip


def npy_bytes(shape: tuple[int, ...], kind: str, content: bytes, fortran: bool = False) -> bytes:
    """An array file whose header says anything."""
    text = f"{{'descr': {kind!r}, 'fortran_order': {fortran}, 'shape': {shape!r}, }}"
    text += " " * (-(len(text) + 11) % 64) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode() + content


def numbers_of(array: np.ndarray, rng: Rng) -> np.ndarray:
    """Some numbers are NaN, infinite, huge, negative or denormal."""
    flat = array.astype(np.float32).ravel()
    for _ in range(int(rng.integers(1, 4))):
        flat[int(rng.integers(max(1, len(flat)))) :][: int(of(rng, (1, 5, len(flat))))] = of(
            rng, (np.nan, np.inf, -np.inf, 1e38, -1, 2, 1e-40, 0, 1, 255, 70_000)
        )
    return flat.reshape(array.shape)


def array(data: bytes, rng: Rng) -> bytes:
    """An array file (.npy) of another shape, type, header or content."""
    chance = rng.random()
    if chance < 0.2:
        return bytewise(data, rng)
    if chance < 0.3:
        size = 10 + struct.unpack("<H", data[8:10])[0]
        text = tokens(data[10:size], rng)[: 2**16 - 1]
        return data[:8] + struct.pack("<H", len(text)) + text + data[size:]
    try:
        value = np.load(io.BytesIO(data), allow_pickle=False)
    except Exception:  # mutated before
        return bytewise(data, rng)
    if chance < 0.5 and value.dtype.kind in "fiu":
        return saved(numbers_of(value, rng))
    if chance < 0.65:
        kind = of(rng, DTYPES)
        return npy_bytes(value.shape, kind, rng.bytes(min(value.size * 8, 10**6)), bool(rng.integers(2)))
    if chance < 0.8:
        return npy_bytes(of(rng, SHAPES), value.dtype.str, value.tobytes(), bool(rng.integers(2)))
    shape = of(
        rng, [shape for shape in SHAPES if abs(np.prod(shape, dtype=float)) < 10**6 and min(shape, default=0) >= 0]
    )
    return saved(np.resize(value, shape) if value.size else np.zeros(shape))


def saved(value: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.save(stream, value, allow_pickle=False)
    return stream.getvalue()


NAMES = (
    "volume",
    "image",
    "masks",
    "lines",
    "sinograms",
    "azimuth",
    "angle",
    "shape",
    "X_train",
    "names",
    "skipped",
    "normal",
    "fresnel",
)


def zipped(data: bytes, rng: Rng) -> bytes:
    """An archive of arrays (.npz) in which one is mutated, missing, renamed, there twice or added."""
    if rng.random() < 0.2:
        return bytewise(data, rng)
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = [(name, archive.read(name)) for name in archive.namelist()]
    for _ in range(int(rng.integers(1, 3))):
        members = changed_members(members, rng)
    stream, kind = io.BytesIO(), int(of(rng, (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)))
    import warnings

    with warnings.catch_warnings(), zipfile.ZipFile(stream, "w", kind) as archive:
        warnings.simplefilter("ignore")  # names that are there twice
        for name, content in members:
            archive.writestr(name or " ", content)  # zipfile writes no name that is empty
    return stream.getvalue()


def changed_members(members: list[tuple[str, bytes]], rng: Rng) -> list[tuple[str, bytes]]:
    if not members:
        return [("x.npy", saved(np.zeros((2, 2))))]
    at, what = int(rng.integers(len(members))), int(rng.integers(10))
    name, content = members[at]
    if what == 0:
        return members[:at] + members[at + 1 :]
    if what == 1:
        renamed = of(
            rng, [*(f"{n}.npy" for n in NAMES), "x", "", "../x.npy", "a/b.npy", "\x1b.npy", "x" * 300 + ".npy"]
        )
        return [*members[:at], (renamed, content), *members[at + 1 :]]
    if what == 2:
        return [*members, (f"{of(rng, NAMES)}.npy", array(of(rng, members)[1], rng))]
    return [*members[:at], (name, array(content, rng)), *members[at + 1 :]]


def png(data: bytes, rng: Rng) -> bytes:
    """A PNG with one chunk changed, missing, twice or elsewhere, its sums right."""
    if rng.random() < 0.3:
        return bytewise(data, rng)
    chunks, at = [], 8
    while at + 12 <= len(data):
        (size,) = struct.unpack(">I", data[at : at + 4])
        chunks.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + size]))
        at += 12 + size
    k, what = int(rng.integers(len(chunks))), int(rng.integers(8))
    kind, body = chunks[k]
    if what == 0:
        chunks.pop(k)
    elif what == 1:
        chunks.insert(int(rng.integers(len(chunks))), (kind, body))
    elif what == 2:
        added = of(
            rng, (b"tRNS", b"PLTE", b"gAMA", b"eXIf", b"iCCP", b"zTXt", b"acTL", b"fcTL", b"IDAT", b"cHRM", b"pHYs")
        )
        chunks.insert(int(rng.integers(len(chunks))), (added, rng.bytes(int(rng.integers(64)))))
    elif kind == b"IDAT" and what < 6:
        chunks[k] = (kind, zlib.compress(bytewise(zlib.decompress(body), rng)))
    elif body:
        chunks[k] = (kind, bytewise(body, rng))
    made = (struct.pack(">I", len(b)) + k + b + struct.pack(">I", zlib.crc32(k + b)) for k, b in chunks)
    return data[:8] + b"".join(made)


def glb(data: bytes, rng: Rng) -> bytes:
    """A binary glTF whose JSON is changed, or its numbers, its lengths right."""
    if rng.random() < 0.3:
        return bytewise(data, rng)
    (size,) = struct.unpack("<I", data[12:16])
    text, rest = data[20 : 20 + size], data[20 + size :]
    if rng.random() < 0.7:
        text = structured(text, rng)
    else:
        rest = rest[:8] + bytewise(rest[8:], rng)
        rest = struct.pack("<I", len(rest) - 8) + rest[4:]
    text += b" " * (-len(text) % 4)
    return data[:8] + struct.pack("<II", 20 + len(text) + len(rest), len(text)) + data[16:20] + text + rest


WEIGHTS = ("F64", "F32", "F16", "BF16", "I64", "I32", "U8", "BOOL", "F8_E4M3", "C64", "X")


def weights(data: bytes, rng: Rng) -> bytes:
    """A safetensors file in which a tensor is of another shape, type, name or place, missing, or holds odd numbers."""
    chance = rng.random()
    if chance < 0.1:
        return bytewise(data, rng)
    (size,) = struct.unpack("<Q", data[:8])
    header, content = json.loads(data[8 : 8 + size]), bytearray(data[8 + size :])
    names = [name for name in header if name != "__metadata__"]
    odd = [name for name in names if name.startswith(("counters/", "panels/"))]
    name = of(rng, odd if odd and rng.random() < 0.4 else names)
    if chance < 0.45:
        planted(header[name], content, rng)
    elif chance < 0.85:
        header = differently_named(header, name, rng)
    else:
        header = changed(header, rng)
    text = json.dumps(header).encode()
    return struct.pack("<Q", len(text)) + text + bytes(content)


def planted(entry: Any, content: bytearray, rng: Rng) -> None:
    """Write odd numbers into a tensor."""
    kind = {"F64": "<f8", "F32": "<f4", "F16": "<f2", "I64": "<i8", "I32": "<i4"}.get(entry["dtype"], "|u1")
    start, end = entry["data_offsets"]
    if end - start < np.dtype(kind).itemsize:
        return
    values = np.frombuffer(content, kind, (end - start) // np.dtype(kind).itemsize, start)
    some = values[int(rng.integers(len(values))) :][: int(of(rng, (1, 3, len(values))))]
    odd = (np.nan, np.inf, -np.inf, 1e300, 1e19, -1, 0, 0.5, 1e9, 1e-320) if kind[1] == "f" else (-1, 0, 127, 5)
    with np.errstate(all="ignore"):
        some[...] = np.asarray(of(rng, odd)).astype(kind)


def differently_named(header: dict[str, Any], name: str, rng: Rng) -> dict[str, Any]:
    """Remove, rename, copy, retype or reshape a tensor; its bytes stay where they are unless the format forbids it."""
    entry, what = header[name], int(rng.integers(6))
    size, (start, end) = int(np.prod(entry["shape"])), entry["data_offsets"]
    if what == 0:
        empty = {"dtype": "U8", "shape": [end - start], "data_offsets": [start, end]}
        return {n: e for n, e in header.items() if n != name} | {"unused": empty}
    if what <= 2:
        first, _, last = name.rpartition("/")
        prefixes = ("", "generator/", "average/", "panels/0/assignment/", "generator_optimiser/", "counters/", "kept/")
        odd = (
            f"{first}/{last}x",
            f"{first}/x/y",
            "x",
            "",
            f"{of(rng, prefixes)}{last}",
            f"{of(rng, prefixes)}9/step",
            "\x1b",
            f"{name}/",
        )
        return {(of(rng, odd) if n == name else n): e for n, e in header.items()}
    if what == 3:
        sizes = {"F64": 8, "F32": 4, "F16": 2, "BF16": 2, "I64": 8, "I32": 4, "U8": 1, "BOOL": 1}
        kind = of(rng, WEIGHTS)
        count = (end - start) // sizes.get(kind, 4)
        return header | {name: {**entry, "dtype": kind, "shape": [count]}}
    shape = of(rng, ([size], [1, size], [size, 1], [1] * 3 + [size], [1] * 70 + [size], [], [-1], [2**40, 2**40]))
    return header | {name: {**entry, "shape": shape}}


def by_content(data: bytes, rng: Rng) -> bytes:
    """Whatever suits the first byte."""
    kinds: dict[bytes, Mutation] = {b"{": structured, b"P": zipped}
    return kinds.get(data[:1], bytewise)(data, rng)
