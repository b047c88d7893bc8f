"""A project: a folder of plain files that the page, the command line and Python read alike."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable
from pathlib import Path

from softmodels.case.case import Case
from softmodels.common.errors import FieldError, reason
from softmodels.common.files import replace_text, write_bytes

OUTLINES, LENS = "outlines", "lens.toml"
CASE, PHOTOS, SETUP, FITTED = "case.toml", "photos.csv", "setup.toml", "fitted.toml"
PHOTOGRAPHS, BOARDS, CURVES, RESULTS = "photographs", "boards", "curves", "results"
PREVIEW = 1600
"""Longest side of a photograph's preview in px."""
FIRST_PRESSURES = "0:60 cm"


@dataclasses.dataclass
class Handles:
    """What can be dragged on a photograph, in px.

    Attributes:
        zero: Two points on the undeformed surface.
        roi: Region of interest, as x0, y0, x1, y1.
        masks: Regions in which no edge is looked for.
    """

    zero: list[list[float]] | None = None
    roi: list[float] | None = None
    masks: list[list[float]] = dataclasses.field(default_factory=list)

    @property
    def corners(self) -> dict[tuple[str, int, int], tuple[float, float]]:
        """The points that can be dragged: by what they belong to, its number, and theirs."""
        found = {("zero", 0, k): (x, y) for k, (x, y) in enumerate(self.zero or [])}
        for name, number, box in (("roi", 0, self.roi), *(("mask", n, mask) for n, mask in enumerate(self.masks))):
            if box is not None:
                found |= {(name, number, 0): (box[0], box[1]), (name, number, 1): (box[2], box[3])}
        return found

    def drag(self, corner: tuple[str, int, int], x: float, y: float) -> None:
        """Put a point elsewhere."""
        name, number, k = corner
        if name == "zero":
            assert self.zero is not None
            self.zero[k] = [x, y]
        else:
            box = self.roi if name == "roi" else self.masks[number]
            assert box is not None
            box[2 * k : 2 * k + 2] = [x, y]

    def settle(self) -> None:
        """Put the corners of boxes in order, as after one was dragged past the other."""
        for box in (self.roi, *self.masks):
            if box is not None:
                box[:] = [*map(min, box[:2], box[2:]), *map(max, box[:2], box[2:])]


@dataclasses.dataclass(frozen=True)
class FileKind:
    """Files that users bring.

    Attributes:
        what: What they are, in the plural.
        formats: Their formats in words.
        endings: Of their names, in small letters.
        largest: Bytes of the largest.
    """

    what: str
    formats: str
    endings: tuple[str, ...]
    largest: int

    @property
    def rejected(self) -> str:
        """The sentence for files that the browser does not send."""
        return f"not taken: {self.what} are {self.formats}, of at most {self.largest >> 20} MB each"


class Project:
    """A project's folder. What several pages show comes from here, so that all tabs show the same.

    Args:
        folder: The folder; it is made where there is none.

    Attributes:
        case: The device, its silicone and its load, as in ``case.toml``.
        case_error: Why the file cannot be used; empty if it can.
    """

    def __init__(self, folder: Path):
        from nicegui import Event

        self.folder = folder.absolute()
        for name in (PHOTOGRAPHS, BOARDS, CURVES, RESULTS):
            (self.folder / name).mkdir(parents=True, exist_ok=True)
        self.changed: Event[str] = Event()
        self.case_error = ""
        self.case = self._read_case()

    def __truediv__(self, name: str) -> Path:
        return self.folder / name

    # -- the case -----------------------------------------------------------------------------------------------------

    def _read_case(self) -> Case:
        from geometries import HollowDisk
        from softmodels.case.case import in_unit
        from softmodels.case.entries import CaseError
        from softmodels.materials.silicones import silicone

        file = self / CASE
        if file.exists():
            try:
                return Case.from_file(file)
            except (CaseError, OSError) as error:
                self.case_error = reason(error) if isinstance(error, OSError) else str(error)
        first = Case("device", HollowDisk(section="axisymmetric"), silicone("ecoflex-00-30"), pressures_cm=(1.0,))
        return dataclasses.replace(first, pressures_cm=in_unit("cm", FIRST_PRESSURES, "pressure", first.cm))

    def change(self, **fields: object) -> None:
        """Change fields of the case and write it; all pages follow.

        Raises:
            CaseError, ArgumentError: The case would be invalid; it stays as it was.
            OSError: It cannot be written.
        """
        self.case = dataclasses.replace(self.case, **fields)  # type: ignore[arg-type]
        self.case_error = ""
        replace_text(self / CASE, self.case.to_toml())
        self.changed.emit(CASE)

    def case_file(self) -> str:
        """Return the name of the case's file, which is written if it is not there yet."""
        if not (self / CASE).exists():
            self.change()
        return CASE

    # -- files that users bring ---------------------------------------------------------------------------------------

    def keep(self, folder: str, name: str, data: bytes, kind: FileKind) -> Path:
        """Write a file that a user brings to a free place, and return it.

        Args:
            folder: Where to.
            name: Of the user's file, which may be anything.
            data: Its content.
            kind: What it must be.

        Raises:
            FieldError: Another kind of file.
            OSError: It cannot be written.
        """
        wanted = re.sub(r"[^\w.+-]+", "_", Path(name.replace("\\", "/")).name).lstrip("._") or "file"
        stem, suffix = Path(wanted).stem[:80], Path(wanted).suffix[:12]
        if suffix.lower() not in kind.endings:
            raise FieldError(f"{name}: {kind.what} are {kind.formats}")
        place, number = self / folder / f"{stem}{suffix}", 2
        while place.exists():
            place, number = self / folder / f"{stem}-{number}{suffix}", number + 1
        write_bytes(place, data)
        return place

    def files(self, folder: str, endings: Iterable[str]) -> list[Path]:
        """Return the files in a folder with some endings, by name."""
        known = {ending.lower() for ending in endings}
        return sorted(path for path in (self / folder).iterdir() if path.suffix.lower() in known)
