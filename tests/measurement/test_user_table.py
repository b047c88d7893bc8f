"""Tables that users name: workbooks as hostile as texts, and how each is read."""

from __future__ import annotations

import io
import zipfile

import openpyxl
import pytest

from softmodels.common import tables
from softmodels.common.files import UserFileError
from softmodels.common.tables import MAX_COLUMNS, pick, read_sheets, records


def workbook(*rows, hidden=()):
    book = openpyxl.Workbook()
    for row in rows:
        book.active.append(row)
    for name in hidden:
        book.create_sheet(name).sheet_state = "hidden"
    data = io.BytesIO()
    book.save(data)
    return data.getvalue()


def changed(data, part, change):
    """A workbook with one of its parts changed."""
    made = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as new:
        for name in old.namelist():
            if name != part:
                new.writestr(name, old.read(name))
            elif (text := change(old.read(name).decode())) is not None:
                new.writestr(name, text)
    return made.getvalue()


def table(tmp_path, data):
    path = tmp_path / "table.xlsx"
    path.write_bytes(data)
    return path


SHEET = "xl/worksheets/sheet1.xml"
BOOK = workbook(["a", "b"], [1, 2.5])
LAUGHS = (
    f"<!DOCTYPE x [<!ENTITY a '{'ha' * 100}'>"
    + "".join(f"<!ENTITY {b} '{f'&{a};' * 10}'>" for a, b in zip("abcdef", "bcdefg", strict=True))
    + "]>"
)


@pytest.mark.parametrize(
    "data",
    [
        BOOK[: len(BOOK) // 2],
        b"PK\x03\x04" + bytes(1000),
        changed(BOOK, "[Content_Types].xml", lambda text: None),
        changed(BOOK, "xl/workbook.xml", lambda text: None),
        changed(BOOK, SHEET, lambda text: None),
        changed(BOOK, SHEET, lambda text: text[:-30]),
        changed(BOOK, SHEET, lambda text: text.replace("<v>2.5</v>", "<v>" + "9" * 5000 + "</v>")),
        changed(BOOK, SHEET, lambda text: text.replace('t="n"><v>1<', 't="s"><v>99<')),
        changed(BOOK, SHEET, lambda text: text.replace('r="A2"', 'r="A-2"')),
        changed(BOOK, SHEET, lambda text: LAUGHS + text.replace("2.5", "&g;")),
    ],
)
def test_what_is_no_workbook_or_a_damaged_one_is_refused(data, tmp_path):
    with pytest.raises(UserFileError, match=r"not an Excel workbook .*, or a damaged one; save it again"):
        read_sheets(table(tmp_path, data))


def test_a_bomb_is_refused_before_it_is_unpacked(tmp_path, monkeypatch):
    """A thousandth of what it unpacks to."""
    bomb = changed(BOOK, "docProps/app.xml", lambda text: "0" * 11_000_000)
    monkeypatch.setattr(tables.files, "MAX_TEXT_BYTES", 10_000_000)
    monkeypatch.setattr(tables, "_read_workbook", None)
    assert len(bomb) < 20_000
    with pytest.raises(UserFileError, match=r"unpacked, its sheets have 11.02 MB, but at most 10 MB are read"):
        read_sheets(table(tmp_path, bomb))


@pytest.mark.parametrize("many", ["<c/>" * 600_000, "<c " + " ".join(f'a{i}=""' for i in range(600_000)) + "/>"])
def test_a_row_that_would_fill_the_memory_is_refused_before_it_is_parsed(many, tmp_path, monkeypatch):
    monkeypatch.setattr(tables, "_read_workbook", None)
    data = changed(BOOK, SHEET, lambda text: text.replace("</row>", many + "</row>"))
    with pytest.raises(UserFileError, match="a row of its sheets, or its styles, have over 500000 parts; save it as CSV"):
        read_sheets(table(tmp_path, data))


def test_a_size_that_the_archive_hides_is_refused(tmp_path):
    """The directory of the archive says ten bytes."""
    size = len(zipfile.ZipFile(io.BytesIO(BOOK)).read(SHEET))
    data = BOOK.replace(size.to_bytes(4, "little"), (10).to_bytes(4, "little"))
    assert data != BOOK
    with pytest.raises(UserFileError, match="or a damaged one"):
        read_sheets(table(tmp_path, data))


@pytest.mark.parametrize("cell", ["A1048576", "XFD1048576", "A999999999"])
def test_a_cell_at_the_far_end_makes_no_rows_without_end(cell, tmp_path):
    row = cell.lstrip("ABCDEFGHIJKLMNOPQRSTUVWXYZ")
    data = changed(BOOK, SHEET, lambda text: text.replace('<row r="2"', f'<row r="{row}"').replace('"B2"', f'"{cell}"'))
    (sheet,) = read_sheets(table(tmp_path, data))
    assert len(sheet.rows) <= 3 and all(len(cells) <= MAX_COLUMNS for _, cells in sheet.rows)


def test_a_wrong_dimension_hides_nothing(tmp_path):
    data = changed(BOOK, SHEET, lambda text: text.replace('ref="A1:B2"', 'ref="A1"'))
    assert data != BOOK
    (sheet,) = read_sheets(table(tmp_path, data))
    assert sheet.rows == [(1, ["a", "b"]), (2, ["1", "2.5"])]


def test_texts_that_the_cells_share_are_read(tmp_path):
    """As Excel itself writes them."""
    kind = "application/vnd.openxmlformats-officedocument.spreadsheetml.sharedStrings+xml"
    part = f'<Override PartName="/xl/sharedStrings.xml" ContentType="{kind}"/></Types>'
    data = changed(BOOK, "[Content_Types].xml", lambda text: text.replace("</Types>", part))
    data = changed(data, SHEET, lambda text: text.replace('t="n"><v>1<', 't="s"><v>1<'))
    made = io.BytesIO(data)
    with zipfile.ZipFile(made, "a") as archive:
        space = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
        archive.writestr("xl/sharedStrings.xml", f'<sst xmlns="{space}"><si><t>a</t></si><si><t>c</t></si></sst>')
    assert read_sheets(table(tmp_path, made.getvalue()))[0].rows[1] == (2, ["c", "2.5"])


def test_hidden_sheets_and_comments_are_left_out(tmp_path):
    (sheet,) = read_sheets(table(tmp_path, workbook(["# by", "me"], [], ["a", "b"], [None, 0.1], hidden=["Raw"])))
    assert sheet.name == "Sheet" and sheet.rows == [(3, ["a", "b"]), (4, ["", "0.1"])]
    assert records(sheet.rows) == [(4, {"a": "", "b": "0.1"})]


def test_an_empty_text_of_a_formula_is_no_missing_value(tmp_path):
    """The cached value of ="" is an empty text; a formula without any value stays visible as one."""
    book = workbook(["a", "=A1&A1", '=""'])
    assert read_sheets(table(tmp_path, book))[0].rows == [(1, ["a", "=A1&A1", '=""'])]
    known = changed(book, SHEET, lambda text: text.replace('<c r="C1">', '<c r="C1" t="str">'))
    assert read_sheets(table(tmp_path, known))[0].rows == [(1, ["a", "=A1&A1"])]


def test_a_cell_without_end_is_a_sentence(tmp_path):
    """The limit of the reader of texts is 131,072 characters."""
    path = table(tmp_path, b'a,b\n1,"' + b"2" * 200_000)
    with pytest.raises(UserFileError, match=r"it is not a table .field larger than field limit"):
        pick(path, read_sheets(path), lambda sheet: sheet.rows if len(sheet.rows) > 5 else None)
