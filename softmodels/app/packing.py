"""A project, or a folder of its results, as one ZIP file, and a project that somebody sent."""

from __future__ import annotations

import shutil
import stat
import tempfile
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import IO

from softmodels.app import history, jobs
from softmodels.app.bench import CASE, INPUT_FOLDERS, OUTLINES, RESULTS, FileKind, Project
from softmodels.common import errors

ARCHIVE = FileKind("projects", "ZIP, as this page writes them", (".zip",), 380 << 20)
MAX_BYTES = 4 << 30
"""Of a project that was sent, unpacked."""
TEXTS = (".toml", ".csv")
FOLDERS = (*INPUT_FOLDERS, OUTLINES, RESULTS, jobs.FOLDER)
"""What a project consists of: files with these endings beside each other, and folders with all that is in them."""
PACKED_ALREADY = (".jpg", ".jpeg", ".png", ".heic", ".3mf", ".mp4")
"""Endings of files that get no smaller."""


def pack(project: Path, place: str = "") -> Path:
    """Return a new ZIP file, to be deleted, of a project or of a folder of its results, within one folder of that name.
    FieldError if there is no such folder, OSError if it cannot be written."""
    folder = (project / place).resolve()
    known = not place or place.partition("/")[0] in (OUTLINES, RESULTS)
    if not (known and folder.is_dir() and folder.is_relative_to(project.resolve())):
        raise errors.FieldError(f"there are no results in {place}")
    with tempfile.NamedTemporaryFile(suffix=".zip", delete=False) as made:
        try:
            # Copies to some memory cards have no time, which a ZIP file cannot say.
            with zipfile.ZipFile(made, "w", strict_timestamps=False) as archive:
                for file in _files(folder):
                    small = file.suffix.lower() in PACKED_ALREADY
                    name = f"{folder.name}/{file.relative_to(folder).as_posix()}"
                    archive.write(file, name, zipfile.ZIP_STORED if small else zipfile.ZIP_DEFLATED)
        except BaseException:
            Path(made.name).unlink()
            raise
    return Path(made.name)


def _files(folder: Path) -> Iterator[Path]:
    """Yield the plain files in a folder and below, by name, without links, hidden ones and what could be undone."""
    for path in sorted(folder.iterdir()):
        if path.is_symlink() or path.name.startswith(".") or path.name == history.FOLDER:
            continue
        if path.is_dir():
            yield from _files(path)
        elif path.is_file():
            yield path


def unpack(archive: IO[bytes], project: Project) -> int:
    """Fill an empty project with one that was sent, and return how many files that are none of a project's were left out. Its
    jobs come along as records, none of which is run. FieldError for a project that is not empty, or no such file; OSError if
    something cannot be written."""
    if (project / CASE).exists() or any(any((project / folder).iterdir()) for folder in (*INPUT_FOLDERS, RESULTS)):
        raise errors.FieldError("this project is not empty; start the page with another folder to open one that was sent")
    try:
        with zipfile.ZipFile(archive) as sent:
            members = [member for member in sent.infolist() if not member.is_dir()]
            places = {place: member for member in members if (place := _place(member))}
            if not places:
                raise errors.FieldError("it holds no project; send what Download the whole project gives")
            if sum(member.file_size for member in places.values()) > MAX_BYTES:
                raise errors.FieldError(f"its files are larger than {MAX_BYTES >> 30} GB in all")
            with tempfile.TemporaryDirectory(dir=project.folder) as aside:  # all of it comes, or nothing
                for place, member in places.items():
                    (file := Path(aside, place)).parent.mkdir(parents=True, exist_ok=True)
                    with sent.open(member) as packed, file.open("wb") as written:
                        shutil.copyfileobj(packed, written)
                for place in places:
                    (project / place).parent.mkdir(parents=True, exist_ok=True)
                    Path(aside, place).replace(project / place)
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError, zlib.error) as error:
        raise errors.FieldError(f"it cannot be read as a ZIP file ({errors.reason(error)})") from None
    return len(members) - len(places)


def _place(member: zipfile.ZipInfo) -> str:
    """Return where a member of a sent project belongs; "" for links, ways out, and what is none of its files."""
    whole = PurePosixPath(member.filename.replace("\\", "/"))
    parts = whole.parts[1:]  # without the project's own name
    plain = stat.S_IFMT(member.external_attr >> 16) in (0, stat.S_IFREG)
    if not plain or whole.is_absolute() or any(part.startswith(".") or ":" in part for part in parts):
        return ""
    known = parts[0] in FOLDERS if len(parts) > 1 else bool(parts) and Path(parts[0]).suffix in TEXTS
    return "/".join(parts) if known else ""
