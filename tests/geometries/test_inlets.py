"""Openings of imported parts: found without being named, closed by plugs, or named, or left open."""

import dataclasses
import math
import re

import gmsh
import meshio
import numpy as np
import pytest

import softmodels as sm
from geometries import inlets, meshing
from geometries.imported import ImportedActuator, ImportedMesh, open_part
from softmodels.common.errors import GeometryError
from tests.benchmarks.random_inlets import wrong
from tests.support.campaigns import sampled
from tests.support.open_parts import Bore, OpenPart, finger, random_part

FORKED = OpenPart(
    (40.0, 30.0, 20.0),
    ((((8.0, 5.0, 4.0, 24.0, 20.0, 12.0)),),),
    ((Bore((0.0, 15.0, 10.0), (1.0, 0.0, 0.0), 1.5, 12.0), Bore((20.0, 30.0, 10.0), (0.0, -0.8, 0.6), 1.0, 12.0)),),
    holes=(Bore((3.0, 3.0, 0.0), (0.0, 0.0, 1.0), 0.9, 6.0),),
)
TWO = OpenPart(
    (60.0, 24.0, 20.0),
    (((5.0, 4.0, 4.0, 20.0, 16.0, 12.0),), ((44.0, 12.0, 10.0, 7.0),)),
    ((Bore((0.0, 12.0, 10.0), (1.0, 0.0, 0.0), 1.2, 12.0),), (Bore((60.0, 12.0, 10.0), (-1.0, 0.0, 0.0), 1.0, 14.0),)),
)

NOZZLE = OpenPart(
    (40.0, 30.0, 20.0),
    (((12.0, 5.0, 4.0, 24.0, 20.0, 12.0),),),
    ((Bore((0.0, 15.0, 10.0), (1.0, 0.0, 0.0), 1.0, 13.0),),),
    grooves=(
        (-1.0, -1.0, -1.0, 9.0, 14.3, 22.0),
        (-1.0, 16.7, -1.0, 9.0, 14.3, 22.0),
        (-1.0, -1.0, -1.0, 9.0, 32.0, 9.3),
        (-1.0, -1.0, 11.7, 9.0, 32.0, 9.3),
    ),
)
"""A bore in a nozzle of 3.4 mm, whose walls are thinner than the bore is wide."""
FLAT = OpenPart(
    (30.0, 30.0, 3.6),
    (((3.0, 3.0, 1.0, 24.0, 24.0, 1.6),),),
    ((Bore((15.0, 15.0, 0.0), (0.0, 0.0, 1.0), 1.6, 2.0), Bore((15.0, 15.0, 3.6), (0.0, 0.0, -1.0), 1.6, 2.0)),),
)
"""One fold of a bellows, with ports wider than a quarter of its height."""


def behind(volume: float, plugs) -> float:
    """Volume in m3 of air of so many mm3, without its bores outside of the plugs' inner ends, of straight bores from x = 0."""
    return volume * 1e-9 - sum(math.pi * p.radius**2 * (p.place[0] + p.length) for p in plugs)


@pytest.fixture(scope="module")
def open_finger(tmp_path_factory):
    """A finger's STEP file, and the volume of its air in mm3 with the bore."""
    file = tmp_path_factory.mktemp("finger") / "finger.step"
    (volume,) = finger().write(file)
    return file, volume


def test_a_finger_with_an_inlet_is_closed(open_finger):
    """The bore is found to a hundredth of a mm, and the cavity has the air behind the plug."""
    file, volume = open_finger
    part = ImportedActuator(file=str(file), support="x = 0 mm")
    (plug,) = part.reading.plugs
    assert plug.place[1:] == pytest.approx((8e-3, 4.5e-3), abs=1e-5) and 0.0 < plug.place[0] < 6e-4
    assert plug.axis == pytest.approx((1.0, 0.0, 0.0), abs=2e-3) and plug.radius == pytest.approx(1.5e-3, rel=0.01)
    assert part.cavity_volume == pytest.approx(behind(volume, [plug]), rel=1e-3)
    (remark,) = part.remarks
    assert re.fullmatch(
        r"the opening of 1.5 mm radius at \(0.[1-5], 8, 4.5\) mm is closed by a plug 3 mm long; --inlets none leaves it open",
        remark,
    )
    named = ImportedActuator(file=str(file), support="x = 0 mm", inlets=("at 0, 8, 4.5 mm",))
    assert named.cavity_volume == pytest.approx(part.cavity_volume, rel=1e-12)


