"""Second-order cells of curved thin walls: edges on curved faces stay curved, and cells stay sound."""

from __future__ import annotations

import subprocess
import sys

import gmsh
import numpy as np
import pytest

from geometries import Balloon, Bellows, BendingBellows, meshing
from geometries.meshing import load_mesh, private_model, summarize
from tests.support.campaigns import sampled

NEEDLES = {
    "balloon": Balloon(radius=0.02, wall=1e-4, neck_radius=0.0, cell_size=0.001),
    "balloon's neck": Balloon(radius=0.02, wall=2e-4, cell_size=0.002),
    "coarse balloon": Balloon(radius=0.02, wall=2e-4, neck_radius=0.0, cell_size=0.004, through=1),
    "spheroid": Balloon(radius=0.02, polar_radius=0.03, wall=1e-4, neck_radius=0.0, cell_size=0.001),
    "bellows": Bellows(wall=1e-4, cell_size=1e-3),
    "coarse bellows": Bellows(wall=5e-4, cell_size=4e-3),
}


def curved_lines(path):
    """The nodes on the faces of a section's mesh: places in m of ends and middles of their edges, shape (n, 3, 2)."""
    with private_model():
        load_mesh(path, 2)
        tags, places, _ = gmsh.model.mesh.getNodes()
        at = np.empty((int(tags.max()) + 1, 2))
        at[tags.astype(int)] = places.reshape(-1, 3)[:, :2]
        _, nodes = gmsh.model.mesh.getElementsByType(8)
        assert meshing._jacobian_ratios(2).min() >= meshing.AIMED_JACOBIAN
        return at[nodes.astype(int).reshape(-1, 3)]


@pytest.mark.parametrize("name", NEEDLES)
def test_every_edge_on_a_curved_face_of_a_section_is_curved(name, tmp_path):
    device = NEEDLES[name]
    lines = curved_lines(device.write(tmp_path / "mesh.msh"))
    off = np.min([side.missed(lines.reshape(-1, 2)) for side in device.sides], axis=0).reshape(-1, 3)
    assert off.max() < 1e-9 * device.size
    ends, middles = lines[:, :2].mean(axis=1), lines[:, 2]
    assert np.linalg.norm(middles - ends, axis=1).max() > 1e-6  # and not because there is no arc


@pytest.mark.campaign
@pytest.mark.parametrize(("wall", "cell_size"), sampled([(1.5e-3, 3e-3), (6e-4, 2e-3)]))
def test_the_wall_of_a_bending_bellows_stays_curved(wall, cell_size, tmp_path):
    """Some of its cells have to be optimised with their nodes on the faces; the nodes stay on the arcs, turned."""
    device = BendingBellows(wall=wall, cell_size=cell_size)
    path = device.write(tmp_path / "bellows.msh")
    found = summarize(path)
    assert found.straight == 0 and found.quality > 0.0
    assert device.copies * found.measure == pytest.approx(device.solid_volume, rel=1e-4)
    with private_model():
        groups = {name: (dimension, tag) for dimension, tag, name in load_mesh(path, 3)}
        x, y, z = gmsh.model.mesh.getNodesForPhysicalGroup(*groups["folds"])[1].reshape(-1, 3).T
        assert meshing._jacobian_ratios(3).min() >= meshing.MIN_JACOBIAN
    r = np.hypot(y, z - 0.5 * device.base)
    off = np.min(
        [np.where((arc.start - 1e-9 <= x) & (x <= arc.end + 1e-9), np.abs(np.hypot(x - arc.centre[0], r - arc.centre[1])
                  - arc.radius), np.inf) for arc in device.arcs(True)], axis=0,
    )  # fmt: skip
    wavy = np.isfinite(off)
    assert wavy.sum() > 100 and off[wavy].max() < 1e-8


def test_straight_edges_are_counted_where_they_remain(tmp_path, monkeypatch):
    """The last resort, forced: the file knows the number, with and without Gmsh, and the program says it."""
    monkeypatch.setattr(meshing, "CURVINGS", ("", "", ""))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    path = BendingBellows(folds=1).write(tmp_path / "bellows.msh")
    count = summarize(path).straight
    assert 0 < count < 200 and meshing.is_whole(path)
    assert path.read_text().endswith(f"${meshing.STRAIGHT}\n{count}\n$End{meshing.STRAIGHT}\n")
    words = [sys.executable, "-m", "geometries", "BendingBellows", "--folds", "1", "-o", str(tmp_path / "again.msh")]
    told = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    assert f"warning: {count} edges of the mesh on curved faces are straight" in told
