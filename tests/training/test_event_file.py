"""Event files hold what stats.jsonl holds, in the form that TensorBoard reads: read back here by the format's rules."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from unproject.cli import main
from unproject.training.event_file import FOLDER, NAME, crc32c, event, scalars_of

TOY = f"{Path(__file__).parent / 'toy.py'}:toy"


def checked(content: bytes, masked: bytes) -> bytes:
    c = (struct.unpack("<I", masked)[0] - 0xA282EAD8) & 0xFFFFFFFF
    assert crc32c(content) == (c >> 17 | c << 15) & 0xFFFFFFFF
    return content


def records(content: bytes) -> Iterator[bytes]:
    while content:
        (length,) = struct.unpack("<Q", checked(content[:8], content[8:12]))
        yield checked(content[12 : 12 + length], content[12 + length : 16 + length])
        content = content[16 + length :]


def fields(content: bytes) -> Iterator[tuple[int, Any]]:
    """The fields of a protocol buffer: number, value."""
    at = 0

    def varint() -> int:
        nonlocal at
        value = shift = 0
        while True:
            byte = content[at]
            at += 1
            value |= (byte & 127) << shift
            if byte < 128:
                return value
            shift += 7

    while at < len(content):
        number, kind = divmod(varint(), 8)
        if kind == 0:
            yield number, varint()
            continue
        size = {1: 8, 5: 4}.get(kind) or varint()
        found = content[at : at + size]
        at += size
        yield number, struct.unpack("<d" if kind == 1 else "<f", found)[0] if kind in (1, 5) else found


def read(file: Path) -> list[tuple[int, dict[str, float]]]:
    events = [dict(fields(part)) for part in records(file.read_bytes())]
    assert events[0][3] == b"brain.Event:2"
    return [
        (one[2], {v[1].decode(): v[2] for v in (dict(fields(value)) for _, value in fields(one[5]))})
        for one in events[1:]
    ]


def assert_as_logged(run: Path) -> None:
    lines = [json.loads(line) for line in (run / "stats.jsonl").read_text().splitlines()]
    found = read(run / FOLDER / NAME)
    assert [step for step, _ in found] == [line["step"] for line in lines]
    for (_, values), line in zip(found, lines, strict=True):
        assert values == pytest.approx(scalars_of(line), rel=1e-6)


def test_an_event_file_holds_the_log_of_a_run_that_was_resumed_too(tmp_path: Path) -> None:
    run = tmp_path / "run"
    words = ["--views", "known", "--quiet", "--log", "tensorboard"]
    assert main(["train", TOY, *words, "--steps", "25", "--out", str(run)]) == 0
    assert_as_logged(run)
    before = len(read(run / FOLDER / NAME))
    assert main(["resume", str(run), "--steps", "50", "--quiet", "--trust"]) == 0
    assert_as_logged(run)
    assert len(read(run / FOLDER / NAME)) > before > 0


def test_an_event_file_may_be_asked_for_when_a_run_is_resumed(tmp_path: Path) -> None:
    run = tmp_path / "run"
    assert main(["train", TOY, "--views", "known", "--quiet", "--steps", "5", "--out", str(run)]) == 0
    assert main(["resume", str(run), "--steps", "10", "--quiet", "--trust", "--log", "tensorboard"]) == 0
    assert_as_logged(run)


def test_without_the_flag_there_is_no_event_file(tmp_path: Path) -> None:
    assert main(["train", TOY, "--views", "known", "--quiet", "--steps", "1", "--out", str(tmp_path / "run")]) == 0
    assert not (tmp_path / "run" / FOLDER).exists()


def test_another_log_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["train", TOY, "--log", "wandb", "--out", str(tmp_path / "run")]) == 2
    assert "tensorboard" in capsys.readouterr().err


def test_the_checksum_is_that_of_the_standard() -> None:
    assert crc32c(bytes(32)) == 0x8A9136AA  # RFC 3720, B.4
    assert crc32c(bytes(range(32))) == 0x46DD794E


def test_numbers_that_are_none_are_left_out() -> None:
    assert scalars_of({"step": 1, "seconds": 2, "a": float("nan"), "b": True, "c": [1]}) == {"seconds": 2.0}
    assert dict(fields(event(1.0, 300, {})))[2] == 300
