"""A deck in the words of CalculiX and of FEBio."""

from __future__ import annotations

import io
from collections.abc import Iterable
from typing import TextIO
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

from geometries.mesh_arrays import Ints
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.components.contact import Obstacle, RigidShape
from softmodels.components.fibres import Fabric, Fibres
from softmodels.decks.deck import WRITTEN, Deck, DeckSilicone, Rigged, check

# ----------------------------------------------------------------------------------------------------------------------
# Write a deck for CalculiX, which Abaqus also reads except for solver keywords. Lengths in mm, pressures in Pa, forces in uN.
#
# In metres the nodal forces are so small that CalculiX treats a residual as zero. C3D10 has displacements only: compare with
# ``formulation = "displacement"``.


NO_TERM = 1e10
"""D of a volumetric term without effect: for 0 CalculiX uses its own default."""
PATIENT = "*CONTROLS, PARAMETERS=TIME INCREMENTATION\n30, 40, 9, 60, 10, 4, , 10\n"
CLOSE = "*CONTROLS, PARAMETERS=FIELD\n1e-5, 1e-3, , , 1e-5, 1e-5, 1e-8, 1e-8\n"
"""Tolerances of residual and correction, instead of the default 0.5 % and 1 %."""

NOTHING = 1e-12
"""Fraction of the largest nodal force below which a force is rounding error."""


def calculix(deck: Deck) -> str:
    """Return the deck's text: a step for the dead loads, if there are any, and one for each requested pressure."""
    out = io.StringIO()
    for text in (WRITTEN, *deck.remarks):
        out.write(f"** {text}\n")
    _write_mesh(deck, out)
    for tie in deck.tied:
        terms = [(tie.node, tie.component, -1.0), *((*at, factor) for at, factor in tie.terms.items())]
        entries = [f"{node + 1}, {i + 1}, {factor:.12e}" for node, i, factor in terms]
        lines = [", ".join(entries[at : at + 4]) for at in range(0, len(entries), 4)]
        out.write(f"*EQUATION\n{len(terms)}\n" + "\n".join(lines) + "\n")
    for one in deck.supports.rigged:
        if one.turn is not None:
            name = f"RIGID_{one.name}".upper()
            out.write(_cards(f"*NSET, NSET={name}", one.nodes))
            out.write(f"*RIGID BODY, NSET={name}, REF NODE={one.place + 1}, ROT NODE={one.turn + 1}\n")
    for component, nodes in deck.held.items():
        out.write(_cards(f"*NSET, NSET=HELD{component + 1}", nodes))
    out.write("*BOUNDARY\n")
    for component in deck.held:
        out.write(f"HELD{component + 1}, {component + 1}, {component + 1}\n")
    for silicone in deck.silicones:
        out.write(f"*MATERIAL, NAME={silicone.name.upper()}\n{_calculix_law(silicone)}")
        sets = ["SOLID"] if len(deck.silicones) == 1 else [region.upper() for region in silicone.regions]
        out.writelines(f"*SOLID SECTION, ELSET={name}, MATERIAL={silicone.name.upper()}\n" for name in sets)
    _write_springs(deck, out)
    if deck.forces is not None:
        _write_step(out, "*CLOAD\n" + _forces(deck.forces))
    for pressures in deck.pressures:
        loads = [f"{role.upper()}, P, {p:.12e}\n" for role, p in zip(deck.walls, pressures, strict=True)]
        _write_step(out, "*DSLOAD\n" + "".join(loads))
    return out.getvalue()


def _write_step(out: TextIO, load: str) -> None:
    """Write a step that applies a load; loads of earlier steps stay."""
    out.write("*STEP, NLGEOM, INC=400\n*STATIC\n0.1, 1., 1e-4, 0.2\n" + PATIENT + CLOSE)
    out.write(f"{load}*NODE FILE\nU\n")
    out.write("*NODE PRINT, NSET=PROBES, FREQUENCY=10000\nU\n*END STEP\n")


def _forces(forces: npt.NDArray[np.float64]) -> str:
    """Return the lines with the forces on nodes, from N."""
    lines = []
    for node, component in np.argwhere(np.abs(forces) > NOTHING * np.abs(forces).max()):
        lines.append(f"{node + 1}, {component + 1}, {1e6 * forces[node, component]:.12e}\n")
    return "".join(lines)


