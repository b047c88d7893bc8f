"""Results folders, of which only the program's own files are replaced.

A folder is taken if it is not there, is empty, or holds a record of an earlier run. The record lists the files that were
written; only they are replaced or removed. New results are prepared in a folder inside and brought in
when their first part is whole: until then the earlier ones stay. Being cut off in between loses neither, see `OwnFolder.mend`.
"""

from __future__ import annotations

import contextlib
import dataclasses
import errno
import hashlib
import itertools
import json
import os
import shutil
import socket
import time
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from softmodels.common.errors import Spoken, reason
from softmodels.common.files import (
    HIDDEN,
    check_file,
    counts,
    file_digest,
    is_inside,
    is_same,
    is_step,
    read_text,
    remove_inside,
    remove_steps,
    replace_text,
    some,
    version,
)
from softmodels.common.pages import Provenance

if TYPE_CHECKING:
    from filelock import BaseFileLock


# ----------------------------------------------------------------------------------------------------------------------
# A lock on a folder of results: one program at a time writes there, also where hosts share a file system.
#
# The system holds the lock until the process ends, however that happens; the file has the process and the host in its lines.
# On file systems that know no locks the file alone counts; of a process of this machine it is seen whether it has ended.


NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP)  # answers of file systems without locks


class InUseError(Spoken, RuntimeError):
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


RECORD = f"{HIDDEN}.json"
FORMAT = 1  # of the record


@dataclasses.dataclass(frozen=True)
class Record:
    """Record of a folder's files.

    Attributes:
        kind, about: What the folder holds, and what was recorded of the results beside their files.
        files: Names that are the program's own: relative, folders with a slash at the end.
        inside: Files that are the program's own inside those folders.
        incoming: New files, and those inside new folders, that are on their way into the folder; None where none are.
        incoming_about: What is to be recorded of them.
        version, format: Of the program that wrote it, and of the record.
    """

    kind: Any = None
    files: tuple[str, ...] = ()
    about: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    inside: Mapping[str, list[str]] = dataclasses.field(default_factory=dict)
    incoming: Mapping[str, list[str]] | None = None
    incoming_about: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    version: str | None = None
    format: int = FORMAT

    @classmethod
    def read(cls, path: Path) -> Record | None:
        """Return the record in a file; None if there is none or it is not readable."""
        try:
            found = json.loads(read_text(path))
        except (OSError, ValueError, RecursionError):
            return None
        kinds = {"files": list, "about": dict, "inside": dict, "incoming": dict, "incoming_about": dict, "format": int}
        if not (isinstance(found, dict) and "files" in found and "about" in found):
            return None
        if not all(isinstance(found.get(name, kind()), kind) for name, kind in kinds.items()):
            return None
        if not all(map(is_inside, [*found["files"], *found.get("incoming", ())])):
            return None
        known = {field.name: found[field.name] for field in dataclasses.fields(cls) if field.name in found}
        return cls(**{"format": 0, **known, "files": tuple(found["files"])})

    def write(self, path: Path) -> None:
        """Write it whole or not at all."""
        own = dataclasses.replace(self, version=version(), format=FORMAT)
        table = {"written_by": "softmodels", **{name: value for name, value in vars(own).items() if value is not None}}
        replace_text(path, json.dumps(table, indent=1) + "\n")

    def of(self, files: Iterable[str]) -> Record:
        """Return the record with these files, and nothing on its way any more."""
        names = tuple(dict.fromkeys(files))
        inside = {name: inner for name, inner in self.inside.items() if name in names}
        return dataclasses.replace(self, files=names, inside=inside, incoming=None, incoming_about={})

    def inside_of(self, name: str) -> set[str]:
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


PATIENCE = 600.0  # seconds to wait for a program that draws into a folder which is to be replaced


class OwnFolderError(Spoken, RuntimeError):
    """A folder or a file that is not a program's own, so that it must not be written; the message is a sentence."""


