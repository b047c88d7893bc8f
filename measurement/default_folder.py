"""The folder that is taken where the user names none: results keep out of each other's way."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from measurement.folder_lock import InUseError
from measurement.own_folder import OwnFolder, OwnFolderError


def take_default(base: Path, kind: str, inputs: Mapping[str, Any]) -> OwnFolder:
    """Take the first of ``base``, ``base-2``, ``base-3`` ... that is free or holds results of the very same inputs.

    Args:
        base: The folder's name where nothing is in the way.
        kind: What it is to hold.
        inputs: What decides the results, as it was recorded under ``"inputs"``.

    Raises:
        InUseError: A program with the same inputs is under way.
        OSError: It cannot be written.
    """
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
    """``base``, ``base-2``, ``base-3`` and so on."""
    yield base
    for number in itertools.count(2):
        yield base.with_name(f"{base.name}-{number}")
