"""Surfaces of STL files that are not as they should be: repaired, and what was done is said; air in a file of its own."""

from __future__ import annotations

import dataclasses
import re
import shutil
import zipfile

import gmsh
import meshio
import numpy as np
import pytest
import pyvista

import softmodels as sm
from geometries import GeometryError, ImportedActuator, ImportedMesh, imported, mesh_arrays, meshing, surfaces
from geometries.imported import read_surfaces
from geometries.meshing import private_model
from softmodels.case.case import Case, identity
from softmodels.case.load import steps_of

BODY, AIR = 20.0 * 10.0 * 10.0, 16.0 * 6.0 * 6.0
"""mm3"""


def box(x, y, z, level=0):
    """Corners in mm (n, 3) and triangles (t, 3) of a box between pairs of values, turned outwards."""
    mesh = pyvista.Box((*x, *y, *z), level=level, quads=False).clean().compute_normals(auto_orient_normals=True)
    return np.asarray(mesh.points, dtype=float), np.asarray(mesh.regular_faces)


def soup(*surfaces):
    """Corners of the triangles of some surfaces, each with its own, shape (t, 3, 3)."""
    return np.concatenate([points[triangles] for points, triangles in surfaces])


def write(path, corners):
    meshio.write_points_cells(path, corners.reshape(-1, 3), [("triangle", np.arange(3 * len(corners)).reshape(-1, 3))])
    return str(path)


OUTSIDE, INSIDE = box((0, 20), (0, 10), (0, 10), level=2), box((2, 18), (2, 8), (2, 8), level=2)


def hollow():
    return soup(OUTSIDE, (INSIDE[0], INSIDE[1][:, ::-1]))