def _write_mesh(deck: Deck, out: TextIO) -> None:
    mesh = deck.mesh
    out.write("*NODE, NSET=ALL\n")
    for number, (x, y, z) in enumerate(1e3 * deck.points, 1):
        out.write(f"{number}, {x:.12e}, {y:.12e}, {z:.12e}\n")
    for name, cells in mesh.regions.items():
        out.write(f"*ELEMENT, TYPE=C3D10, ELSET={name.upper()}\n")
        for cell in cells:
            out.write(f"{cell + 1}, " + ", ".join(str(node + 1) for node in mesh.cells[cell]) + "\n")
    if list(mesh.regions) != ["solid"]:
        others = [name.upper() for name in mesh.regions if name != "solid"]
        out.write("*ELSET, ELSET=SOLID\n" + "\n".join(others) + "\n")
    for role, faces in mesh.faces.items():
        out.write(f"*SURFACE, NAME={role.upper()}, TYPE=ELEMENT\n")
        out.writelines(f"{cell + 1}, S{side + 1}\n" for cell, side in faces)
    for role, nodes in mesh.nodes.items():
        out.write(_cards(f"*NSET, NSET=ON_{role.upper()}", nodes))
    out.write(_cards("*NSET, NSET=PROBES", deck.watched.values()))


def _write_springs(deck: Deck, out: TextIO) -> None:
    """Write each spring with its own table: elements, and forces in uN over elongations in mm."""
    number = len(deck.mesh.cells)
    for part, (one, first) in enumerate(deck.grounds, 1):
        for begin, end, stretches, forces in one.elements:
            name, number = f"SPRING{part}_{end}", number + 1
            out.write(f"*ELEMENT, TYPE=SPRINGA, ELSET={name}\n{number}, {first + begin + 1}, {first + end + 1}\n")
            # Blank lines are skipped: real numbers distinguish a table from the degrees of freedom of other springs.
            pairs = zip(1e6 * forces, 1e3 * stretches, strict=True)
            table = "".join(f"{force:.8e}, {stretch:.10e}\n" for force, stretch in pairs)
            out.write(f"*SPRING, ELSET={name}, NONLINEAR\n{table}")


def _calculix_law(silicone: DeckSilicone) -> str:
    """Return CalculiX's material cards of the silicone, with volumetric energy (1/D) (J - 1)^2."""
    terms, d1 = silicone.invariant_terms, 2 / silicone.bulk
    if stretches := silicone.material.stretch_terms:
        factors = [value for mu, alpha in stretches for value in (mu * alpha / 2, alpha)]
        values = [*factors, d1, *([NO_TERM] * (len(stretches) - 1))]
        return f"*HYPERELASTIC, OGDEN, N={len(stretches)}\n" + _lines(values)
    if set(terms) <= {(1, 0), (0, 1)}:
        return "*HYPERELASTIC, MOONEY-RIVLIN\n" + _lines([terms.get((1, 0), 0.0), terms.get((0, 1), 0.0), d1])
    if set(terms) <= {(1, 0), (2, 0), (3, 0)}:
        return "*HYPERELASTIC, YEOH\n" + _lines([*(terms.get((i, 0), 0.0) for i in (1, 2, 3)), d1, NO_TERM, NO_TERM])
    raise CaseError(f"{silicone.material.name} has terms without a CalculiX law; write a .feb for FEBio")


def _lines(values: list[float]) -> str:
    """At most eight numbers in a line."""
    return "".join(
        ", ".join(f"{value:.12e}" for value in values[at : at + 8]) + "\n" for at in range(0, len(values), 8)
    )


def _cards(keyword: str, nodes: Iterable[int]) -> str:
    """Return a set of nodes that count from 0; a line may hold at most 16."""
    values = [str(int(node) + 1) for node in nodes]
    return f"{keyword}\n" + "".join(", ".join(values[at : at + 12]) + "\n" for at in range(0, len(values), 12))


# ----------------------------------------------------------------------------------------------------------------------
# Write a deck for FEBio (febio_spec 4.0). Lengths in mm, pressures in Pa, forces in uN.
#
# Rigid parts that do not rotate are linear constraints; a rotating one is a rigid body without elements, followed by its nodes.
# FEBio's "uncoupled" laws have the same isochoric energies; ``pressure_model`` 2 is K/2 (J - 1)^2 in the volume.


Node = ElementTree.Element

FIRST_CAVITY = 2
"""Number of the pressure's load curve."""
LARGEST_STEP = "0.1"
"""Unit of time between requested pressures."""


