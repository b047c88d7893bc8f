"""Volume, first and second moments of a device: of its own mesh, slices repeated to the whole, and of a STEP file."""

from __future__ import annotations

import numpy as np

from geometries.actuator import reflected
from geometries.meshing import load_mesh, private_model
from softmodels.casting.facets import read_step


def of_mesh(device, folder):
    """Integrals of (1, x, y, z) (1, x, y, z) over the whole device in SI units, shape (4, 4), by its own curved mesh."""
    import gmsh

    path, found = device.write(folder / "whole.msh"), np.zeros((4, 4))
    flat = device.dimension == 2
    with private_model():
        load_mesh(path)
        for kind in gmsh.model.mesh.getElementTypes(device.dimension):
            local, weights = gmsh.model.mesh.getIntegrationPoints(kind, "Gauss6")
            _, determinants, places = gmsh.model.mesh.getJacobians(kind, local)
            measure = np.tile(weights, len(determinants) // len(weights)) * determinants
            x, y, z = places.reshape(-1, 3).T
            if flat:  # radius and height: four points around the axis have the moments of a ring
                measure, z = np.tile(0.5 * np.pi * x * measure, 4), np.tile(y, 4)
                x, y = np.concatenate([x, 0.0 * x, -x, 0.0 * x]), np.concatenate([0.0 * x, x, 0.0 * x, -x])
            rows = np.stack([np.ones_like(x), x, y, z])
            found += rows * measure @ rows.T
    if flat:
        return found
    images = np.tile(np.eye(4), (device.copies, 1, 1))
    images[:, 1:, 1:] = reflected([plane.normal for plane in device.cut_planes])
    return (images @ found @ images.transpose(0, 2, 1)).sum(axis=0)


def of_step(step, folder):
    """The same of the one solid of a STEP file, given as bytes, by the CAD kernel."""
    import gmsh

    (folder / "whole.step").write_bytes(step)
    with private_model():
        solid = read_step(folder / "whole.step")
        mass, centre = gmsh.model.occ.getMass(3, solid), np.array(gmsh.model.occ.getCenterOfMass(3, solid))
        inertia = np.reshape(gmsh.model.occ.getMatrixOfInertia(3, solid), (3, 3))
    second = 0.5 * np.trace(inertia) * np.eye(3) - inertia + mass * np.outer(centre, centre)
    found = np.block([[mass, mass * centre[None]], [mass * centre[:, None], second]])
    metres = np.diag([1.0, 1e-3, 1e-3, 1e-3])
    return 1e-9 * metres @ found @ metres


def mirror_gap(device, step, folder):
    """Largest difference of volume and moments between a device's mesh and a STEP, over volume and size."""
    one, other = of_mesh(device, folder), of_step(step, folder)
    size = np.sqrt(np.trace(one[1:, 1:]) / one[0, 0])
    sizes = np.array([1.0, size, size, size])
    return float((np.abs(one - other) / one[0, 0] / np.outer(sizes, sizes)).max())
