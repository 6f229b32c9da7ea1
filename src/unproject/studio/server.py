"""The server: requests in, answers out; everything that others could abuse is refused here."""

from __future__ import annotations

import os
import re
import secrets
import socket
import sys
import traceback
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from os import PathLike
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, urlsplit

from .._types import UserError
from .answers import POLICY, Answer, Busy, Missing, Request, of_json
from .guard import EVERYWHERE, Guard, authority
from .routes import PAGE, ROUTES
from .state import State

MAX_REQUEST_BYTES, MAX_REFUSED_BYTES = 40_000_000, 500_000_000
"""Bytes that may be sent to the studio at once, a picture or a light probe; bytes of what is refused that are read all
the same: a browser hears no answer before it has sent all, and none if the connection breaks."""
PATIENCE = 30
"""Seconds after which a connection that sends nothing is closed."""


class Studio(ThreadingHTTPServer):
    """The server of the studio.

    Args:
        folder: where runs lie; nothing else is shown.
        host: where to listen. Others than this machine may ask if it is no loopback address.
        port: 0 for any that is free.
        trust: import code of runs outside this package.

    Attributes:
        address: to open in a browser, with the token, without which nobody may ask.

    Raises:
        UserError: if there is no such folder, or the port is taken.

    Examples:
        >>> import pathlib
        >>> pathlib.Path("runs").mkdir(exist_ok=True)
        >>> studio = Studio("runs", port=0)
        >>> studio.address.startswith("http://127.0.0.1:")
        True
        >>> studio.server_close()
    """

    daemon_threads = True

    def __init__(
        self, folder: str | PathLike[str], host: str = "127.0.0.1", port: int = 0, trust: bool = False
    ) -> None:
        self.state = State(Path(folder), trust)
        host = "0.0.0.0" if host == "0" else host
        if not host:
            raise UserError("--host: is empty; give an address, such as 127.0.0.1, or 0.0.0.0 for all of this machine")
        if ":" in host:
            self.address_family = socket.AF_INET6
        try:
            super().__init__((host, port), Handler)
        except (OSError, OverflowError) as error:
            why = getattr(error, "strerror", None) or error
            raise UserError(f"--host {host} --port {port}: {why}; give another --host or --port (0 for any)") from None
        self.host, self.port = host, int(self.server_address[1])
        self.guard = Guard.of(host, self.port, secrets.token_urlsafe(24))
        self.address = self.address_at(host)

    def address_at(self, host: str) -> str:
        """Return the address by which it is opened at a name of this machine."""
        return f"http://{authority(host, self.port)}/?token={self.guard.token}"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing of connections that break off: browsers do that all the time."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)


class Handler(BaseHTTPRequestHandler):
    """One connection."""

    server: Studio  # pyright: ignore[reportIncompatibleVariableOverride]
    protocol_version = "HTTP/1.1"
    server_version = "unproject"
    sys_version = ""
    timeout = PATIENCE

    def do_GET(self) -> None:
        self._answer("GET")

    def do_POST(self) -> None:
        self._answer("POST")

    def log_message(self, format: str, *args: Any) -> None:
        """Keep quiet: the terminal is for what goes wrong."""

    def _answer(self, method: str) -> None:
        try:
            address = urlsplit(self.path)
        except ValueError:  # no address of ours: a bracket without its other half
            self.close_connection = True
            self._send(of_json({"error": "this is no address"}, 400))
            return
        query = dict(parse_qsl(address.query, keep_blank_values=True))
        if method == "GET" and address.path == "/" and self.server.guard.knows(query.get("token", "")):
            cookie = f"{self.server.guard.cookie}={query['token']}; HttpOnly; SameSite=Strict; Path=/"
            self._send(Answer(b"", "text/plain", 303, {"Location": "/", "Set-Cookie": cookie}))
            return
        page = method == "GET" and address.path in PAGE
        refused = self.server.guard.refusal(self.headers, page)  # pyright: ignore[reportArgumentType]
        if refused:
            self._refuse(refused, 403)
            return
        length = self._length() if method == "POST" else 0
        if length is None or length > MAX_REQUEST_BYTES:
            self._refuse(_too_large(query.get("name", ""), length), 413)
            return
        request = Request(query, self.rfile.read(length), self.headers.get("If-None-Match"))
        self._send(respond(self.server.state, method, address.path, request))

    def _length(self) -> int | None:
        """Return how many bytes are sent along; None if that is not told."""
        length = self.headers.get("Content-Length", "")
        told = re.fullmatch("[0-9]{1,12}", length) and "Transfer-Encoding" not in self.headers
        return int(length) if told else None

    def _refuse(self, said: str, status: int) -> None:
        self.close_connection = True
        self._send(of_json({"error": said}, status))
        left = min(self._length() or 0, MAX_REFUSED_BYTES)
        while left > 0 and (part := self.rfile.read1(min(left, 2**16))):  # pyright: ignore[reportAttributeAccessIssue]
            left -= len(part)

    def _send(self, answer: Answer) -> None:
        self.send_response(answer.status)
        headers = {
            "Content-Type": answer.kind,
            "Content-Length": str(len(answer.content)),
            "Content-Security-Policy": POLICY,
            "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Cache-Control": "no-store",
        }
        for name, value in {**headers, **answer.headers}.items():
            self.send_header(name, value)
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()
        if answer.status != 304:
            self.wfile.write(answer.content)


def _too_large(name: str, length: int | None) -> str:
    if length is None:
        return "what is sent does not say how large it is"
    remedy = f"give at most {MAX_REQUEST_BYTES // 1_000_000} MB: a picture of fewer pixels, or light at 2K"
    return f"{name[:80] or 'this'}: is {length / 1e6:.0f} MB; {remedy}"


def respond(state: State, method: str, path: str, request: Request) -> Answer:
    """Return the answer to a request that may be asked, whatever goes wrong."""
    route = ROUTES.get((method, path))
    if route is None:
        return of_json({"error": f"there is no {method} {path}"}, 404)
    try:
        return route(state, request)
    except Missing as error:
        return of_json({"error": str(error)}, 404)
    except Busy as error:
        return of_json({"error": str(error)}, 503)
    except (UserError, ValueError, OSError) as error:
        return of_json({"error": " ".join(str(error).split()) or type(error).__name__}, 400)
    except Exception as error:  # a part of the user's own may fail in any way; the studio goes on
        traceback.print_exc()
        return of_json({"error": f"{type(error).__name__}: {error}"}, 500)


def serve(folder: str | PathLike[str], host: str = "127.0.0.1", port: int = 8600, trust: bool = False) -> None:
    """Show the runs of a folder until Ctrl-C.

    Raises:
        UserError: if there is no such folder, or the port is taken.
    """
    with Studio(folder, host, port, trust) as studio:
        respond(studio.state, "GET", "/api/runs", Request({}))  # reads all logs once, so that the page is there at once
        print(f"studio: {studio.address}  (Ctrl-C ends it)", flush=True)
        if studio.host in EVERYWHERE:
            print(f"from other machines, as this one's name: {studio.address_at(socket.gethostname())}")
        try:
            studio.serve_forever()
        except KeyboardInterrupt:
            print(flush=True)
            if studio.state.computes:  # Python would end around a thread within torch, which aborts
                os._exit(0)
