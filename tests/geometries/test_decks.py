"""Decks of Abaqus and CalculiX become cases: `softmodels import`."""

import re
import shutil
import subprocess

import gmsh
import numpy as np
import pytest
from click.testing import CliRunner

import softmodels as sm
from geometries import abaqus as deck_reader
from geometries.imported import mesh_of
from geometries.meshing import private_model
from softmodels.case import abaqus
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.cli.exports import import_command
from softmodels.common.errors import GeometryError
from softmodels.path import steps
from tests.support import decks


@pytest.fixture(scope="module")
def block(tmp_path_factory):
    """Folder with the mesh and both decks, and its nodes, cells and faces."""
    folder = tmp_path_factory.mktemp("decks")
    made = decks.mesh(folder / "block.msh")
    (folder / "block.inp").write_text(decks.assembly(*made))
    (folder / "flat.inp").write_text(decks.flat(*made))
    return folder, made


def by_hand(folder) -> Case:
    """The case of the Gmsh file, written by hand."""
    c1, c2, c3 = (1e6 * c for c in decks.YEOH)
    c10, c01 = (1e6 * c for c in decks.LID)

    def poisson(mu):
        return (3 * 1e6 * decks.BULK - 2 * mu) / (6 * 1e6 * decks.BULK + 2 * mu)

    return Case.from_toml(
        f"""
        [geometry]
        device = "ImportedMesh"
        file = "block.msh"
        cavities = ["named chamber"]
        support = "named foot"
        [material]
        law = "yeoh"
        c1 = "{c1} Pa"
        c2 = "{c2} Pa"
        c3 = "{c3} Pa"
        poisson = {poisson(2 * c1)!r}
        [region.lid]
        law = "mooney-rivlin"
        c10 = "{c10} Pa"
        c01 = "{c01} Pa"
        poisson = {poisson(2 * (c10 + c01))!r}
        [load]
        pressure = "0:{1e6 * decks.PRESSURE} Pa"
        """,
        folder,
    )


def test_an_assembly_is_read_whole(block):
    """Two instances, one drawn elsewhere, tied; surfaces, laws, support and pressure; contact is listed."""
    folder, (_, cells, _) = block
    made = abaqus.import_model(folder / "block.inp", folder)
    case = made.case
    file = folder / "block.inp"
    assert made.unread == (f"*Contact (line {line_of(file, '*Contact')})",
                           f"*Contact inclusions (line {line_of(file, '*Contact Inclusions')})")  # fmt: skip
    assert case.actuator.expected_cells == len(cells["block"]) + len(cells["lid"])
    assert case.actuator.solid_volume == pytest.approx((20 * 8 * 10 - 12 * 4 * 4) * 1e-9, rel=1e-12)
    assert case.actuator.cavity_volume == pytest.approx(12 * 4 * 4 * 1e-9, rel=1e-12)
    hand = by_hand(folder)
    assert case.material.c1 == hand.material.c1 and case.material.poisson == pytest.approx(hand.material.poisson, rel=1e-14)
    (region,) = (part for part in case.components if isinstance(part, sm.Region))
    assert region.name == "stiff" and region.material.c01 == pytest.approx(20e3, rel=1e-14)
    assert case.values[-1] == pytest.approx(1e6 * decks.PRESSURE)


def line_of(file, keyword):
    return next(i for i, line in enumerate(file.read_text().splitlines(), 1) if line == keyword)


@pytest.mark.campaign
def test_an_assembly_is_solved_as_by_hand(block):
    """The same path as of the Gmsh file with a case by hand, within 1e-8."""
    folder, _ = block
    runs = [sm.run(case) for case in (abaqus.import_model(folder / "block.inp", folder).case, by_hand(folder))]
    volumes = [np.array(run.added_volume) for run in runs]
    assert len(volumes[0]) == len(volumes[1]) > 1
    assert volumes[0] == pytest.approx(volumes[1], rel=1e-8)


