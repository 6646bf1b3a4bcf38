"""Access to the page: host name, token, and the headers that limit what a browser does with a response."""

import hashlib
import hmac
import ipaddress
import socket
from collections.abc import Iterable
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from typing import Final
from urllib.parse import urlencode

from starlette.datastructures import Headers, MutableHeaders, QueryParams
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from headway.errors import UserError

TOKEN_LENGTH_MIN: Final = 16
WRITABLE: Final = "/handling"
"""The one path that takes POST."""
COOKIE: Final = "headway_dashboard"
_HEADERS: Final = {
    "Content-Security-Policy": "default-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches what is bound to `host`."""
    address = _address(host)
    return host == "localhost" if address is None else address.is_loopback


def read_token(file: Path) -> str:
    """Read the token from the first line of a file.

    Raises
    ------
    UserError
        The file cannot be read, or its token is too short.
    """
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"token file {file}: {getattr(error, 'strerror', None) or error}") from None
    token = lines[0].strip() if lines else ""
    if len(token) < TOKEN_LENGTH_MIN or not token.isascii():
        raise UserError(f"token file {file}: the first line needs at least {TOKEN_LENGTH_MIN} ASCII characters")
    return token


class AccessControl:
    """ASGI middleware in front of everything.

    The Host header must be a literal address, `localhost`, the bound host, this machine's name or one of `names`: this
    rejects DNS rebinding. A loopback address accepts loopback names only.
    """

    def __init__(self, app: ASGIApp, *, host: str, token: str | None, names: Iterable[str] = ()) -> None:
        self._app = app
        self._token = None if token is None else token.encode()
        self._cookie = "" if token is None else hmac.new(token.encode(), b"headway dashboard", "sha256").hexdigest()
        self._loopback = is_loopback(host)
        self._names = {"localhost", host.lower(), *(name.lower() for name in names)}
        if not self._loopback:
            self._names |= {socket.gethostname().lower(), socket.getfqdn().lower()}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request that is refused, pass on the others."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def send_guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(_HEADERS)
            await send(message)

        await (self._refusal(scope) or self._app)(scope, receive, send_guarded)

    def _refusal(self, scope: Scope) -> Response | None:
        headers, query = Headers(scope=scope), QueryParams(scope["query_string"])
        if not (self._is_known(headers.get("host", "")) and _is_same_origin(headers)):
            return PlainTextResponse("unknown host name: start the dashboard with --name for it\n", 421)
        if scope["method"] not in {"GET", "HEAD"} and (scope["method"], scope["path"]) != ("POST", WRITABLE):
            return PlainTextResponse("only GET\n", 405, {"Allow": "GET, HEAD"})
        if self._token is None:
            return None
        if self._is_token(query.get("token", "")):
            is_encrypted = "https" in {scope["scheme"], headers.get("x-forwarded-proto", "").strip().lower()}
            return self._redirect_with_cookie(scope["path"], query, secure=is_encrypted)
        scheme, _, credential = headers.get("authorization", "").partition(" ")
        if (scheme.lower() == "bearer" and self._is_token(credential)) or self._has_cookie(headers.get("cookie", "")):
            return None
        hint = "token needed: open /?token=... once, or send it as `Authorization: Bearer ...`\n"
        return PlainTextResponse(hint, 401, {"WWW-Authenticate": "Bearer"})

    def _is_known(self, host_header: str) -> bool:
        name = _without_port(host_header).lower()
        address = _address(name)
        if address is None:
            return name in self._names
        return address.is_loopback or not self._loopback

    def _is_token(self, offered: str) -> bool:
        assert self._token is not None
        return hmac.compare_digest(_digest(offered.encode()), _digest(self._token))

    def _has_cookie(self, cookie_header: str) -> bool:
        try:
            cookie = SimpleCookie(cookie_header).get(COOKIE)
        except CookieError:
            return False
        return cookie is not None and hmac.compare_digest(cookie.value.encode(), self._cookie.encode())

    def _redirect_with_cookie(self, path: str, query: QueryParams, *, secure: bool) -> Response:
        """Move the token from the address, where it stays visible, into a cookie that scripts cannot read."""
        rest = urlencode([(name, value) for name, value in query.multi_items() if name != "token"])
        response = RedirectResponse("/" + path.lstrip("/") + ("?" + rest if rest else ""), 303)
        response.set_cookie(COOKIE, self._cookie, httponly=True, samesite="lax", secure=secure)
        return response


def _is_same_origin(headers: Headers) -> bool:
    """Whether a request comes from the page itself, or from no page."""
    origin = headers.get("origin")
    return origin is None or origin.rpartition("//")[2].lower() == headers.get("host", "").lower()


def _address(host: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(host.strip("[]"))
    except ValueError:
        return None


def _without_port(host_header: str) -> str:
    if host_header.startswith("["):
        return host_header.partition("]")[0] + "]"
    return host_header.partition(":")[0]


def _digest(text: bytes) -> bytes:
    """Return bytes of equal length, so that the time of a comparison does not reveal the length."""
    return hashlib.sha256(text).digest()
