"""Folders of results that a program may clear, because it wrote what it clears.

A folder is taken if it is not there, is empty, or holds a record of an earlier run. The record lists the files that were
written; they alone are ever replaced or taken away. New results are prepared in a folder inside and brought in
when their first part is whole: until then the earlier ones stay. Being cut off in between loses neither, see `OwnFolder.mend`.
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from measurement.folder_lock import FolderLock
from measurement.folder_record import FORMAT, RECORD, Record, remove_recorded
from measurement.own_files import HIDDEN, counts, is_same, is_step, remove_inside, some
from measurement.wording import Spoken

PATIENCE = 600.0
"""Seconds to wait for a program that draws into a folder which is to be replaced."""


class OwnFolderError(Spoken, RuntimeError):
    """A folder or a file that is not a program's own, so that it must not be written; the message is a sentence."""


class OwnFolder:
    """A folder of results, and the record of what was written there.

    Args:
        path: The folder; it need not be there.
        kind: What it holds, such as ``"run"``; other kinds are not replaced.
        part: Distinguishes records that one folder may have beside each other; each has a lock of its own.
    """

    def __init__(self, path: Path, kind: str, part: str = ""):
        self.path, self.kind = Path(path), kind
        stem = f"{HIDDEN}-{part}" if part else HIDDEN
        self._record, self._prepared = self.path / f"{stem}.json", self.path / f"{stem}-new"
        self.lock = FolderLock(self._record.with_suffix(".lock"))
        self._made: list[Path] = []

    # -- what is known of it ---------------------------------------------------------------------------------------

    @property
    def record(self) -> Record | None:
        """What is recorded; None where there is none, or none that can be understood."""
        return Record.read(self._record)

    @property
    def _known(self) -> Record:
        return self.record or Record(self.kind)

    @property
    def files(self) -> list[str]:
        """Names that are the program's own: relative, folders with a slash at the end."""
        return list(self._known.files)

    @property
    def about(self) -> dict[str, Any]:
        """What was recorded of the results beside their files."""
        return dict(self._known.about)

    @property
    def is_free(self) -> bool:
        """Whether nothing is there, not even of an earlier run."""
        try:
            return not any(counts(file) for file in self.path.iterdir())
        except FileNotFoundError:
            return True
        except OSError:
            return False

    def check(self) -> None:
        """Refuse a folder that is not this program's to write.

        Raises:
            OwnFolderError: It is something else, with what it is and what to do.
        """
        record = self.record
        if record is not None and record.kind == self.kind:
            if record.format > FORMAT:
                raise OwnFolderError(
                    f"{self.path} was written by a later version ({record.version}); update, or take another folder"
                )
            return
        if record is not None:
            raise OwnFolderError(
                f"{self.path} holds another kind of results ({record.kind}), which are not replaced; take another "
                "folder (--output)"
            )
        if self._record.name == RECORD and not self.is_free:
            raise OwnFolderError(self._foreign())

    def _foreign(self) -> str:
        try:
            names = sorted(file.name for file in self.path.iterdir() if counts(file))
        except OSError as error:
            return f"the folder {self.path} cannot be written ({error.strerror})"
        if self._record.exists():
            return f"{self._record} cannot be understood, so nothing in its folder is replaced; take another folder (--output)"
        return (
            f"{self.path} holds files that no run of this version has recorded as its own ({some(names)}), and nothing in it "
            "is replaced; take a folder that is empty or not there (--output), or move those files away"
        )

    def check_names(self, names: Iterable[str]) -> None:
        """Refuse names under which somebody else's files lie.

        Raises:
            OwnFolderError: One is there and not recorded, with what to do.
        """
        own = set(self.files)
        taken = [name for name in names if name not in own and os.path.lexists(self.path / name)]
        if taken:
            raise OwnFolderError(
                f"{self.path / taken[0]} is there and was not written by this program, so it is not replaced; move it "
                "away, or take another folder (--output)"
            )

    def check_inputs(self, inputs: Iterable[Path]) -> None:
        """Refuse inputs that lie among the results which are to be replaced.

        Raises:
            OwnFolderError: One does.
        """
        for name in self.files:
            for file in inputs:
                if is_same(self.path / name, file):
                    raise OwnFolderError(
                        f"{file} is read, and is one of the results in {self.path} that would be replaced; take another "
                        "folder (--output), or read a copy of it"
                    )

    # -- taking and leaving it -------------------------------------------------------------------------------------

    def take(self, wait: float = 0.0) -> None:
        """Make the folder if need be, lock it, and mend what a killed process has left.

        Args:
            wait: Seconds to wait while another program holds it.

        Raises:
            OwnFolderError: It is not this program's.
            InUseError: Another program writes there.
            OSError: It cannot be written.
        """
        if self.lock.held:
            return
        self.check()
        self._made = [folder for folder in (self.path, *self.path.parents) if not folder.exists()]
        self.path.mkdir(parents=True, exist_ok=True)
        self.lock.take(wait)
        try:
            self.check()  # it may have been filled meanwhile
            self.mend()
        except BaseException:
            self.lock.release()
            raise

    def leave(self) -> None:
        """Unlock it; prepared files that were not brought in go, and so does a folder that was made for nothing."""
        if not self.lock.held:
            return
        with contextlib.suppress(OSError):
            if self._known.incoming is None:
                shutil.rmtree(self._prepared, ignore_errors=True)
            if not self.files and self._record.exists() and (self._record.name != RECORD or self.is_free):
                self._record.unlink()
        self.lock.release()
        for folder in self._made:
            with contextlib.suppress(OSError):  # there is something in it
                folder.rmdir()

    # -- writing ---------------------------------------------------------------------------------------------------

    def claim(self, names: Iterable[str], about: Mapping[str, Any] | None = None) -> None:
        """Record files as the program's own, before they are written.

        Args:
            names: Relative; folders with a slash at the end.
            about: More to record of the results; what was recorded under the same names is replaced.

        Raises:
            OwnFolderError: Somebody else's file lies under one of the names.
            OSError: The record cannot be written.
        """
        names, known = list(names), self._known
        self.check_names(names)
        self._write(known.of([*known.files, *names]), {**known.about, **(about or {})})

    def remove(self, names: Iterable[str]) -> None:
        """Take away those of some names that are recorded, and forget them."""
        known, wanted = self._known, set(names)
        gone = [name for name in known.files if name in wanted]
        for name in gone:
            remove_recorded(self.path, name, known.inside_of(name))
        if gone:
            self._write(known.of(name for name in known.files if name not in wanted), known.about)

    def forget_unwritten(self) -> None:
        """Forget names that were recorded and not written in the end: somebody else may use them."""
        if gone := [name for name in self.files if not (self.path / name).exists()]:
            self.remove(gone)

    def prepare(self) -> Path:
        """An empty folder inside, for new results until `bring_in`."""
        shutil.rmtree(self._prepared, ignore_errors=True)
        if self.record is None:
            self._write(Record(self.kind), {})
        self._prepared.mkdir()
        return self._prepared

    def bring_in(self, about: Mapping[str, Any]) -> None:
        """Put what was prepared in the place of the earlier results, whose files go.

        Raises:
            OwnFolderError: Somebody else's file lies under one of the names.
            OSError: A file cannot be moved; `mend` goes on from there.
        """
        known = self._known
        incoming = {
            file.name + "/" * file.is_dir(): sorted(inner.name for inner in file.iterdir()) if file.is_dir() else []
            for file in sorted(self._prepared.iterdir())
            if not file.name.startswith(".")  # something half written
        }
        self.check_names(incoming)
        for name, inner in incoming.items():
            for file in inner:
                if file not in known.inside_of(name) and (self.path / name / file).exists() and not is_step(file):
                    raise OwnFolderError(
                        f"{self.path / name / file} is there and was not written by this program, so it is not replaced; "
                        "move it away, or take another folder (--output)"
                    )
        # Both the earlier and the new names are the program's from here on.
        inside = {name: sorted({*inner, *known.inside_of(name)}) for name, inner in incoming.items() if inner}
        begun = dataclasses.replace(
            known.of([*known.files, *incoming]),
            inside={**known.inside, **inside},
            incoming=incoming,
            incoming_about=about,
        )
        self._write(begun, known.about)
        self.mend()

    def mend(self) -> None:
        """End what `bring_in` has begun; nothing happens if nothing was left halfway."""
        known = self._known
        if known.incoming is None:
            shutil.rmtree(self._prepared, ignore_errors=True)
            return
        for name, inner in known.incoming.items():
            source, target = self._prepared / name, self.path / name
            if not name.endswith("/"):
                if source.exists():
                    source.replace(target)
            elif source.is_dir():
                target.mkdir(exist_ok=True)
                remove_inside(target, known.inside_of(name) - set(inner), keep=inner)
                for file in sorted(source.iterdir()):
                    file.replace(target / file.name)
                source.rmdir()
        for name in known.files:
            if name not in known.incoming:
                remove_recorded(self.path, name, known.inside_of(name))
        inside = {name: inner for name, inner in known.incoming.items() if inner and not all(map(is_step, inner))}
        self._write(Record(self.kind, tuple(known.incoming), inside=inside), known.incoming_about)
        shutil.rmtree(self._prepared, ignore_errors=True)

    def _write(self, record: Record, about: Mapping[str, Any]) -> None:
        dataclasses.replace(record, kind=self.kind, about=about).write(self._record)
