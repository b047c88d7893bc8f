"""Bad uploads and inputs by the hundred: a sentence each, and nothing in the project is lost."""

from __future__ import annotations

import ast
import asyncio
import errno
import functools
import io
import json
import random
import socket
import struct
import zipfile
import zlib
from pathlib import Path

import pytest

pytest.importorskip("nicegui")

from nicegui import Client, ui
from nicegui.page import page
from PIL import Image

import softmodels as sm
from measurement.series.photo_list import ColumnError
from softmodels.app import making, tracing
from softmodels.app.bench import CASE, Photographs, Project
from softmodels.app.forms import page_words, with_field
from softmodels.app.jobs import AnswerError
from softmodels.app.making import CURVE
from softmodels.app.server import LARGEST_UPLOAD, KeyMiddleware, free_port
from softmodels.case.entries import INPUT_ERRORS
from softmodels.case.load import steps_of
from softmodels.common.errors import FieldError, reason
from softmodels.common.units import UnitError

ERRORS = (AnswerError, ColumnError, FieldError, UnitError, OSError, *INPUT_ERRORS)
"""What the page shows as a sentence."""


class Direct:
    """Answers as the warm process does, in this one."""

    async def ask(self, function, *args, kind=""):
        try:
            return getattr(tracing, function)(*args)
        except Exception as error:
            raise AnswerError(reason(error)) from None


@pytest.fixture
def photographs(tmp_path):
    project = Project(tmp_path / "project")
    project.change()
    found = Photographs(project, Direct())
    asyncio.run(found.add("good.png", picture("PNG")))
    return found


def picture(kind, size=(64, 48)):
    data = io.BytesIO()
    Image.new("RGB", size, (200, 190, 180)).save(data, kind)
    return data.getvalue()


def chunk(name, data):
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def huge_png(width, height):
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    body = zlib.compress(bytes(1 << 20), 9)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", body) + chunk(b"IEND", b"")


def zip_bomb():
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as package:
        package.writestr("xl/worksheets/sheet1.xml", bytes(20 << 20))
    return data.getvalue()


def bad_photographs():
    """Names and contents of files that are no photographs or lists of them."""
    dice = random.Random(1)
    names = [
        "a.jpg", "../../a.jpg", "..\\a.jpg", "/etc/passwd.jpg", "a\0.jpg", "<script>alert(1)</script>.jpg", "n" * 300 + ".jpg",
        "Größe 9 µm.jpg", "写真.JPG", "a\n.png", "a b;c'd\".png", "\u202egnp.exe.png", "con.tiff", "%2e%2e%2fa.webp", "a.heic",
    ]  # fmt: skip
    contents = [
        b"",
        b"text",
        dice.randbytes(4000),
        b"<svg xmlns='http://www.w3.org/2000/svg'/>",
        b"%PDF-1.7\n%%EOF",
        zip_bomb(),
    ]
    yield from ((name, dice.choice(contents)) for name in names for _ in range(2))
    for kind, ending in (
        ("JPEG", "jpg"),
        ("PNG", "png"),
        ("TIFF", "tif"),
        ("GIF", "gif"),
        ("BMP", "bmp"),
        ("WEBP", "webp"),
    ):
        whole = picture(kind, (640, 480))
        yield from ((f"cut.{ending}", whole[: int(len(whole) * share)]) for share in (0.02, 0.3))
        yield f"head.{ending}", whole[:12]
    yield from ((f"{w}x{h}.png", huge_png(w, h)) for w, h in ((60000, 60000), (2**31 - 1, 1), (0, 0)))
    yield from ((name, picture("PNG")) for name in ("a.exe", ".png", "png", "", "a.png.html", "a.svg"))
    for text in (
        b"", b"\0\0", b"\xff\xfe\xff", b"file,pressure\n", b"file,pressure\ngood.png\n", b"file,pressure\ngood.png,nan\n",
        b"file,pressure\ngood.png,1e999 cm\n", b"file,pressure\ngood.png,one\n", b"file,pressure,use\ngood.png,1 cm,maybe\n",
        b"file,pressure,hold\ngood.png,1 cm,2 s\n", b"a" * 100000, b"file,pressure\n../../x\0.png,1 cm\n",
    ):  # fmt: skip
        yield "list.csv", text


def state(project):
    return {file: file.read_bytes() for file in Path(project.folder).rglob("*") if file.is_file()}


def is_sentence(error):
    text = page_words(reason(error))
    assert text.strip() and "Traceback" not in text and "Errno" not in text, text
    return True


def test_bad_uploads_get_a_sentence_and_leave_nothing_behind(photographs):
    project, count = photographs.project, 0
    before, listed = state(project), list(photographs.listed)
    for name, data in bad_photographs():
        with pytest.raises(ERRORS) as found:
            asyncio.run(photographs.add(name, data))
        assert is_sentence(found.value), name
        assert state(project) == before and list(photographs.listed) == listed, name
        count += 1
    for name in ("a.exe", "", "a.xlsx.sh", "../a", "x" * 400):
        with pytest.raises(FieldError, match="curves are CSV or Excel"):
            project.keep("curves", name, b"1", CURVE)
        count += 1
    assert count >= 60 and state(project) == before


