"""The server of the page: its files, and a WebSocket for each tab.

It listens on this computer only. A tab needs the token of the address that `wrt view` prints, and must come from the
page itself, so that neither other users of the computer nor other pages in the browser see the picture. Messages are
those of `wrt.view.viewer`.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import http
import json
import secrets
import socket
import struct
from collections.abc import Callable
from importlib import resources
from typing import Any
from urllib.parse import parse_qs, urlsplit

from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from wrt.errors import InputError
from wrt.view.session import Session
from wrt.view.viewer import Viewer

HOST = "127.0.0.1"
PORTS = range(8765, 8785)
"""Ports that are tried, one after the other, unless one is given."""

LONGEST_MESSAGE = 1 << 14
"""Bytes of a message from a page."""

FILES = {
    "/": ("index.html", "text/html"),
    "/view.js": ("view.js", "text/javascript"),
    "/view.css": ("view.css", "text/css"),
}
"""The files of the page and their types, by address."""

HEADERS = {
    # The page may load nothing from elsewhere.
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self'; "
        "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
    ),
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
    "Connection": "close",
}


class _Tab(Viewer):
    """A tab of a browser."""

    def __init__(self, connection: ServerConnection, session: Session) -> None:
        super().__init__(session)
        self._connection = connection
        self._messages = asyncio.Queue[str | bytes]()

    async def run(self) -> None:
        """Serve the tab until it leaves."""
        self.begin()
        sending = asyncio.create_task(self._send_all())
        try:
            async for message in self._connection:
                try:
                    values = json.loads(message)
                except (ValueError, RecursionError):
                    values = None
                self.receive(values)
        except ConnectionClosed:
            pass
        finally:
            self.end()
            sending.cancel()
            with contextlib.suppress(asyncio.CancelledError, ConnectionClosed):
                await sending

    def send(self, message: dict[str, Any], content: bytes | None = None) -> None:
        self._messages.put_nowait(json.dumps(message) if content is None else _with_content(message, content))

    async def _send_all(self) -> None:
        while True:
            await self._connection.send(await self._messages.get())


def _with_content(message: dict[str, Any], content: bytes) -> bytes:
    """Return a message of bytes: the length of its JSON (uint32, little-endian), the JSON, the content."""
    header = json.dumps(message).encode()
    return struct.pack("<I", len(header)) + header + content


def _answer(request: Request, token: str, port: int) -> Response | None:
    """Return the answer to a request for the page or its files, or None to begin a WebSocket."""

    def is_from(header: str, scheme: str) -> bool:
        """Return whether the request has one such header, and it names this server."""
        values = request.headers.get_all(header)
        return len(values) == 1 and values[0] in {f"{scheme}{name}:{port}" for name in (HOST, "localhost")}

    # A page elsewhere may have its own name resolve to this computer.
    if not is_from("Host", ""):
        return _response(http.HTTPStatus.FORBIDDEN, b"unknown host\n")
    try:
        address = urlsplit(request.path)
    except ValueError:
        return _response(http.HTTPStatus.BAD_REQUEST, b"not an address\n")
    if address.path in FILES:
        name, kind = FILES[address.path]
        return _response(http.HTTPStatus.OK, (resources.files("wrt.view") / "page" / name).read_bytes(), kind)
    if address.path != "/live":
        return _response(http.HTTPStatus.NOT_FOUND, b"there is nothing here\n")
    sent_token = parse_qs(address.query).get("token", [""])[0]
    if not secrets.compare_digest(sent_token.encode(), token.encode()):
        return _response(http.HTTPStatus.FORBIDDEN, b"this needs the address that wrt view has printed\n")
    if not is_from("Origin", "http://"):
        return _response(http.HTTPStatus.FORBIDDEN, b"not from another page\n")
    return None


def _response(status: http.HTTPStatus, content: bytes, kind: str = "text/plain") -> Response:
    size = {"Content-Type": f"{kind}; charset=utf-8", "Content-Length": str(len(content))}
    return Response(status.value, status.phrase, Headers({**size, **HEADERS}), content)


def bound_socket(port: int | None) -> socket.socket:
    """Return a socket bound to a port of this computer, or to the first free one of PORTS.

    Raises:
        InputError: when the port is in use.
    """
    for each in [port] if port is not None else PORTS:
        bound = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            bound.bind((HOST, each))
        except OSError as error:
            bound.close()
            if error.errno not in (errno.EADDRINUSE, errno.EACCES):
                raise
            continue
        return bound
    if port is None:
        raise InputError(f"the ports {PORTS[0]} to {PORTS[-1]} are all in use; name a free one with --port")
    raise InputError(f"port {port} is in use or not allowed; choose another with --port, or leave it out")


async def run_server(session: Session, bound: socket.socket, token: str, ready: Callable[[str], None]) -> None:
    """Serve a session until this task is cancelled; `ready` is called with the page's address."""
    port = bound.getsockname()[1]

    async def serve_tab(connection: ServerConnection) -> None:
        await _Tab(connection, session).run()

    server: Server
    async with serve(
        serve_tab,
        sock=bound,
        process_request=lambda _, request: _answer(request, token, port),
        compression=None,  # frames are compressed already
        max_size=LONGEST_MESSAGE,
        write_limit=1 << 16,
        server_header=None,
        close_timeout=1.0,
    ) as server:
        ready(f"http://{HOST}:{port}/?token={token}")
        await server.wait_closed()
