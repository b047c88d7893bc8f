"""Why a file could not be read or written, in the words of the system and not of Python."""

from __future__ import annotations


def reason(error: BaseException) -> str:
    """``"No such file or directory"`` where Python says ``"[Errno 2] No such file or directory: 'a.csv'"``."""
    return getattr(error, "strerror", None) or str(error)
