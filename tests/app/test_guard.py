"""Who may speak to the page: the key, this server's name, this server's own requests, and no more bytes than a bench needs."""

from __future__ import annotations

import asyncio
import socket

import pytest

pytest.importorskip("nicegui")

from softmodels.app.server import LARGEST_UPLOAD, Guard, free_port

KEY, HOST = "a-key", "127.0.0.1:8700"
COOKIE = ("cookie", f"softmodels-8700={KEY}")


def answered(path="/", *headers, method="GET", kind="http", host=HOST):
    """Return status and headers of a request through the guard; 200 where it was let through."""
    sent = []

    async def inner(scope, receive, send):
        sent.append({"type": "passed"})

    async def send(message):
        sent.append(message)

    where, _, query = path.partition("?")
    named = [(name.encode(), value.encode("latin-1")) for name, value in (("host", host), *headers)]
    scope = {"type": kind, "method": method, "path": where, "query_string": query.encode(), "headers": named}
    asyncio.run(Guard(inner, KEY, frozenset({HOST, "localhost:8700"}))(scope, None, send))
    first = sent[0]
    if first["type"] == "passed":
        return 200, {}
    if first["type"] == "websocket.close":
        return first["code"], {}
    return first["status"], {name.decode(): value.decode() for name, value in first["headers"]}


def test_the_key_is_kept_in_a_cookie_and_leaves_the_address():
    status, headers = answered(f"/here?token={KEY}&tab=Device")
    assert (status, headers["location"]) == (303, "/here?tab=Device")
    assert headers["set-cookie"].startswith(f"softmodels-8700={KEY};")
    assert "HttpOnly" in headers["set-cookie"] and "SameSite" in headers["set-cookie"]
    assert answered("/", COOKIE)[0] == 200


@pytest.mark.parametrize("path", ["/", "/?token=", "/?token=other", "/files/case.toml", "/_nicegui/3.18.0/static/x.js"])
@pytest.mark.parametrize("cookie", [None, ("cookie", "softmodels-8700=wrong"), ("cookie", "softmodels-8700=")])
def test_nothing_is_answered_without_the_key(path, cookie):
    assert answered(path, *([cookie] if cookie else []))[0] == 403
    assert answered(path, *([cookie] if cookie else []), method="POST")[0] == 403
    assert answered(path, *([cookie] if cookie else []), kind="websocket")[0] == 1008


def test_another_sites_requests_are_refused_even_with_the_cookie():
    for origin in ("http://evil.example", "http://127.0.0.1:9999", "null"):
        assert answered("/", COOKIE, ("origin", origin), method="POST")[0] == 403
        assert answered("/", COOKIE, ("origin", origin), kind="websocket")[0] == 1008
    assert answered("/", COOKIE, ("origin", f"http://{HOST}"), kind="websocket")[0] == 200


def test_another_name_of_this_machine_is_refused():
    """As when a site lets its own name point at this machine (DNS rebinding)."""
    assert answered("/", COOKIE, host="evil.example:8700")[0] == 421
    assert answered(f"/?token={KEY}", host="evil.example:8700")[0] == 421


def test_the_address_leads_to_no_other_site():
    assert answered(f"//evil.example/?token={KEY}")[1]["location"] == "/evil.example/"
    assert answered(f"/\\evil.example/?token={KEY}")[1]["location"] == "/evil.example/"


def test_uploads_are_bounded():
    assert answered("/x", COOKIE, method="POST")[0] == 411
    assert answered("/x", COOKIE, ("content-length", "many"), method="POST")[0] == 411
    assert answered("/x", COOKIE, ("content-length", str(LARGEST_UPLOAD + 1)), method="POST")[0] == 413
    assert answered("/x", COOKIE, ("content-length", str(LARGEST_UPLOAD)), method="POST")[0] == 200


def test_a_port_in_use_is_told():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(OSError):
            free_port("127.0.0.1", taken.getsockname()[1])
    assert 8700 <= free_port("127.0.0.1") < 8800
