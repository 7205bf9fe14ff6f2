"""Guard of the viewer's server: who may see the page, from where, and how much they may send.

Any web page that a person has open can ask the browser for `localhost`: a request for another
host's name (DNS rebinding) and a websocket that another page has opened are refused. Beyond this
machine a token is needed, once in the address, then as a cookie.
"""

from __future__ import annotations

import hmac
import inspect
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
from typing import Any
from unittest import mock
from urllib.parse import parse_qs, urlsplit

LOCAL_NAMES = 'localhost', '127.0.0.1', '::1'
COOKIE = 'hand_tracker_token'
LARGEST_FRAME = 2**24     # [bytes] of a browser's message: a picture of the largest screen
# viser's page unpacks itself by inline code; nothing may come from or go to another host.
CONTENT_POLICY = (
    "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; "
    "connect-src 'self' data: blob: ws://{host} wss://{host}; object-src 'none'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'")
HEADERS = {'X-Content-Type-Options': 'nosniff', 'Referrer-Policy': 'no-referrer',
           'Cross-Origin-Resource-Policy': 'same-origin', 'Cache-Control': 'no-store'}


class PageGuard:
    """Decide on each request of a browser.

    Parameters
    ----------
    is_local : bool
        Whether the server listens to this machine alone.
    token : str or None
        That is asked for.
    """

    def __init__(self, is_local: bool, token: str | None) -> None:
        self._is_local, self._token = is_local, token

    def refusal(self, path: str, headers: Any) -> str | None:
        """Return why a request is refused, None where it is not.

        Parameters
        ----------
        path : str
            With the query.
        headers : mapping of str to str
        """
        host = headers.get('Host') or ''
        if self._is_local and urlsplit(f'//{host}').hostname not in LOCAL_NAMES:
            return 'another host is asked for'
        origin = headers.get('Origin')
        if origin is not None and urlsplit(origin).netloc != host:
            return 'another page asks'
        if self._token is None:
            return None
        given = [*parse_qs(urlsplit(path).query).get('token', []), *_cookies(headers, host)]
        if not any(hmac.compare_digest(one.encode(), self._token.encode()) for one in given):
            return 'the token is missing: use the whole address that the viewer has printed'
        return None

    def headers(self, host: str) -> dict[str, str]:
        """Return the headers of each answer to a request for a host."""
        cookie = {} if self._token is None else {
            'Set-Cookie': f'{cookie_name(host)}={self._token}; HttpOnly; SameSite=Strict; Path=/'}
        return {**HEADERS, **cookie, 'Content-Security-Policy': CONTENT_POLICY.format(host=host)}

    def guarded(self, serve_page: Callable[[Any, Any], Any] | None) -> Callable[[Any, Any], Any]:
        """Return a `process_request` of `websockets.serve` around that of the page."""
        async def process(connection: Any, request: Any) -> Any:
            try:
                reason = self.refusal(request.path, request.headers)
            except (ValueError, LookupError):  # no host, no path, or a header more than once
                reason = 'malformed'
            if reason is not None:
                return connection.respond(HTTPStatus.FORBIDDEN, f'{reason}\n')
            response = None if serve_page is None else serve_page(connection, request)
            if inspect.isawaitable(response):
                response = await response
            if response is not None:
                for name, value in self.headers(request.headers['Host']).items():
                    response.headers[name] = value
            return response
        return process

    @contextmanager
    def around_servers(self) -> Iterator[list[Any]]:
        """Guard the servers that websockets starts meanwhile; yield a list that grows with each.

        viser has no other way to its server.
        """
        from websockets.asyncio import server

        serve, started = server.serve, []

        def guarded_serve(*args: Any, **options: Any) -> Any:
            options['process_request'] = self.guarded(options.get('process_request'))
            options['max_size'] = LARGEST_FRAME
            started.append(options)
            return serve(*args, **options)

        with mock.patch.object(server, 'serve', guarded_serve):
            yield started


def cookie_name(host: str) -> str:
    """Return the name of the cookie of a host; cookies are of all ports of a host."""
    return f"{COOKIE}_{urlsplit(f'//{host}').port}"


def _cookies(headers: Any, host: str) -> list[str]:
    """Return the tokens among the cookies of a request."""
    try:
        cookie = SimpleCookie(headers.get('Cookie') or '')
    except CookieError:
        return []
    name = cookie_name(host)
    return [cookie[name].value] if name in cookie else []
