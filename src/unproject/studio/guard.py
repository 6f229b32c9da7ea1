"""Guard: who may ask. A page of another site, open in the same browser, must neither read nor start anything.

Its requests carry that site's name as Origin; if its name was made to lead to this machine (DNS rebinding), they carry
that name as Host. Both are refused. Whoever asks needs the token, on this machine too: others may be logged in there.
The page itself holds nothing of any run, and is shown to whoever follows a link to it.
"""

from __future__ import annotations

import hmac
import re
from collections.abc import Mapping
from dataclasses import dataclass

COOKIE = "unproject-studio"
LOOPBACK = ("127.0.0.1", "localhost", "::1")
EVERYWHERE = ("0.0.0.0", "::")


def authority(host: str, port: int) -> str:
    """Return `host:port` as a browser writes it.

    Examples:
        >>> authority("::1", 8000)
        '[::1]:8000'
    """
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


@dataclass(frozen=True)
class Guard:
    """What a request must say.

    Attributes:
        hosts: the names that Host may be; None for any, as for a server that listens everywhere.
        token: what the cookie must hold.
        port: of the server.
    """

    hosts: frozenset[str] | None
    token: str
    port: int

    @property
    def cookie(self) -> str:
        """Return the name of the cookie: that of the port, since browsers send cookies to all ports of a host."""
        return f"{COOKIE}-{self.port}"

    @classmethod
    def of(cls, host: str, port: int, token: str) -> Guard:
        """Return the guard of a server that listens there."""
        names = {host.lower(), *LOOPBACK}
        known = {authority(name, port) for name in names}
        known |= {authority(name, port).removesuffix(":80") for name in names if port == 80}  # as browsers write it
        return cls(None if host in EVERYWHERE else frozenset(known), token, port)

    def refusal(self, headers: Mapping[str, str], page: bool = False) -> str | None:
        """Return why a request with these headers is refused; None if it may be answered.

        Args:
            page: whether it is for a file of the page.
        """
        host, origin = headers.get("Host", ""), headers.get("Origin")
        if self.hosts is not None and host.lower() not in self.hosts:
            return self._other(host)
        if page:
            return None
        if origin is not None and origin.lower() != f"http://{host.lower()}":
            return "asked by a page of another site"
        if headers.get("Sec-Fetch-Site", "same-origin") not in ("same-origin", "none"):
            return "asked by a page of another site"
        if not self.knows(_cookie(headers, self.cookie)):
            return "the token is missing; open the address that `unproject studio` printed"
        return None

    def _other(self, host: str) -> str:
        if re.sub(r":\d+$", "", host).strip("[]").lower() in LOOPBACK:  # forwarded from another machine
            same = f"ssh -L {self.port}:localhost:{self.port} HOST"
            return f"the studio has port {self.port}; forward the same port: {same}"
        return "this address is not the studio's; open the one that `unproject studio` printed"

    def knows(self, token: str) -> bool:
        """Whether this is the token."""
        return hmac.compare_digest(token.encode(), self.token.encode())


def _cookie(headers: Mapping[str, str], name: str) -> str:
    """Return the value of a cookie, "" if it is missing.

    `http.cookies` stops at the first one that it does not understand; other programs of this host may have set any.
    """
    pairs = (pair.strip().partition("=") for pair in headers.get("Cookie", "").split(";"))
    return next((value for key, _, value in pairs if key == name), "")
