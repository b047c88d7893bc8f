"""Files of users: opened safely, recognised as a program's own, and written whole or not at all; pages from templates.

A named pipe waits for ever, a device such as ``/dev/zero`` never ends, and both can be behind a name in a foreign case file,
list of photographs or folder of results. What is refused is an `OSError`, so that whoever reads a file has one kind of error.
"""

from __future__ import annotations

import base64
import contextlib
import csv
import errno
import functools
import hashlib
import io
import json
import math
import os
import re
import stat
import tomllib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import h5py
    from jinja2 import Environment
    from markupsafe import Markup


MAX_TEXT_BYTES = 100_000_000
"""Bytes of a table or text at most: a test machine that writes 1 kHz for an hour fills 100 MB."""
MAX_GEOMETRY_BYTES = 4_000_000_000
CHUNK_BYTES = 1 << 20
_KINDS = (
    (stat.S_ISDIR, "a folder"), (stat.S_ISFIFO, "a named pipe"), (stat.S_ISCHR, "a device"), (stat.S_ISBLK, "a device"),
    (stat.S_ISSOCK, "a socket"),
)  # fmt: skip


class UserFileError(OSError):
    """A file that is not opened; its ``strerror`` is the reason, as the system's own are."""

    def __init__(self, path: Path | str, reason: str):
        super().__init__(errno.EINVAL, reason, str(path))


def check_file(path: Path | str, largest: int = MAX_GEOMETRY_BYTES) -> None:
    """Raise `OSError` before a library opens a file by its name: it cannot be opened, is not a regular one (links are
    followed), or has more bytes."""
    os.close(_open_file(path, largest))


def read_file(path: Path | str, largest: int = MAX_TEXT_BYTES) -> bytes:
    """Read a whole file; `OSError` as of `check_file`."""
    handle = _open_file(path, largest)
    try:
        data = bytearray()
        while part := os.read(handle, CHUNK_BYTES):  # one of /proc has more bytes than its stated size
            data += part
            if len(data) > largest:
                raise UserFileError(path, _too_large(largest))
        return bytes(data)
    finally:
        os.close(handle)


def read_text(path: Path | str, largest: int = MAX_TEXT_BYTES) -> str:
    """Read a text in UTF-8, a byte order mark left out; `OSError` as `check_file`, `UnicodeDecodeError` if it is no such
    text."""
    return read_file(path, largest).decode("utf-8-sig")


def parse_json(text: str | bytes) -> Any:
    """Parse JSON; ValueError also where it nests deeper than Python follows, as nothing of ours does."""
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("it nests too many lists or tables") from None


def json_number(value: float) -> float | None:
    """Return a number, or None for one that JSON does not have: infinity and NaN."""
    return float(value) if math.isfinite(value) else None


def read_json(path: Path | str) -> Any:
    """Read a JSON file; `OSError` as of `check_file`, ValueError if it is no JSON, see `parse_json`."""
    return parse_json(read_text(path))


