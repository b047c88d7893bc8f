"""Functions that kill the process which calls them."""

from __future__ import annotations

import os
import signal
from pathlib import Path


def die_once(marker):
    """Kill this process, unless that was done before."""
    if not Path(marker).exists():
        Path(marker).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return "alive"


def die(marker):
    os.kill(os.getpid(), signal.SIGKILL)
