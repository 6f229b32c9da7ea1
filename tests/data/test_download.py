"""Getting a public collection: from a server that breaks off, lies, or is not there."""

from __future__ import annotations

import gzip
import hashlib
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from unproject._types import UserError
from unproject.cli import main
from unproject.data import download, get
from unproject.data.download import PublicCollection

CONTENT = {name: bytes(range(256)) * 40 + name.encode() for name in ("images.gz", "labels.gz")}
PACKED = {name: gzip.compress(content, mtime=0) for name, content in CONTENT.items()}


class Server(ThreadingHTTPServer):
    """Serves PACKED; keeps what was asked; may break off or send something else."""

    def __init__(self) -> None:
        self.asked: list[str] = []
        self.cut, self.lie = False, False
        super().__init__(("127.0.0.1", 0), Handler)

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.server_address[1]}/"


class Handler(BaseHTTPRequestHandler):
    server: Server

    def do_GET(self) -> None:
        name = self.path.strip("/")
        self.server.asked.append(name)
        body = gzip.compress(b"a page that says sorry") if self.server.lie else PACKED[name]
        self.send_response(200)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body[:50] if self.server.cut else body)

    def log_message(self, format: str, *args: object) -> None: ...


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[Server]:
    with Server() as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        digests = {name: hashlib.sha256(content).hexdigest() for name, content in CONTENT.items()}
        monkeypatch.setitem(download.PUBLIC, "mnist", PublicCollection((server.address,), digests, ""))
        yield server
        server.shutdown()
        thread.join()


def is_whole(folder: Path) -> bool:
    return {path.name: path.read_bytes() for path in folder.iterdir()} == PACKED


def test_files_come_once(server: Server, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["data", "get", "mnist", "--out", str(tmp_path / "new")]) == 0
    assert is_whole(tmp_path / "new") and capsys.readouterr().out.count("checked") == 2
    assert main(["data", "get", "mnist", "--out", str(tmp_path / "new")]) == 0
    assert server.asked == list(PACKED) and capsys.readouterr().out.count("already") == 2


def test_a_download_that_broke_off_leaves_nothing_and_works_the_next_time(server: Server, tmp_path: Path) -> None:
    server.cut = True
    with pytest.raises(UserError, match="could not be fetched .*50 bytes read.*; check the network and try again"):
        get("mnist", tmp_path)
    assert not list(tmp_path.iterdir())
    server.cut = False
    get("mnist", tmp_path)
    assert is_whole(tmp_path)


def test_the_next_mirror_is_tried(server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    known = download.PUBLIC["mnist"]
    deaf = PublicCollection(("http://127.0.0.1:9/", *known.mirrors), known.files, "")
    monkeypatch.setitem(download.PUBLIC, "mnist", deaf)
    get("mnist", tmp_path)
    assert is_whole(tmp_path)


def test_a_mirror_may_pack_again(server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(PACKED, "images.gz", gzip.compress(CONTENT["images.gz"], 1, mtime=99))
    get("mnist", tmp_path)
    assert is_whole(tmp_path)


def test_what_is_not_the_file_never_gets_its_name(server: Server, tmp_path: Path) -> None:
    server.lie = True
    with pytest.raises(UserError, match="not the file it should be"):
        get("mnist", tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_damaged_file_is_fetched_again(server: Server, tmp_path: Path) -> None:
    (tmp_path / "images.gz").write_bytes(PACKED["images.gz"][:-9])
    (tmp_path / "labels.gz").write_bytes(b"nothing of the kind")
    get("mnist", tmp_path)
    assert is_whole(tmp_path)


def test_without_a_network(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Port 9 of this machine: nobody listens there."""
    monkeypatch.setenv("UNPROJECT_MIRROR", "http://127.0.0.1:9/")
    assert main(["data", "get", "mnist", "--out", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert error.startswith("unproject: ") and error.count("\n") == 1 and "check the network" in error
    assert not list(tmp_path.iterdir())


def test_an_address_that_is_none(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="Invalid URL 'nowhere/"):
        get("mnist", tmp_path, "nowhere")


def test_an_unknown_collection(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="choose mnist"):
        get("minst", tmp_path / "new")
    assert not list(tmp_path.iterdir())