def volume(surface):
    """What a closed surface encloses, mm3: less its air."""
    points, triangles = surface
    a, b, c = np.moveaxis(1e3 * points[triangles], 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0


def inverted(corners):
    corners[5:60:7] = corners[5:60:7, ::-1]
    return corners


def parted(corners):
    """All on one side of a plane 2 um away from the rest."""
    corners[corners.mean(axis=1)[:, 0] > 10.0] += np.array([2e-3, 0.0, 0.0])
    return corners


DAMAGE = {
    "doubled": (lambda corners: np.concatenate([corners, corners[3:9]]), "6 doubled facets"),
    "inverted": (inverted, "8 inverted facets"),
    "inside out": (lambda corners: corners[:, ::-1], None),
    "a seam": (parted, r"\d+ open edges .* seams narrower than 0.0\d+ mm are joined"),
    "as it is": (lambda corners: corners, None),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_damaged_surfaces_are_repaired(name, tmp_path):
    damage, said = DAMAGE[name]
    surface, remarks = read_surfaces(write(tmp_path / "part.stl", damage(hollow())), 1e-3)
    assert volume(surface) == pytest.approx(BODY - AIR, rel=1e-3)
    assert len(remarks) == (said is not None) and all(re.search(said, remark) for remark in remarks)


def test_a_small_hole_is_filled_and_a_large_one_is_not(tmp_path):
    fine = soup(box((0, 20), (0, 10), (0, 10), level=60))
    surface, remarks = read_surfaces(write(tmp_path / "small.stl", np.delete(fine, 500, axis=0)), 1e-3)
    assert volume(surface) == pytest.approx(BODY, rel=1e-6) and "filled by 1 facets" in remarks[0]
    with pytest.raises(GeometryError, match="not watertight: 3 edges"):
        read_surfaces(write(tmp_path / "large.stl", hollow()[1:]), 1e-3)


def test_bodies_that_overlap_are_joined_and_keep_their_air(tmp_path):
    """A rib through the wall of the outside, which does not reach the air."""
    rib = box((5, 7), (9, 12), (-1, 11))
    surface, remarks = read_surfaces(write(tmp_path / "part.stl", np.concatenate([hollow(), soup(rib)])), 1e-3)
    assert volume(surface) == pytest.approx(BODY - AIR + 2.0 * 3.0 * 12.0 - 2.0 * 1.0 * 10.0, rel=1e-6)
    assert len(remarks) == 1 and "2 bodies" in remarks[0]


@pytest.mark.parametrize("body", [soup(OUTSIDE), hollow()], ids=["filled", "hollow"])
def test_the_air_of_a_part_comes_in_a_file_of_its_own(body, tmp_path):
    files = {"file": write(tmp_path / "part.stl", body), "air": write(tmp_path / "cavity.stl", soup(INSIDE))}
    part = ImportedMesh(**files, support="x = 0 mm", cell_size=0.01)
    assert part.cavity_volume == pytest.approx(AIR * 1e-9, rel=1e-6)
    assert part.solid_volume == pytest.approx((BODY - AIR) * 1e-9, rel=1e-6)
    assert part.files == {"file": files["file"], "air[1]": files["air"]} and all("coarse" in remark for remark in part.remarks)
    key = part.key
    write(tmp_path / "cavity.stl", soup(box((2, 17), (2, 8), (2, 8))))
    assert ImportedMesh(**files, support="x = 0 mm", cell_size=0.01).key != key


TWO = [box((low, low + 5), (2, 8), (2, 8), level=2) for low in (2, 13)]
"""Boxes of air of 180 mm3 each."""


@pytest.mark.parametrize("files", [2, 1], ids=["a file each", "one file"])
def test_each_body_of_air_is_a_cavity_in_the_order_of_the_files(files, tmp_path):
    written = [write(tmp_path / f"air{i}.stl", soup(air)) for i, air in enumerate(TWO[::-1])]
    air = tuple(written) if files == 2 else write(tmp_path / "air.stl", soup(*TWO))
    given = {"file": write(tmp_path / "part.stl", soup(OUTSIDE)), "air": air, "support": "x = 0 mm", "cell_size": 0.01}
    part = ImportedMesh(**given, pressure_ratios=(1.0, 0.5))
    assert [float(text.split()[1].strip(",")) > 10.0 for text in part.cavities] == (
        [True, False] if files == 2 else [False, True]
    )
    assert part.reading.cavity_volumes == pytest.approx((180e-9, 180e-9), rel=1e-6)
    assert not any("bodies" in remark for remark in part.remarks)  # bodies of air that lie apart are not joined
    case = sm.Case("part", part, sm.NeoHookean(30e3), steps_of(pressure_cm="0:1"))
    copies = {file: f"copy-{number}.stl" for number, file in enumerate(case.files)}
    assert len(copies) == files + 1 and all(copy in case.to_toml(copies) for copy in copies.values())
    (tmp_path / "elsewhere").mkdir()
    for file, copy in copies.items():
        shutil.copy(file, tmp_path / "elsewhere" / copy)
    again = Case.from_toml(case.to_toml(copies), tmp_path / "elsewhere")
    assert again.actuator.key == part.key and identity(again) == identity(case)


def mirrored(surface):
    """The mirror image of a box at x = 5."""
    points, triangles = surface
    return points * [-1.0, 1.0, 1.0] + [10.0, 0.0, 0.0], triangles[:, ::-1]


TOUCHING = {
    "apart": (box((6, 9), (0, 5), (0, 5)), None),
    "in a side": (box((5, 9), (0, 5), (0, 5)), "2 bodies of .* become 1, because those that touch or overlap"),
    "in facets": (mirrored(box((0, 5), (0, 5), (0, 5))), "2 bodies of .* become 1, because those that touch or overlap"),
    "in an edge": (box((5, 9), (5, 9), (0, 5)), None),
    "inside a side": (box((5, 9), (1, 4), (1, 4)), "2 bodies of .* become 1, because those that touch or overlap"),
}


@pytest.mark.parametrize("name", TOUCHING)
def test_bodies_that_touch_are_joined_and_others_are_not(name, tmp_path):
    other, said = TOUCHING[name]
    surface, remarks = read_surfaces(write(tmp_path / "part.stl", soup(box((0, 5), (0, 5), (0, 5)), other)), 1e-3)
    assert volume(surface) == pytest.approx(125.0 + np.prod(np.ptp(other[0], axis=0)), rel=1e-6)
    assert len(remarks) == (said is not None) and all(re.search(said, remark) for remark in remarks)


def test_a_surface_written_with_both_sides_is_one_surface(tmp_path):
    corners = hollow()
    surface, (remark,) = read_surfaces(write(tmp_path / "part.stl", np.concatenate([corners, corners[:, ::-1]])), 1e-3)
    assert volume(surface) == pytest.approx(BODY - AIR, rel=1e-6) and f"{len(corners)} doubled" in remark


def test_air_that_is_not_in_the_part_is_refused(tmp_path):
    body, air = write(tmp_path / "part.stl", soup(OUTSIDE)), write(tmp_path / "cavity.stl", soup(INSIDE) + 15.0)
    with pytest.raises(GeometryError, match="does not lie in the part"):
        ImportedMesh(file=body, air=air, support="x = 0 mm")
    with pytest.raises(GeometryError, match=r"all as surfaces \(\.stl"):
        ImportedMesh(file=body, air=str(tmp_path / "cavity.step"), support="x = 0 mm")


def test_air_that_is_cut_out_of_the_walls_of_a_hollow_part_is_told(tmp_path):
    """Its share, volume and place; air that fits in the hollow, or in a part drawn full, needs no word."""
    body, full = write(tmp_path / "part.stl", hollow()), write(tmp_path / "full.stl", soup(OUTSIDE))
    fits, longer = (write(tmp_path / f"{end}.stl", soup(box((2, end), (2, 8), (2, 8), level=2))) for end in (18, 19))
    part = ImportedMesh(file=body, air=longer, support="x = 0 mm")
    assert part.cavity_volume == pytest.approx(17 * 36e-9, rel=1e-6)
    (said,) = [remark for remark in part.remarks if "cut out" in remark]
    assert re.search(r"6% of the air of \S+19.stl, 0.036 ml around 18.5, 5, 5 mm, lies in the walls of \S+part.stl", said)
    for file, air in (body, fits), (full, fits), (full, longer):
        assert not any("cut out" in remark for remark in ImportedMesh(file=file, air=air, support="x = 0 mm").remarks)


def cup(path, at=(30.0, 40.0, 5.0)):
    """A block at a place (mm) with a pocket that is open below."""
    with private_model():
        occ = gmsh.model.occ
        pocket = occ.addBox(at[0] + 2.0, at[1] + 2.0, at[2], 16.0, 6.0, 6.0)
        occ.cut([(3, occ.addBox(*at, 20.0, 10.0, 8.0))], [(3, pocket)])
        occ.synchronize()
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
        gmsh.option.setNumber("Mesh.MeshSizeMax", 4.0)
        if path.suffix == ".stl":
            gmsh.model.mesh.generate(2)
        gmsh.write(str(path))
    kind = ImportedMesh if path.suffix == ".stl" else ImportedActuator
    return kind(file=str(path), support=f"z = {at[2]} mm", cell_size=0.005)


def test_a_cavity_that_is_not_named_is_no_air_that_cells_miss(tmp_path):
    air = [box((low, low + 6), (2, 8), (2, 8), level=2) for low in (2, 12)]
    file = write(tmp_path / "part.stl", soup(OUTSIDE, *((points, triangles[:, ::-1]) for points, triangles in air)))
    part = ImportedMesh(file=file, support="x = 0 mm", cavities=("at 5, 5, 5 mm",), cell_size=0.004)
    assert not any("less volume" in text for text in part.remarks)
    both = part.replaced(cavities=("at 5, 5, 5 mm", "at 15, 5, 5 mm"))
    assert both.reading.air_on_file == pytest.approx(2 * 216e-9)


def test_cells_of_an_stl_part_get_smaller(tmp_path):
    part = ImportedMesh(file=write(tmp_path / "part.stl", hollow()), support="x = 0 mm", cell_size=0.004)
    own, finer = (meshing.summarize(one.write(tmp_path / "part.msh")) for one in (part, part.refined(2.0)))
    assert finer.cells > 2 * own.cells and finer.measure == pytest.approx(own.measure, rel=1e-6)
    with pytest.raises(GeometryError, match="used as they are"):
        ImportedMesh(file=str(tmp_path / "part.msh"), unit="m", support="x = 0 mm", finer=2.0)


def test_facets_finer_than_the_walls_ask_for_are_joined():
    """A box with a fine ball of air: no corner is farther from the surface left over than asked, and both volumes are kept."""
    ball = pyvista.Sphere(radius=3.0, center=(10.0, 5.0, 5.0), theta_resolution=60, phi_resolution=60)
    corners = soup(OUTSIDE, (np.asarray(ball.points, dtype=float), np.asarray(ball.regular_faces)[:, ::-1]))
    surface, _ = surfaces.repaired("ball.stl", 1e-3 * corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
    fewer = surfaces.simplified(surface, 20e-6)
    assert len(fewer[1]) < 0.9 * len(surface[1])
    left = pyvista.PolyData.from_regular_faces(1e3 * fewer[0], fewer[1])
    away = pyvista.PolyData(1e3 * surface[0]).compute_implicit_distance(left)["implicit_distance"]
    assert np.abs(away).max() < 0.02 * 1.01
    air = BODY - volume(surface)
    assert volume(fewer) == pytest.approx(volume(surface), rel=5e-4) and BODY - volume(fewer) == pytest.approx(air, rel=5e-4)
    coarse = surfaces.simplified(surface, 1e-3)  # which would cut the ball to pieces
    assert BODY - volume(coarse) == pytest.approx(air, rel=5e-4)


def test_long_facets_are_split_where_they_are_faces_of_cells(tmp_path):
    """A surface that cannot be meshed anew keeps its facets, but no sliver as long as a side: too stiff."""
    corners = soup(box((0, 60), (0, 10), (0, 10)), (INSIDE[0], INSIDE[1][:, ::-1]))
    surface, _ = read_surfaces(write(tmp_path / "part.stl", corners), 1e-3)
    longest = {}
    for name, (nodes, cells) in {
        "split": imported._fill_between_facets(surface, 4e-3),
        "whole": imported._mesh_surfaces(*surface, 4e-3, False),
    }.items():
        mesh = mesh_arrays.Tetrahedra.made(nodes, cells, {}, {})
        assert mesh.volume == pytest.approx((6000.0 - AIR) * 1e-9, rel=1e-9)
        edges = mesh.points[mesh.cells[:, mesh_arrays.EDGES]]
        longest[name] = np.linalg.norm(edges[:, :, 1] - edges[:, :, 0], axis=2).max()
    assert longest["split"] < 8e-3 and longest["whole"] > 40e-3


@pytest.mark.parametrize("ending", ["stl", "step"])
def test_a_plate_closes_a_chamber_without_a_floor(ending, tmp_path):
    """Held on its rim, away from the origin, its air is that of the pocket; held elsewhere it is open."""
    device = cup(tmp_path / f"cup.{ending}")
    assert device.cavity_volume == pytest.approx(16.0 * 6.0 * 6.0 * 1e-9, rel=1e-9)
    assert "the cavity opens onto 'z = 5.0 mm': the plate that holds the part there closes it" in device.remarks
    with pytest.raises(GeometryError, match="no closed inner shell"):
        dataclasses.replace(device, support="z = 13 mm")


@pytest.mark.campaign
def test_air_over_a_plate_presses_alike_wherever_the_part_is(tmp_path):
    runs = [
        sm.inflate(cup(tmp_path / f"{i}.step", at), sm.NeoHookean(30e3), pressures=[0.0, 500.0])
        for i, at in enumerate([(30.0, 40.0, 5.0), (0.0, 0.0, 0.0)])
    ]
    there, here = (run.added_volume[-1] for run in runs)
    assert there == pytest.approx(here, rel=2e-3) and here > 1e-9  # of two meshes


def binary(corners, count):
    """A binary STL file that announces a number of triangles, whose header begins as a text does."""
    facets = np.zeros(len(corners), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    facets["corners"] = corners
    return b"solid".ljust(80) + count.to_bytes(4, "little") + facets.tobytes()


def test_a_wrong_count_of_triangles_is_not_believed(tmp_path):
    corners = soup(OUTSIDE, INSIDE)
    (tmp_path / "part.stl").write_bytes(binary(corners, len(corners) - 3))
    (points, triangles), _ = read_surfaces(str(tmp_path / "part.stl"), 1e-3)
    volume = np.einsum("ti,ti->", points[triangles[:, 0]], np.cross(points[triangles[:, 1]], points[triangles[:, 2]])) / 6
    assert abs(volume) * 1e9 == pytest.approx(BODY - AIR, rel=1e-6)


def test_a_file_that_was_cut_off_is_named(tmp_path):
    corners = soup(OUTSIDE, INSIDE)
    (tmp_path / "part.stl").write_bytes(binary(corners, len(corners))[:-70])
    with pytest.raises(GeometryError, match=rf"announces {len(corners)} triangles .* cut off"):
        read_surfaces(str(tmp_path / "part.stl"), 1e-3)


def three_mf(path, models, unit="millimeter", main="3D/3dmodel.model"):
    """A 3MF package of models by their files: their resources and what the first builds."""
    core, production = (
        f"http://schemas.microsoft.com/3dmanufacturing/{name}" for name in ("core/2015/02", "production/2015/06")
    )
    with zipfile.ZipFile(path, "w") as package:
        for file, body in models.items():
            package.writestr(file, f'<model unit="{unit}" xmlns="{core}" xmlns:p="{production}">{body}</model>')
    return str(path)


def three_mf_object(number, surface):
    points, triangles = surface
    vertices = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in points)
    corners = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in triangles)
    return f'<object id="{number}"><mesh><vertices>{vertices}</vertices><triangles>{corners}</triangles></mesh></object>'


HOLLOW_OBJECTS = three_mf_object(1, OUTSIDE) + three_mf_object(2, (INSIDE[0] - [2.0, 0.0, 0.0], INSIDE[1][:, ::-1]))
TURNED = '<build><item objectid="3" transform="0 1 0 -1 0 0 0 0 1 50 0 0"/><item objectid="1" printable="0"/></build>'
PARTS = (
    '<object id="3"><components><component{} objectid="1"/>'
    '<component{} objectid="2" transform="1 0 0 0 1 0 0 0 1 2 0 0"/></components></object>'
)


@pytest.mark.parametrize("kind", ["obj", "ply", "3mf", "3mf in several files", "3mf in inches"])
def test_surfaces_come_as_other_files_too(kind, tmp_path):
    """A block with air; quads in the OBJ; in the 3MF it is put together from two objects, turned and moved."""
    if kind in ("obj", "ply"):
        file = tmp_path / f"part.{kind}"
        if kind == "ply":
            (
                pyvista.PolyData.from_regular_faces(*OUTSIDE)
                + pyvista.PolyData.from_regular_faces(INSIDE[0], INSIDE[1][:, ::-1])
            ).save(file)
        else:
            corners = [
                (x, y, z) for part in ((0, 20, 0, 10), (2, 18, 2, 8)) for x in part[:2] for y in part[2:] for z in part[2:]
            ]
            sides = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
            faces = [*(sides + 1), *(sides[:, ::-1] - 8)]  # the last eight by their numbers from the end
            file.write_text(
                "".join(f"v {x} {y} {z}\n" for x, y, z in corners) + "".join(f"f {a} {b} {c} {d}\n" for a, b, c, d in faces)
            )
    elif kind == "3mf in several files":
        parts = PARTS.format(*[' p:path="/3D/Objects/own.model"'] * 2)
        models = {"3D/Objects/own.model": f"<resources>{HOLLOW_OBJECTS}</resources>",
                  "3D/3dmodel.model": f"<resources>{parts}</resources>{TURNED}"}  # fmt: skip
        file = three_mf(tmp_path / "part.3mf", models)
    else:
        text = f"<resources>{HOLLOW_OBJECTS}{PARTS.format('', '')}</resources>{TURNED}"
        file = three_mf(tmp_path / "part.3mf", {"3D/3dmodel.model": text}, unit="inch" if "inches" in kind else "millimeter")
    surface, _ = read_surfaces(str(file), 1e-3)
    scale = 25.4 if "inches" in kind else 1.0
    assert volume(surface) == pytest.approx((BODY - AIR) * scale**3, rel=1e-6)
    low, high = 1e3 * surface[0].min(axis=0) / scale, 1e3 * surface[0].max(axis=0) / scale
    turned = kind.startswith("3mf")
    assert low == pytest.approx([40, 0, 0] if turned else [0, 0, 0], abs=1e-4)
    assert high == pytest.approx([50, 20, 10] if turned else [20, 10, 10], abs=1e-4)


def test_a_package_without_a_model_is_a_sentence(tmp_path):
    for name, models in (
        ("empty", {}),
        ("unbuilt", {"3D/3dmodel.model": "<resources/>"}),
        ("broken", {"3D/3dmodel.model": "<a"}),
    ):
        with pytest.raises(GeometryError, match="is not a mesh of the format of its extension"):
            read_surfaces(three_mf(tmp_path / f"{name}.3mf", models), 1e-3)
    (tmp_path / "text.3mf").write_text("no package")
    with pytest.raises(GeometryError, match="is not a mesh of the format of its extension"):
        read_surfaces(str(tmp_path / "text.3mf"), 1e-3)


@pytest.mark.parametrize("twice", [True, False])
def test_a_package_of_packages_ends_with_a_sentence(tmp_path, twice):
    """Thirty objects, each of which places the one before twice, are a thousand million; one that places itself has no end."""
    placed = '<object id="{0}"><components><component objectid="{1}"/><component objectid="{1}"/></components></object>'
    parts = [placed.format(k, k - 1) for k in range(3, 33)] if twice else [placed.format(32, 32)]
    body = f'<resources>{HOLLOW_OBJECTS}{"".join(parts)}</resources><build><item objectid="32"/></build>'
    words = "places more than 10000 objects" if twice else "recursion"
    with pytest.raises(GeometryError, match=words):
        read_surfaces(three_mf(tmp_path / "part.3mf", {"3D/3dmodel.model": body}), 1e-3)


def revolved(radii, heights, count):
    """Corners (t, 3, 3) of the closed surface that a line from axis to axis sweeps, in mm."""
    angle = 2 * np.pi * np.arange(count) / count
    x, y, z = (np.outer(*pair) for pair in ((radii, np.cos(angle)), (radii, np.sin(angle)), (heights, np.ones(count))))
    places = np.stack([x, y, z], axis=-1)
    low, high = places[:-1], places[1:]
    after, above = np.roll(low, -1, axis=1), np.roll(high, -1, axis=1)
    triangles = np.concatenate([np.stack([low, after, high], axis=2), np.stack([after, above, high], axis=2)]).reshape(-1, 3, 3)
    return triangles[np.linalg.norm(np.cross(*np.moveaxis(np.diff(triangles, axis=1), 1, 0)), axis=1) > 1e-9]


@pytest.mark.campaign
def test_a_bellows_of_very_many_facets(tmp_path):
    """Gmsh does not come back from them as they are; joined within a hundredth of the wall's thickness it does."""
    z = np.linspace(0.0, 40.0, 171)
    fold, caps = 12.0 + 4.0 * np.cos(2 * np.pi * z / 8.0), [np.linspace(0.0, r, 8) for r in (16.75, 15.25)]
    outside = revolved(
        np.concatenate([caps[0], fold + 0.75, caps[0][::-1]]), np.concatenate([np.full(8, -2.0), z, np.full(8, 42.0)]), 240
    )
    inside = revolved(
        np.concatenate([caps[1][:-1], fold - 0.75, caps[1][-2::-1]]), np.concatenate([np.zeros(7), z, np.full(7, 40.0)]), 240
    )
    file = write(tmp_path / "bellows.stl", np.concatenate([outside, inside]))
    part = ImportedMesh(file=file, support="z = -2 mm", cell_size=0.003)
    assert len(read_surfaces(file, 1e-3)[0][1]) > 5 * imported.MAX_FACETS
    drawn = np.einsum("ti,ti->t", outside[:, 0], np.cross(outside[:, 1], outside[:, 2])).sum() / 6e9
    air = np.einsum("ti,ti->t", inside[:, 0], np.cross(inside[:, 1], inside[:, 2])).sum() / 6e9
    assert part.cavity_volume == pytest.approx(abs(air), rel=2e-3)
    assert part.solid_volume == pytest.approx(abs(drawn) - abs(air), rel=2e-3)
