"""Files that users name: only regular files are opened, and nothing waits for a pipe or reads a device."""

from __future__ import annotations

import os

import pytest

from measurement.camera import CameraError, _database_file
from measurement.outline.outline import Outline, OutlineError
from measurement.pictures import Unmeasurable, read_pixels
from measurement.series.photo_list import PhotoListError, read_photos
from softmodels.common.files import UserFileError, check_file, file_digest, read_file, read_text, replace_text
from softmodels.common.folders import FolderLock, has_table, is_drawn
from softmodels.common.tables import TomlError, read_toml


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
    assert caught.value.strerror in {
        f"it is a {kind}, not a regular file" for kind in ("folder", "named pipe", "device")
    }


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
    replace_text(tmp_path / "case.toml", "theirs")
    assert mine.read_text() == "mine" and (tmp_path / "case.toml").read_text() == "theirs"
