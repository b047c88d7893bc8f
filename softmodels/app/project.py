"""A project: a folder of plain files that the page, the command line and Python read alike."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable
from pathlib import Path

from softmodels.case.case import Case
from softmodels.case.entries import INPUT_ERRORS, CaseError
from softmodels.common.errors import FieldError, reason
from softmodels.common.files import read_file, replace_text, write_bytes

OUTLINES, LENS = "outlines", "lens.toml"
CASE, PHOTOS, SETUP, FITTED = "case.toml", "photos.csv", "setup.toml", "fitted.toml"
PHOTOGRAPHS, BOARDS, CURVES, RESULTS = "photographs", "boards", "curves", "results"
PREVIEW = 1600
"""Longest side of a photograph's preview in px."""
AUTO = "auto"
"""How photographs store light: as their edges show; `measurement.series.measuring.AUTO`, which this process does not import."""
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
        case_error: Why the file cannot be used; empty if it can. Nothing changes the file until it can.
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
        from softmodels.materials.silicones import silicone

        self._text = self.case_error = ""
        try:
            self._text = self._written()
        except OSError as error:
            self.case_error = f"it cannot be read: {reason(error)}"
        if self._text:
            try:
                return Case.from_toml(self._text, self.folder)
            except INPUT_ERRORS as error:
                self.case_error = str(error)
        first = Case("device", HollowDisk(section="axisymmetric"), silicone("ecoflex-00-30"), pressures_cm=(1.0,))
        return dataclasses.replace(first, pressures_cm=in_unit("cm", FIRST_PRESSURES, "pressure", first.cm))

    def _written(self) -> str:
        """Return the text of ``case.toml``; empty where there is none."""
        file = self / CASE
        return read_file(file).decode("utf-8", "replace") if file.exists() else ""

    @property
    def case_text(self) -> str:
        """The case's text: that of its file, if there is one."""
        return self._text or self.case.to_toml()

    def change(self, **fields: object) -> None:
        """Change fields of the case and write it; all pages follow.

        Raises:
            CaseError, ArgumentError: The case would be invalid, or what its file holds would be lost; it stays as it was.
            OSError: It cannot be written.
        """
        self._check_file()
        if self.case_error:
            raise CaseError(
                f"{CASE} cannot be used ({self.case_error}); correct it under The whole case, or set it aside"
            )
        self._take(changed := dataclasses.replace(self.case, **fields), changed.to_toml())  # type: ignore[arg-type]

    def change_text(self, text: str) -> None:
        """Take another text of the case; errors as of `change`."""
        self._check_file()
        self._take(Case.from_toml(text, self.folder), text)

    def set_aside(self) -> None:
        """Give a case file that cannot be used another name, and start anew.

        Raises:
            OSError: It cannot be renamed.
        """
        (self / CASE).rename(self._free(".", "case-aside", ".toml"))
        self.case = self._read_case()
        self.changed.emit(CASE)

    def _check_file(self) -> None:
        """Read the case again, and say so, if another program has changed its file."""
        if self._written() != self._text:
            self.case = self._read_case()
            self.changed.emit(CASE)
            raise CaseError(f"another program has changed {CASE}, which is shown now; change it again")

    def _take(self, case: Case, text: str) -> None:
        replace_text(self / CASE, text)
        self.case, self._text, self.case_error = case, text, ""
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
        place = self._free(folder, stem, suffix)
        write_bytes(place, data)
        return place

    def _free(self, folder: str, stem: str, suffix: str) -> Path:
        """Return a place in a folder where no file is yet."""
        place, number = self / folder / f"{stem}{suffix}", 2
        while place.exists():
            place, number = self / folder / f"{stem}-{number}{suffix}", number + 1
        return place

    def files(self, folder: str, endings: Iterable[str]) -> list[Path]:
        """Return the files in a folder with some endings, by name."""
        known = {ending.lower() for ending in endings}
        return sorted(path for path in (self / folder).iterdir() if path.suffix.lower() in known)