@pytest.mark.campaign
@pytest.mark.skipif(not shutil.which("ccx"), reason="no CalculiX")
def test_a_deck_is_solved_as_by_calculix(block):
    """CalculiX runs the very file that is imported; the largest displacement agrees within 1e-3."""
    folder, (points, _, _) = block
    subprocess.run(["ccx", "flat"], cwd=folder, check=True, capture_output=True)
    blocks = re.split(r"displacements .*\n", (folder / "flat.dat").read_text())
    rows = np.array([line.split() for line in blocks[-1].strip().splitlines()], dtype=float)
    far = int(np.linalg.norm(rows[:, 1:], axis=1).argmax())
    place, moved = points[int(rows[far, 0]) - 1], rows[far, 1:]
    axis = int(np.abs(moved).argmax())
    made = abaqus.import_model(folder / "flat.inp", folder)
    text = made.text.replace(
        "[geometry]\n", f'[geometry]\ngauge_point = "at {place[0]}, {place[1]}, {place[2]} mm"\nrise = "{"xyz"[axis]}"\n'
    )
    text += '\n[solver]\nformulation = "displacement"\n' if "[solver]" not in text else ""
    run = sm.run(Case.from_toml(text, folder))
    assert 1e3 * run.tip[-1] == pytest.approx(moved[axis], rel=1e-3)


BRICKS = """*NODE
1, 0, 0, 0
2, 10, 0, 0
3, 10, 10, 0
4, 0, 10, 0
5, 0, 0, 10
6, 10, 0, 10
7, 10, 10, 10
8, 0, 10, 10
9, 20, 0, 0
10, 20, 0, 10
*ELEMENT, TYPE=C3D8R, ELSET=BRICK
1, 1, 2, 3, 4, 5, 6, 7, 8
*ELEMENT, TYPE=C3D6H, ELSET=WEDGE
2, 2, 9, 3, 6, 10, 7
*SURFACE, NAME=SHARED
1, S4
*SURFACE, NAME=LOW
BRICK, S1
WEDGE, S1
"""


@pytest.mark.parametrize("order", range(6))
def test_bricks_and_wedges_are_split_face_to_face(tmp_path, order):
    """Whatever the numbers of their nodes: the volume is theirs, and no face between them is left outside."""
    numbers = np.random.default_rng(order).permutation(10)
    lines = BRICKS.splitlines()
    nodes = [lines[1 + i] for i in numbers]
    (tmp_path / "bricks.inp").write_text("\n".join([lines[0], *nodes, *lines[11:]]) + "\n")
    deck = deck_reader.Deck("bricks.inp", (tmp_path / "bricks.inp").read_text())
    mesh = mesh_of("bricks.inp", deck.mesh(), 1e-3)
    assert mesh.volume == pytest.approx(1.5e-6, rel=1e-12) and len(mesh.cells) == 9
    assert len(mesh.triangles) == 2 * 5 + 2 * 2 + 2
    assert len(mesh.named("LOW")) == 3 and len(mesh.named("SHARED")) == 0 and len(mesh.faces["SHARED"]) == 2
    assert len(mesh.regions["BRICK"]) == 6


def test_curved_bricks_keep_their_volume(tmp_path):
    """Hexahedra of 20 and wedges of 15 nodes beside each other, whose edges follow a quadratic map."""
    with private_model():
        gmsh.model.occ.addRectangle(0, 0, 0, 2, 1)
        gmsh.model.occ.addRectangle(2, 0, 0, 1, 1)
        gmsh.model.occ.fragment([(2, 1)], [(2, 2)])
        gmsh.model.occ.synchronize()
        gmsh.model.mesh.setTransfiniteAutomatic([(2, 1)])
        gmsh.model.occ.extrude([(2, 1), (2, 2)], 0, 0, 1, numElements=[2], recombine=True)
        gmsh.model.occ.synchronize()
        gmsh.model.mesh.setRecombine(2, 1)
        gmsh.option.setNumber("Mesh.SecondOrderIncomplete", 1)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.6)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(2)
        tags, places, _ = gmsh.model.mesh.getNodes()
        blocks = {kind: gmsh.model.mesh.getElementsByType(number)[1] for kind, number in (("C3D20", 17), ("C3D15", 18))}
    x, y, z = places.reshape(-1, 3).T
    points = np.column_stack([x + 0.1 * y * y, y + 0.05 * x * x, z + 0.04 * x * y])
    # Gmsh's edges in the order of Abaqus.
    orders = {
        "C3D20": [0, 1, 2, 3, 4, 5, 6, 7, 8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15],
        "C3D15": [0, 1, 2, 3, 4, 5, 6, 9, 7, 12, 14, 13, 8, 10, 11],
    }
    lines = ["*NODE", *(f"{int(tag)}, {', '.join(map(repr, p))}" for tag, p in zip(tags, points.tolist(), strict=True))]
    start = 1
    for kind, order in orders.items():
        cells = blocks[kind].astype(int).reshape(-1, len(order))[:, order]
        assert len(cells)
        lines += [
            f"*ELEMENT, TYPE={kind}",
            *(f"{i}, {', '.join(map(str, cell))}" for i, cell in enumerate(cells.tolist(), start)),
        ]
        start += len(cells)
    mesh = mesh_of("curved.inp", deck_reader.Deck("curved.inp", "\n".join(lines) + "\n").mesh(), 1.0)
    # det of the map is 1 - 0.2 y 0.1 x, and z's part does not matter.
    assert mesh.volume == pytest.approx(3.0 - 0.02 * (9 / 2) * (1 / 2), rel=2e-3)
    assert len(mesh.bodies) == 1


