"""The light file that tells ParaView where the fields of every step are.

It spells out topology, geometry and all fields in every time step: VTK's reader crashes on the ``xi:include`` that DOLFINx
would write, and ParaView would show each field on a grid of its own.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from xml.etree import ElementTree

from softmodels.results.stored_step import StoredStep

HERE = "\ue000"
"""Where the steps go in the frame around them: a character for private use, which stands in no name."""


def xdmf(name: str, heavy: str, shapes: tuple[int, tuple[int, ...], str], stored: Sequence[StoredStep]) -> bytes:
    """The XDMF of a folder of results.

    Args:
        name: Stem of the result files.
        heavy: The HDF5 file with the grid.
        shapes: Number of points, shape of the cells, and XDMF's name of them.
        stored: Where each step's fields are.
    """
    root = ElementTree.Element("Xdmf", Version="3.0")
    domain = ElementTree.SubElement(root, "Domain")
    series = ElementTree.SubElement(domain, "Grid", Name=name, GridType="Collection", CollectionType="Temporal")
    series.text = HERE
    ElementTree.indent(root)
    frame = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    steps = [
        _grid(name, heavy, shapes, str(step.row["step"]), f"{step.file}:{step.group}", tuple(step.shapes.items()))
        for step in stored
    ]
    return frame.replace(HERE.encode(), "".join([*steps, "\n    "]).encode())


@functools.lru_cache(maxsize=4096)  # the file is written after each step, and the steps before have not changed
def _grid(
    name: str,
    heavy: str,
    shapes: tuple[int, tuple[int, ...], str],
    number: str,
    place: str,
    fields: tuple[tuple[str, tuple[int, ...]], ...],
) -> str:
    """One step's part of the file."""
    points, cells, cell_name = shapes
    grid = ElementTree.Element("Grid", Name=name, GridType="Uniform")
    ElementTree.SubElement(grid, "Time", Value=number)
    topology = ElementTree.SubElement(grid, "Topology", TopologyType=cell_name, NumberOfElements=str(cells[0]))
    _item(topology, cells, f"{heavy}:/mesh/cells", "Int", "8")
    _item(ElementTree.SubElement(grid, "Geometry", GeometryType="XYZ"), (points, 3), f"{heavy}:/mesh/points")
    for field, shape in fields:
        kind = "Scalar" if len(shape) == 1 else "Vector"
        attribute = ElementTree.SubElement(grid, "Attribute", Name=field, AttributeType=kind, Center="Node")
        _item(attribute, shape, f"{place}/{field}")
    ElementTree.indent(grid, level=3)
    return f"\n{3 * '  '}{ElementTree.tostring(grid, encoding='unicode')}"


def _item(
    parent: ElementTree.Element, shape: tuple[int, ...], place: str, number: str = "Float", precision: str = "8"
) -> None:
    item = ElementTree.SubElement(
        parent, "DataItem", Dimensions=" ".join(map(str, shape)), NumberType=number, Precision=precision, Format="HDF"
    )
    item.text = place