def test_what_cannot_be_closed_is_said(open_finger):
    """An open part that is to stay open has no cavity; an inlet is named where there is none."""
    file = str(open_finger[0])
    with pytest.raises(GeometryError, match="no closed inner shell"):
        ImportedActuator(file=file, support="x = 0 mm", inlets=("none",))
    with pytest.raises(
        GeometryError, match=r"there is no opening\. The openings found: of 1.5 mm radius at \(0.[1-5], 8, 4.5\) mm"
    ):
        ImportedActuator(file=file, support="x = 0 mm", inlets=("at 30, 0, 0 mm",))
    with pytest.raises(GeometryError, match="inlets"):
        ImportedActuator(file=file, support="x = 0 mm", inlets=("somewhere",))


def test_the_search_leaves_the_cells_as_asked(open_finger):
    """Its own mesh of the surface is a tool: sizes of cells are those of the session before."""
    part = ImportedActuator(file=str(open_finger[0]), support="x = 0 mm")
    with meshing.private_model():
        sizes = ("Mesh.MeshSizeMax", "Mesh.MeshSizeFromCurvature")
        before = [gmsh.option.getNumber(name) for name in sizes]
        assert len(open_part(part).plugs) == 1
        assert [gmsh.option.getNumber(name) for name in sizes] == before
        assert not len(gmsh.model.mesh.getNodes()[0])


@pytest.mark.campaign
def test_two_cavities_have_an_inlet_each(tmp_path):
    """A point in the air of each names them; one of them alone closes only its own."""
    volumes = TWO.write(tmp_path / "two.step")
    points = ("at 15, 12, 10 mm", "at 44, 12, 10 mm")
    part = ImportedActuator(file=str(tmp_path / "two.step"), cavities=points, support="z = 0 mm")
    first, second = sorted(part.reading.plugs, key=lambda plug: plug.place[0])
    assert part.reading.cavity_volumes[0] == pytest.approx(behind(volumes[0], [first]), rel=1e-3)
    depth = 60e-3 - second.place[0] + second.length
    expected = volumes[1] * 1e-9 - math.pi * second.radius**2 * depth
    assert part.reading.cavity_volumes[1] == pytest.approx(expected, rel=2e-3)
    with pytest.raises(GeometryError, match="2 closed inner shells") as refused:
        ImportedActuator(file=str(tmp_path / "two.step"), support="z = 0 mm")
    named = tuple(re.findall(r"at [-0-9., ]+ mm(?=;)", str(refused.value)))  # as the message gives them
    both = dataclasses.replace(part, cavities=named)
    assert sorted(both.reading.cavity_volumes) == pytest.approx(sorted(part.reading.cavity_volumes), rel=1e-9)


def test_a_cavity_with_two_bores_gets_two_plugs():
    """One of them slanted; a blind hole beside them stays open."""
    (space,) = inlets.air_spaces(*FORKED.surface())
    straight, slanted = sorted(space.inlets, key=lambda inlet: -inlet.radius)
    assert straight.radius == pytest.approx(1.5e-3, rel=0.02) and slanted.radius == pytest.approx(1e-3, rel=0.03)
    assert np.dot(slanted.axis, (0.0, -0.8, 0.6)) > 0.995


def test_a_nozzle_is_not_as_wide_as_its_outside():
    """The plug is as wide as the bore, not as the nozzle, and stays within its walls."""
    ((plug,),) = (space.inlets for space in inlets.air_spaces(*NOZZLE.surface()))
    assert plug.radius == pytest.approx(1e-3, rel=0.02) and 1e-3 < plug.cylinder < 1.3e-3
    assert plug.place[1:] == pytest.approx((15e-3, 10e-3), abs=2e-5)


@pytest.mark.parametrize(("kind", "suffix"), [(ImportedActuator, "step"), (ImportedMesh, "stl")])
def test_cups_on_a_plate_have_inlets(tmp_path, kind, suffix):
    """Two chambers without a floor, each with a bore, held on their rim; named or not, and one of them alone."""
    cups = OpenPart(
        (30.0, 14.0, 8.0),
        (((2.0, 2.0, -1.0, 12.0, 10.0, 7.0),), ((16.0, 2.0, -1.0, 12.0, 10.0, 7.0),)),
        ((Bore((0.0, 7.0, 3.5), (1.0, 0.0, 0.0), 1.0, 3.0),), (Bore((30.0, 7.0, 3.5), (-1.0, 0.0, 0.0), 1.0, 3.0),)),
    )
    file = tmp_path / f"cups.{suffix}"
    if suffix == "step":
        cups.write(file)
    else:
        points, triangles = cups.surface()
        meshio.write_points_cells(file, 1e3 * points, [("triangle", triangles)])
    named = ("at 8, 7, 2 mm", "at 22, 7, 2 mm")
    part = kind(file=str(file), support="z = 0 mm", cavities=named, cell_size=0.004)
    for plug, volume in zip(sorted(part.reading.plugs, key=lambda p: p.place), part.reading.cavity_volumes, strict=True):
        inner = plug.place[0] + plug.length * plug.axis[0]
        bore = math.pi * plug.radius**2 * (2e-3 - min(inner, 30e-3 - inner))
        assert volume == pytest.approx(12.0 * 10.0 * 6.0 * 1e-9 + bore, rel=1e-3)
    assert any("opens onto 'z = 0 mm'" in remark for remark in part.remarks)
    assert len(dataclasses.replace(part, cavities=named[1:]).reading.plugs) == 1
    with pytest.raises(GeometryError, match="2 closed inner shells"):
        dataclasses.replace(part, cavities=())
    with pytest.raises(GeometryError, match="outside the part"):
        dataclasses.replace(part, inlets=("none",))