LAWS = {
    "*Hyperelastic, neo hooke\n0.1, 0.": sm.Yeoh(1e5, poisson=0.5),
    "*Hyperelastic, reduced polynomial, n=2\n0.1, 0.01, 2., 0.": sm.Yeoh(1e5, 1e4, poisson=(3e6 - 4e5) / (6e6 + 4e5)),
    "*Hyperelastic, polynomial, n=2\n0.1, 0.02, 3e-3, 4e-4, 5e-5, 2., 0.": sm.Polynomial(
        1e5, 2e4, 3e3, 4e2, 5e1, poisson=(3e6 - 4.8e5) / (6e6 + 4.8e5)
    ),
    "*Hyperelastic, polynomial, n=1\n0.1, 0.02, 0.": sm.MooneyRivlin(1e5, 2e4, 0.5),
    "*Hyperelastic, n=2, ogden\n0.1, 2., 0.05, -3.,\n1., 0.": sm.Ogden.from_two_mu(
        (1e5, 5e4), (2.0, -3.0), (6e6 - 3e5) / (12e6 + 3e5)
    ),
    "*Elastic\n1.2, 0.3": sm.NeoHookean.from_young(1.2e6, 0.3),
}


@pytest.mark.parametrize("card", LAWS)
def test_laws_are_read(tmp_path, card):
    text = decks_of_one(card)
    (tmp_path / "one.inp").write_text(text)
    made = abaqus.import_model(tmp_path / "one.inp", tmp_path)
    assert made.case.material == LAWS[card]


def decks_of_one(card: str) -> str:
    """A hollow cube of bricks with a material."""
    nodes = [(x, y, z) for z in range(4) for y in range(4) for x in range(4)]
    number = {place: i for i, place in enumerate(nodes, 1)}
    cells = [
        [number[x + dx, y + dy, z + dz] for dz in (0, 1) for dx, dy in ((0, 0), (1, 0), (1, 1), (0, 1))]
        for z in range(3) for y in range(3) for x in range(3) if (x, y, z) != (1, 1, 1)
    ]  # fmt: skip
    faces = [(i, side) for i, side in ((5, "S2"), (22, "S1"), (11, "S5"), (16, "S3"), (13, "S4"), (14, "S6"))]
    return "\n".join([
        "*NODE", *(f"{i}, {x}, {y}, {z}" for (x, y, z), i in number.items()),
        "*ELEMENT, TYPE=C3D8H, ELSET=Cube", *(f"{i}, {', '.join(map(str, c))}" for i, c in enumerate(cells, 1)),
        "*SURFACE, NAME=Inside", *(f"{i}, {side}" for i, side in faces),
        "*NSET, NSET=Foot, GENERATE", "1, 16", "*NSET, NSET=Top, GENERATE", "49, 64",
        "*SOLID SECTION, ELSET=Cube, MATERIAL=Rubber", "*MATERIAL, NAME=Rubber", card,
        "*BOUNDARY", "Foot, ENCASTRE", "Top, 1, 2", "*STEP, NLGEOM", "*STATIC", "*DSLOAD", "Inside, P, 0.01", "*END STEP",
        "*STEP, NLGEOM", "*STATIC", "*DSLOAD", "Inside, P, 0.03", "*DLOAD", "Cube, GRAV, 9810., 0., 0., -1.", "*END STEP", "",
    ])  # fmt: skip


