"""A part drawn elsewhere: a STEP file, and texts that say which of its faces do what."""

from __future__ import annotations

import dataclasses
from typing import ClassVar

from geometries.errors import GeometryError
from geometries.fields import choice_field, length_field, number_field
from geometries.imported_part import ImportedPart, Reading
from geometries.imported_shape import build_part, open_part, read_part
from geometries.registry import register


@register
@dataclasses.dataclass(frozen=True, kw_only=True)
class ImportedActuator(ImportedPart):
    """A part from a STEP file, whose own unit counts; see `ImportedPart`.

    Several solids that touch are glued, and each is a region of its own name.
    """

    cell_size: float = length_field(0.003, "longest edge of the cells", shape=False)
    curvature: float = number_field(10.0, "cells around a full circle", shape=False)
    order: int = choice_field(2, (1, 2), "order of the cells' geometry: 1 straight, 2 curved edges")

    kind: ClassVar[str] = "STEP file (--file part.step)"

    def check_cells(self) -> None:
        if not 4.0 <= self.curvature <= 100.0:
            raise GeometryError(f"curvature is {self.curvature:g}; it must lie between 4 and 100 cells around a circle")

    @property
    def reading(self) -> Reading:
        return read_part(self, self.digest())

    @property
    def regions(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the file's solids, if there are several."""
        return self.reading.regions

    @property
    def mesh_order(self) -> int:
        return self.order

    def build_whole(self) -> None:
        if self.planes:
            raise GeometryError(
                f"file {self.file} draws one of {self.copies} equal pieces, cut on its planes; draw the whole part"
            )
        if len(open_part(self, "MM").tags) > 1:
            raise GeometryError(f"file {self.file} holds several solids; a mould is made of a part of one solid")

    def build(self) -> None:
        build_part(self)
