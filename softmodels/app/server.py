"""Serve the page on this machine, to those who hold its key, with the frame around all its pages."""

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

import segno
from nicegui import app, background_tasks, core, ui
from starlette.background import BackgroundTask
from starlette.responses import FileResponse, PlainTextResponse, Response

from softmodels.app import device, forms, making, packing, photographs, start
from softmodels.app.bench import Bench, Project
from softmodels.common import errors, processes

if TYPE_CHECKING:
    from nicegui.events import KeyEventArguments
    from starlette.types import ASGIApp, Message, Receive, Scope, Send


LOCAL_HOST = "127.0.0.1"
FIRST_PORT, PORTS_TRIED = 8700, 100
"""Where free ports are looked for, and how many are tried."""
FILES = "/files"
"""Where the project's files are served."""
KEY = "token"
"""Name of the key in the address."""
LARGEST_UPLOAD = 400 << 20
"""Bytes of the largest request: a few raw photographs at once."""


def free_port(host: str, wanted: int | None = None) -> int:
    """Return the wanted port, or the first free one from `FIRST_PORT`; OSError if it, or all of them, are in use."""
    ports = [wanted] if wanted else range(FIRST_PORT, FIRST_PORT + PORTS_TRIED)
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
            return LOCAL_HOST
        return str(probe.getsockname()[0])


async def answers(port: int) -> bool:
    """Return whether a server of this machine listens at a port."""
    try:
        _, writer = await asyncio.open_connection(LOCAL_HOST, port)
    except OSError:
        return False
    writer.close()
    return True


SECURITY_HEADERS = {
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
}
"""Headers of all answers: a browser shows them as what they are called, and gives nothing of them to other sites."""
FRAME_POLICY = "frame-ancestors 'self'"
PAGE_POLICY = f"{FRAME_POLICY}; base-uri 'self'; object-src 'none'; form-action 'self'"
"""Content security policy of the page: no other site shows it in a frame, and it sends forms nowhere else."""
OF_PROJECT = (
    f"sandbox {forms.ALLOWED}; default-src 'none'; img-src data: blob:; media-src data: blob:; font-src data:; "
    f"style-src 'unsafe-inline'; script-src 'unsafe-inline'; base-uri 'none'; form-action 'none'; {FRAME_POLICY}"
)
"""That of the project's files, which may come from elsewhere: a report runs its program, but is not of the page's origin, and
has no network."""


def _with_headers(send: Send, path: str) -> Send:
    """Return how an answer is sent with the headers above; ``path`` is the one requested."""
    policy = OF_PROJECT if path.startswith(FILES) else PAGE_POLICY
    own = {**SECURITY_HEADERS, "content-security-policy": policy}

    async def sent(message: Message) -> None:
        if message["type"] == "http.response.start":
            others = [(name, value) for name, value in message.get("headers", ()) if name.lower().decode() not in own]
            message = {**message, "headers": [*others, *((name.encode(), value.encode()) for name, value in own.items())]}
        await send(message)

    return sent


class KeyMiddleware:
    """ASGI middleware that answers only requests with the key, addressed to this server by one of its hosts (with port), and
    not sent by other sites. No answer can be framed by other sites, and the project's files cannot act on the page.

    The key comes once in the address, and from then on in a cookie that scripts cannot read. A site that points its own name
    at this machine (DNS rebinding) fails by the name, another site's form or socket by its origin.
    """

    def __init__(self, app: ASGIApp, key: str, hosts: frozenset[str]):
        self.app, self.key, self.hosts = app, key, hosts
        self.cookie = f"softmodels-{sorted(hosts)[0].rpartition(':')[2]}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            return await self.app(scope, receive, send)
        send = _with_headers(send, scope["path"])
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


# ----------------------------------------------------------------------------------------------------------------------
# The frame around all pages: their names, light and dark.