def test_ports_of_a_flat_part_are_closed(tmp_path):
    """Both ports of a fold; the cavity has the air between the plugs."""
    (volume,) = FLAT.write(tmp_path / "fold.step")
    part = ImportedActuator(file=str(tmp_path / "fold.step"), support="x = 0 mm", cell_size=0.004)
    plugs = sorted(part.reading.plugs, key=lambda plug: plug.place[2])
    assert [plug.radius for plug in plugs] == pytest.approx([1.6e-3, 1.6e-3], rel=0.02)
    inner = [plug.place[2] + plug.length * plug.axis[2] for plug in plugs]
    closed = math.pi * 1.6e-3**2 * (inner[0] + 3.6e-3 - inner[1])
    assert part.cavity_volume == pytest.approx(volume * 1e-9 - closed, rel=2e-3)


@pytest.mark.parametrize(("kind", "suffix"), sampled([(ImportedMesh, "stl"), (ImportedActuator, "step")]))
def test_an_inlet_that_a_symmetry_plane_halves_is_closed(tmp_path, kind, suffix):
    """Half a box with a chamber and a bore, cut by the CAD kernel: as much air as two halves of the box closed by its drawing
    behind the plug, and the plug ends in the plane."""
    box = OpenPart(
        (20.0, 10.0, 8.0), (((4.0, 2.0, 2.0, 12.0, 6.0, 4.0),),), ((Bore((0.0, 5.0, 4.0), (1.0, 0.0, 0.0), 1.0, 5.0),),)
    )
    file = tmp_path / f"half.{suffix}"
    with meshing.private_model():
        box.draw()
        occ = gmsh.model.occ
        occ.translate(occ.getEntities(3), 0.0, -5.0, 0.0)
        occ.intersect(occ.getEntities(3), [(3, occ.addBox(-10.0, 0.0, -10.0, 40.0, 20.0, 30.0))])
        occ.synchronize()
        if suffix == "step":
            meshing.write_step(file)
        else:
            gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 24)
            gmsh.model.mesh.generate(2)
            gmsh.write(str(file))
    part = kind(file=str(file), support="x = 0 mm", planes=("y = 0 mm",), cell_size=0.003)
    (plug,) = part.reading.plugs
    assert plug.place[1] == 0.0 and plug.axis[1] == 0.0 and plug.radius == pytest.approx(1e-3, rel=0.02)
    air = 12.0 * 6.0 * 4.0 + math.pi * (4.0 - 1e3 * (plug.place[0] + plug.length))
    assert part.cavity_volume == pytest.approx(air * 1e-9, rel=1e-3)
    with pytest.raises(GeometryError, match="no closed inner shell"):
        dataclasses.replace(part, inlets=("none",))


@pytest.mark.campaign
def test_a_surface_is_closed_as_a_drawing_is(open_finger, tmp_path):
    """The same part as an STL file, some of its triangles turned inside out."""
    points, triangles = finger().surface()
    triangles[::7] = triangles[::7, ::-1]
    meshio.write_points_cells(tmp_path / "finger.stl", 1e3 * points, [("triangle", triangles)])
    drawn = ImportedActuator(file=str(open_finger[0]), support="x = 0 mm")
    part = ImportedMesh(file=str(tmp_path / "finger.stl"), support="x = 0 mm")
    assert part.cavity_volume == pytest.approx(drawn.cavity_volume, rel=1e-2)  # the round bore is cut to facets twice
    assert part.solid_volume == pytest.approx(drawn.solid_volume, rel=2e-3)
    assert part.reading.air_on_file == pytest.approx(drawn.cavity_volume, rel=1e-2)


@pytest.mark.campaign
@pytest.mark.parametrize("seed", [*range(12), 1002])
def test_openings_of_random_parts_are_found(seed):
    """Chambers, balls, pairs joined by a channel, slanted bores, blind holes; `random_inlets` has 200 of them."""
    assert wrong(random_part(seed)) == ""


