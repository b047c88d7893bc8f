"""A deck of FEBio (febio_spec 4.0). Lengths in mm, pressures in Pa, forces in uN.

FEBio's "uncoupled" laws have the same isochoric energies; ``pressure_model`` 2 is K/2 (J - 1)^2 in the volume.
"""

from __future__ import annotations

from xml.etree import ElementTree

from softmodels.case.case import Case, CaseError
from softmodels.case.decks.deck import WRITTEN, Deck, acting, check
from softmodels.case.decks.silicone import Silicone

Node = ElementTree.Element

LARGEST_STEP = "0.1"
"""Of the time; one pressure follows the other at 1."""


def febio(deck: Deck) -> str:
    """The deck's text: time 1, 2, ... is at the requested pressures, in order."""
    root = Node("febio_spec", version="4.0")
    for text in (WRITTEN, *deck.remarks):
        root.append(ElementTree.Comment(f" {text.replace('--', '- -')} "))
    ElementTree.SubElement(root, "Module", type="solid")
    _control(root, len(deck.pressures))
    _materials(root, deck)
    _mesh(root, deck)
    domains = ElementTree.SubElement(root, "MeshDomains")
    for silicone in deck.silicones:
        for region in silicone.regions:
            ElementTree.SubElement(domains, "SolidDomain", name=region, mat=silicone.name)
    _boundary(root, deck)
    loads = ElementTree.SubElement(root, "Loads")
    load = ElementTree.SubElement(loads, "surface_load", name="air", type="pressure", surface="cavity")
    _text(load, "pressure", "1", lc="1")
    _text(load, "symmetric_stiffness", "1")
    data = ElementTree.SubElement(root, "LoadData")
    _curve(data, 1, "pressure", [f"{pressure:.12e}" for pressure in (0.0, *deck.pressures)])
    # FEBio's steps are as long as it likes; its curve of largest steps has the times that they do not pass.
    _curve(data, 2, "largest steps", [LARGEST_STEP] * (len(deck.pressures) + 1))
    output = ElementTree.SubElement(root, "Output")
    plot = ElementTree.SubElement(output, "plotfile", type="febio")
    ElementTree.SubElement(plot, "var", type="displacement")
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def check_without_loads(case: Case) -> None:
    """Refuse dead loads too; see `softmodels.case.decks.deck.check`."""
    check(case)
    if loads := acting(case):
        raise CaseError(
            f"the case has {', '.join(loads)}, and dead loads are written for CalculiX alone: name a file NAME.inp, or "
            "leave them out"
        )


def _text(parent: Node, tag: str, text: str, **attributes: str) -> None:
    ElementTree.SubElement(parent, tag, attributes).text = text


def _curve(parent: Node, number: int, name: str, values: list[str]) -> None:
    """A curve with a value at each of the times 0, 1, 2, ..."""
    curve = ElementTree.SubElement(parent, "load_controller", id=str(number), name=name, type="loadcurve")
    _text(curve, "interpolate", "LINEAR")
    points = ElementTree.SubElement(curve, "points")
    for time, value in enumerate(values):
        _text(points, "pt", f"{time},{value}")


def _control(root: Node, steps: int) -> None:
    control = ElementTree.SubElement(root, "Control")
    _text(control, "analysis", "STATIC")
    _text(control, "time_steps", str(20 * steps))
    _text(control, "step_size", "0.05")
    stepper = ElementTree.SubElement(control, "time_stepper", type="default")
    for tag, text in (("max_retries", "20"), ("opt_iter", "15"), ("dtmin", "0.0005")):
        _text(stepper, tag, text)
    _text(stepper, "dtmax", "0", lc="2")
    solver = ElementTree.SubElement(control, "solver", type="solid")
    _text(solver, "symmetric_stiffness", "symmetric")


def _materials(root: Node, deck: Deck) -> None:
    materials = ElementTree.SubElement(root, "Material")
    for number, silicone in enumerate(deck.silicones, 1):
        kind, names = _law(silicone)
        material = ElementTree.SubElement(materials, "material", id=str(number), name=silicone.name, type=kind)
        _text(material, "density", "1")
        _text(material, "k", f"{silicone.bulk:.12e}")
        _text(material, "pressure_model", "2")
        for name, value in names.items():
            _text(material, name, f"{value:.12e}")


def _law(silicone: Silicone) -> tuple[str, dict[str, float]]:
    """FEBio's name for a law and its parameters."""
    law, terms = silicone.material, silicone.invariant_terms
    if law.stretch_terms:
        names: dict[str, float] = {}
        for i, (mu, alpha) in enumerate(law.stretch_terms, 1):  # FEBio writes c/m^2 where this library has mu/alpha
            names |= {f"c{i}": mu * alpha, f"m{i}": alpha}
        return "Ogden", names
    if set(terms) <= {(1, 0), (0, 1)}:
        return "Mooney-Rivlin", {"c1": terms.get((1, 0), 0.0), "c2": terms.get((0, 1), 0.0)}
    if all(j == 0 and i <= 6 for i, j in terms):
        return "Yeoh", {f"c{i}": value for (i, _), value in terms.items()}
    raise CaseError(f"{law.name} has terms that FEBio has no law for; take Mooney-Rivlin, Yeoh or Ogden")


def _mesh(root: Node, deck: Deck) -> None:
    arrays = deck.mesh
    mesh = ElementTree.SubElement(root, "Mesh")
    nodes = ElementTree.SubElement(mesh, "Nodes", name="all")
    for number, (x, y, z) in enumerate(1e3 * arrays.points, 1):
        _text(nodes, "node", f"{x:.12e},{y:.12e},{z:.12e}", id=str(number))
    for region, cells in arrays.regions.items():
        elements = ElementTree.SubElement(mesh, "Elements", type="tet10", name=region)
        for cell in cells:
            _text(elements, "elem", _listed(arrays.cells[cell]), id=str(cell + 1))
    for component, held in deck.held.items():
        _text(mesh, "NodeSet", _listed(held), name=f"held{component}")
    for role in arrays.faces:
        surface = ElementTree.SubElement(mesh, "Surface", name=role)
        for number, triangle in enumerate(arrays.triangles(role), 1):
            _text(surface, "tri6", _listed(triangle), id=str(number))


def _boundary(root: Node, deck: Deck) -> None:
    boundary = ElementTree.SubElement(root, "Boundary")
    for component in deck.held:
        condition = ElementTree.SubElement(
            boundary, "bc", name=f"held{component}", type="zero displacement", node_set=f"held{component}"
        )
        for i, axis in enumerate("xyz"):
            _text(condition, f"{axis}_dof", str(int(i == component)))
    for node, component, factors in deck.tied:
        condition = ElementTree.SubElement(boundary, "bc", type="linear constraint")
        _text(condition, "node", str(node + 1))
        _text(condition, "dof", "xyz"[component])
        _text(condition, "offset", "0")
        for i, factor in factors.items():
            child = ElementTree.SubElement(condition, "child_dof")
            _text(child, "node", str(node + 1))
            _text(child, "dof", "xyz"[i])
            _text(child, "value", f"{factor:.12e}")


def _listed(nodes: object) -> str:
    return ",".join(str(int(node) + 1) for node in nodes)  # type: ignore[attr-defined]