def file_digest(path: Path | str) -> str:
    """Return SHA-256 of a file's content, in hexadecimal digits; `OSError` as of `check_file`."""
    with os.fdopen(_open_file(path, MAX_GEOMETRY_BYTES), "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def fingerprint(path: Path) -> str:
    """Return SHA-256 of a file, or of a folder's CSV files and their names; ``"missing"`` where there is none."""
    try:
        if path.is_dir():
            parts = [f"{file.name} {fingerprint(file)}" for file in sorted(path.glob("*.csv"))]
            return hashlib.sha256("\n".join(parts).encode()).hexdigest()
        return file_digest(path)
    except OSError:
        return "missing"


def _open_file(path: Path | str, largest: int) -> int:
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


# ----------------------------------------------------------------------------------------------------------------------
# Files in a folder that is a program's own: which of them count, which are its own, and how they are written and removed.


HIDDEN_NAME = ".softmodels"
"""What the names of files and folders begin with that a folder's record, lock and preparation have."""


def is_same(path: Path, other: Path) -> bool:
    """Return whether two names are of one file, which may be reached in several ways."""
    try:
        return path.samefile(other)
    except OSError:
        return False


def version() -> str:
    """Return the installed version; of a bare checkout unknown."""
    import importlib.metadata

    try:
        return importlib.metadata.version("softmodels")
    except importlib.metadata.PackageNotFoundError:
        return "unknown"


@contextlib.contextmanager
def replaced_whole(path: Path, aside: Path | None = None) -> Iterator[Path]:
    """Provide a file beside another (a hidden one unless given) to write to, which takes the other's place at the end of the
    block; if that fails it goes."""
    aside = path.with_name(f".{os.getpid()}-{path.name}") if aside is None else aside
    try:
        aside.unlink(missing_ok=True)  # a link there, in a folder from elsewhere, would be written through
        yield aside
        aside.replace(path)
    finally:
        with contextlib.suppress(OSError):
            aside.unlink(missing_ok=True)


def is_inside(name: Any) -> bool:
    """Return whether a recorded name is of a file or folder in the folder, or of a file in a folder there: a record may have
    come from elsewhere."""
    parts = name.removesuffix("/").split("/") if isinstance(name, str) else []
    return 0 < len(parts) <= 2 and all(part.strip(".") and not re.search(r"[\\\0]", part) for part in parts)


def counts(file: Path) -> bool:
    """Return whether a file in a folder makes it one that is in use: not what locking and preparing leave there."""
    return not file.name.startswith(HIDDEN_NAME)


def some(names: list[str]) -> str:
    return ", ".join(map(repr, names[:3])) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def is_step(name: str) -> bool:
    """Return whether a file in a folder of steps is one of a run's: they come and go too often to be recorded one by one."""
    return re.fullmatch(r"([^/]+/)?\d{4,}\.h5(\.part)?", name) is not None


def remove_steps(folder: Path, keep: Iterable[str] = ()) -> None:
    """Take away the steps in a folder of a folder of results, but for some named from there, and itself if nothing else is in
    it."""
    kept = {*keep}
    if folder.is_dir() and not folder.is_symlink():
        for file in folder.iterdir():
            if is_step(file.name) and f"{folder.name}/{file.name}" not in kept:
                file.unlink(missing_ok=True)
        with contextlib.suppress(OSError):  # something of the user's is in it
            folder.rmdir()


FILE_MARK = "softmodels"
"""What the header of a drawn PNG names as its software."""


def has_table(name: str) -> Callable[[Path], bool]:
    """Return a test whether a file is TOML with a table of some name."""

    def test(path: Path) -> bool:
        try:
            return name in tomllib.loads(read_text(path))
        except (OSError, ValueError, RecursionError):
            return False

    return test


def is_drawn(path: Path) -> bool:
    """Return whether a picture was drawn by this program."""
    from PIL import Image

    try:
        check_file(path)
        with Image.open(path) as image:
            return str(image.info.get("Software", "")).startswith(FILE_MARK)
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
        return False


# ----------------------------------------------------------------------------------------------------------------------
# Write files atomically, so that no reader ever sees a partial file.


def replace(path: Path, fill: Callable[[Path], object]) -> None:
    """Write a file under a temporary name and rename it, so that no reader ever sees a partial file."""
    with replaced_whole(path, path.with_name(f"{path.name}.part")) as aside:
        fill(aside)


def replace_hdf5(path: Path, fill: Callable[[h5py.File], object]) -> None:
    """Make an HDF5 file in memory and write its bytes.

    Writing by itself, HDF5 finds a full disk only when it closes the file, and then may crash at the program's end.
    """
    import h5py

    with h5py.File(path.name, "w", driver="core", backing_store=False) as file:
        fill(file)
        file.flush()
        image = file.id.get_file_image()
    replace(path, lambda aside: aside.write_bytes(image))


def hdf5_reason(error: BaseException) -> str:
    """Return the operating system's error in a long HDF5 message, or the message's first line."""
    match = re.search(r"error message = '([^']+)'", str(error))
    return match[1] if match else str(error).strip().splitlines()[0]


def csv_text(head: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """Return a table as CSV; rows are in the order of the head."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(rows)
    return text.getvalue()


def write_text(path: Path, text: str) -> None:
    """Write a small text file atomically, in UTF-8."""
    replace(path, lambda aside: aside.write_text(text, encoding="utf-8"))


def write_bytes(path: Path, data: bytes) -> None:
    """Write bytes atomically."""
    replace(path, lambda aside: aside.write_bytes(data))


# ----------------------------------------------------------------------------------------------------------------------
# Self-contained HTML pages from templates.
#
# A page fits a phone's width, and paper: a table that is wider than the screen scrolls by itself, pictures shrink. What is
# put into a template is escaped, but for what is marked as HTML.


def render(template: str, package: str = "measurement", **values: object) -> str:
    """Return a page from a template in the package's folder ``templates``, which may build upon those here, such as
    ``base.html``."""
    return _environment(package).get_template(template).render(**values)


def compile_templates(package: str, *templates: str) -> None:
    """Compile templates of a package ahead of the first page that `render` makes of them."""
    for template in templates:
        _environment(package).get_template(template)


@functools.cache
def _environment(package: str) -> Environment:
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

    packages = dict.fromkeys((package, "softmodels.common"))
    loader = ChoiceLoader([PackageLoader(name) for name in packages])
    made = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)

    def raw(name: str) -> Markup:
        """Return a static file beside the templates, such as a style sheet or a program."""
        return Markup(loader.get_source(made, name)[0])

    made.globals["raw"] = raw
    return made


def data_uri(data: bytes, kind: str) -> str:
    """Return the bytes, of a media type such as ``"image/png"``, as an address that a page carries in itself."""
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"


def image_uri(file: Path) -> str:
    """Return the same of a picture's file, PNG, GIF, WebP or SVG."""
    return data_uri(read_file(file), f"image/{file.suffix[1:].replace('svg', 'svg+xml')}")
