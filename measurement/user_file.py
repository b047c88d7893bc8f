"""Opening files that a user names or that came with somebody else's folder: regular files only, up to a size.

A named pipe waits for ever, a device such as ``/dev/zero`` never ends, and both can be behind a name in a foreign case file,
list of photographs or folder of results. What is refused is an `OSError`, so that whoever reads a file has one kind of error.
"""

from __future__ import annotations

import errno
import hashlib
import os
import stat
from pathlib import Path

TEXT = 100_000_000
"""Bytes of a table or text at most: a test machine that writes 1 kHz for an hour fills 100 MB."""
GEOMETRY = 4_000_000_000
"""Bytes of a drawing or mesh at most."""
CHUNK = 1 << 20
_KINDS = (
    (stat.S_ISDIR, "a folder"), (stat.S_ISFIFO, "a named pipe"), (stat.S_ISCHR, "a device"), (stat.S_ISBLK, "a device"),
    (stat.S_ISSOCK, "a socket"),
)  # fmt: skip


class UserFileError(OSError):
    """A file that is not opened; its ``strerror`` is the reason, as the system's own are."""

    def __init__(self, path: Path | str, reason: str):
        super().__init__(errno.EINVAL, reason, str(path))


def check_file(path: Path | str, largest: int = GEOMETRY) -> None:
    """Check a file before a library opens it by its name.

    Args:
        path: The file; links are followed.
        largest: Its bytes at most.

    Raises:
        OSError: It cannot be opened, is not a regular file, or is larger.
    """
    os.close(_opened(path, largest))


def read_file(path: Path | str, largest: int = TEXT) -> bytes:
    """Read a whole file; `OSError` as of `check_file`."""
    handle = _opened(path, largest)
    try:
        data = bytearray()
        while part := os.read(handle, CHUNK):  # one of /proc has more bytes than its size says
            data += part
            if len(data) > largest:
                raise UserFileError(path, _too_large(largest))
        return bytes(data)
    finally:
        os.close(handle)


def read_text(path: Path | str, largest: int = TEXT) -> str:
    """Read a text in UTF-8, a byte order mark left out.

    Raises:
        OSError: As of `check_file`.
        UnicodeDecodeError: It is no such text.
    """
    return read_file(path, largest).decode("utf-8-sig")


def file_digest(path: Path | str) -> str:
    """SHA-256 of a file's content, in hexadecimal digits; `OSError` as of `check_file`."""
    with os.fdopen(_opened(path, GEOMETRY), "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _opened(path: Path | str, largest: int) -> int:
    # Without O_NONBLOCK, opening a pipe waits for its other end.
    handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    try:
        status = os.fstat(handle)
        if not stat.S_ISREG(status.st_mode):
            kind = next((name for test, name in _KINDS if test(status.st_mode)), "no file")
            raise UserFileError(path, f"it is {kind}, not a regular file")
        if status.st_size > largest:
            raise UserFileError(path, _too_large(largest))
    except BaseException:
        os.close(handle)
        raise
    return handle


def _too_large(largest: int) -> str:
    return f"it is larger than {largest / 1e6:g} MB"
