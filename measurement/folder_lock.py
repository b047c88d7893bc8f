"""A lock on a folder of results: one program at a time writes there, also where hosts share a file system.

The system holds the lock and lets go of it when the process ends, however that happens. The file says who holds it, for the
sentence that another program is refused with. On file systems that know no locks the file alone counts.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import socket
import time
from pathlib import Path
from typing import Any

from measurement.wording import Spoken

try:
    import fcntl
except ImportError:  # not on Windows
    fcntl = None  # type: ignore[assignment]

POLL = 0.2
"""Seconds between two looks at a lock that is waited for."""


class InUseError(Spoken, RuntimeError):
    """Another program writes in the folder; the message is a sentence for the user."""


class FolderLock:
    """A lock that a file in the folder stands for.

    Args:
        file: The file; it is there while the lock is held. One that a killed process left behind is taken over.
    """

    def __init__(self, file: Path):
        self.file = file
        self._handle: int | None = None

    @property
    def held(self) -> bool:
        return self._handle is not None

    def take(self, wait: float = 0.0) -> None:
        """Take the lock, or wait for it.

        Args:
            wait: Seconds to wait while another program holds it.

        Raises:
            InUseError: Another program holds it.
            OSError: The file cannot be written.
        """
        until = time.monotonic() + wait
        while not self.held:
            handle = self._open()
            try:
                if self._is_mine(handle):
                    self._handle = handle
                    os.ftruncate(handle, 0)
                    os.write(handle, json.dumps(_me()).encode())
                    return
                holder = _holder(handle)
            finally:
                if self._handle is None:
                    os.close(handle)
            if time.monotonic() >= until:
                raise InUseError(self._refusal(holder))
            time.sleep(POLL)

    def _open(self) -> int:
        try:
            # Through a link in a folder from elsewhere, any file of the user's would be emptied.
            return os.open(self.file, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
        except OSError as error:
            if self.file.is_symlink():
                raise OSError(
                    error.errno, f"its lock {self.file.name} is a link; remove that", str(self.file)
                ) from None
            raise

    def release(self) -> None:
        """Give the lock back and take its file away; nothing happens if it is not held."""
        if self._handle is None:
            return
        with contextlib.suppress(OSError):
            self.file.unlink(missing_ok=True)
        with contextlib.suppress(OSError):
            os.close(self._handle)
        self._handle = None

    def _is_mine(self, handle: int) -> bool:
        try:
            if fcntl is None:
                raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError:  # a file system without locks
            return _is_stale(_holder(handle))
        # Whoever held it before may have taken the file away between opening and locking.
        with contextlib.suppress(OSError):
            return os.fstat(handle).st_ino == self.file.stat().st_ino
        return False

    def _refusal(self, holder: dict[str, Any]) -> str:
        who = f"process {holder.get('pid', 'unknown')} on {holder.get('host', 'this machine')}"
        since = f", since {holder['since']}" if "since" in holder else ""
        return (
            f"{self.file.parent} is in use by {who}{since}; wait until it has ended, or take another folder (--output). "
            f"If there is no such process any more, remove {self.file}"
        )


def _me() -> dict[str, Any]:
    since = time.strftime("%Y-%m-%d %H:%M:%S")
    return {"pid": os.getpid(), "host": socket.gethostname(), "since": since}


def _holder(handle: int) -> dict[str, Any]:
    """Who a lock's file names; empty if it names nobody."""
    try:
        os.lseek(handle, 0, os.SEEK_SET)
        found = json.loads(os.read(handle, 4096))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _is_stale(holder: dict[str, Any]) -> bool:
    """Whether the process that a file names has ended; of another host nobody can tell, so it is taken to be alive."""
    if not holder:
        return True
    if os.name == "nt" or holder.get("host") != socket.gethostname() or not isinstance(holder.get("pid"), int):
        return False
    if holder["pid"] == os.getpid():
        return True  # left by another process that had this number
    try:
        os.kill(holder["pid"], 0)
    except ProcessLookupError:
        return True
    except OSError:
        return False
    return False