class OwnFolder:
    """A folder of results, which need not be there, and the record of what was written there; those of another kind are not
    replaced. Records of several parts, each with a lock of its own, may be beside each other."""

    def __init__(self, path: Path, kind: str, part: str = ""):
        self.path, self.kind = Path(path), kind
        stem = f"{HIDDEN}-{part}" if part else HIDDEN
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
        """Names that are the program's own: relative, folders with a slash at the end."""
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
        if record is not None and record.kind == self.kind:
            if record.format > FORMAT:
                text = f"{self.path} was written by a later version ({record.version})"
                raise OwnFolderError(f"{text}; update, or take another folder")
            return
        if record is not None:
            text = f"{self.path} holds another kind of results ({record.kind}), which is not replaced"
            raise OwnFolderError(f"{text}; use another folder (--output)")
        if self._record.name == RECORD and not self.is_free:
            try:
                names = some(sorted(file.name for file in self.path.iterdir() if counts(file)))
            except OSError as error:
                raise OwnFolderError(f"the folder {self.path} cannot be written ({error.strerror})") from None
            text = (
                f"{self.path} holds files not written by a run of this version ({names}), so nothing in it is replaced"
            )
            raise OwnFolderError(f"{text}; use an empty or new folder (--output), or move those files away")

    def check_names(self, names: Iterable[str]) -> None:
        """Raise `OwnFolderError` for a name under which somebody else's file lies."""
        for name in sorted({*names} - {*self.files}):
            if os.path.lexists(self.path / name):
                raise _not_ours(self.path / name)

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
        """Return an empty folder inside, for new results until `bring_in`."""
        shutil.rmtree(self._prepared, ignore_errors=True)
        if self.record is None:
            self._write(Record(self.kind), {})
        self._prepared.mkdir()
        return self._prepared

    def bring_in(self, about: Mapping[str, Any]) -> None:
        """Put what was prepared in the place of the earlier results; see `check_names`. `mend` ends what is cut off."""
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
                    raise _not_ours(self.path / name / file)
        # Both the earlier and the new names are the program's from here on.
        inside = {name: sorted({*inner, *known.inside_of(name)}) for name, inner in incoming.items() if inner}
        both = known.of([*known.files, *incoming])
        on_the_way = {"inside": {**known.inside, **inside}, "incoming": incoming, "incoming_about": dict(about)}
        self._write(dataclasses.replace(both, **on_the_way), known.about)  # type: ignore[arg-type]
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
        dataclasses.replace(record, kind=self.kind, about=dict(about)).write(self._record)


def _not_ours(file: Path) -> OwnFolderError:
    text = f"{file} exists and was not written by this program, so it is not replaced"
    return OwnFolderError(f"{text}; move it away, or use another folder (--output)")


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


# ----------------------------------------------------------------------------------------------------------------------
# What a command writes: a folder of results that is replaced whole at its end, and single files.
#
# Earlier results are replaced whole or stay. No file is written over one that is read, nor over one that somebody else made.


NO_INPUT = ("output", "quiet", "no_pictures", "jobs")
"""Options that change nothing in a command's numbers."""


class ResultFolder:
    """A command's folder of results, locked from its beginning to its end; `OwnFolderError` if it is not this program's, is in
    use, or cannot be written.

    Without ``output`` it is the first of ``default``, ``default-2`` ... that is free or holds results of the very same inputs:
    the command's options by name, and the files that are read, or folders of CSV files, which are never replaced.
    """

    def __init__(
        self, output: Path | None, default: Path, kind: str, options: Mapping[str, Any], files: Iterable[Path] = ()
    ):
        files = list(files)
        self._inputs = {
            "options": {name: repr(value) for name, value in sorted(options.items()) if name not in NO_INPUT},
            "files": {str(file): fingerprint(file) for file in files},
        }
        try:
            if output is None:
                self._own = take_default(default, kind, self._inputs)
            else:
                self._own = OwnFolder(output, kind)
                self._own.take()
            try:
                self._own.check_inputs(files)
            except OwnFolderError:
                self._own.leave()
                raise
        except InUseError as error:
            raise OwnFolderError(str(error)) from None
        except OSError as error:
            raise OwnFolderError(f"the folder {output or default} cannot be written ({reason(error)})") from None

    @property
    def path(self) -> Path:
        return self._own.path

    @contextlib.contextmanager
    def writing(self) -> Iterator[Path]:
        """Provide a folder to write all results into, which take the place of the earlier ones at the end of the block;
        `OwnFolderError` if somebody else's file has the name of a result. Without room the earlier results stay."""
        yield self._own.prepare()
        self._own.bring_in({"inputs": self._inputs, "made": Provenance.now().table()})

    def leave(self) -> None:
        """Let go of it; nothing is left where nothing was written."""
        self._own.leave()


def fingerprint(path: Path) -> str:
    """Return SHA-256 of a file, or of a folder's CSV files and their names; ``"missing"`` where there is none."""
    try:
        if path.is_dir():
            parts = [f"{file.name} {fingerprint(file)}" for file in sorted(path.glob("*.csv"))]
            return hashlib.sha256("\n".join(parts).encode()).hexdigest()
        return file_digest(path)
    except OSError:
        return "missing"


# ----------------------------------------------------------------------------------------------------------------------
# Single files that a command writes: never one that it reads, and never one that somebody else made.


MARK = "softmodels"
"""What the header of a drawn PNG names as its software."""


def check_output_file(
    path: Path, inputs: Iterable[Path], is_own: Callable[[Path], bool], what: str, option: str
) -> None:
    """Raise `OwnFolderError`, which names the option, if a file would take the place of an input, or of one that is not an
    earlier one of its kind, ``what`` in words."""
    for file in inputs:
        if is_same(path, file):
            raise OwnFolderError(f"{path} is an input and would be overwritten by {what}; give another name ({option})")
    if path.is_dir():
        raise OwnFolderError(f"{path} is a folder; name a file for {what} ({option})")
    if path.exists() and not is_own(path):
        raise OwnFolderError(
            f"{path} exists and is not {what} of this program, so it is not replaced; give another name ({option}), or "
            "move it away"
        )


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
            return str(image.info.get("Software", "")).startswith(MARK)
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
        return False
