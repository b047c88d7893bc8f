"""Files that users name: only regular files are opened, and nothing waits for a pipe or reads a device."""

from __future__ import annotations

import os
import re

import pytest

from measurement.camera import CameraError, _database_file
from measurement.outline.outline import Outline, OutlineError
from measurement.pictures import Unmeasurable, read_pixels
from measurement.screen.setup import Setup, SetupError
from measurement.series.photo_list import PhotoListError, read_photos
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.case.materials import material_from
from softmodels.common.files import (
    UserFileError,
    check_file,
    file_digest,
    has_table,
    is_drawn,
    read_file,
    read_text,
    write_text,
)
from softmodels.common.folders import FolderLock
from softmodels.common.tables import TomlError, numbers, read_toml
from softmodels.materials.laws import MaterialError


@pytest.fixture(params=["pipe", "device", "link to a device", "folder"])
def odd(request, tmp_path):
    """Something that is no regular file."""
    path = tmp_path / "odd.csv"
    match request.param:
        case "pipe":
            os.mkfifo(path)
        case "device":
            return type(path)("/dev/zero")
        case "link to a device":
            path.symlink_to("/dev/zero")
        case "folder":
            path.mkdir()
    return path


@pytest.mark.parametrize("read", [check_file, read_file, read_text, file_digest])
def test_only_regular_files_are_opened(odd, read):
    with pytest.raises(UserFileError) as caught:
        read(odd)
    assert caught.value.strerror in {f"it is a {kind}, not a regular file" for kind in ("folder", "named pipe", "device")}


@pytest.mark.parametrize(
    ("read", "error"),
    [(read_toml, TomlError), (read_photos, PhotoListError), (Outline.from_csv, OutlineError),
     (read_pixels, Unmeasurable), (_database_file, CameraError)],
)  # fmt: skip
def test_every_reader_of_the_users_files_refuses_them_in_a_sentence(odd, read, error):
    with pytest.raises(error, match="not a regular file"):
        read(odd)


def test_what_is_in_the_way_of_an_output_is_no_earlier_one(odd):
    assert not has_table("camera")(odd) and not is_drawn(odd)


def test_sizes_are_bounded(tmp_path):
    file = tmp_path / "a.csv"
    file.write_bytes(b"\xef\xbb\xbfabc")
    assert read_file(file, 6) == b"\xef\xbb\xbfabc" and read_text(file) == "abc"
    for read in (check_file, read_file):
        with pytest.raises(UserFileError, match="larger than"):
            read(file, 5)
    with pytest.raises(UserFileError, match="larger than"):  # its size is said to be 0
        read_file("/proc/self/maps", 5)


def test_a_link_from_elsewhere_is_not_written_through(tmp_path):
    """A folder from somebody else may hold links with the names of locks and of files that are being written."""
    mine = tmp_path / "mine.txt"
    mine.write_text("mine")
    lock = tmp_path / "folder.lock"
    lock.symlink_to(mine)
    with pytest.raises(OSError, match=r"its lock folder.lock is a link; remove that"):
        FolderLock(lock).take()
    (tmp_path / "case.toml.part").symlink_to(mine)
    write_text(tmp_path / "case.toml", "theirs")
    assert mine.read_text() == "mine" and (tmp_path / "case.toml").read_text() == "theirs"


# -- TOML that is broken, giant or deep: refused with a reason, in a moment; a byte order mark does no harm ----------


BROKEN = {
    "no TOML": (b"a = ", "is not valid TOML"),
    "a number of 400 digits": (b"a = " + b"9" * 400, "(400 characters) does not fit into 64 bits"),
    "a number of 5,000 digits": (b"a = " + b"9" * 5000, "a whole number of thousands of digits"),
    "a number of 5,000 hexadecimal digits": (b"a = 0x" + b"f" * 5000, "does not fit into 64 bits"),
    "deep lists": (b"a = " + b"[" * 5000 + b"]" * 5000, "lists or tables"),
    "deeper lists": (b"a = " + b"[\n" * 100_000, "lists or tables"),
    "deep tables": (b"[" + b".".join([b"a"] * 60) + b"]\nb = 1", "lists or tables"),
    "a key of many parts": (b".".join([b"a"] * 5000) + b" = 1", "has more than 100 parts"),
    "a long line": (b'a = "' + b"x" * 100_000 + b'"', "has 100006 characters"),
    "a giant": (b"a = 1\n" * 1_000_000, "is larger than 2 MB"),
    "another encoding": ("a = 'é'".encode("utf-16"), "not UTF-8 text"),
    "a zero byte": (b"a = '\0'", "invalid character"),
    "a key twice": (b"a = 1\na = 2", "is not valid TOML"),
}


@pytest.mark.parametrize("kind", BROKEN)
def test_broken_files_are_a_sentence(kind, tmp_path):
    data, words = BROKEN[kind]
    path = tmp_path / "a.toml"
    path.write_bytes(data)
    with pytest.raises(TomlError, match=re.escape(words)) as refused:
        read_toml(path)
    assert len(str(refused.value)) < 400
    readers = [(Case.from_file, CaseError), (Setup.from_file, SetupError)]
    readers.append((lambda file: material_from(str(file), {}), MaterialError))
    for read, error in readers:
        with pytest.raises(error, match=re.escape(words)):
            read(path)


def test_files_that_are_not_there(tmp_path):
    for path in (tmp_path / "none.toml", tmp_path):
        with pytest.raises(TomlError, match=r"cannot be read \((No such file|it is a folder)"):
            read_toml(path)


def test_a_byte_order_mark_does_no_harm(tmp_path):
    case = tmp_path / "case.toml"
    text = '[geometry]\ndevice = "HollowDisk"\n[load]\npressure_cm = 20\n[material]\nsilicone = "ecoflex-00-30"\n'
    case.write_text(text, encoding="utf-8-sig")
    assert Case.from_file(case) == Case.from_toml(text) == Case.from_toml("\ufeff" + text)
    assert material_from(str(case), {}) == Case.from_file(case).material


def test_lists_of_numbers():
    assert numbers([[1, 2.5], [3, 4]]).tolist() == [[1.0, 2.5], [3.0, 4.0]] and numbers([]).shape == (0,)
    for value in ([1, "2"], [True], [[1, 2], [3]], 5, [1, [2]], [{}], [float("nan")]):
        with pytest.raises((TypeError, ValueError)):
            numbers(value)
