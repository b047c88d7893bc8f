"""Results folders, of which only the program's own files are replaced.

A folder is taken if it is not there, is empty, or holds a record of an earlier run. The record lists the files that were
written; only they are replaced or removed. New results are prepared in a folder inside and brought in when their first part
is whole: until then the earlier ones stay. Being cut off in between loses neither, see `OwnFolder.mend`.
"""

from __future__ import annotations

import contextlib
import dataclasses
import errno
import itertools
import json
import os
import shutil
import socket
import time
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from softmodels.common import errors
from softmodels.common.files import (
    HIDDEN_NAME,
    counts,
    is_inside,
    is_same,
    is_step,
    read_json,
    read_text,
    remove_steps,
    some,
    version,
    write_text,
)

if TYPE_CHECKING:
    from filelock import BaseFileLock


class OwnFolder:
    """A folder of results, which need not be there, and the record of what was written there; those of another kind are not
    replaced. Records of several parts, each with a lock of its own, may be beside each other."""

    def __init__(self, path: Path, kind: str, part: str = ""):
        self.path, self.kind = Path(path), kind
        stem = f"{HIDDEN_NAME}-{part}" if part else HIDDEN_NAME
        self._record, self._prepared = self.path / f"{stem}.json", self.path / f"{stem}-new"
        self.lock = FolderLock(self._record.with_suffix(".lock"))
        self._made: list[Path] = []

    @property
    def record(self) -> Record | None:
        """The record; None if there is none or it is not readable."""
        return Record.read(self._record)

    @property
    def _known(self) -> Record:
        return self.record or Record(self.kind)

    @property
    def files(self) -> list[str]:
        """Names that are the program's own, as `Record.files`."""
        return list(self._known.files)

    @property
    def about(self) -> dict[str, Any]:
        """The record's data of the results other than their files."""
        return dict(self._known.about)

    @property
    def is_free(self) -> bool:
        """Whether the folder is empty, without files of an earlier run."""
        try:
            return not any(counts(file) for file in self.path.iterdir())
        except OSError as error:
            return isinstance(error, FileNotFoundError)

    def check(self) -> None:
        """Raise `OwnFolderError` for a folder that is not this program's to write, with what it is and what to do."""
        record = self.record
        if record is not None and record.kind != self.kind:
            text = f"{self.path} holds another kind of results ({record.kind}), which is not replaced"
            raise OwnFolderError(f"{text}; use another folder (--output)")
        if record is not None and record.format > RECORD_FORMAT:
            text = f"{self.path} was written by a later version ({record.version})"
            raise OwnFolderError(f"{text}; update, or take another folder")
        if record is None and self._record.name == RECORD and not self.is_free:
            try:
                names = some(sorted(file.name for file in self.path.iterdir() if counts(file)))
            except OSError as error:
                raise OwnFolderError(f"the folder {self.path} cannot be written ({error.strerror})") from None
            text = f"{self.path} holds files not written by a run of this version ({names}), so nothing in it is replaced"
            raise OwnFolderError(f"{text}; use an empty or new folder (--output), or move those files away")

    def check_names(self, names: Iterable[str]) -> None:
        """Raise `OwnFolderError` for a name under which somebody else's file lies."""
        for name in sorted({*names} - {*self.files}):
            if os.path.lexists(self.path / name) and not is_step(name):
                text = f"{self.path / name} exists and was not written by this program, so it is not replaced"
                raise OwnFolderError(f"{text}; move it away, or use another folder (--output)")

    def check_inputs(self, inputs: Iterable[Path]) -> None:
        """Raise `OwnFolderError` for an input that lies among the results which are to be replaced."""
        for name, file in itertools.product(self.files, inputs):
            if is_same(self.path / name, file):
                text = f"{file} is an input, and one of the results in {self.path} that would be replaced"
                raise OwnFolderError(f"{text}; use another folder (--output), or read a copy of it")

    def take(self, wait: float = 0.0) -> None:
        """Make the folder if need be, lock it, and mend what a killed process has left; `OwnFolderError` if it is not this
        program's, `InUseError` if another one still writes there after ``wait`` seconds."""
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

    def claim(self, names: Iterable[str], about: Mapping[str, Any] | None = None) -> None:
        """Record files as the program's own, before they are written, and more about the results; see `check_names`."""
        names = list(names)
        self.check_names(names)
        self._update(files=[*self.files, *names], about={**self.about, **(about or {})})

    def remove(self, names: Iterable[str]) -> None:
        """Take away those of some names that are recorded, and forget them."""
        files, wanted = self.files, {*names}
        if gone := wanted.intersection(files):
            remove_recorded(self.path, gone)
            self._update(files=[name for name in files if name not in gone])

    def forget_unwritten(self) -> None:
        """Forget names that were recorded and not written in the end: somebody else may use them."""
        self.remove(name for name in self.files if not (self.path / name).exists())

    def prepare(self) -> Path:
        """Return an empty folder inside, for new results until `bring_in`."""
        shutil.rmtree(self._prepared, ignore_errors=True)
        if self.record is None:
            self._update()
        self._prepared.mkdir()
        return self._prepared

    def bring_in(self, about: Mapping[str, Any]) -> None:
        """Put what was prepared in the place of the earlier results; see `check_names`. `mend` ends what is cut off."""
        incoming = sorted(
            file.relative_to(self._prepared).as_posix() + "/" * file.is_dir()
            for file in self._prepared.rglob("*")
            if not file.name.startswith(".")  # something half written
        )
        self.check_names(incoming)
        # Both the earlier and the new names are the program's from here on.
        self._update(files=[*self.files, *incoming], incoming=tuple(incoming), incoming_about=dict(about))
        self.mend()

    def mend(self) -> None:
        """End what `bring_in` has begun; nothing happens if nothing was left halfway."""
        known = self._known
        if known.incoming is not None:
            for name in sorted(known.incoming):  # a folder before what is in it
                source, target = self._prepared / name, self.path / name
                if name.endswith("/"):
                    target.mkdir(exist_ok=True)
                elif source.exists():
                    source.replace(target)
            new = {*known.incoming}
            remove_recorded(self.path, {*known.files} - new)
            for folder in {name.partition("/")[0] for name in new if "/" in name}:
                remove_steps(self.path / folder, keep=new)
            files = [name for name in known.incoming if not is_step(name)]
            self._update(files=files, about=known.incoming_about, incoming=None, incoming_about={})
        shutil.rmtree(self._prepared, ignore_errors=True)

    def _update(self, files: Iterable[str] | None = None, **changes: Any) -> None:
        known = self._known
        names = tuple(dict.fromkeys(known.files if files is None else files))
        dataclasses.replace(known, kind=self.kind, files=names, **changes).write(self._record)