STYLE = """
svg.section { width: 100%; max-height: 62vh; }
svg.section .scale-bar path { stroke: currentColor; fill: none; }
svg.section .scale-bar text { fill: currentColor; }
.two-columns { display: grid; grid-template-columns: minmax(0, 1fr); gap: 1rem; width: 100%; }
@media (min-width: 900px) {
  .two-columns { grid-template-columns: 22rem minmax(0, 1fr); }
  .picture-first { grid-template-rows: auto 1fr; }
  .picture-first > :first-child { grid-column: 2; }
  .picture-first > :nth-child(2) { grid-area: 1 / 1 / span 2; align-self: start; }
}
.q-header { flex-wrap: nowrap; }
.q-header .q-tabs { min-width: 0; }
@media (max-width: 700px) {
  .q-header { flex-wrap: wrap; }
  .q-header > :first-child { margin-right: auto; }
  .q-header .q-tabs { order: 1; flex: 1 0 100%; }
  .q-header .q-tab__content { flex-direction: column; min-width: 0; }
  .q-header .q-tab__label { font-size: 10px; line-height: 1.2; margin: 0; text-transform: none; }
  .q-header .q-tab { min-width: 0; padding: 0 3px; }
}
.colour-bar { display: flex; gap: 0.6rem; align-items: center; font-size: 0.85rem; max-width: 30rem; margin: 0 auto; }
.colour-bar div { flex: 1 0 6rem; height: 0.7rem; }
.brand { font-size: 1rem; line-height: 1.5rem; font-weight: 700; margin: 0; }
.q-tab--inactive { opacity: 1; }
.quiet { color: #616161; }
.body--dark .quiet { color: #bdbdbd; }
.body--dark .nicegui-content { --q-negative: #ff8a80; }
.body--dark :is(.q-btn--flat, .q-btn--outline, .q-field, .q-slider, .q-toggle) { --q-primary: #8ec5f4; }
.body--dark a { color: #8ec5f4; }
.photograph svg polyline { fill: none; stroke-width: 2.5; vector-effect: non-scaling-stroke; }
.photograph svg .traced { stroke: #e6194b; }
.photograph svg .band { fill: #e6194b; fill-opacity: 0.3; stroke: none; }
.cures { outline: 2px solid #f58231; outline-offset: 3px; border-radius: 4px; }
.photograph svg .simulated { stroke: #f5d90a; }
.photograph svg .zero { stroke: #0082c8; stroke-dasharray: 8 5; }
.photograph svg circle { fill: none; stroke: #3cb44b; stroke-width: 2; }
.photograph svg .handle { fill: #0082c8aa; stroke: white; }
.photograph svg .roi { fill: none; stroke: #f58231; stroke-width: 2.5; }
.photograph svg .mask { fill: #f5823166; stroke: #f58231; stroke-width: 1.5; }
.photograph img { touch-action: none; }
img.stored { max-height: 60vh; max-width: 100%; margin: 0 auto; display: block; border-radius: 4px; }
.outdated { opacity: 0.4; }
.steps { display: grid; grid-template-columns: repeat(auto-fill, minmax(17rem, 1fr)); gap: 0.75rem; width: 100%; }
iframe { width: 100%; height: 80vh; border: 0; background: white; }
.nicegui-content { padding: 0.75rem; }
"""

ICON = "🎈"
BLUE = "#1f5f99"
"""Of buttons and the head of the page: white on it has a contrast of 6.6."""
HEAD = """<script>
document.documentElement.lang = "en";
new MutationObserver(() => document.querySelectorAll("img:not([alt])").forEach(img =>
  img.alt = img.closest("[aria-label]")?.getAttribute("aria-label") ?? ""
)).observe(document, {childList: true, subtree: true});
</script>"""
"""The page's language, and words for pictures that NiceGUI leaves without."""


class HistoryButtons(forms.TabPage):
    """Undo and redo of what the project's results are made of, in the head of the page and by keys."""

    def __init__(self, bench: Bench):
        super().__init__(bench)
        self.buttons = {}
        for by, (icon, keys) in {-1: ("undo", "Ctrl+Z"), 1: ("redo", "Ctrl+Shift+Z")}.items():
            with ui.button(icon=icon, on_click=lambda by=by: self._go(by)).props("flat round dense color=white") as button:
                tooltip = ui.tooltip("")
            self.buttons[by] = forms.with_attribute(button, "aria-label", icon), tooltip, f"{icon} ({keys})"
        ui.keyboard(self._key, ignore=["input", "textarea"])  # which have an undo of their own
        for changed in (self.project.changed, bench.photographs.changed):
            changed.subscribe(lambda _: self._show())
        self._show()

    def _show(self) -> None:
        for by, (button, tooltip, what) in self.buttons.items():
            change = self.project.history.change_of(by)
            button.set_enabled(bool(change))
            tooltip.set_text(f"{what}: {change}" if change else what)

    async def _key(self, event: KeyEventArguments) -> None:
        if event.action.keydown and (event.modifiers.ctrl or event.modifiers.meta) and str(event.key).lower() in ("z", "y"):
            await self._go(1 if event.modifiers.shift or str(event.key).lower() == "y" else -1)

    async def _go(self, by: int) -> None:
        try:
            lost = await self.bench.step(by)
        except OSError as error:
            lost = errors.reason(error)
        if lost:
            ui.notify(lost, type="warning")


