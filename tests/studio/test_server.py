"""The studio's server: closed to others, reads nothing but runs, bounded, and says what is wrong with a run."""

from __future__ import annotations

import http.client
import json
import os
import shutil
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest

from unproject._types import UserError
from unproject.cli import main
from unproject.report import write_report
from unproject.report.contents import read_contents
from unproject.report.sections import curves_section
from unproject.studio import Studio
from unproject.studio.answers import Busy
from unproject.studio.guard import Guard
from unproject.studio.server import MAX_REQUEST_BYTES
from unproject.studio.state import State
from unproject.studio.worker import Worker
from unproject.training import lock

Said = Callable[..., tuple[int, dict[str, Any]]]
TOY = f"{Path(__file__).parents[1] / 'training' / 'toy.py'}:toy"


@contextmanager
def served(folder: Path, host: str = "127.0.0.1") -> Iterator[Studio]:
    with Studio(folder, host, 0) as studio:
        thread = threading.Thread(target=studio.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            yield studio
        finally:  # or a test that fails would never end
            studio.shutdown()
            thread.join()


def ask(studio: Studio, path: str, method: str = "GET", body: bytes | None = None, **headers: str) -> Any:
    """(status, headers, content) of a request, with the token."""
    connection = http.client.HTTPConnection("127.0.0.1", studio.server_address[1], timeout=60)
    headers = {"Cookie": f"{studio.guard.cookie}={studio.guard.token}", **headers}
    connection.request(method, path, body, {name.replace("_", "-"): value for name, value in headers.items()})
    answer = connection.getresponse()
    content = answer.read()
    connection.close()
    return answer.status, dict(answer.getheaders()), content


# The list, and a run


def test_the_list_tells_of_each_run(runs: Path, said: Said) -> None:
    status, found = said(State(runs), "/api/runs")
    (run,) = found["runs"]
    assert status == 200
    assert (run["name"], run["step"], run["complete"], run["kind"]) == ("toy", 2, True, "volumes")


def test_a_run_is_shown_with_the_sections_of_its_report(runs: Path, said: Said) -> None:
    _, run = said(State(runs), "/api/run", run="toy")
    assert "unproject resume" in run["sections"]["commands"]
    assert run["training"] is False


def test_a_run_counts_as_training_while_a_process_holds_it(
    runs: Path, said: Said, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = Path(shutil.copytree(runs, tmp_path / "runs"))
    (folder / "toy" / "verdict.json").unlink(missing_ok=True)
    recipe = folder / "toy" / "recipe.json"
    recipe.write_text(recipe.read_text().replace('"steps": 2', '"steps": 5'))
    state = State(folder)
    with lock.locked(folder / "toy"):
        assert said(state, "/api/runs")[1]["runs"][0]["training"] is (lock.fcntl is not None)
        assert lock.is_locked(folder / "toy") in (True, None)
    with lock.locked(folder / "toy"):  # looking did not keep it
        pass
    assert said(state, "/api/run", run="toy")[1]["training"] is (lock.fcntl is None)
    monkeypatch.setattr(lock, "fcntl", None)  # without locks, a log that grew a moment ago
    assert said(state, "/api/newest", run="toy")[1]["training"] is True


def test_the_folder_may_be_a_run(runs: Path, said: Said) -> None:
    _, found = said(State(runs / "toy"), "/api/runs")
    assert [run["name"] for run in found["runs"]] == ["."]
    assert said(State(runs / "toy"), "/api/run", run=".")[0] == 200
    assert said(State(runs / "toy"), "/api/newest", run=".")[1]["title"] == "toy"


def test_what_is_there_already_is_not_sent_again(runs: Path) -> None:
    with served(runs) as studio:
        _, headers, _ = ask(studio, "/api/runs")
        status, _, content = ask(studio, "/api/runs", If_None_Match=headers["ETag"])
    assert (status, content) == (304, b"")


@pytest.mark.parametrize("path", ["/", "/assets/app.js", "/assets/studio.css", "/assets/report/shapes.js"])
def test_the_page_and_its_files_load_nothing_from_elsewhere(runs: Path, path: str) -> None:
    with served(runs) as studio:
        status, headers, content = ask(studio, path)
    assert status == 200
    assert headers["Content-Security-Policy"].startswith("default-src 'self'")
    assert b"http://" not in content and b"https://" not in content


# Others are kept out


FOREIGN = {
    "host of another site": {"Host": "evil.example"},
    "host with another port": {"Host": "127.0.0.1:1"},
    "origin of another site": {"Origin": "http://evil.example"},
    "origin null": {"Origin": "null"},
    "another site, by the browser": {"Sec_Fetch_Site": "cross-site"},
}


@pytest.mark.parametrize("headers", FOREIGN.values(), ids=list(FOREIGN))
@pytest.mark.parametrize("method", ["GET", "POST"])
def test_another_site_is_refused(runs: Path, headers: dict[str, str], method: str) -> None:
    with served(runs) as studio:
        status, _, content = ask(studio, "/api/runs", method, b"{}" if method == "POST" else None, **headers)
    assert status == 403
    assert b"toy" not in content


LINKS = {
    "a link in another site": {"Sec_Fetch_Site": "cross-site"},
    "a link on another port of this machine": {"Sec_Fetch_Site": "same-site"},
    "without the cookie": {"Cookie": ""},
    "with that of a studio before": {"Cookie": "unproject-studio-8600=before"},
}


@pytest.mark.parametrize("headers", LINKS.values(), ids=list(LINKS))
def test_a_link_may_lead_to_the_page_from_anywhere(runs: Path, headers: dict[str, str]) -> None:
    """It holds nothing of the runs, of which nothing is told."""
    headers = {"Sec_Fetch_Mode": "navigate", "Sec_Fetch_Dest": "document", **headers}
    with served(runs) as studio:
        for path in ("/", "/assets/app.js"):
            status, told, content = ask(studio, path, "GET", None, **headers)
            assert status == 200 and (b"<title>unproject studio" in content or b"hashchange" in content)
            assert "frame-ancestors 'none'" in told["Content-Security-Policy"]
        assert ask(studio, "/api/runs", "GET", None, **headers)[0] == 403
        assert ask(studio, "/", "POST", b"", **headers)[0] in (403, 404)
        assert ask(studio, "/", "GET", None, **{**headers, "Host": "evil.example"})[0] == 403


def test_a_port_that_is_forwarded_as_another_is_told_how_to_be_the_same(runs: Path) -> None:
    with served(runs) as studio:
        port = studio.port
        for host in ("localhost:9000", "127.0.0.1:9000", "[::1]:9000"):
            status, _, content = ask(studio, "/", Host=host)
            assert status == 403 and f"ssh -L {port}:localhost:{port} HOST".encode() in content
        assert b"ssh" not in ask(studio, "/", Host="localhost.evil.example:9000")[2]


def test_the_own_page_is_answered(runs: Path) -> None:
    with served(runs) as studio:
        own = f"http://127.0.0.1:{studio.server_address[1]}"
        assert ask(studio, "/api/runs", Origin=own, Sec_Fetch_Site="same-origin")[0] == 200
        assert studio.address.startswith(f"{own}/?token=")


@pytest.mark.parametrize("host", ["127.0.0.1", "0.0.0.0"])
def test_whoever_asks_needs_the_token(runs: Path, host: str) -> None:
    """On this machine too, where others may be logged in."""
    with served(runs, host) as studio:
        token = studio.address.partition("token=")[2]
        assert len(token) >= 32
        assert ask(studio, "/api/runs", Cookie="")[0] == 403
        assert "Set-Cookie" not in ask(studio, "/?token=wrong", Cookie="")[1]
        status, headers, _ = ask(studio, f"/?token={token}", Cookie="")
        assert (status, headers["Location"]) == (303, "/")
        cookie = headers["Set-Cookie"]
        assert "HttpOnly" in cookie and "SameSite=Strict" in cookie
        assert ask(studio, "/api/runs", Cookie=cookie.partition(";")[0])[0] == 200
        name = cookie.partition("=")[0]
        assert str(studio.server_address[1]) in name  # browsers send cookies to all ports of a host
        assert ask(studio, "/api/runs", Cookie=f"{name}=wrong")[0] == 403
        for other in ('settings={"theme":"dark"}', "a b=c d", "x[1]=y", "alone", f"{name}2=wrong"):  # of other programs
            assert ask(studio, "/api/runs", Cookie=f"{other}; {cookie.partition(';')[0]}")[0] == 200


@pytest.mark.parametrize("name", ["..", "../secret", "/etc", "toy/../../secret", "a\0b", "x" * 5000, "linked"])
def test_nothing_outside_the_folder_is_read(tmp_path: Path, name: str, said: Said) -> None:
    (tmp_path / "runs").mkdir()
    (tmp_path / "secret").mkdir()
    (tmp_path / "secret" / "recipe.json").write_text('{"recipe": "x", "arguments": {}, "resolved": {}}')
    (tmp_path / "runs" / "linked").symlink_to(tmp_path / "secret")
    state = State(tmp_path / "runs")
    assert said(state, "/api/runs")[1]["runs"] == []
    for path in ("/api/run", "/api/picture"):
        assert said(state, path, run=name)[0] == 404


def test_a_run_with_a_link_out_of_the_folder_is_refused(tmp_path: Path, said: Said) -> None:
    run = tmp_path / "runs" / "one"
    (run / "samples").mkdir(parents=True)
    (run / "recipe.json").write_text('{"recipe": "x", "arguments": {}, "resolved": {}}')
    (tmp_path / "secret.png").write_bytes(b"secret")
    (run / "samples" / "step-1.png").symlink_to(tmp_path / "secret.png")
    state = State(tmp_path / "runs")
    status, answer = said(state, "/api/picture", run="one")
    assert (status, answer["error"]) == (
        400,
        f"one: its samples/step-1.png is a link out of {tmp_path / 'runs'}; put a copy in its place",
    )
    assert "is a link out of" in said(state, "/api/runs")[1]["runs"][0]["said"]


@pytest.mark.parametrize("path", ["/assets/../server.py", "/assets/%2e%2e/server.py", "/etc/passwd", "/api/none"])
def test_no_other_file_is_served(runs: Path, path: str) -> None:
    with served(runs) as studio:
        assert ask(studio, path)[0] == 404


# Bounds


def test_what_is_sent_is_bounded(runs: Path) -> None:
    with served(runs) as studio:
        assert ask(studio, "/api/runs", "POST", b"", Content_Length=str(MAX_REQUEST_BYTES + 1))[0] == 413
        assert ask(studio, "/api/runs", "POST", b"0\r\n\r\n", Transfer_Encoding="chunked")[0] == 413
        assert ask(studio, "/api/runs", "POST", b"", Content_Length="9" * 5000)[0] == 413
        with socket.create_connection(studio.server_address[:2]) as raw:
            raw.sendall(b"GET http://[x/ HTTP/1.1\r\nHost: x\r\n\r\n")
            assert raw.recv(64).split()[1] == b"400"


def test_what_is_too_large_is_said_by_name_once_all_of_it_is_sent(runs: Path) -> None:
    """A connection that breaks while a browser sends is all that it would say."""
    with served(runs) as studio:
        status, headers, content = ask(
            studio, "/api/light?name=probe.exr", "POST", bytes(MAX_REQUEST_BYTES + 2_000_000)
        )
        assert (status, headers["Connection"]) == (413, "close")
        says = "probe.exr: is 42 MB; give at most 40 MB: a picture of fewer pixels, or light at 2K"
        assert json.loads(content) == {"error": says}
        status, _, content = ask(studio, "/api/light?name=probe.exr", "POST", bytes(9_000_000), Cookie="")
        assert status == 403 and b"the token is missing" in content
        assert ask(studio, "/api/runs")[0] == 200


def test_the_page_knows_the_limit() -> None:
    page = (files("unproject.studio") / "assets" / "app.js").read_text()
    assert f"const LIMIT = {MAX_REQUEST_BYTES};" in page


def test_no_more_calls_wait_than_the_queue_holds() -> None:
    worker, go = Worker(waiting=2), threading.Event()
    first = worker.submit(go.wait)
    while not first.running():
        time.sleep(0.001)
    waiting = [worker.submit(lambda: 1) for _ in range(2)]
    with pytest.raises(Busy):
        worker.submit(lambda: 1)
    go.set()
    assert [call.result() for call in waiting] == [1, 1]


# What is broken


def test_a_broken_run_says_so_and_hides_no_other(runs: Path, tmp_path: Path, said: Said) -> None:
    (tmp_path / "toy").mkdir()
    (tmp_path / "toy" / "recipe.json").write_text("{")
    (tmp_path / "log").mkdir()
    (tmp_path / "log" / "recipe.json").write_text((runs / "toy" / "recipe.json").read_text())
    state = State(tmp_path)
    by_name = {run["name"]: run for run in said(state, "/api/runs")[1]["runs"]}
    assert "damaged" in by_name["toy"]["said"]
    assert "There is no checkpoint yet" in by_name["log"]["unfinished"]
    assert said(state, "/api/run", run="toy")[0] == 400


BAD_RECIPES = {
    "steps of hundreds of digits": {"steps": 10**400},
    "panels that are a number": {"panels": 3},
    "an observation that is a number": {"panels": [{"observations": [7]}]},
    "observations that are a number": {"panels": [{"observations": 7}]},
    "an observation without projection": {"panels": [{"observations": [{"name": 1}]}]},
    "a projection that is a number": {"panels": [{"observations": [{"name": "a", "projection": 7}]}]},
}


@pytest.mark.parametrize("wrong", BAD_RECIPES.values(), ids=list(BAD_RECIPES))
def test_a_recipe_may_say_anything(runs: Path, tmp_path: Path, said: Said, wrong: dict[str, object]) -> None:
    shutil.copytree(runs / "toy", tmp_path / "wrong")
    recipe = json.loads((tmp_path / "wrong" / "recipe.json").read_text())
    (tmp_path / "wrong" / "recipe.json").write_text(json.dumps(recipe | {"resolved": {**recipe["resolved"], **wrong}}))
    for path in ("/api/runs", "/api/run", "/api/newest", "/api/kinds"):
        assert said(State(tmp_path), path, run="wrong")[0] == 200
    assert write_report(tmp_path / "wrong", data=False).is_file()


def test_a_run_that_cannot_be_read_for_whatever_reason_hides_no_other(
    runs: Path, tmp_path: Path, said: Said, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("one", "two"):
        shutil.copytree(runs / "toy", tmp_path / name)

    def read(path: Path, *log: object) -> Any:
        return {}[path.name] if path.name == "one" else read_contents(path)

    monkeypatch.setattr("unproject.studio.runs.read_contents", read)
    status, found = said(State(tmp_path), "/api/runs")
    by_name = {run["name"]: run for run in found["runs"]}
    assert status == 200 and by_name["two"]["step"] == 2 and by_name["one"]["said"] == "damaged (KeyError: 'one')"
    status, found = said(State(tmp_path), "/api/run", run="one")
    assert (status, found["error"]) == (400, "damaged (KeyError: 'one')")


# Watching


def test_watching_a_run_reads_and_draws_what_is_new_alone(
    runs: Path, tmp_path: Path, said: Said, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(runs / "toy", tmp_path / "toy")
    log, line = tmp_path / "toy" / "stats.jsonl", {"step": 1, "seconds": 1.0, "loss_d": 0.5}
    log.write_text("".join(json.dumps(line | {"step": k}) + "\n" for k in range(1000)))
    counted = {"lines": 0, "curves": 0}
    loads, curves = json.loads, curves_section

    def parsed(text: Any) -> Any:
        counted["lines"] += 1
        return loads(text)

    def drawn(contents: Any) -> str:
        counted["curves"] += 1
        return curves(contents)

    monkeypatch.setattr("unproject.report.log.json.loads", parsed)
    monkeypatch.setattr("unproject.studio.runs.curves_section", drawn)
    state = State(tmp_path)
    with lock.locked(tmp_path / "toy"):
        for extra in range(1, 5):
            for path in ("/api/runs", "/api/newest", "/api/run", "/api/run"):
                assert said(state, path, run="toy")[0] == 200
            with log.open("a") as stream:
                stream.write(json.dumps(line | {"step": 1000 + extra}) + "\n")
            os.utime(log, (time.time() + extra, time.time() + extra))
        assert said(state, "/api/newest", run="toy")[1]["trained"] == 1004
    assert counted["curves"] <= 2 and counted["lines"] < 1200


def test_a_folder_that_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["studio", str(tmp_path / "none")]) == 2
    assert "there is no such folder; give the one that holds runs" in capsys.readouterr().err


def test_no_example_is_put_into_a_run(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It would not be seen there."""
    monkeypatch.setattr("unproject.studio.serve", lambda *of: None)
    shutil.copytree(runs / "toy", tmp_path / "toy")
    assert main(["studio", str(tmp_path / "toy"), "--example"]) == 2
    assert "give the folder that holds runs" in capsys.readouterr().err
    assert not (tmp_path / "toy" / "example-chairs").exists()


def test_a_port_that_is_taken(runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with Studio(runs) as studio:
        port = studio.server_address[1]
        assert main(["studio", str(runs), "--port", str(port)]) == 2
    assert f"--port {port}: Address already in use; give another --host or --port" in capsys.readouterr().err


def test_training_prints_the_command_that_watches_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["train", TOY, "--views", "known", "--steps", "1", "--out", str(tmp_path / "run")]) == 0
    assert f"unproject studio {tmp_path}" in capsys.readouterr().out


def test_what_takes_too_long_is_said_to_go_on(runs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("unproject.studio.state.LONGEST", 0.05)
    state, go = State(runs), threading.Event()
    with pytest.raises(Busy, match="still being computed"):
        state.compute(go.wait)
    go.set()


def test_hosts_as_browsers_write_them() -> None:
    assert Guard.of("127.0.0.1", 80, "").refusal({"Host": "127.0.0.1"}, page=True) is None
    assert Guard.of("MyBox", 8600, "").refusal({"Host": "mybox:8600"}, page=True) is None
    assert Guard.of("127.0.0.1", 8600, "").refusal({"Host": "127.0.0.1"}, page=True) is not None


BUSY = """
import os, signal, threading, time
import torch
from unproject.studio import server

def ends(studio):
    studio.state.jobs.submit(lambda: [torch.rand(300, 300) @ torch.rand(300, 300) for _ in range(10**6)])
    while not studio.state.jobs.busy:
        time.sleep(0.01)
    raise KeyboardInterrupt

server.Studio.serve_forever = ends
server.serve({folder!r}, port=0)
"""


def test_ctrl_c_ends_it_while_it_computes(runs: Path, forked: None) -> None:
    """Python would end around the thread that is within torch, which aborts the process."""
    done = subprocess.run(
        [sys.executable, "-c", BUSY.format(folder=str(runs))], capture_output=True, text=True, timeout=120
    )
    assert (done.returncode, done.stderr) == (0, "") and "Ctrl-C ends it" in done.stdout


def test_a_studio_that_listens_everywhere_has_an_address_for_others(runs: Path) -> None:
    with Studio(runs, "0") as studio:
        assert studio.host == "0.0.0.0"
        assert studio.address_at("here") == studio.address.replace("0.0.0.0", "here")
        assert studio.address_at("::1").startswith(f"http://[::1]:{studio.port}/?token=")


def test_an_empty_host_is_refused_and_not_all_of_the_machine(runs: Path) -> None:
    with pytest.raises(UserError, match="--host: is empty"):
        Studio(runs, "")