# ----------------------------------------------------------------------------------------------------------------------
# A lock on a folder of results: one program at a time writes there, also where hosts share a file system.
#
# The system holds the lock until the process ends, however that happens; the file has the process and the host in its lines.
# On file systems that know no locks the file alone counts; of a process of this machine it is seen whether it has ended.


NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP)  # answers of file systems without locks


class InUseError(errors.OptionMessage, RuntimeError):
    """Another program writes in the folder; the message is for the user."""


class FolderLock:
    """A lock that a file stands for while it is held; one that a killed process left behind is taken over."""

    def __init__(self, file: Path):
        self.file = file
        self._lock: BaseFileLock | None = None

    @property
    def held(self) -> bool:
        return self._lock is not None

    def take(self, wait: float = 0.0) -> None:
        """Take the lock; after ``wait`` seconds `InUseError` while another program holds it."""
        from filelock import FileLock, SoftFileLock, Timeout

        if self.held:
            return
        if self.file.is_symlink():  # in a folder from elsewhere, it could lead to any file of the user's
            raise OSError(errno.ELOOP, f"its lock {self.file.name} is a link; remove that", str(self.file))
        lock: BaseFileLock = FileLock(self.file, thread_local=False, fallback_to_soft=False)
        try:
            try:
                lock.acquire(timeout=wait)
                self.file.write_text(f"{os.getpid()}\n{socket.gethostname()}\n", encoding="utf-8")
            except OSError as error:
                if isinstance(error, Timeout) or error.errno not in NO_LOCKS:
                    raise
                if not self.file.stat().st_size:  # made by this attempt
                    self.file.unlink()
                lock = SoftFileLock(self.file, thread_local=False)
                lock.acquire(timeout=wait)
        except Timeout:
            raise InUseError(self._refusal()) from None
        except BaseException:
            lock.release()
            raise
        self._lock = lock

    def release(self) -> None:
        """Give the lock back and take its file away; nothing happens if it is not held."""
        if self._lock is None:
            return
        with contextlib.suppress(OSError):
            self.file.unlink(missing_ok=True)
        with contextlib.suppress(OSError):
            self._lock.release()
        self._lock = None

    def _refusal(self) -> str:
        who, since = "another process", ""
        with contextlib.suppress(OSError, ValueError):
            pid, host, *_ = read_text(self.file).splitlines()
            who = f"process {int(pid)} on {host}"
            since = f", since {time.strftime('%Y-%m-%d %H:%M:%S', time.localtime(self.file.stat().st_mtime))}"
        text = f"{self.file.parent} is in use by {who}{since}; wait until it ends, or use another folder (--output)"
        return f"{text}. If that process no longer exists, remove {self.file}"


