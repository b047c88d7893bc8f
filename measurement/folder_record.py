"""The record in a folder of results: which files a program wrote there, so that it may replace and remove them."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from measurement.own_files import HIDDEN, is_inside, remove_steps, replace_text, version
from measurement.user_file import read_text

RECORD = f"{HIDDEN}.json"
FORMAT = 1
"""Of the record."""

Names = Mapping[str, list[str]]
"""Names of files by the folder that they are in."""


@dataclasses.dataclass(frozen=True)
class Record:
    """What is written down of a folder's files.

    Attributes:
        kind: What the folder holds.
        files: Names that are the program's own: relative, folders with a slash at the end.
        about: What was recorded of the results beside their files.
        inside: Files that are the program's own inside those folders.
        incoming: New files, and those inside new folders, that are on their way into the folder; None where none are.
        incoming_about: What is to be recorded of them.
        version: Version of the program that wrote it.
        format: Of the record.
    """

    kind: Any
    files: tuple[str, ...] = ()
    about: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    inside: Names = dataclasses.field(default_factory=dict)
    incoming: Names | None = None
    incoming_about: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    version: str | None = None
    format: int = FORMAT

    @classmethod
    def read(cls, path: Path) -> Record | None:
        """That of a file; None where there is none, or none that can be understood."""
        try:
            found = json.loads(read_text(path))
        except (OSError, ValueError, RecursionError):
            return None
        kinds = {"files": list, "about": dict, "inside": dict, "incoming": dict, "incoming_about": dict, "format": int}
        if not (isinstance(found, dict) and "files" in found and "about" in found):
            return None
        if not all(isinstance(found.get(name, kind()), kind) for name, kind in kinds.items()):
            return None
        if not all(map(is_inside, found["files"])):
            return None
        incoming = found.get("incoming")
        return cls(
            found.get("kind"),
            tuple(found["files"]),
            found["about"],
            found.get("inside", {}),
            None if incoming is None else {name: inner for name, inner in incoming.items() if is_inside(name)},
            found.get("incoming_about", {}),
            found.get("version"),
            found.get("format", 0),
        )

    def write(self, path: Path) -> None:
        """Write it whole or not at all."""
        table = {
            "written_by": "softmodels", "version": version(), "format": FORMAT, "kind": self.kind,
            "files": self.files, "about": dict(self.about),
        }  # fmt: skip
        if self.inside:
            table["inside"] = self.inside
        if self.incoming is not None:
            table |= {"incoming": self.incoming, "incoming_about": dict(self.incoming_about)}
        replace_text(path, json.dumps(table, indent=1) + "\n")

    def of(self, files: Iterable[str]) -> Record:
        """The record with these files, and nothing on its way any more."""
        names = tuple(dict.fromkeys(files))
        inside = {name: inner for name, inner in self.inside.items() if name in names}
        return dataclasses.replace(self, files=names, inside=inside, incoming=None, incoming_about={})

    def inside_of(self, name: str) -> set[str]:
        """Files that are recorded inside a folder of the program's own."""
        return set(self.inside.get(name, ()))


def remove_recorded(folder: Path, name: str, inside: Iterable[str] = ()) -> None:
    """Take a recorded file away; of a folder what is recorded inside, and the folder if nothing else is in it."""
    path = folder / name
    if not name.endswith("/"):
        if not path.is_dir():
            path.unlink(missing_ok=True)
        path.with_name(f"{path.name}.part").unlink(missing_ok=True)
    elif path.is_dir() and not path.is_symlink():
        own = Record.read(path / RECORD)
        if own is not None:
            for file in own.files:
                remove_recorded(path, file)
            (path / RECORD).unlink(missing_ok=True)
        remove_steps(path, inside)
