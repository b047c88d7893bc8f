"""How a face of the part is named to its owner: by the name it has in the file, else by its kind, and where it is."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from geometries import Actuator
from softmodels.design.mould.facets import Array
from softmodels.design.mould.solids import Parted


def face_namer(device: Actuator, parted: Parted) -> Callable[[Array], str]:
    """A function from a place in the mould (mm) to the clause that names the part's face there.

    Args:
        device: The part.
        parted: How it was turned and scaled.
    """

    def named(place: Array) -> str:
        return _name(device, parted.drawn(place))

    return named


def _name(device: Actuator, place: Array) -> str:
    """``at`` the place, with the face nearest to it."""
    import gmsh  # type: ignore[import-untyped]

    from geometries.face_labels import face_names, named_surfaces
    from geometries.meshing import private_model

    where = "at " + ", ".join(f"{value + 0.0:.4g}" for value in np.round(place, 3)) + " mm"
    with private_model():
        device.build_whole()
        best, face = np.inf, 0
        tags = [tag for _, tag in gmsh.model.getEntities(2)]
        for tag in tags:
            nearest, _ = gmsh.model.getClosestPoint(2, tag, list(place))
            low, high = np.reshape(gmsh.model.getBoundingBox(2, tag), (2, 3))
            if ((low - 1e-3 > nearest) | (nearest > high + 1e-3)).any():
                continue
            if (distance := float(np.linalg.norm(nearest - place))) < best:
                best, face = distance, tag
        if not face:
            return where
        kind, file = gmsh.model.getType(2, face).lower(), device.files.get("file", "")
        names = face_names(file) if file else {}
        label = next((name for name in names if tags.index(face) in named_surfaces(file, name)), "")
    return f"{where}, on the part's face {label!r}" if label else f"{where}, on the part's face {face} (a {kind})"
