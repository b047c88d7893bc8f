"""Simulation of pneumatic soft actuators on FEniCSx: from a case to a load path that ends in results, not in divergence.

    import softmodels as sm

    disk = sm.HollowDisk(section="axisymmetric")
    run = sm.inflate(disk, sm.Yeoh(14e3, 60.0), pressures="0:177 cm")
    run.pressure, run.apex, run.limit

Every name is loaded when it is first used. Numbers are in SI units, inwards and outwards; texts carry a unit. Nothing is
printed, no signal handler is set, no process exits: errors are exceptions, with the sentence that the command line prints.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from measurement.lazy_names import lazy_names

__version__ = "0.1.0"

_PLACES = {
    "measurement.arguments": ("ArgumentError", "ImplausibleWarning"),
    "measurement.folder_lock": ("InUseError",),
    "measurement.own_folder": ("OwnFolderError",),
    "geometries": (
        "Beam",
        "BendingBellows",
        "Cylinder",
        "HollowDisk",
        "SeminarActuator",
        "ImportedActuator",
        "ImportedMesh",
        "Membrane",
        "Balloon",
        "Bellows",
        "PneuNet",
        "GeometryError",
        "MeshFileError",
        "MeshingError",
    ),
    "softmodels.materials.laws": ("NeoHookean", "MooneyRivlin", "Yeoh", "Ogden", "Gent", "Material", "MaterialError"),
    "softmodels.materials.silicones": ("silicone",),
    "softmodels.mechanics.contact": ("Obstacle", "ObstacleError"),
    "softmodels.mechanics.fabric": ("Fabric",),
    "softmodels.mechanics.fibres": ("Fibres",),
    "softmodels.mechanics.holds": ("Clamp",),
    "softmodels.mechanics.loads": ("Gravity", "Mass", "Force", "Moment"),
    "softmodels.mechanics.mpi": ("StartError",),
    "softmodels.mechanics.parts": ("PartError",),
    "softmodels.mechanics.rigid": ("Rigid",),
    "softmodels.mechanics.rigid_shapes": ("RigidShape",),
    "softmodels.mechanics.sheet": ("Sheet",),
    "softmodels.mechanics.walls.part": ("Walls",),
    "softmodels.path.air_supply": ("SupplyError",),
    "softmodels.path.syringe": ("Syringe",),
    "softmodels.case.case": ("Case", "CaseError"),
    "softmodels.case.region": ("Region",),
    "softmodels.design.asked": ("Keep",),
    "softmodels.design.errors": ("DesignError",),
    "softmodels.design.optimise": ("optimise",),
    "softmodels.design.problem": ("DesignProblem",),
    "softmodels.fitting.problem": ("FitError",),
    "softmodels.fitting.options": ("FitOptions",),
    "softmodels.fitting.outlines.fit_device": ("fit", "fit_heights"),
    "softmodels.fitting.curves.curve": ("TensileCurve",),
    "softmodels.fitting.curves.columns": ("TensileError",),
    "softmodels.fitting.curves.fit_curves": ("fit_curves",),
    "softmodels.fitting.score_materials": ("score",),
    "softmodels.fitting.scoring": ("Score",),
    "softmodels.results.limits": ("Limit",),
    "softmodels.results.outcomes": ("RunError",),
    "softmodels.results.store": ("ResultsError",),
    "softmodels.design.mould.settings": ("MouldError",),
    "softmodels.runs.moulding": ("mould",),
    "softmodels.runs.exporting": ("export",),
    "softmodels.runs.run": ("Run",),
    "softmodels.runs.states": ("SolvedState",),
    "softmodels.runs.door": ("inflate", "run", "load", "limit"),
}
_NAMES, __getattr__, __dir__ = lazy_names(__name__, _PLACES)

__all__ = ["__version__", *_NAMES]

if TYPE_CHECKING:
    from geometries import Balloon as Balloon
    from geometries import Beam as Beam
    from geometries import Bellows as Bellows
    from geometries import BendingBellows as BendingBellows
    from geometries import Cylinder as Cylinder
    from geometries import GeometryError as GeometryError
    from geometries import HollowDisk as HollowDisk
    from geometries import ImportedActuator as ImportedActuator
    from geometries import ImportedMesh as ImportedMesh
    from geometries import Membrane as Membrane
    from geometries import MeshFileError as MeshFileError
    from geometries import MeshingError as MeshingError
    from geometries import PneuNet as PneuNet
    from geometries import SeminarActuator as SeminarActuator
    from measurement.arguments import ArgumentError as ArgumentError
    from measurement.arguments import ImplausibleWarning as ImplausibleWarning
    from measurement.folder_lock import InUseError as InUseError
    from measurement.own_folder import OwnFolderError as OwnFolderError
    from softmodels.case.case import Case as Case
    from softmodels.case.case import CaseError as CaseError
    from softmodels.case.region import Region as Region
    from softmodels.design.asked import Keep as Keep
    from softmodels.design.errors import DesignError as DesignError
    from softmodels.design.mould.settings import MouldError as MouldError
    from softmodels.design.optimise import optimise as optimise
    from softmodels.design.problem import DesignProblem as DesignProblem
    from softmodels.fitting.curves.columns import TensileError as TensileError
    from softmodels.fitting.curves.curve import TensileCurve as TensileCurve
    from softmodels.fitting.curves.fit_curves import fit_curves as fit_curves
    from softmodels.fitting.options import FitOptions as FitOptions
    from softmodels.fitting.outlines.fit_device import fit as fit
    from softmodels.fitting.outlines.fit_device import fit_heights as fit_heights
    from softmodels.fitting.problem import FitError as FitError
    from softmodels.fitting.score_materials import score as score
    from softmodels.fitting.scoring import Score as Score
    from softmodels.materials.laws import Gent as Gent
    from softmodels.materials.laws import Material as Material
    from softmodels.materials.laws import MaterialError as MaterialError
    from softmodels.materials.laws import MooneyRivlin as MooneyRivlin
    from softmodels.materials.laws import NeoHookean as NeoHookean
    from softmodels.materials.laws import Ogden as Ogden
    from softmodels.materials.laws import Yeoh as Yeoh
    from softmodels.materials.silicones import silicone as silicone
    from softmodels.mechanics.contact import Obstacle as Obstacle
    from softmodels.mechanics.contact import ObstacleError as ObstacleError
    from softmodels.mechanics.fabric import Fabric as Fabric
    from softmodels.mechanics.fibres import Fibres as Fibres
    from softmodels.mechanics.holds import Clamp as Clamp
    from softmodels.mechanics.loads import Force as Force
    from softmodels.mechanics.loads import Gravity as Gravity
    from softmodels.mechanics.loads import Mass as Mass
    from softmodels.mechanics.loads import Moment as Moment
    from softmodels.mechanics.mpi import StartError as StartError
    from softmodels.mechanics.parts import PartError as PartError
    from softmodels.mechanics.rigid import Rigid as Rigid
    from softmodels.mechanics.rigid_shapes import RigidShape as RigidShape
    from softmodels.mechanics.sheet import Sheet as Sheet
    from softmodels.mechanics.walls.part import Walls as Walls
    from softmodels.path.air_supply import SupplyError as SupplyError
    from softmodels.path.syringe import Syringe as Syringe
    from softmodels.results.limits import Limit as Limit
    from softmodels.results.outcomes import RunError as RunError
    from softmodels.results.store import ResultsError as ResultsError
    from softmodels.runs.door import inflate as inflate
    from softmodels.runs.door import limit as limit
    from softmodels.runs.door import load as load
    from softmodels.runs.door import run as run
    from softmodels.runs.exporting import export as export
    from softmodels.runs.moulding import mould as mould
    from softmodels.runs.run import Run as Run
    from softmodels.runs.states import SolvedState as SolvedState