def test_steps_gravity_and_a_guided_face_are_read(tmp_path):
    """Pressures of two steps; the top slips only along z; densities and accelerations follow from both units."""
    (tmp_path / "one.inp").write_text(decks_of_one("*Density\n1.07e-9,\n*Hyperelastic, neo hooke\n0.1, 0.\n*Damping, alpha=1"))
    made = abaqus.import_model(tmp_path / "one.inp", tmp_path)
    (gravity,) = (part for part in made.case.components if isinstance(part, sm.Gravity))
    assert gravity.density == pytest.approx(1070.0) and gravity.magnitude == pytest.approx(9.81)
    (clamp,) = (part for part in made.case.components if isinstance(part, sm.Clamp))
    assert clamp.slip == "z" and clamp.face == "top"
    assert list(made.case.values) == pytest.approx([0.0, 1e4, 3e4])
    assert made.unread == (f"*Damping (line {line_of(tmp_path / 'one.inp', '*Damping, alpha=1')})",)


def test_a_fluid_cavity_has_the_pressure_of_its_node(tmp_path):
    """And one line of *Boundary may be a pressure, the other a support."""
    text = decks_of_one("*Hyperelastic, neo hooke\n0.1, 0.").replace(
        "*DSLOAD\nInside, P, 0.01", "*BOUNDARY\nRef, 8, 8, 0.02\nFoot, 1, 3"
    )
    text = text.replace("*DSLOAD\nInside, P, 0.03\n", "").replace("Foot, ENCASTRE\n", "Foot, 1\n")
    text = text.replace("*MATERIAL", "*FLUID CAVITY, NAME=Air, REF NODE=Ref, SURFACE=Inside\n*MATERIAL")
    (tmp_path / "one.inp").write_text(text)
    case = abaqus.import_model(tmp_path / "one.inp", tmp_path).case
    assert case.actuator.cavities == ("named Inside",)
    assert case.actuator.support.lower() == "named foot" and list(case.values)[-1] == pytest.approx(2e4)


def test_cavities_may_have_steps_of_their_own(tmp_path):
    """Two surfaces of one chamber's walls would be one cavity; of two blocks they are two, each with its series."""
    text = decks_of_one("*Hyperelastic, neo hooke\n0.1, 0.")
    lines = text.splitlines()
    cells = [line for line in lines[lines.index("*ELEMENT, TYPE=C3D8H, ELSET=Cube") + 1 :] if line[0].isdigit()][:26]
    shifted = [", ".join(str(int(n) + (0 if k == 0 else 64)) for k, n in enumerate(line.split(", "))) for line in cells]
    shifted = [f"{int(line.split(', ')[0]) + 26}, {line.split(', ', 1)[1]}" for line in shifted]
    nodes = [line for line in lines[1:] if line.count(",") == 3][:64]
    moved = [f"{int(a) + 64}, {float(x) + 3}, {y}, {z}" for a, x, y, z in (line.split(", ") for line in nodes)]
    # The second cube shares the first one's face at x = 3: its nodes there are the first one's.
    same = {int(a.split(", ")[0]): int(b.split(", ")[0]) for a in moved for b in nodes
            if [float(v) for v in a.split(", ")[1:]] == [float(v) for v in b.split(", ")[1:]]}  # fmt: skip
    shifted = [
        ", ".join([line.split(", ")[0], *(str(same.get(int(n), int(n))) for n in line.split(", ")[1:])]) for line in shifted
    ]
    inside = [line for line in lines if line.endswith(("S1", "S2", "S3", "S4", "S5", "S6"))]
    second = ["*SURFACE, NAME=Other", *(f"{int(line.split(',')[0]) + 26},{line.split(',')[1]}" for line in inside)]
    text = text.replace("*ELEMENT, TYPE", "\n".join(moved) + "\n*ELEMENT, TYPE")
    text = text.replace("*SURFACE, NAME=Inside", "\n".join(shifted) + "\n*SURFACE, NAME=Inside")
    text = text.replace("*NSET, NSET=Foot", "\n".join(second) + "\n*NSET, NSET=Foot")
    text = text.replace("Inside, P, 0.03", "Inside, P, 0.01\nOther, P, 0.02")
    (tmp_path / "two.inp").write_text(text)
    case = abaqus.import_model(tmp_path / "two.inp", tmp_path).case
    assert case.actuator.cavity_volume == pytest.approx(2e-9)
    assert [list(course.values) for course in steps.courses(case.steps)] == [[0.0, 1e4, 1e4], [0.0, 0.0, 2e4]]


