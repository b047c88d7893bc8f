"""Geometries of soft pneumatic actuators: parameters in, a mesh with named surfaces out.

Every device is a frozen dataclass in SI units. Its ``write`` makes a second-order Gmsh mesh whose physical groups are
*roles* ("cavity", "support", "plane0", ...), so that a solver never has to know which device it is given::

    from geometries import HollowDisk
    HollowDisk(membrane=0.004).write("disk.msh")

The same from a shell is ``python -m geometries HollowDisk --membrane 4mm -o disk.msh``. A new device is one subclass of
`Actuator`, here or in a file of one's own; with `register_device` above it, commands and settings files find it by its name.
Every name is loaded when it is first used.

Begin with `actuator`: a device is a frozen dataclass of it that is registered (`registry`).

- `disk`, `seminar`, `pneunet`, `membrane`, `balloon`, `bellows`, `bending_bellows`, `cylinder`, `beam`, `suction_cup`,
  `channel_plate`, `channel_cell`: one file for each device: its lengths, their checks, its mesh and its outline.
- `imported`: parts from files: STEP, meshes of Gmsh, Abaqus or CalculiX, STL. `faces`: texts that pick their faces and points.
  `surfaces`: STL files repaired. `inlets`: openings of their air and their plugs. `abaqus`: decks of Abaqus and CalculiX.
- `network`: networks of channels, their walls and surface. `plates`: plates with them, in Gmsh. `drawings`: SVG and DXF.
  `slices`: the part between mirrors.
- `revolved`: half sections of bodies of revolution. `meshing`: Gmsh, in a process of its own where it takes long.
- `mesh_arrays`: meshes as arrays. `registry`: also the command-line options of a device.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from softmodels.common.names import lazy_names

PLACES = {
    "Balloon": "geometries.balloon",
    "Beam": "geometries.beam",
    "Bellows": "geometries.bellows",
    "BendingBellows": "geometries.bending_bellows",
    "ChannelCell": "geometries.channel_cell",
    "ChannelPlate": "geometries.channel_plate",
    "Cylinder": "geometries.cylinder",
    "HollowDisk": "geometries.disk",
    "ImportedActuator": "geometries.imported",
    "ImportedMesh": "geometries.imported",
    "Membrane": "geometries.membrane",
    "PneuNet": "geometries.pneunet",
    "SeminarActuator": "geometries.seminar",
    "SuctionCup": "geometries.suction_cup",
}
"""The modules of the library's own devices, which register them when they are loaded."""

if TYPE_CHECKING:
    from geometries.actuator import Actuator as Actuator, CutPlane as CutPlane, Hold as Hold
    from geometries.balloon import Balloon as Balloon
    from geometries.beam import Beam as Beam
    from geometries.bellows import Bellows as Bellows
    from geometries.bending_bellows import BendingBellows as BendingBellows
    from geometries.channel_cell import ChannelCell as ChannelCell
    from geometries.channel_plate import ChannelPlate as ChannelPlate
    from geometries.cylinder import Cylinder as Cylinder
    from geometries.disk import HollowDisk as HollowDisk
    from geometries.imported import ImportedActuator as ImportedActuator, ImportedMesh as ImportedMesh
    from geometries.membrane import Membrane as Membrane
    from geometries.pneunet import PneuNet as PneuNet
    from geometries.registry import ACTUATORS as ACTUATORS, register_device as register_device
    from geometries.seminar import SeminarActuator as SeminarActuator
    from geometries.suction_cup import SuctionCup as SuctionCup
    from softmodels.common.errors import (
        GeometryError as GeometryError,
        MeshFileError as MeshFileError,
        MeshingError as MeshingError,
        MeshingStopped as MeshingStopped,
    )


_NAMES, __getattr__, __dir__ = lazy_names(__name__)

__all__ = [*_NAMES]
