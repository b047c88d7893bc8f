"""Cavities are closed: by their walls, by cut planes, or by a plane in which a support holds their rim."""

from __future__ import annotations

import dataclasses
import math

import gmsh
import numpy as np
import pytest

from geometries import ACTUATORS, Balloon, Cylinder, GeometryError, HollowDisk, PneuNet, pneunet
from geometries.actuator import check_closed, find_openings
from geometries.imported import Triangles
from geometries.meshing import mirror_mesh, private_model
from softmodels.__main__ import softmodels
from softmodels.case.case import Case
from softmodels.case.load import steps_of
from softmodels.common.schema import number_field
from softmodels.components.rigid import Clamp
from softmodels.materials.laws import NeoHookean
from softmodels.mechanics.body import Body, BodyError
from softmodels.mechanics.system import System
from softmodels.runs.simulation import Simulation

CUT = {"section": "wedge", "angle": 45.0}
COARSE = [
    *({"device": name} for name in ("Balloon", "Bellows", "BendingBellows", "Membrane", "Cylinder", "HollowDisk")),
    {"device": "Balloon", "neck_radius": 0.0},
    {"device": "Balloon", "rod_radius": 0.002},
    {"device": "Balloon", "held": "outside"},
    {"device": "Membrane", "thickness": 0.005, "through": 1, "cell_size": 0.005, "clamp_width": 0.005, "clamp": "slip", **CUT},
    {"device": "Cylinder", "section": "half", "strip": 120.0, "cell_size": 0.008, "wall": 0.004, "length": 0.02},
    {"device": "Cylinder", "section": "whole", "cell_size": 0.008, "wall": 0.004, "length": 0.02, "base": "sliding"},
    {"device": "HollowDisk", "section": "axisymmetric", "support": "rim"},
    {"device": "PneuNet", "chambers": 2, "sides": 2},
    {"device": "PneuNet", "chambers": 2, "part": "full", "gap": 0.0},
    {"device": "SeminarActuator", "channels": 1, "spread": 20.0, "around": 6.0, "cell_size": 0.006},
]  # fmt: skip


@pytest.mark.parametrize("options", COARSE, ids=str)
def test_devices_of_the_library_are_closed(options):
    device = ACTUATORS[options["device"]](**{name: value for name, value in options.items() if name != "device"})
    with private_model():
        device.build()
        gmsh.model.mesh.generate(device.dimension - 1)  # faces are enough
        for mirror in device.mirrors:
            mirror_mesh(mirror)
        openings = find_openings(device)
    check_closed(device, openings, device.holds)
    neck, rod = (getattr(device, name, 0.0) > 0.0 for name in ("neck_radius", "rod_radius"))
    assert len(openings) == (options["device"] in ("Membrane", "Cylinder")) + neck + rod


def test_a_device_whose_air_misses_a_face_is_refused(ended, monkeypatch, tmp_path):
    """The floor of the air is a face of the base: a role that forgets it left the volume 4 % wrong, and the base unpressed."""
    known = pneunet._role

    def forgetful(finger, tag):
        low, high = pneunet.meshing.face_block(tag)
        floor = np.allclose((low[2], high[2]), 0.5 * finger.base, atol=1e-9)
        return "outer" if floor else known(finger, tag)

    monkeypatch.setattr(pneunet, "_role", forgetful)
    case = Case(
        "f",
        PneuNet(chambers=1, chamber_length=0.01, cell_size=0.004),
        NeoHookean(30e3),
        steps=steps_of(pressure_cm=(1.0,)),
    )
    (tmp_path / "finger.toml").write_text(case.to_toml())
    status, _, told = ended(softmodels, "run", tmp_path / "finger.toml", "--quiet", "--output", tmp_path / "run")
    assert status == 2 and told.count("\n") == 1
    assert "'cavity' of PneuNet end near" in told and "other faces are (outer)" in told and "1.5 mm" in told
    status, _, again = ended(softmodels, "limit", tmp_path / "finger.toml")
    assert status == 2 and again == told