# ----------------------------------------------------------------------------------------------------------------------
# The record in a folder of results: which files a program wrote there, so that it may replace and remove them.


RECORD = f"{HIDDEN_NAME}.json"
RECORD_FORMAT = 2  # of the record


@dataclasses.dataclass(frozen=True)
class Record:
    """Record of a folder's files.

    Attributes:
        kind, about: What the folder holds, and what was recorded of the results beside their files.
        files: Names that are the program's own, relative to the folder; folders with a slash at the end. A run's steps have
            no names here: in a folder that is the program's own they are its own too.
        incoming: New files on their way into the folder; None where none are.
        incoming_about: What is to be recorded of them.
        version, format: Of the program that wrote it, and of the record.
    """

    kind: Any = None
    files: tuple[str, ...] = ()
    about: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    incoming: tuple[str, ...] | None = None
    incoming_about: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    version: str | None = None
    format: int = RECORD_FORMAT

    @classmethod
    def read(cls, path: Path) -> Record | None:
        """Return the record in a file; None if there is none or it is not readable."""
        try:
            record = {"format": 0, **read_json(path)}
            if record["format"] < 2:  # what is in a folder stood beside its name
                record["files"] = [*record["files"], *_is_inside(record.get("inside", {}))]
                record |= {"incoming": [*given, *_is_inside(given)]} if (given := record.get("incoming")) is not None else {}
            kinds = {"files": list, "about": dict, "incoming": list, "incoming_about": dict}
            if not all(isinstance(record.get(name, kind()), kind) for name, kind in kinds.items()):
                return None
            known = {field.name: record[field.name] for field in dataclasses.fields(cls) if field.name in record}
            known |= {name: tuple(known[name]) for name in ("files", "incoming") if name in known}
            own = all(map(is_inside, (*known["files"], *known.get("incoming", ()))))
            return cls(**known) if own and "about" in known else None
        except (OSError, ValueError, TypeError, KeyError, AttributeError):
            return None

    def write(self, path: Path) -> None:
        """Write it whole or not at all."""
        own = dataclasses.replace(self, version=version(), format=RECORD_FORMAT)
        table = {"written_by": "softmodels", **{name: value for name, value in vars(own).items() if value is not None}}
        write_text(path, json.dumps(table, indent=1) + "\n")


def _is_inside(folders: Mapping[str, list[str]]) -> list[str]:
    return [f"{folder}{file}" for folder, files in folders.items() for file in files]


def remove_recorded(folder: Path, names: Iterable[str]) -> None:
    """Take recorded files away; of a folder its steps and what its own record names, and itself if nothing else is in it."""
    for name in sorted(names, reverse=True):  # a folder after what is in it
        path = folder / name
        if path.parent != folder and path.parent.is_symlink():
            continue
        if not name.endswith("/"):
            if not path.is_dir():
                path.unlink(missing_ok=True)
            path.with_name(f"{path.name}.part").unlink(missing_ok=True)
        elif path.is_dir() and not path.is_symlink():
            if (own := Record.read(path / RECORD)) is not None:
                remove_recorded(path, own.files)
                (path / RECORD).unlink(missing_ok=True)
            remove_steps(path)


DRAWING_TIMEOUT = 600.0  # seconds to wait for a program that draws into a folder which is to be replaced


class OwnFolderError(errors.OptionMessage, RuntimeError):
    """A folder or a file that is not a program's own, so that it must not be written; the message is a sentence."""


# ----------------------------------------------------------------------------------------------------------------------
# The folder that is taken where the user names none: results keep out of each other's way.


def take_default(base: Path, kind: str, inputs: Mapping[str, Any]) -> OwnFolder:
    """Take the first of ``base``, ``base-2``, ``base-3`` ... that is free or holds results of the same recorded ``inputs``."""
    for path in numbered(base):
        own = OwnFolder(path, kind)
        record = own.record
        same = record is not None and record.kind == kind and record.about.get("inputs") == dict(inputs)
        if not same and os.path.lexists(path) and not own.is_free:
            continue
        try:
            own.take()
            return own
        except InUseError:
            if same:
                raise
        except OwnFolderError:
            if same or not own.path.exists():
                raise
    raise AssertionError("there is always another number")


def numbered(base: Path) -> Iterator[Path]:
    """Yield ``base``, ``base-2``, ``base-3`` and so on."""
    yield base
    for number in itertools.count(2):
        yield base.with_name(f"{base.name}-{number}")
