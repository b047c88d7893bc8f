"""Geometries of soft pneumatic actuators: parameters in, a mesh with named surfaces out.

Every device is a frozen dataclass in SI units. Its ``write`` makes a second-order Gmsh mesh whose physical groups are
*roles* ("cavity", "support", "plane0", ...), so that a solver never has to know which device it is given::

    from geometries import HollowDisk
    HollowDisk(membrane=0.004).write("disk.msh")

The same from a shell is ``python -m geometries HollowDisk --membrane 4mm -o disk.msh``. A new device is one subclass of
`Actuator`, here or in a file of one's own; with `register` above it, command lines and settings files find it by its name.
"""

import contextlib
import sys

from measurement.ending import stoppable

# While Python looks for the module that -m names, as python -m geometries, it is no library that is imported.
with stoppable("geometries") if sys.argv[:1] == ["-m"] else contextlib.nullcontext():
    from geometries.actuator import Actuator, CutPlane, Hold
    from geometries.balloon import Balloon
    from geometries.beam import Beam
    from geometries.bellows import Bellows
    from geometries.bending_bellows import BendingBellows
    from geometries.cylinder import Cylinder
    from geometries.disk import HollowDisk
    from geometries.errors import GeometryError, MeshFileError, MeshingError, MeshingStopped
    from geometries.imported import ImportedActuator
    from geometries.imported_mesh import ImportedMesh
    from geometries.membrane import Membrane
    from geometries.pneunet import PneuNet
    from geometries.registry import ACTUATORS, register
    from geometries.seminar import SeminarActuator

__all__ = [
    "ACTUATORS",
    "Actuator",
    "Balloon",
    "Beam",
    "Bellows",
    "BendingBellows",
    "CutPlane",
    "Cylinder",
    "GeometryError",
    "Hold",
    "HollowDisk",
    "ImportedActuator",
    "ImportedMesh",
    "Membrane",
    "MeshFileError",
    "MeshingError",
    "MeshingStopped",
    "PneuNet",
    "SeminarActuator",
    "register",
]
