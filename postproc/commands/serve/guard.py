"""What stands before every request: its host, its origin, the token, the size and the time of its body.

A page of another site can make a browser send requests here, also under another name of this computer (DNS rebinding):
the name in `Host` must be one of this server, and what changes something must come from a page of this server.
"""

from __future__ import annotations

import asyncio
import hmac
import ipaddress
import socket
from collections.abc import Awaitable, Callable, Iterable, MutableMapping
from contextlib import suppress
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs, urlencode

Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
Headers = dict[str, str]
LOCAL = ("127.0.0.1", "localhost", "::1")
"""Names of this computer on this computer."""
COOKIE = "ncomp_token"
DISCARD_S = 2.0
"""Time, s, for which the rest of a refused form is read."""
WRONG_S = 1.0
"""Time, s, until a wrong token is answered: it cannot be found by trying."""
OWN = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "frame-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
)
"""Content-Security-Policy of the pages: no script and no style but the files of this server."""
SAFE = {
    "content-security-policy": OWN,
    "x-content-type-options": "nosniff",
    "referrer-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}
"""Headers of every answer, unless it has its own."""


class Refused(Exception):
    """A request that is not answered; its status and the sentence for the user."""

    def __init__(self, status: int, reason: str) -> None:
        super().__init__(reason)
        self.status, self.reason = status, reason


@dataclass(frozen=True)
class Limits:
    """What a request may send."""

    size: int
    """Largest body, bytes."""
    seconds: float
    """Time in which it must be complete."""


def is_loopback(host: str) -> bool:
    """True for an address that only this computer reaches."""
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


@dataclass(frozen=True)
class Guard:
    """The checks before the pages; `refusal` makes the page of a request that is not answered."""

    pages: Callable[[Message, Receive, Send], Awaitable[None]]
    refusal: Callable[[int, str], Callable[[Message, Receive, Send], Awaitable[None]]]
    host: str
    port: int
    token: str
    """Empty where none is needed."""
    limits: Limits

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        """Answer a request."""
        if scope["type"] != "http":
            return
        headers = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}
        body, begun = _Body(receive, self.limits), False

        async def safely(message: Message) -> None:
            """Send a message; the first of an answer gets the headers that restrict what a browser does with it."""
            nonlocal begun
            if message["type"] == "http.response.start":
                begun = True
                given = {name.lower() for name, _ in message["headers"]}
                own = [(n.encode(), v.encode()) for n, v in SAFE.items() if n.encode() not in given]
                message = {**message, "headers": [*message["headers"], *own]}
            await send(message)

        try:
            self._check_host(headers)
            self._check_kind(scope, headers)
            if not await self._let_in(scope, headers, safely):
                await self.pages(scope, body if scope["method"] == "POST" else receive, safely)
        except Refused as refused:
            if begun:
                raise
            if scope["method"] == "POST" and refused.status != 408:
                await body.discard()
            await self.refusal(refused.status, refused.reason)(scope, receive, safely)

    def _check_host(self, headers: Headers) -> None:
        """Refused for a name that is none of this server."""
        name, port = _host_and_port(headers.get("host", ""))
        known: Iterable[str] = LOCAL
        if not is_loopback(self.host):
            own = socket.gethostname().lower()
            known = {*LOCAL, self.host.lower(), own, f"{own}.local", socket.getfqdn().lower()}
        if port != self.port or not (name in known or (not is_loopback(self.host) and _is_address(name))):
            raise Refused(421, "This name is none of this server: use the address that ncomp serve has printed.")

    def _check_kind(self, scope: Message, headers: Headers) -> None:
        """Refused for a method, an origin, a kind or a size that the pages do not send."""
        if scope["method"] not in ("GET", "HEAD", "POST"):
            raise Refused(405, "Only pages are read here, and forms sent.")
        if scope["method"] != "POST":
            return
        if headers.get("origin") != f"http://{headers['host']}":
            raise Refused(403, "The form was sent by the page of another site, and nothing was done: open this page.")
        kind = headers.get("content-type", "").partition(";")[0].strip().lower()
        if kind not in ("multipart/form-data", "application/x-www-form-urlencoded"):
            raise Refused(415, "Only the forms of this page are accepted.")
        size = headers.get("content-length", "0")
        if size.isdecimal() and int(size) > self.limits.size:
            raise _too_large(self.limits)

    async def _let_in(self, scope: Message, headers: Headers, send: Send) -> bool:
        """True where the answer is a redirection with a cookie, for an address with the right token.

        Refused without it, but for the form that asks for it and its style.
        """
        if not self.token or scope["path"] in ("/login", "/static/serve.css", "/static/page.css"):
            return False
        query = parse_qs(scope["query_string"].decode("latin-1"))
        if "token" in query and scope["method"] == "GET":
            if not self.is_token(query.pop("token")[0]):
                await asyncio.sleep(WRONG_S)
                raise Refused(401, "The token is wrong: use the address that ncomp serve has printed.")
            target = scope["path"] + (f"?{urlencode(query, doseq=True)}" if query else "")
            await send_redirection(send, "/" + target.lstrip("/"), self.cookie())
            return True
        try:
            found = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
        except CookieError:
            found = None
        if found is None or not self.is_token(found.value):
            raise Refused(401, "This page needs the token that ncomp serve has printed.")
        return False

    def is_token(self, text: str) -> bool:
        """True for the token of this server."""
        return hmac.compare_digest(text.encode(), self.token.encode())

    def cookie(self) -> str:
        """The header that makes a browser keep the token: not for scripts, and not for requests of other sites."""
        return f"{COOKIE}={self.token}; HttpOnly; SameSite=Strict; Path=/"


@dataclass
class _Body:
    """The body of a request as it arrives."""

    receive: Receive
    limits: Limits
    size: int = 0
    end: float = 0.0
    whole: bool = False

    async def __call__(self) -> Message:
        """The next part; Refused for too many, and for one that does not arrive in time."""
        clock = asyncio.get_running_loop().time
        self.end = self.end or clock() + self.limits.seconds
        try:
            message = await asyncio.wait_for(self.receive(), max(self.end - clock(), 0.0))
        except TimeoutError:
            raise Refused(408, f"The upload was not complete after {self.limits.seconds:g} s: send it again.") from None
        self.whole = not message.get("more_body", False)
        self.size += len(message.get("body", b""))
        if self.size > self.limits.size:
            raise _too_large(self.limits)
        return message

    async def discard(self) -> None:
        """Read the rest, for a time: a browser that cannot send its form to the end does not show the answer."""
        with suppress(TimeoutError):
            async with asyncio.timeout(DISCARD_S):
                while not self.whole:
                    self.whole = not (await self.receive()).get("more_body", False)


def _too_large(limits: Limits) -> Refused:
    return Refused(
        413, f"The files are larger than {limits.size / 1e6:g} MB: use the command line, or start with --largest-mb."
    )


async def send_redirection(send: Send, target: str, cookie: str) -> None:
    """Send the browser to another address of this server, with a cookie."""
    headers = [(b"location", target.encode("latin-1")), (b"set-cookie", cookie.encode())]
    await send({"type": "http.response.start", "status": 303, "headers": headers})
    await send({"type": "http.response.body", "body": b""})


def _host_and_port(text: str) -> tuple[str, int]:
    """The name and the port in a header `Host`; port 80 without one, 0 for a text that is none."""
    name, colon, port = text.lower().rpartition(":")
    if not colon or text.endswith("]"):
        name, port = text.lower(), "80"
    return name.strip("[]"), int(port) if port.isdecimal() and len(port) < 6 else 0


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
