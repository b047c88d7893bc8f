"""Solve the benchmark's beam in FElupe, on the same mesh and with the same law, and hold it against softmodels.

    uv run --with felupe python -m tests.validation.in_felupe

Printed is the tip's drop by both: in softmodels with displacements only, as in FElupe, and with the pressure as an unknown, as
the benchmark has it. FElupe 11 puts pressures on faces of quadrilaterals and hexahedra only, so that devices with air
cannot be solved there on their own meshes.
"""

from __future__ import annotations

import dataclasses
import tempfile
from pathlib import Path

import felupe as fem
import meshio
import numpy as np

import softmodels as sm
from softmodels.materials.laws import NeoHookean
from tests.validation.devices import G, Measured, beam

DENSITY = 1070.0
STEPS = 10
"""Steps of the weight, and of the load after it."""


def edge_forces(points: np.ndarray, edge: np.ndarray, load: float) -> tuple[np.ndarray, np.ndarray]:
    """Forces in N on the nodes of a straight edge, and these nodes, of a load spread evenly: Simpson's weights."""
    order = edge[np.argsort(points[edge, 1])]
    shares = np.zeros(len(points))
    for first in range(0, len(order) - 1, 2):
        three = order[first : first + 3]
        shares[three] += np.array([1, 4, 1]) / 6 * np.ptp(points[three, 1])
    return load * shares[order] / shares.sum(), order


def drops(one: Measured, material: NeoHookean, mesh: Path) -> np.ndarray:
    """Drop of the tip in mm at the measured loads, by FElupe."""
    device = one.case(material).actuator
    read = meshio.read(mesh)
    quadratic = fem.Mesh(read.points, read.cells_dict["tetra10"], "tetra10")
    field = fem.FieldContainer(
        [fem.Field(fem.RegionQuadraticTetra(quadratic, quadrature=fem.TetrahedronQuadrature(order=5)), dim=3)]
    )
    law = fem.CompositeMaterial(fem.NeoHookeCompressible(mu=material.shear_modulus), fem.Volumetric(bulk=material.bulk))
    x, y, z = quadratic.points.T
    held = {
        "support": fem.Boundary(field[0], mask=x < 1e-9),
        "mirror": fem.Boundary(field[0], mask=y < 1e-9, skip=(True, False, True)),
    }
    weight = fem.SolidBodyForce(field)
    tip, top = device.length, device.thickness / 2
    forces, nodes = edge_forces(quadratic.points, np.flatnonzero((x > tip - 1e-9) & (z > top - 1e-9)), one.given[-1] / 2)
    pull = fem.PointLoad(field, nodes)
    ramps = np.linspace(1 / STEPS, 1.0, STEPS)
    loads = np.unique(np.r_[np.linspace(0.0, one.given[-1], STEPS + 1), one.given])
    values = np.outer(loads / one.given[-1], forces)[:, :, None] * np.array([0.0, 0.0, -1.0])
    items, found = [fem.SolidBody(law, field), weight, pull], {}
    hanging = fem.Step(items=items, ramp={weight: np.outer(ramps, [0.0, 0.0, -G * DENSITY])}, boundaries=held)
    loading = fem.Step(items=items, ramp={pull: values}, boundaries=held)
    places = [[tip, 0.0, side * top] for side in (-1, 1)]
    ends = [int(np.argmin(np.linalg.norm(quadratic.points - place, axis=1))) for place in places]
    for _ in hanging.generate(x0=field, verbose=False):
        pass
    for load, _ in zip(loads, loading.generate(x0=field, verbose=False), strict=True):
        found[load] = -1e3 * field[0].values[ends, 2].mean()
    return np.array([found[load] for load in one.given])


def main() -> None:
    one = next(beam())
    material = one.material
    with tempfile.TemporaryDirectory() as folder:
        mesh = Path(folder) / "beam.msh"
        case = one.case(material)
        case.actuator.write(mesh)
        theirs = drops(one, material, mesh)
    mixed = one.predict(sm.run(case), one.given)
    alike = one.predict(sm.run(dataclasses.replace(case, formulation="displacement")), one.given)
    print("load, measured, FElupe, softmodels with displacements only, with the pressure: drop of the tip in mm")
    for row in zip(one.given, one.values, theirs, alike, mixed, strict=True):
        print(", ".join(f"{value:.6g}" for value in row))
    print(f"largest difference of FElupe and softmodels: {100 * np.abs(theirs / alike - 1).max():.2g} %")


if __name__ == "__main__":
    main()
