"""Where results are to go: asked before the work begins, so that nobody waits for what cannot be kept."""

from __future__ import annotations

import errno
import os
from pathlib import Path

from measurement.ending import FAILED

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Errors of a disk without room: the run failed, its input was good."""
UNUSABLE = 2


def trouble(folder: Path) -> str:
    """Why files cannot be written into a folder, which need not exist yet; empty if they can."""
    place = Path(folder)
    try:
        while not place.exists():
            place = place.parent
        if not place.is_dir():
            return os.strerror(errno.ENOTDIR)
        return "" if os.access(place, os.W_OK | os.X_OK) else os.strerror(errno.EACCES)
    except (OSError, ValueError) as error:
        return getattr(error, "strerror", None) or str(error)


def status_of(error: OSError) -> int:
    """Exit status where something could not be written: the place was bad input, or the disk became full."""
    return FAILED if error.errno in FULL else UNUSABLE