NUMBERS = (
    "nan mm",
    "inf mm",
    "-3 mm",
    "0 mm",
    "1e400 mm",
    "3 kg",
    "three",
    "",
    "3 mm; DROP",
    "3 mm" * 200,
    "\0",
)
PRESSURES = ("nan", "0:nan cm", "0:1e999 cm", "a:b", "", "1 kg")
CASES = (
    "name = ", "\0", "[device]\nkind = 3", "[device]\nmembrane = '-1 mm'", "a" * 10_000, "x = [" * 2000, "[rigid]\nface = 7",
    "name = '../../x'\n[device]\n", "[gravity]\ndirection = 'sideways'", "pressures_cm = nan", "[load]\npressures_cm = ['<b>']",
)  # fmt: skip


def test_bad_inputs_get_a_sentence_and_change_nothing(photographs):
    project, count = photographs.project, 0
    one = photographs.listed["good.png"]
    asyncio.run(photographs.change({"good.png": {"pressure": "5 cm"}}))
    before, case, row = state(project), project.case, one.row
    device, change = sm.HollowDisk(section="axisymmetric"), photographs.change
    lengths = [(name, text) for name in ("membrane", "wall") for text in NUMBERS]
    tries = [
        *(functools.partial(with_field, device, name, text) for name, text in lengths),
        *(functools.partial(steps_of, pressure=text) for text in PRESSURES),
        *(
            lambda text=text: asyncio.run(change({"good.png": {"pressure": text}}))
            for text in ("nan cm", "5", "one cm", "\0", "5 mm kg")
        ),
        *(functools.partial(project.change_text, text) for text in CASES),
        lambda: project.change(steps=steps_of(pressure_cm=(float("nan"),))),
    ]
    for number, bad in enumerate(tries):
        with pytest.raises(ERRORS) as found:
            bad()
        assert is_sentence(found.value), number
        assert state(project) == before and project.case == case and one.row == row, number
        count += 1
    assert count >= 40


@pytest.mark.parametrize("written", ["name = 'x'\n[device\n", "[device]\nmembrane = '-1 mm'\n"])
def test_a_case_that_cannot_be_used_is_kept_until_it_is_corrected(written, tmp_path):
    (tmp_path / CASE).write_text(written)
    project = Project(tmp_path)
    assert project.case_error and project.case_text == written
    with pytest.raises(INPUT_ERRORS, match="cannot be used"):
        project.change(steps=steps_of(pressure_cm=(3.0,)))
    assert (tmp_path / CASE).read_text() == written
    project.set_aside()
    assert (tmp_path / "case-aside.toml").read_text() == written and not project.case_error
    project.change(steps=steps_of(pressure_cm=(3.0,)))
    text = "# mine\n" + project.case.to_toml() + "\n[gravity]\ndirection = '-z'\n"
    project.change_text(text)
    assert project.case.components and (tmp_path / CASE).read_text() == text


def test_what_another_program_writes_is_not_overwritten(tmp_path):
    project = Project(tmp_path)
    project.change()
    text = (
        "# mine\n"
        + sm.Case("mine", sm.HollowDisk(section="axisymmetric"), "ecoflex-00-30", steps=steps_of(pressure_cm=(7.0,))).to_toml()
    )
    (tmp_path / CASE).write_text(text)
    with pytest.raises(INPUT_ERRORS, match="another program"):
        project.change(steps=steps_of(pressure_cm=(3.0,)))
    assert (tmp_path / CASE).read_text() == text and [value.number for value in project.case.values] == [7.0]


def test_a_full_disk_is_told_and_loses_nothing(photographs, monkeypatch):
    project, one = photographs.project, photographs.listed["good.png"]
    asyncio.run(photographs.change({"good.png": {"pressure": "5 cm"}}))
    before, case, row, tone = state(project), project.case, one.row, photographs.tone

    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    for name in ("write_text", "write_bytes"):
        monkeypatch.setattr(Path, name, full)
    for work in (
        lambda: project.change(steps=steps_of(pressure_cm=(3.0,))), lambda: project.change_text(case.to_toml()),
        lambda: asyncio.run(photographs.change({"good.png": {"pressure": "6 cm"}})),
        lambda: asyncio.run(photographs.take_tone("linear")),
        lambda: asyncio.run(photographs.add("b.png", picture("PNG"))),
    ):  # fmt: skip
        with pytest.raises(OSError) as found:
            work()
        assert reason(found.value) == "No space left on device"
    monkeypatch.undo()
    assert state(project) == before and list(photographs.listed) == ["good.png"]
    assert (project.case, one.row, photographs.tone) == (case, row, tone)
    assert not list(project.folder.glob("*.part"))


