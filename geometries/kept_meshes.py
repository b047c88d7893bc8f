"""Meshes that were made before, kept in the user's cache: the same device is meshed once.

A mesh is known by the device's class and fields, by the file it is drawn in, and by what meshes it: Gmsh's version and the
source of this package. Classes from elsewhere are meshed anew each time, since what they build from is not known here.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import hashlib
import os
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from geometries.actuator import Actuator

MOST_KEPT = 500_000_000
"""Bytes of all kept meshes; those unused for longest go first."""


def folder() -> Path:
    """Where meshes are kept."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "softmodels" / "meshes"


def take(actuator: Actuator, path: Path) -> bool:
    """Put a device's kept mesh into a file; whether there was one."""
    with contextlib.suppress(OSError, RuntimeError):  # no cache, or no home, is no failure
        if (kept := _place(actuator)) is not None and kept.exists():
            shutil.copyfile(kept, path)
            os.utime(kept)
            return True
    return False


def known(actuator: Actuator) -> bool:
    """Whether a device's mesh is kept."""
    with contextlib.suppress(OSError, RuntimeError):
        return (kept := _place(actuator)) is not None and kept.exists()
    return False


def told(actuator: Actuator) -> str:
    """What is reported where a device is about to be meshed."""
    kind = "solid" if actuator.dimension == 3 else "axisymmetric section"
    what = f"{type(actuator).__name__} ({kind}, 1/{actuator.copies})"
    return f"{what} was meshed before" if known(actuator) else f"meshing {what}"


def keep(actuator: Actuator, path: Path) -> None:
    """Keep the mesh in a file as a device's."""
    with contextlib.suppress(OSError, RuntimeError):
        if (kept := _place(actuator)) is not None:
            kept.parent.mkdir(parents=True, exist_ok=True)
            partial = kept.with_name(f".{kept.name}-{os.getpid()}")
            try:
                shutil.copyfile(path, partial)
                partial.replace(kept)
            finally:
                partial.unlink(missing_ok=True)
            _forget_old(kept.parent)


def _place(actuator: Actuator) -> Path | None:
    """The file in the cache; None for a device that is not kept."""
    kind = type(actuator)
    if kind.__module__.partition(".")[0] != __name__.partition(".")[0]:
        return None
    fields = [(field.name, getattr(actuator, field.name)) for field in dataclasses.fields(actuator)]
    drawn = actuator.digest() if hasattr(actuator, "digest") else ""
    key = repr((kind.__qualname__, fields, drawn, _mesher()))
    return folder() / f"{hashlib.sha256(key.encode()).hexdigest()[:32]}.msh"


@functools.cache
def _mesher() -> str:
    """What meshes: Gmsh and this package."""
    import gmsh

    source = hashlib.sha256(gmsh.__version__.encode())
    for file in sorted(Path(__file__).parent.glob("*.py")):
        source.update(file.read_bytes())
    return source.hexdigest()


def _forget_old(place: Path) -> None:
    """Take away what is beyond `MOST_KEPT`."""
    found = sorted(((file.stat().st_mtime, file.stat().st_size, file) for file in place.glob("*.msh")), reverse=True)
    total = 0
    for _, size, file in found:
        total += size
        if total > MOST_KEPT:
            file.unlink(missing_ok=True)
