"""Who may look, and who may command: a secret word where the configuration has one, this host alone where it has none.

Without a word the page listens on loopback only, and answers to names of loopback only: a page of elsewhere that a
browser on this host has open could reach it under a name of its own otherwise. Engaging and aborting always take the
word, and a header that no page of elsewhere may send.
"""

from __future__ import annotations

import ipaddress
from collections.abc import Awaitable, Callable
from typing import Final
from urllib.parse import urlsplit

from aiohttp import web
from aiohttp.typedefs import Middleware

from companion.host.token import is_token

COOKIE: Final = "companion"
COMMAND_HEADER: Final = "X-Companion"
_OPEN: Final = frozenset({"/healthz"})
_HEADERS: Final = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
_Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


def guard(token: str | None) -> Middleware:
    """Middleware that lets in who may."""

    @web.middleware
    async def check(request: web.Request, handler: _Handler) -> web.StreamResponse:
        if token is None:
            if not _is_loopback(request.host):
                raise web.HTTPForbidden(text="this page is for this host; ask for http://127.0.0.1 or localhost\n")
        elif request.path not in _OPEN:
            given = request.query.get("token")
            if given is not None and is_token(given, token) and request.method == "GET":
                raise _remembered(request.path, given)
            if not is_allowed(request, token):
                raise web.HTTPUnauthorized(
                    text="open this page with ?token=WORD, or send Authorization: Bearer WORD (page.token_file)\n",
                    headers={"WWW-Authenticate": "Bearer"},
                )
        return await handler(request)

    return check


async def add_headers(request: web.Request, response: web.StreamResponse) -> None:
    """A signal of aiohttp: nothing from elsewhere is loaded, nothing is kept."""
    response.headers.update(_HEADERS)


def is_allowed(request: web.Request, token: str) -> bool:
    """Whether a request carries the word, in its cookie or as a bearer."""
    kind, _, bearer = request.headers.get("Authorization", "").partition(" ")
    if kind.lower() == "bearer":
        return is_token(bearer.strip(), token)
    return is_token(request.cookies.get(COOKIE, ""), token)


def is_own_command(request: web.Request) -> bool:
    """Whether a command comes from the page itself, or from a program: never from another site's page."""
    origin = request.headers.get("Origin")
    return COMMAND_HEADER in request.headers and (origin is None or urlsplit(origin).netloc == request.host)


def _remembered(path: str, token: str) -> web.HTTPFound:
    """The word leaves the address for a cookie, so that it stands in no history and no picture of the screen."""
    answer = web.HTTPFound(path)
    answer.set_cookie(COOKIE, token, httponly=True, samesite="Strict", path="/")
    return answer


def _is_loopback(host: str) -> bool:
    name = urlsplit(f"//{host}").hostname or ""
    if name == "localhost":
        return True
    try:
        return ipaddress.ip_address(name).is_loopback
    except ValueError:
        return False