# -- Who may speak to the page: the key, this server's name, this server's own requests, and no more bytes than a be--


KEY, HOST = "a-key", "127.0.0.1:8700"
COOKIE = ("cookie", f"softmodels-8700={KEY}")


def answered(path="/", *headers, method="GET", kind="http", host=HOST, given=()):
    """Return status and headers of a request through the guard; 200 where it was let through, with headers given to it."""
    sent = []

    async def inner(scope, receive, send):
        if kind == "http":
            return await send({"type": "http.response.start", "status": 200, "headers": list(given)})
        sent.append({"type": "passed"})

    async def send(message):
        sent.append(message)

    where, _, query = path.partition("?")
    named = [(name.encode(), value.encode("latin-1")) for name, value in (("host", host), *headers)]
    scope = {"type": kind, "method": method, "path": where, "query_string": query.encode(), "headers": named}
    asyncio.run(KeyMiddleware(inner, KEY, frozenset({HOST, "localhost:8700"}))(scope, None, send))
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


def policy(headers):
    """Content security policy by its directives."""
    parts = (part.split() for part in headers["content-security-policy"].split(";"))
    return {name: set(values) for name, *values in parts}


@pytest.mark.parametrize("path", ["/", "/_nicegui/3.18.0/static/x.js", "/files/results/fit/report.html", "/?token=x"])
@pytest.mark.parametrize("cookie", [(), (COOKIE,)])
def test_no_answer_can_be_framed_or_taken_for_something_else(path, cookie):
    """Refusals and what the key leads to as well."""
    for _, headers in (answered(path, *cookie), answered(f"{path.partition('?')[0]}?token={KEY}", *cookie)):
        assert headers["x-content-type-options"] == "nosniff" and headers["referrer-policy"] == "no-referrer"
        assert policy(headers)["frame-ancestors"] == {"'self'"}


def test_files_of_the_project_have_neither_the_pages_origin_nor_a_network():
    weak = ((b"Content-Security-Policy", b"default-src *"), (b"content-type", b"text/html"))
    status, headers = answered("/files/results/fit/report.html", COOKIE, given=weak)
    rules = policy(headers)
    assert status == 200 and headers["content-type"] == "text/html" and "Content-Security-Policy" not in headers
    assert "allow-scripts" in rules["sandbox"] and "allow-same-origin" not in rules["sandbox"]
    assert rules["default-src"] == {"'none'"} and "connect-src" not in rules and "frame-src" not in rules
    assert rules["img-src"] == {"data:", "blob:"} and rules["script-src"] == {"'unsafe-inline'"}
    assert "sandbox" not in policy(answered("/", COOKIE)[1])


def test_a_port_in_use_is_told():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(OSError):
            free_port("127.0.0.1", taken.getsockname()[1])
    assert 8700 <= free_port("127.0.0.1") < 8800


NAME = 'x" onclick="alert(1)" y.stl'
"""Of a file in a foreign project: in the text that ``props`` takes it would end the quotes."""


def test_a_files_name_stays_one_attribute(tmp_path):
    folder = tmp_path / making.MOULD
    folder.mkdir(parents=True)
    (folder / NAME).touch()
    with Client(page("/"), request=None):
        shown = making.MouldPage.__new__(making.MouldPage)
        shown.project, shown.files, shown.exploded = Project(tmp_path), ui.column(), ui.html("", sanitize=False)
        shown._show()
    _, link = shown.files.default_slot.children  # below their heading
    assert link.props["download"] == NAME and "onclick" not in link.props


def test_no_name_is_written_between_quotes_of_properties():
    found = []
    for file in sorted(Path(making.__file__).parent.glob("*.py")):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Call) and getattr(node.func, "attr", "") == "props":
                texts = [part for one in node.args if isinstance(one, ast.JoinedStr) for part in one.values]
                found += [f"{file.name}:{node.lineno}" for one in texts if '"' in str(getattr(one, "value", ""))]
    assert not found


@pytest.mark.parametrize("text", ["[]", "3", "null", '{"laws": 3}', '{"laws": [3], "chosen": "yeoh"}', "[" * 100_000])
def test_a_fit_of_something_else_is_no_fit(text, tmp_path):
    (tmp_path / "fit.json").write_text(text)
    assert making.fitted_law(tmp_path / "fit.json") is None


def test_a_fits_parameters_have_their_intervals(tmp_path):
    one = {"name": "c1", "value": 14e3, "unit": "Pa", "fixed": False, "interval_95": [13e3, 15e3]}
    fit = {"chosen": "yeoh", "verdict": "usable", "laws": [{"law": "yeoh", "parameters": [one]}]}
    (tmp_path / "fit.json").write_text(json.dumps(fit))
    assert making.fitted_law(tmp_path / "fit.json") == ([("c1", "14 kPa", "95 %: 13 kPa to 15 kPa")], "usable")
