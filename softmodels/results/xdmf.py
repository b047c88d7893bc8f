"""The light file that tells ParaView where the fields of every step are.

It spells out topology, geometry and all fields in every time step: VTK's reader crashes on the ``xi:include`` that DOLFINx
would write, and ParaView would show each field on a grid of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree

from softmodels.results.stored_step import StoredStep


def xdmf(name: str, heavy: str, shapes: tuple[int, tuple[int, ...], str], stored: Sequence[StoredStep]) -> bytes:
    """The XDMF of a folder of results.

    Args:
        name: Stem of the result files.
        heavy: The HDF5 file with the grid.
        shapes: Number of points, shape of the cells, and XDMF's name of them.
        stored: Where each step's fields are.
    """
    points, cells, cell_name = shapes
    root = ElementTree.Element("Xdmf", Version="3.0")
    domain = ElementTree.SubElement(root, "Domain")
    series = ElementTree.SubElement(domain, "Grid", Name=name, GridType="Collection", CollectionType="Temporal")
    for step in stored:
        grid = ElementTree.SubElement(series, "Grid", Name=name, GridType="Uniform")
        ElementTree.SubElement(grid, "Time", Value=str(step.row["step"]))
        topology = ElementTree.SubElement(grid, "Topology", TopologyType=cell_name, NumberOfElements=str(cells[0]))
        _item(topology, cells, f"{heavy}:/mesh/cells", "Int", "8")
        _item(
            ElementTree.SubElement(grid, "Geometry", GeometryType="XYZ"),
            (points, 3),
            f"{heavy}:/mesh/points",
        )
        for field, shape in step.shapes.items():
            kind = "Scalar" if len(shape) == 1 else "Vector"
            attribute = ElementTree.SubElement(grid, "Attribute", Name=field, AttributeType=kind, Center="Node")
            _item(attribute, shape, f"{step.file}:{step.group}/{field}")
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)


def _item(
    parent: ElementTree.Element, shape: tuple[int, ...], place: str, number: str = "Float", precision: str = "8"
) -> None:
    item = ElementTree.SubElement(
        parent, "DataItem", Dimensions=" ".join(map(str, shape)), NumberType=number, Precision=precision, Format="HDF"
    )
    item.text = place