@pytest.mark.campaign
def test_a_plugged_part_bends_as_one_drawn_closed(tmp_path):
    """A chamber off the middle, and the same whose bore begins behind the plug: fall and added volume within 1 %."""
    bore = Bore((0.0, 4.0, 3.0), (1.0, 0.0, 0.0), 1.0, 8.0)
    drawn = OpenPart((30.0, 8.0, 10.0), (((7.0, 1.5, 1.5, 20.0, 5.0, 3.0),),), ((bore,),))
    drawn.write(tmp_path / "open.step")
    part = ImportedActuator(file=str(tmp_path / "open.step"), support="x = 0 mm", cell_size=0.003)
    (plug,) = part.reading.plugs
    end = 1e3 * (plug.place[0] + plug.length)
    inner = dataclasses.replace(bore, place=(end + 2.0, *bore.place[1:]), length=bore.length - end - 2.0)  # drawn 2 mm earlier
    dataclasses.replace(drawn, bores=((inner,),)).write(tmp_path / "closed.step")
    closed = dataclasses.replace(part, file=str(tmp_path / "closed.step"))
    assert not closed.reading.plugs and closed.cavity_volume == pytest.approx(part.cavity_volume, rel=2e-3)
    runs = [sm.inflate(device, sm.Yeoh(30e3, 200.0), pressures=[0.0, 12000.0]) for device in (part, closed)]
    for name in ("tip", "added_volume"):
        plugged, whole = (getattr(run, name)[-1] for run in runs)
        assert plugged == pytest.approx(whole, rel=1e-2), name
    assert abs(runs[0].tip[-1]) > 3e-4


@pytest.mark.campaign
def test_cells_that_miss_the_air_of_a_surface_are_said(tmp_path, monkeypatch):
    """A ball of air with an inlet: the file's air is that of the ball and the rest of the bore; less in the cells is said."""
    ball = OpenPart((20.0, 20.0, 20.0), (((10.0, 10.0, 10.0, 6.0),),), ((Bore((0.0, 10.0, 10.0), (1.0, 0.0, 0.0), 1.2, 8.0),),))
    points, triangles = ball.surface()
    meshio.write_points_cells(tmp_path / "ball.stl", 1e3 * points, [("triangle", triangles)])
    part = ImportedMesh(file=str(tmp_path / "ball.stl"), support="z = 0 mm", cell_size=0.008)
    reading = part.reading
    assert reading.air_on_file == pytest.approx(4.0 / 3.0 * math.pi * 6e-3**3, rel=0.06)
    # Cells larger than the ball's radius: what they miss of it is said.
    missed = 1.0 - reading.cavity_volumes[0] / reading.air_on_file
    assert 1e-3 < missed < 5e-3 and f"the cavities have {missed:.2%} less volume in these cells" in part.remarks[-1]
    larger = dataclasses.replace(reading, air_on_file=sum(reading.cavity_volumes) / 0.97)
    monkeypatch.setattr(ImportedMesh, "reading", property(lambda self: larger))
    assert part.remarks[-1].startswith("the cavities have 3.00% less volume in these cells than in the file; use smaller ones")


def test_an_inlet_of_a_mesh_is_closed(tmp_path):
    """A mesh with an opening gets cells around a plug; one of which a face is picked by name keeps its own, and is refused."""
    part, file = finger(), str(tmp_path / "finger.msh")
    with meshing.private_model():
        _, (volume,) = part.draw()
        gmsh.model.addPhysicalGroup(3, [tag for _, tag in gmsh.model.getEntities(3)])
        end = gmsh.model.getBoundingBox(-1, -1)[3]
        tip = [tag for _, tag in gmsh.model.getEntities(2) if gmsh.model.getBoundingBox(2, tag)[0] > end - 1e-3]
        gmsh.model.addPhysicalGroup(2, tip, name="tip")
        gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 16)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 4.0)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(2)
        gmsh.write(file)
    mesh = ImportedMesh(file=file, support="x = 0 mm")
    (plug,) = mesh.reading.plugs
    assert plug.place[1:] == pytest.approx((8e-3, 4.5e-3), abs=2e-5) and plug.radius == pytest.approx(1.5e-3, rel=0.02)
    assert mesh.cavity_volume == pytest.approx(behind(volume, [plug]), rel=2e-3)
    assert mesh.remarks[0].endswith("are made anew, because an opening is closed")
    with pytest.raises(GeometryError, match="no face is picked by name; else take its STEP or STL file"):
        ImportedMesh(file=file, support="named tip")
