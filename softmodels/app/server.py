"""Serve the page on this machine, to those who hold its key."""

from __future__ import annotations

import asyncio
import hmac
import secrets
import socket
import webbrowser
from http.cookies import SimpleCookie
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import parse_qsl, urlencode, urlsplit

from softmodels.common.processes import say

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

HERE = "127.0.0.1"
FIRST_PORT, PORTS = 8700, 100
"""Where free ports are looked for, and how many are tried."""
KEY = "token"
"""Name of the key in the address."""
LARGEST_UPLOAD = 400 << 20
"""Bytes of the largest request: a few raw photographs at once."""


def free_port(host: str, wanted: int | None = None) -> int:
    """Return the wanted port, or the first free one from `FIRST_PORT`.

    Raises:
        OSError: The wanted port, or all of them, are in use.
    """
    ports = [wanted] if wanted else range(FIRST_PORT, FIRST_PORT + PORTS)
    for port in ports:
        with socket.socket() as tried:
            tried.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                tried.bind((host, port))
            except OSError as error:
                last = error
                continue
            return port
    raise last


def lan_address() -> str:
    """Return this machine's address on its network; its own loop where it has none."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # sends nothing; the route to any outside address names the interface
        except OSError:
            return HERE
        return str(probe.getsockname()[0])


async def answers(port: int) -> bool:
    """Return whether a server of this machine listens at a port."""
    try:
        _, writer = await asyncio.open_connection(HERE, port)
    except OSError:
        return False
    writer.close()
    return True


class Guard:
    """ASGI middleware that answers only requests with the key, addressed to this server, and not sent by other sites.

    The key comes once in the address, and from then on in a cookie that scripts cannot read. A site that points its own name
    at this machine (DNS rebinding) fails by the name, another site's form or socket by its origin.

    Args:
        app: The application behind it.
        key: The key.
        hosts: Names with port under which the server is addressed.
    """

    def __init__(self, app: ASGIApp, key: str, hosts: frozenset[str]):
        self.app, self.key, self.hosts = app, key, hosts
        self.cookie = f"softmodels-{sorted(hosts)[0].rpartition(':')[2]}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            return await self.app(scope, receive, send)
        headers = {name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]}
        host, origin = headers.get("host", ""), headers.get("origin")
        if host not in self.hosts:
            return await _refuse(scope, send, 421, "This server has another name; open the address that it printed.")
        if origin is not None and urlsplit(origin).netloc != host:
            return await _refuse(scope, send, 403, "Requests from other sites are refused.")
        query = dict(parse_qsl(scope["query_string"].decode("latin-1")))
        if scope["type"] == "http" and self._fits(query.get(KEY, "")):
            rest = urlencode([(name, value) for name, value in query.items() if name != KEY])
            return await self._enter(send, scope["path"] + (f"?{rest}" if rest else ""))
        held = SimpleCookie(headers.get("cookie", "")).get(self.cookie)
        if held is None or not self._fits(held.value):
            return await _refuse(
                scope, send, 403, "The key is missing; open the address that softmodels app printed, with its token."
            )
        if scope["type"] == "http" and scope["method"] not in ("GET", "HEAD", "OPTIONS"):
            length = headers.get("content-length", "")
            if not length.isdecimal():
                return await _refuse(scope, send, 411, "An upload must state its length.")
            if int(length) > LARGEST_UPLOAD:
                return await _refuse(scope, send, 413, f"Uploads are limited to {LARGEST_UPLOAD >> 20} MB at once.")
        return await self.app(scope, receive, send)

    def _fits(self, given: str) -> bool:
        return hmac.compare_digest(given.encode(), self.key.encode())

    async def _enter(self, send: Send, path: str) -> None:
        """Keep the key in a cookie, and take it out of the address."""
        cookie = f"{self.cookie}={self.key}; Path=/; HttpOnly; SameSite=Lax"
        where = "/" + path.lstrip("/\\")  # never another site's
        headers = [(b"location", where.encode("latin-1")), (b"set-cookie", cookie.encode()), (b"content-length", b"0")]
        await send({"type": "http.response.start", "status": 303, "headers": headers})
        await send({"type": "http.response.body", "body": b""})


async def _refuse(scope: Scope, send: Send, status: int, sentence: str) -> None:
    if scope["type"] == "websocket":
        closed: Message = {"type": "websocket.close", "code": 1008, "reason": sentence}
        return await send(closed)
    body = sentence.encode()
    headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"content-length", str(len(body)).encode())]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    return await send({"type": "http.response.body", "body": body})


def serve(folder: Path, port: int | None = None, *, browser: bool = True, lan: bool = False) -> None:
    """Serve a project's page until Ctrl-C.

    Args:
        folder: The project.
        port: Of the server; a free one if None.
        browser: Whether to open the user's browser.
        lan: Whether other machines of the network may connect, with the key.

    Raises:
        OSError: The folder or the port cannot be used.
    """
    from nicegui import app, background_tasks, core, ui

    from softmodels.app.bench import Bench
    from softmodels.app.project import Project
    from softmodels.app.shell import ICON, build_page

    host = "0.0.0.0" if lan else HERE
    port = free_port(host, port)
    outside = lan_address() if lan else HERE
    key = secrets.token_urlsafe(24)
    hosts = frozenset(f"{name}:{port}" for name in (HERE, "localhost", outside))
    bench = Bench(Project(folder), f"http://{outside}:{port}/?{KEY}={key}" if lan else "")
    app.on_startup(bench.begin)
    app.on_shutdown(bench.end)
    address = f"http://{HERE}:{port}/?{KEY}={key}"

    async def tell() -> None:
        while not await answers(port):  # handlers of the start run before the server listens
            await asyncio.sleep(0.05)
        say(f"softmodels: {address}\nCtrl-C stops it; the project is {folder}")
        if lan:
            say(f"on the same network: {bench.address}")
        if browser:
            webbrowser.open(address)

    app.on_startup(lambda: background_tasks.create(tell()))
    app.add_static_files("/files", bench.project.folder, max_cache_age=0)
    core.app.add_middleware(Guard, key=key, hosts=hosts)  # type: ignore[arg-type]
    ui.run(
        lambda: build_page(bench), host=host, port=port, title="softmodels", show=False, reload=False, dark=None, favicon=ICON,
        show_welcome_message=False, reconnect_timeout=30.0, uvicorn_logging_level="error", storage_secret=None,
    )  # fmt: skip