def build_page(bench: Bench) -> None:
    """Build the page of one tab."""

    def go(name: str) -> None:
        tabs.set_value(name)

    pages = {
        "Start": ("home", lambda bench: start.StartPage(bench, go)),
        "Photographs": ("photo_camera", photographs.PhotographsPage),
        "Material": ("science", making.MaterialPage),
        "Device": ("tune", device.DevicePage),
        "Overlay": ("layers", photographs.OverlayPage),
        "Design": ("auto_fix_high", making.DesignPage),
        "Mould": ("view_in_ar", making.MouldPage),
    }
    ui.add_css(STYLE)
    ui.add_head_html(HEAD)
    ui.colors(primary=BLUE)
    tabs: ui.tabs
    with ui.header(elevated=False).classes("items-center gap-2 py-1"):
        ui.html('<h1 class="brand">softmodels</h1>', sanitize=False)
        with ui.tabs().props("dense mobile-arrows inline-label").classes("grow") as tabs:
            for name, (icon, _) in pages.items():
                forms.with_attribute(ui.tab(name, icon=icon), "aria-label", name)
        HistoryButtons(bench)
        if bench.address:
            with ui.button(icon="qr_code").props('flat round dense color=white aria-label="phone"'), ui.menu():
                ui.html(segno.make(bench.address).svg_inline(scale=5, light="white"), sanitize=False)
        dark = ui.dark_mode(None)
        switch = ui.button(icon="dark_mode", on_click=lambda: dark.set_value(not dark.value))
        switch.props('flat round dense color=white aria-label="light or dark"')
    # A panel that slides in takes no clicks for half a second.
    with ui.tab_panels(tabs, value="Start", animated=False).classes("w-full bg-transparent"):
        for name, (_, page) in pages.items():
            with ui.tab_panel(name).classes("p-0"):
                page(bench)


def zipped(project: Path, place: str) -> Response:
    """Return the answer with a project, or a folder of its results, as a ZIP file."""
    try:
        made = packing.pack(project, place)
    except (OSError, ValueError) as error:  # a FieldError, or a text that is no path
        return PlainTextResponse(errors.reason(error), 404)
    name = "-".join(filter(None, (project.name, Path(place).name)))
    return FileResponse(made, filename=f"{name}.zip", background=BackgroundTask(made.unlink))


def serve(folder: Path, port: int | None = None, *, browser: bool = True, lan: bool = False) -> None:
    """Serve a project's page until Ctrl-C, in the user's browser if wanted, on a free port if none is given; over ``lan``
    other machines of the network may connect, with the key. OSError if the folder or the port cannot be used."""
    host = "0.0.0.0" if lan else LOCAL_HOST
    port = free_port(host, port)
    outside = lan_address() if lan else LOCAL_HOST
    key = secrets.token_urlsafe(24)
    hosts = frozenset(f"{name}:{port}" for name in (LOCAL_HOST, "localhost", outside))
    bench = Bench(Project(folder), f"http://{outside}:{port}/?{KEY}={key}" if lan else "")
    app.on_startup(bench.begin)
    app.on_shutdown(bench.end)
    address = f"http://{LOCAL_HOST}:{port}/?{KEY}={key}"

    async def tell() -> None:
        while not await answers(port):  # handlers of the start run before the server listens
            await asyncio.sleep(0.05)
        processes.say(f"softmodels: {address}\nCtrl-C stops it; the project is {folder}")
        if lan:
            processes.say(f"on the same network: {bench.address}")
        if browser:
            webbrowser.open(address)

    app.on_startup(lambda: background_tasks.create(tell()))
    app.add_static_files(FILES, bench.project.folder, max_cache_age=0)
    app.add_api_route(forms.ZIP, lambda place="": zipped(bench.project.folder, place))
    core.app.add_middleware(KeyMiddleware, key=key, hosts=hosts)  # type: ignore[arg-type]
    ui.run(
        lambda: build_page(bench), host=host, port=port, title="softmodels", show=False, reload=False, dark=None, favicon=ICON,
        show_welcome_message=False, reconnect_timeout=30.0, uvicorn_logging_level="error", storage_secret=None,
    )  # fmt: skip
