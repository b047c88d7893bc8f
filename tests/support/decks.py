"""A block with a closed chamber and a lid of another silicone, meshed by Gmsh: as a mesh, and as decks of other programs."""

from __future__ import annotations

from pathlib import Path

import gmsh
import numpy as np

from geometries.meshing import private_model

YEOH = (0.05, 0.004, 0.0003)
"""C10, C20 and C30 in MPa of the block."""
PRESSURE = 0.02
"""In MPa."""
BULK = 2.0
"""Of both, in MPa: D = 2/K."""
LID = (0.06, 0.02)
"""C10 and C01 in MPa of the lid."""
SIDES = {frozenset((0, 1, 2)): 1, frozenset((0, 1, 3)): 2, frozenset((1, 2, 3)): 3, frozenset((0, 2, 3)): 4}
"""Sides of a tetrahedron by its corners, as in Abaqus' manual."""
ROTATION = (np.array([1.0, 2.0, 3.0]), np.array([1.0, 2.0, 8.0]), 90.0)
"""Two points of an axis and an angle in degrees, as an instance's second data line."""
TRANSLATION = np.array([5.0, -3.0, 2.0])


def mesh(file: Path) -> tuple[np.ndarray, dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Write the mesh with names to a Gmsh file; return nodes in mm, cells of both bodies, and faces by name."""
    with private_model():
        occ, model = gmsh.model.occ, gmsh.model
        block = occ.cut([(3, occ.addBox(0, 0, 0, 20, 8, 8))], [(3, occ.addBox(4, 2, 2, 12, 4, 4))])[0]
        occ.fragment(block, [(3, occ.addBox(0, 0, 8, 20, 8, 2))])
        occ.synchronize()
        (first, second) = sorted((tag for _, tag in model.getEntities(3)), key=lambda tag: occ.getCenterOfMass(3, tag)[2])
        model.addPhysicalGroup(3, [first], name="block")
        model.addPhysicalGroup(3, [second], name="lid")
        every = [tag for _, tag in model.getEntities(2)]
        chamber = [tag for tag in every if occ.getBoundingBox(2, tag)[2] > 1 and occ.getBoundingBox(2, tag)[5] < 7]
        foot = [tag for tag in every if occ.getBoundingBox(2, tag)[3] < 0.1]
        seam = [tag for tag in every if abs(occ.getCenterOfMass(2, tag)[2] - 8) < 1e-6]
        faces = {"chamber": chamber, "foot": foot, "seam": seam}
        for name in ("chamber", "foot"):
            model.addPhysicalGroup(2, faces[name], name=name)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 4)
        gmsh.option.setNumber("Mesh.SecondOrderLinear", 1)
        model.mesh.generate(3)
        model.mesh.setOrder(2)
        gmsh.write(str(file))
        tags, places, _ = model.mesh.getNodes()
        row = np.zeros(int(tags.max()) + 1, dtype=int)
        row[tags.astype(int)] = np.arange(len(tags))
        to_abaqus = [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]
        cells = {
            name: row[model.mesh.getElementsByType(11, tag)[1].astype(int)].reshape(-1, 10)[:, to_abaqus]
            for name, tag in (("block", first), ("lid", second))
        }
        triangles = {
            name: np.concatenate(
                [row[model.mesh.getElementsByType(9, tag)[1].astype(int)].reshape(-1, 6)[:, :3] for tag in tags]
            )
            for name, tags in faces.items()
        }
        return places.reshape(-1, 3), cells, triangles


def _surface(name: str, cells: np.ndarray, triangles: np.ndarray, of: str = "", first: int = 1) -> list[str]:
    """Lines of sets of elements and the surface on their sides."""
    corners = {frozenset(triangle) for triangle in triangles.tolist()}
    sides: dict[int, list[int]] = {}
    for number, cell in enumerate(cells.tolist(), first):
        for side, k in SIDES.items():
            if frozenset(cell[i] for i in side) in corners:
                sides.setdefault(k, []).append(number)
    lines = []
    for k, numbers in sides.items():
        lines += [f"*Elset, elset=_{name}_S{k}, internal{of}", *(f"{n}," for n in numbers)]
    return [*lines, f"*Surface, type=ELEMENT, name={name}", *(f"_{name}_S{k}, S{k}" for k in sides)]


def _numbered(points: np.ndarray, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    used, local = np.unique(cells, return_inverse=True)
    return points[used], local.reshape(cells.shape)


def _lines(kind: str, options: str, rows: np.ndarray, first: int = 1) -> list[str]:
    return [f"*{kind}{options}", *(f"{i}, {', '.join(map(repr, row))}" for i, row in enumerate(rows.tolist(), first))]


MATERIALS = [
    "*Material, name=Soft Body", "*Density", "1.07e-9,",
    "*Hyperelastic, yeoh", f"{YEOH[0]}, {YEOH[1]}, {YEOH[2]}, {2 / BULK}, 0., 0.",
    "*Material, name=Stiff", "*Hyperelastic, mooney-rivlin", f"{LID[0]}, {LID[1]}, {2 / BULK}",
]  # fmt: skip


def assembly(points: np.ndarray, cells: dict[str, np.ndarray], faces: dict[str, np.ndarray]) -> str:
    """A deck of Abaqus: two parts of hybrid elements, the lid's drawn elsewhere and placed by its instance."""
    lines = ["*Heading", " a block and its lid"]
    for name, material in (("block", "Soft Body"), ("lid", "Stiff")):
        own, local = _numbered(points, cells[name])
        if name == "lid":  # where it was drawn: turned back by -90 degrees, then moved back
            start = own - ROTATION[0]
            own = np.column_stack([start[:, 1], -start[:, 0], start[:, 2]]) + ROTATION[0] - TRANSLATION
        lines += [f"*Part, name={name}", *_lines("Node", "", own), *_lines("Element", ", type=C3D10H", local + 1)]
        lines += ["*Elset, elset=Set-1, generate", f"1, {len(local)}, 1"]
        lines += [f"*Solid Section, elset=Set-1, material={material}", ",", "*End Part"]
    lines += ["*Assembly, name=Assembly", "*Instance, name=block-1, part=block", "*End Instance"]
    (a, b, angle), move = ROTATION, TRANSLATION
    lines += [
        "*Instance, name=lid-1, part=lid",
        ", ".join(map(str, move)),
        ", ".join(map(str, (*a, *b, angle))),
        "*End Instance",
    ]
    nodes = np.searchsorted(np.unique(cells["block"]), np.unique(_second(cells["block"], faces["foot"])))
    lines += ["*Nset, nset=_PickedSet5, internal, instance=block-1", *(f"{n + 1}," for n in nodes)]
    lid_foot = np.unique(_second(cells["lid"], faces["foot"]))
    nodes = np.searchsorted(np.unique(cells["lid"]), lid_foot)
    lines += ["*Nset, nset=_PickedSet5, internal, instance=lid-1", *(f"{n + 1}," for n in nodes)]
    lines += _surface("Chamber", cells["block"], faces["chamber"], ", instance=block-1")
    lines += _surface("Top", cells["block"], faces["seam"], ", instance=block-1")
    lines += _surface("Bottom", cells["lid"], faces["seam"], ", instance=lid-1")
    lines += ["*Tie, name=glue, adjust=yes", "Bottom, Top", "*End Assembly", *MATERIALS, "*Contact", "*Contact Inclusions"]
    lines += ["*Boundary", "_PickedSet5, ENCASTRE", "*Step, name=inflate, nlgeom=YES", "*Static", "0.1, 1., 1e-5, 1."]
    lines += ["*Dsload", f"Chamber, P, {PRESSURE}", "*Output, field, variable=PRESELECT", "*End Step", ""]
    return "\n".join(lines)


def _second(cells: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """All nodes of those sides of cells that are some triangles, those inside edges among them."""
    corners = {frozenset(triangle) for triangle in triangles.tolist()}
    edges = [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)]
    nodes = set()
    for cell in cells.tolist():
        for side in SIDES:
            if frozenset(cell[i] for i in side) in corners:
                nodes |= {cell[i] for i in side} | {cell[4 + k] for k, edge in enumerate(edges) if set(edge) <= side}
    return np.array(sorted(nodes))


def flat(points: np.ndarray, cells: dict[str, np.ndarray], faces: dict[str, np.ndarray], increments: int = 8) -> str:
    """A deck of CalculiX: the same on common nodes."""
    lines = ["*HEADING", "a block and its lid", *_lines("NODE", ", NSET=all", points)]
    start = 1
    for name, material in (("block", "Soft Body"), ("lid", "Stiff")):
        lines += _lines("ELEMENT", f", TYPE=C3D10, ELSET={name}", cells[name] + 1, start)
        lines += [f"*SOLID SECTION, ELSET={name}, MATERIAL={material.replace(' ', '_')}"]
        start += len(cells[name])
    foot = np.union1d(_second(cells["block"], faces["foot"]), _second(cells["lid"], faces["foot"]))
    lines += ["*NSET, NSET=foot", *(f"{n + 1}," for n in foot)]
    lines += [line.replace(", internal", "") for line in _surface("Chamber", cells["block"], faces["chamber"])]
    lines += [line.replace("Soft Body", "Soft_Body") for line in MATERIALS]
    lines += ["*BOUNDARY", "foot, 1, 3", f"*STEP, NLGEOM, INC={10 * increments}", "*STATIC", f"{1 / increments}, 1."]
    lines += ["*DSLOAD", f"Chamber, P, {PRESSURE}", "*NODE PRINT, NSET=all", "U", "*NODE FILE", "U", "*END STEP", ""]
    return "\n".join(lines)