def test_branches_are_of_the_relaxed_modulus(tmp_path):
    """Abaqus' shares are of the instantaneous one; laws may be given as either."""
    prony = "*Viscoelastic, time=PRONY\n0.2, 0., 0.5\n0.1, 0., 20."
    for moduli, share in (("", 1.0), (", moduli=INSTANTANEOUS", 0.7)):
        (tmp_path / "one.inp").write_text(decks_of_one(f"*Hyperelastic, neo hooke{moduli}\n0.1, 0.\n{prony}"))
        material = abaqus.import_model(tmp_path / "one.inp", tmp_path).case.material
        assert material.c1 == pytest.approx(1e5 * share)
        assert [branch.share for branch in material.memory.branches] == pytest.approx([0.2 / 0.7, 0.1 / 0.7])
        assert [branch.time for branch in material.memory.branches] == [0.5, 20.0]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("neo hooke", "marlow"), "is marlow, which is not read; neo hooke, mooney-rivlin, yeoh"),
        (("*Hyperelastic, neo hooke\n0.1, 0.", "*Density\n1e-9"), "material RUBBER has no law that is read"),
        (("Inside, P, 0.01", "Nowhere, P, 0.01"), "there is no surface Nowhere"),
        (("*SOLID SECTION, ELSET=Cube, MATERIAL=Rubber", "*SHELL SECTION"), "no .Solid section with a material"),
        (("Foot, ENCASTRE", "Foot, 3"), "no .Boundary holds a face of the part in all three directions"),
    ],
)
def test_what_cannot_be_read_is_refused(tmp_path, change, words):
    text = decks_of_one("*Hyperelastic, neo hooke\n0.1, 0.")
    assert change[0] in text
    (tmp_path / "one.inp").write_text(text.replace(*change))
    with pytest.raises((CaseError, GeometryError), match=words):
        abaqus.import_model(tmp_path / "one.inp", tmp_path)


def test_other_files_are_no_decks(tmp_path):
    with pytest.raises(CaseError, match=r"part.msh is no deck .*softmodels run .*ImportedMesh"):
        abaqus.import_model(tmp_path / "part.msh", tmp_path)


def test_the_command_writes_a_case_and_what_it_leaves_out(block, tmp_path):
    """And no file of somebody else's, nor the deck itself, is replaced."""
    folder, _ = block
    run = CliRunner().invoke(import_command, [str(folder / "block.inp"), "-o", str(tmp_path / "block.toml")])
    assert run.exit_code == 0, run.output
    assert Case.from_file(tmp_path / "block.toml").material.c1 == pytest.approx(50e3)
    (tmp_path / "other.toml").write_text("mine = 1\n")
    for target in (folder / "block.inp", tmp_path / "other.toml"):
        before = target.read_bytes()
        assert CliRunner().invoke(import_command, [str(folder / "block.inp"), "-o", str(target)]).exit_code != 0
        assert target.read_bytes() == before


def test_ties_of_unlike_meshes_are_refused(block):
    text = decks.assembly(*block[1]).replace("5.0, -3.0, 2.0", "5.0, -3.0, 2.2")
    with pytest.raises(GeometryError, match=r"nodes do not coincide: \d+ of \d+ nodes of Bottom .* merge both instances"):
        deck_reader.Deck("a.inp", text).mesh()
