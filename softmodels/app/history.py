"""What can be undone: a project's inputs after each of its last changes, kept in the project's folder."""

from __future__ import annotations

import contextlib
import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path

from softmodels.common import files

FOLDER = "history"
STEPS = "steps.json"
MAX_STEPS = 100
"""Changes that are kept; files that none of them holds are deleted."""
STORED_NAME = re.compile(r"[0-9a-f]{64}|[0-9a-f]{16}(-[0-9a-f]{1,32}){2}")


class History:
    """Inputs of a project after each change: ``texts``, files by what is written in them, and all files of ``folders``, which
    users bring, by size and time. Results are none: they are marked by the inputs that they were made of.

    A file that is removed or undone is moved here, so that nothing is lost and no photograph is stored twice.
    """

    def __init__(self, project: Path, texts: Mapping[str, str], folders: Mapping[str, str]):
        self.project, self.texts, self.folders = project, texts, folders
        self.steps, self.current = self._read()
        self._held = 0
        self.record()

    def record(self) -> None:
        """Keep the inputs as they are now, if they differ from those kept last; what was undone before cannot be redone then.
        OSError if they cannot be written."""
        now = self._now()
        if self._held or (self.steps and now == self.steps[self.current]):
            return
        self.steps = [*self.steps[: self.current + 1], now][-MAX_STEPS - 1 :]
        self.current = len(self.steps) - 1
        for name in now.keys() & self.texts.keys():
            if not (stored := self._stored(now[name])).exists():
                files.write_bytes(stored, files.read_file(self.project / name))
        self._write()
        kept = {key for step in self.steps for key in step.values()}
        for stored in (self.project / FOLDER).iterdir():
            if stored.name != STEPS and stored.name not in kept:
                stored.unlink()

    @contextlib.contextmanager
    def one_step(self) -> Iterator[None]:
        """Record all changes within as one."""
        self._held += 1
        try:
            yield
        finally:
            self._held -= 1
            self.record()

    def remove(self, file: Path) -> None:
        """Take a user's file out of its folder; OSError if it cannot be moved."""
        self.record()
        file.rename(self._stored(_identity(file)))

    def change_of(self, by: int) -> str:
        """Return in words what going some steps back (negative) or forth would change; empty if there are none."""
        if not 0 <= (wanted := self.current + by) < len(self.steps):
            return ""
        now, then = self.steps[self.current], self.steps[wanted]
        differing = sorted(name for name in now.keys() | then.keys() if now.get(name) != then.get(name))
        words = [self.texts.get(name) or f"{self.folders[name.partition('/')[0]]} {Path(name).name}" for name in differing]
        named = list(dict.fromkeys(words))
        return ", ".join(named[:2]) + (f" and {len(named) - 2} more" if len(named) > 2 else "")

    def go(self, by: int) -> list[str]:
        """Restore the inputs of some steps before (negative) or after; nothing happens where there are none. Return the files
        that another program has taken away meanwhile, which cannot come back. OSError if a file cannot be written."""
        self.record()
        if not 0 <= (wanted := self.current + by) < len(self.steps):
            return []
        now, then, lost = self.steps[self.current], self.steps[wanted], []
        for name, key in now.items():
            if then.get(name) == key:
                continue
            if name not in self.texts:
                (self.project / name).rename(self._stored(key))
            elif name not in then:
                (self.project / name).unlink()
        for name, key in then.items():
            stored = self._stored(key)
            if now.get(name) == key:
                continue
            if not stored.is_file() or stored.is_symlink():
                lost.append(name)
            elif name in self.texts:
                files.write_bytes(self.project / name, files.read_file(stored))
            else:
                stored.rename(self.project / name)
        self.steps[wanted] = {name: key for name, key in then.items() if name not in lost}
        self.current = wanted
        self._write()
        return lost

    def _stored(self, key: str) -> Path:
        return self.project / FOLDER / key

    def _now(self) -> dict[str, str]:
        now = {}
        for name in self.texts:
            if (file := self.project / name).is_file():
                now[name] = hashlib.sha256(files.read_file(file)).hexdigest()
        for folder in self.folders:
            for file in sorted((self.project / folder).iterdir()):
                if file.is_file() and not file.is_symlink():
                    now[f"{folder}/{file.name}"] = _identity(file)
        return now

    def _write(self) -> None:
        text = json.dumps({"current": self.current, "steps": self.steps})
        files.write_text(self.project / FOLDER / STEPS, text)

    def _read(self) -> tuple[list[dict[str, str]], int]:
        """Return the steps that are stored and the number of the current one; none where they are not as written here."""
        (self.project / FOLDER).mkdir(exist_ok=True)
        try:
            stored = files.parse_json(files.read_text(self.project / FOLDER / STEPS))
            steps, current = stored["steps"], stored["current"]
            names = {name for step in steps for name in step}
            keys = {key for step in steps for key in step.values()}
            if 0 <= current < len(steps) and all(map(self._is_input, names)) and all(map(STORED_NAME.fullmatch, keys)):
                return steps, current
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            pass
        return [], -1

    def _is_input(self, name: str) -> bool:
        folder, _, file = name.partition("/")
        return name in self.texts or (folder in self.folders and file == Path(file).name and file not in ("", ".", ".."))


def _identity(file: Path) -> str:
    about, place = file.stat(), f"{file.parent.name}/{file.name}"
    return f"{hashlib.sha256(place.encode()).hexdigest()[:16]}-{about.st_size:x}-{about.st_mtime_ns:x}"
