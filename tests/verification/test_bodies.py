"""Contact of two bodies: derivatives, the patch test, Hertz' spheres, balance of forces and work, Coulomb's ratio, ranks."""

from __future__ import annotations

import numpy as np
import pytest

from softmodels.components import pressing, touching


def sheet(height, count, up, bend=0.0, shift=0.0):
    """A square of triangles of second order, bent, whose solid is below (``up``) or above it."""
    step = 1 / (2 * count)
    grid = np.array([[i * step + shift, j * step, 0.0] for i in range(2 * count + 1) for j in range(2 * count + 1)])
    at = np.arange(len(grid)).reshape(2 * count + 1, -1)
    grid[:, 2] = height + bend * ((grid[:, 0] - 0.5) ** 2 + grid[:, 1] ** 2 / 2)
    facets = []
    for i in range(0, 2 * count, 2):
        for j in range(0, 2 * count, 2):
            a, b, c, d = at[i, j], at[i + 2, j], at[i, j + 2], at[i + 2, j + 2]
            middle = at[i + 1, j + 1]
            facets += [[a, b, c, middle, at[i, j + 1], at[i + 1, j]], [d, b, c, middle, at[i + 1, j + 2], at[i + 2, j + 1]]]
    facets = np.array(facets)
    inside = grid[facets[:, :3]].mean(axis=1) - [0, 0, 0.1 if up else -0.1]
    return grid, facets, inside


def two_sheets(gap, counts=(2, 3), bend=0.3, shift=0.0):
    below, above = sheet(0.0, counts[0], True, bend), sheet(gap, counts[1], False, bend / 2, shift)
    nodes = np.concatenate([below[0], above[0]])
    facets = np.concatenate([below[1], above[1] + len(below[0])])
    walls = np.repeat([0, 1], [len(below[1]), len(above[1])])
    return touching.TwoSurfaces.of(pressing.Surface(nodes, facets, walls, np.concatenate([below[2], above[2]])))


PENALTY = pressing.Penalty(100.0, 0.003)


def test_energy_forces_and_stiffness_are_derivatives(figure):
    surfaces, rng = two_sheets(0.03), np.random.default_rng(1)
    nodes = surfaces.surface.nodes + 0.002 * rng.normal(size=surfaces.surface.nodes.shape)
    top = np.unique(surfaces.surface.facets[surfaces.surface.walls == 1])
    nodes[top, 2] -= 0.04
    rest = np.zeros(len(surfaces.owner))

    def at(places):
        return touching.Touching(surfaces, PENALTY, rest, places)

    here, along = at(nodes), rng.normal(size=nodes.shape)
    assert here.touching.sum() > 20
    h = 1e-6
    after, before = at(nodes + h * along), at(nodes - h * along)
    work, rate = (after.energy - before.energy) / (2 * h), float((here.forces * along).sum())
    force, product = (after.forces - before.forces).ravel() / (2 * h), here.stiffness @ along.ravel()
    error = max(abs(work / rate - 1), np.abs(force - product).max() / np.abs(force).max())
    figure("differences", "contact of bodies: forces and stiffness", error, 1e-7)
    turned = np.cross(nodes, here.forces).sum(axis=0)
    assert np.abs(here.forces.sum(axis=0)).max() < 1e-12 * np.abs(here.forces).sum()
    assert np.abs(turned).max() < 1e-9 * np.abs(here.forces).sum()


@pytest.mark.parametrize("way", [0.001, 0.03])
def test_friction_has_its_derivative_and_keeps_coulombs_ratio(way):
    surfaces, rng = two_sheets(0.0, bend=0.0), np.random.default_rng(2)
    rest, rubbing, start = np.zeros(len(surfaces.owner)), pressing.Rubbing(0.4, 0.004), surfaces.surface.nodes
    top = np.unique(surfaces.surface.facets[surfaces.surface.walls == 1])

    def at(places):
        return touching.Touching(surfaces, PENALTY, rest, places)

    pressed = start.copy()
    pressed[top, 2] -= 0.01
    grip = touching.RubbedTouching(at(pressed), rubbing, touching.Anchors.of_free(at(start))).kept()
    places = pressed + 1e-4 * rng.normal(size=start.shape)
    places[top] += [0.6 * way, 0.8 * way, -0.002]

    def rubbed(nodes):
        return touching.RubbedTouching(at(nodes), rubbing, grip)

    here, along, h = rubbed(places), rng.normal(size=start.shape), 1e-7
    assert here.slides.any() == (way > 0.01)
    number = (rubbed(places + h * along).forces - rubbed(places - h * along).forces).ravel() / (2 * h)
    assert np.abs(number - here.whole_stiffness @ along.ravel()).max() < 1e-5 * np.abs(number).max()
    assert abs(here.stiffness - here.stiffness.T).max() < 1e-12 * abs(here.stiffness).max()
    assert np.abs(here.forces.sum(axis=0)).max() < 1e-12 * np.abs(here.forces).sum()
    if way > 0.01:
        assert np.linalg.norm(here.force[:2]) == pytest.approx(0.4 * abs(here.force[2]), rel=0.02)


def test_uniform_pressure_is_the_same_work_on_both_sides_of_any_mesh(figure):
    """Nodal forces of a uniform gap are those of a uniform traction on either mesh."""
    surfaces = two_sheets(0.0, (2, 5), bend=0.0)
    nodes = surfaces.surface.nodes.copy()
    top = np.unique(surfaces.surface.facets[surfaces.surface.walls == 1])
    nodes[top, 2] -= 0.01
    here = touching.Touching(surfaces, PENALTY, np.zeros(len(surfaces.owner)), nodes)
    pressure = float(PENALTY.rates(np.array([0.01]))[1][0])
    rule = surfaces.surface.rule[0]
    wanted = np.zeros(len(nodes))
    areas = np.linalg.norm(surfaces.surface.rest[1], axis=1).reshape(len(surfaces.surface.facets), -1)
    np.add.at(wanted, surfaces.surface.facets, pressure * np.einsum("fq,qa->fa", areas, rule))
    error = np.abs(np.abs(here.forces[:, 2]) - wanted).max() / wanted.max()
    figure("patch test", "contact of bodies: nodal forces across meshes that do not match", error, 1e-10)