def test_an_imported_mesh_whose_air_misses_a_face_is_refused(ended, monkeypatch, tmp_path):
    """A mesh file of another program; what picks its roles is made to leave out the floor of the air."""
    finger = PneuNet(chambers=1, chamber_length=0.01, cell_size=0.004)
    finger.write(tmp_path / "finger.msh")
    roles = Triangles.roles

    def forgetful(boundary):
        found, mesh = roles(boundary), boundary.mesh
        floor = np.abs(mesh.corners[found["cavity"]][:, :, 2] - 0.5 * finger.base).max(axis=1) < 1e-9
        return found | {"cavity": found["cavity"][~floor], "outer": np.union1d(found["outer"], found["cavity"][floor])}

    words = ("run", "--device", "ImportedMesh", "--file", tmp_path / "finger.msh", "--unit", "m", "--cavities", "at 9, 0, 8 mm",
             "--support", "x = 0 mm", "--planes", "y = 0 mm", "--pressure-cm", 0.1, "--quiet", "--no-pictures")  # fmt: skip
    monkeypatch.setattr(Triangles, "roles", forgetful)
    monkeypatch.setattr("geometries.meshing.apart", lambda task, *given, **_: task(*given))  # a patch is of this process only
    status, _, told = ended(softmodels, *words, "--output", tmp_path / "run")
    assert status == 2 and told.count("\n") == 1
    assert "'cavity' of ImportedMesh end near" in told and "outer" in told and "1.5 mm" in told


def test_a_rim_has_to_stay_in_its_plane(comm, tmp_path):
    """A tube that slides on its bench along the axis has no known volume; one that slides across it has."""
    tube, law = Cylinder(end="held"), NeoHookean(30e3)
    body = Body.from_file(tube, tube.write(tmp_path / "tube.msh"), comm)
    with pytest.raises(GeometryError, match=r"hold one of these faces along 0, 0, 1"):
        System(body, law, components=[Clamp("support", slip="z")])
    assert System(body, law, components=[Clamp("support", along="z")]).rest().V > 0


@pytest.mark.parametrize(
    "device", [Balloon(), Cylinder(section="half", cell_size=0.008, wall=0.004, length=0.02)], ids=["section", "half"]
)
def test_a_rim_off_the_origin_is_in_no_plane(device):
    """A plane that is not through the origin adds to the volume's integral, whoever holds it."""
    up = np.array([0.0, 1e-3, 0.0] if device.dimension == 2 else [0.0, 0.0, 1e-3])
    with private_model():
        device.build()
        gmsh.model.mesh.generate(device.dimension - 1)
        tags, places, _ = gmsh.model.mesh.getNodes()
        for tag, place in zip(tags, places.reshape(-1, 3), strict=True):
            gmsh.model.mesh.setNode(tag, place + up, [])
        (opening,) = find_openings(device)
    assert opening.normal is None
    with pytest.raises(GeometryError, match="so that the cavity is open there"):
        check_closed(device, [opening], device.holds)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Unmeasured(HollowDisk):
    """A disk whose air has no closed form, and perhaps a wall of another role."""

    section: str = "axisymmetric"
    lost: str = ""

    cavity_volume = math.nan

    def build(self):
        super().build()
        for tag in [tag for dimension, tag in gmsh.model.getPhysicalGroups(1)]:
            if gmsh.model.getPhysicalName(1, tag) == "cavity" and self.lost:
                walls = gmsh.model.getEntitiesForPhysicalGroup(1, tag)
                gmsh.model.removePhysicalGroups([(1, tag)])
                gmsh.model.addPhysicalGroup(1, walls[1:], tag, "cavity")
                gmsh.model.addPhysicalGroup(1, walls[:1], 77, self.lost)


def test_a_device_without_a_closed_form_of_its_volume_is_looked_at_too(comm, tmp_path):
    law = NeoHookean(30e3)
    closed = Unmeasured()
    assert System(Body.from_file(closed, closed.write(tmp_path / "a.msh"), comm), law).rest().V > 0
    open_one = Unmeasured(lost="roof")
    body = Body.from_file(open_one, open_one.write(tmp_path / "b.msh"), comm)
    with pytest.raises(GeometryError, match=r"'cavity' of Unmeasured end near .*roof"):
        System(body, law)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Smaller(HollowDisk):
    """A disk whose mesh has less air than it is said to have, as one that forgets a pocket has."""

    section: str = "axisymmetric"
    share: float = number_field(0.95, "of the air that its mesh has")

    @property
    def cavity_volume(self):
        return super().cavity_volume / self.share


def test_a_mesh_with_less_air_than_the_device_is_warned_of_or_refused(comm, tmp_path):
    law = NeoHookean(30e3)
    device = Smaller(share=0.8)
    with pytest.raises(BodyError, match="include every face around the air in its walls"):
        System(Body.from_file(device, device.write(tmp_path / "a.msh"), comm), law)
    simulation, told = Simulation(Case("d", Smaller(), law, steps=steps_of(pressure_cm=(1.0,))), comm), []
    simulation.write_mesh(tmp_path / "b.msh")
    simulation.prepare(tmp_path / "b.msh")
    simulation.listener.say = told.append
    simulation.describe()
    assert any("has 5.0% less volume than the device's" in text for text in told), told