def febio(deck: Deck) -> str:
    """Return the deck's text: time 1, 2, ... is at the requested pressures in order, after the dead loads
    if any."""
    root = Node("febio_spec", version="4.0")
    for text in (WRITTEN, *deck.remarks):
        root.append(ElementTree.Comment(f" {text.replace('--', '- -')} "))
    ElementTree.SubElement(root, "Module", type="solid")
    _control(root, len(deck.pressures) + (deck.forces is not None))
    _materials(root, deck)
    _mesh(root, deck)
    domains = ElementTree.SubElement(root, "MeshDomains")
    for silicone in deck.silicones:
        for region in silicone.regions:
            ElementTree.SubElement(domains, "SolidDomain", name=region, mat=silicone.name)
    _mesh_data(root, deck)
    _boundary(root, deck)
    _rigid(root, deck)
    _loads(root, deck)
    _curves(root, deck)
    output = ElementTree.SubElement(root, "Output")
    plot = ElementTree.SubElement(output, "plotfile", type="febio")
    ElementTree.SubElement(plot, "var", type="displacement")
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def check_without_springs(case: Case) -> None:
    """Also reject contact, fibres and fabrics; see `softmodels.decks.deck.check`."""
    check(case)
    sprung = [part.where for part in case.components if isinstance(part, (Obstacle, RigidShape, Fibres, Fabric))]
    if sprung:
        raise CaseError(
            f"the case has {', '.join(sprung)}, which is supported for CalculiX only: name the file NAME.inp, or "
            "leave it out"
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


def _curves(root: Node, deck: Deck) -> None:
    """Write the load curves, numbered in order: largest steps, each cavity's pressure, then dead loads."""
    data, loaded, steps = ElementTree.SubElement(root, "LoadData"), deck.forces is not None, len(deck.pressures)
    # FEBio chooses its step lengths; the curve of largest steps holds the times to stop at.
    _curve(data, 1, "largest steps", [LARGEST_STEP] * (1 + loaded + steps))
    for number, (role, pressures) in enumerate(zip(deck.walls, deck.pressures.T, strict=True), FIRST_CAVITY):
        _curve(data, number, f"pressure {role}", [f"{p:.12e}" for p in (*[0.0] * (1 + loaded), *pressures)])
    if loaded:
        _curve(data, FIRST_CAVITY + len(deck.walls), "dead loads", ["0", *["1"] * (1 + steps)])


def _control(root: Node, steps: int) -> None:
    control = ElementTree.SubElement(root, "Control")
    _text(control, "analysis", "STATIC")
    _text(control, "time_steps", str(20 * steps))
    _text(control, "step_size", "0.05")
    stepper = ElementTree.SubElement(control, "time_stepper", type="default")
    for tag, text in (("max_retries", "20"), ("opt_iter", "15"), ("dtmin", "0.0005")):
        _text(stepper, tag, text)
    _text(stepper, "dtmax", "0", lc="1")
    solver = ElementTree.SubElement(control, "solver", type="solid")
    _text(solver, "symmetric_stiffness", "symmetric")


def _materials(root: Node, deck: Deck) -> None:
    materials = ElementTree.SubElement(root, "Material")
    for number, silicone in enumerate(deck.silicones, 1):
        kind, names = _febio_law(silicone)
        material = ElementTree.SubElement(materials, "material", id=str(number), name=silicone.name, type=kind)
        _text(material, "density", "1")
        _text(material, "k", f"{silicone.bulk:.12e}")
        _text(material, "pressure_model", "2")
        for name, value in names.items():
            _text(material, name, f"{value:.12e}")
    for number, one in enumerate(_turning(deck), len(deck.silicones) + 1):
        material = ElementTree.SubElement(materials, "material", id=str(number), name=_body(one), type="rigid body")
        _text(material, "density", "1")
        _text(material, "override_com", "1")
        _text(material, "center_of_mass", ",".join(f"{1e3 * x:.12e}" for x in deck.points[one.place]))


def _febio_law(silicone: DeckSilicone) -> tuple[str, dict[str, float]]:
    """Return FEBio's name for a law and its parameters."""
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
    raise CaseError(f"{law.name} has terms without a FEBio law; use Mooney-Rivlin, Yeoh or Ogden")


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
    for component, held in _held(deck).items():
        _text(mesh, "NodeSet", _listed(held), name=f"held{component}")
    for one in _turning(deck):
        _text(mesh, "NodeSet", _listed(one.nodes), name=f"on_{one.name}")
    if deck.forces is not None:
        _text(mesh, "NodeSet", _listed(range(len(arrays.points))), name="every")
    for role in arrays.faces:
        surface = ElementTree.SubElement(mesh, "Surface", name=role)
        for number, triangle in enumerate(arrays.triangles(role), 1):
            _text(surface, "tri6", _listed(triangle), id=str(number))


def _boundary(root: Node, deck: Deck) -> None:
    boundary = ElementTree.SubElement(root, "Boundary")
    for component in _held(deck):
        condition = ElementTree.SubElement(
            boundary, "bc", name=f"held{component}", type="zero displacement", node_set=f"held{component}"
        )
        for i, axis in enumerate("xyz"):
            _text(condition, f"{axis}_dof", str(int(i == component)))
    for one in _turning(deck):
        name = f"on_{one.name}"
        condition = ElementTree.SubElement(boundary, "bc", name=name, type="rigid", node_set=name)
        _text(condition, "rb", _body(one))
    for tie in deck.supports.tied:
        condition = ElementTree.SubElement(boundary, "bc", type="linear constraint")
        _text(condition, "node", str(tie.node + 1))
        _text(condition, "dof", "xyz"[tie.component])
        _text(condition, "offset", "0")
        for (node, i), factor in tie.terms.items():
            child = ElementTree.SubElement(condition, "child_dof")
            _text(child, "node", str(node + 1))
            _text(child, "dof", "xyz"[i])
            _text(child, "value", f"{factor:.12e}")


def _moving_forces(deck: Deck) -> npt.NDArray[np.float64]:
    """Return the dead loads in uN, shape (n, 3): those on tied displacements transferred to the others.

    FEBio puts forces on nodes into its equations as they are, without asking whether a displacement is tied.
    """
    assert deck.forces is not None
    found = 1e6 * deck.forces
    for tie in deck.supports.tied:
        for at, factor in tie.terms.items():
            found[at] += factor * 1e6 * deck.forces[tie.node, tie.component]
    for tie in deck.supports.tied:
        found[tie.node, tie.component] = 0.0
    for component, nodes in _held(deck).items():
        found[nodes, component] = 0.0
    return found


def _mesh_data(root: Node, deck: Deck) -> None:
    """Write the forces on all nodes by component, to which `_loads` refers."""
    if deck.forces is None:
        return
    data = ElementTree.SubElement(root, "MeshData")
    for axis, forces in zip("xyz", _moving_forces(deck).T, strict=True):
        nodes = ElementTree.SubElement(data, "NodeData", name=f"force_{axis}", node_set="every", data_type="scalar")
        for number, force in enumerate(forces, 1):
            _text(nodes, "node", f"{force:.12e}", lid=str(number))


def _loads(root: Node, deck: Deck) -> None:
    loads = ElementTree.SubElement(root, "Loads")
    for number, role in enumerate(deck.walls, FIRST_CAVITY):
        load = ElementTree.SubElement(loads, "surface_load", name=f"air_{role}", type="pressure", surface=role)
        _text(load, "pressure", "1", lc=str(number))
        _text(load, "symmetric_stiffness", "1")
    if deck.forces is not None:
        for axis in "xyz":
            load = ElementTree.SubElement(loads, "nodal_load", name=f"dead_{axis}", type="nodal_load", node_set="every")
            _text(load, "dof", axis)
            _text(load, "scale", f"force_{axis}", type="map", lc=str(FIRST_CAVITY + len(deck.walls)))


def _rigid(root: Node, deck: Deck) -> None:
    """Write the free motions of rotating rigid parts."""
    section = ElementTree.SubElement(root, "Rigid") if _turning(deck) else root
    for one in _turning(deck):
        if any(tie.node in (one.place, one.turn) for tie in deck.supports.tied):
            raise CaseError(
                f"the rigid part {one.name} rotates in a half model whose cut is not a coordinate plane, which FEBio's rigid "
                f"bodies do not support; name the file NAME.inp, or model the whole device"
            )
        condition = ElementTree.SubElement(section, "rigid_bc", name=f"{one.name}_left", type="rigid_fixed")
        _text(condition, "rb", _body(one))
        for node, names in ((one.place, "xyz"), (one.turn, "uvw")):
            for component, name in enumerate(names):
                _text(condition, f"R{name}_dof", str(int(node in deck.held.get(component, []))))


def _turning(deck: Deck) -> list[Rigged]:
    """Return the rigid parts that rotate."""
    return [one for one in deck.supports.rigged if one.turn is not None]


def _held(deck: Deck) -> dict[int, Ints]:
    """Return the held displacements of the mesh's own nodes, by component, without the deck's extra nodes."""
    found = {component: nodes[nodes < len(deck.mesh.points)] for component, nodes in deck.held.items()}
    return {component: nodes for component, nodes in found.items() if len(nodes)}


def _body(one: Rigged) -> str:
    """Return the name of a rigid body's material."""
    return f"rigid_{one.name}"


def _listed(nodes: object) -> str:
    return ",".join(str(int(node) + 1) for node in nodes)  # type: ignore[attr-defined]
