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

from softmodels.common.lazy_names import lazy_names

if TYPE_CHECKING:
    from geometries import (
        Balloon as Balloon,
    )
    from geometries import (
        Beam as Beam,
    )
    from geometries import (
        Bellows as Bellows,
    )
    from geometries import (
        BendingBellows as BendingBellows,
    )
    from geometries import (
        Cylinder as Cylinder,
    )
    from geometries import (
        GeometryError as GeometryError,
    )
    from geometries import (
        HollowDisk as HollowDisk,
    )
    from geometries import (
        ImportedActuator as ImportedActuator,
    )
    from geometries import (
        ImportedMesh as ImportedMesh,
    )
    from geometries import (
        Membrane as Membrane,
    )
    from geometries import (
        MeshFileError as MeshFileError,
    )
    from geometries import (
        MeshingError as MeshingError,
    )
    from geometries import (
        PneuNet as PneuNet,
    )
    from geometries import (
        SeminarActuator as SeminarActuator,
    )
    from softmodels.case.case import Case as Case
    from softmodels.case.entries import CaseError as CaseError
    from softmodels.case.materials import Region as Region
    from softmodels.casting.files import mould as mould
    from softmodels.casting.settings import MouldError as MouldError
    from softmodels.common.calls import ArgumentError as ArgumentError
    from softmodels.common.calls import ImplausibleWarning as ImplausibleWarning
    from softmodels.common.folders import InUseError as InUseError
    from softmodels.common.folders import OwnFolderError as OwnFolderError
    from softmodels.design.loads import DesignError as DesignError
    from softmodels.design.optimise import optimise as optimise
    from softmodels.design.problem import DesignProblem as DesignProblem
    from softmodels.design.problem import Keep as Keep
    from softmodels.fitting.curves.curve import TensileCurve as TensileCurve
    from softmodels.fitting.curves.curve import TensileError as TensileError
    from softmodels.fitting.curves.fit import fit_curves as fit_curves
    from softmodels.fitting.outlines.fit import fit as fit
    from softmodels.fitting.outlines.fit import fit_heights as fit_heights
    from softmodels.fitting.problem import FitError as FitError
    from softmodels.fitting.problem import FitOptions as FitOptions
    from softmodels.fitting.scoring import Score as Score
    from softmodels.fitting.scoring import score as score
    from softmodels.materials.laws import (
        Gent as Gent,
    )
    from softmodels.materials.laws import (
        Material as Material,
    )
    from softmodels.materials.laws import (
        MaterialError as MaterialError,
    )
    from softmodels.materials.laws import (
        MooneyRivlin as MooneyRivlin,
    )
    from softmodels.materials.laws import (
        NeoHookean as NeoHookean,
    )
    from softmodels.materials.laws import (
        Ogden as Ogden,
    )
    from softmodels.materials.laws import (
        Yeoh as Yeoh,
    )
    from softmodels.materials.silicones import silicone as silicone
    from softmodels.mechanics.component import ComponentError as ComponentError
    from softmodels.mechanics.contact import Obstacle as Obstacle
    from softmodels.mechanics.contact import ObstacleError as ObstacleError
    from softmodels.mechanics.contact import RigidShape as RigidShape
    from softmodels.mechanics.fibres import Fabric as Fabric
    from softmodels.mechanics.fibres import Fibres as Fibres
    from softmodels.mechanics.holds import Clamp as Clamp
    from softmodels.mechanics.loads import (
        Force as Force,
    )
    from softmodels.mechanics.loads import (
        Gravity as Gravity,
    )
    from softmodels.mechanics.loads import (
        Mass as Mass,
    )
    from softmodels.mechanics.loads import (
        Moment as Moment,
    )
    from softmodels.mechanics.mpi import StartError as StartError
    from softmodels.mechanics.rigid import Rigid as Rigid
    from softmodels.mechanics.sheet import Sheet as Sheet
    from softmodels.mechanics.walls import Walls as Walls
    from softmodels.path.supply import SupplyError as SupplyError
    from softmodels.path.supply import Syringe as Syringe
    from softmodels.runs.api import (
        export as export,
    )
    from softmodels.runs.api import (
        inflate as inflate,
    )
    from softmodels.runs.api import (
        limit as limit,
    )
    from softmodels.runs.api import (
        load as load,
    )
    from softmodels.runs.api import (
        run as run,
    )
    from softmodels.runs.limits import Limit as Limit
    from softmodels.runs.model import Equilibrium as Equilibrium
    from softmodels.runs.model import Mode as Mode
    from softmodels.runs.model import Model as Model
    from softmodels.runs.outcomes import RunError as RunError
    from softmodels.runs.run import Run as Run
    from softmodels.runs.run import SolvedState as SolvedState
    from softmodels.runs.store import ResultsError as ResultsError


__version__ = "0.1.0"

_PLACES = {
    "softmodels.common.calls": ("ArgumentError", "ImplausibleWarning"),
    "softmodels.common.folders": ("InUseError", "OwnFolderError"),
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
    "softmodels.mechanics.contact": ("Obstacle", "ObstacleError", "RigidShape"),
    "softmodels.mechanics.fibres": ("Fabric", "Fibres"),
    "softmodels.mechanics.holds": ("Clamp",),
    "softmodels.mechanics.loads": ("Gravity", "Mass", "Force", "Moment"),
    "softmodels.mechanics.mpi": ("StartError",),
    "softmodels.mechanics.component": ("ComponentError",),
    "softmodels.mechanics.rigid": ("Rigid",),
    "softmodels.mechanics.sheet": ("Sheet",),
    "softmodels.mechanics.walls": ("Walls",),
    "softmodels.path.supply": ("SupplyError", "Syringe"),
    "softmodels.case.case": ("Case",),
    "softmodels.case.entries": ("CaseError",),
    "softmodels.case.materials": ("Region",),
    "softmodels.design.problem": ("Keep", "DesignProblem"),
    "softmodels.design.loads": ("DesignError",),
    "softmodels.design.optimise": ("optimise",),
    "softmodels.fitting.problem": ("FitError", "FitOptions"),
    "softmodels.fitting.outlines.fit": ("fit", "fit_heights"),
    "softmodels.fitting.curves.curve": ("TensileCurve", "TensileError"),
    "softmodels.fitting.curves.fit": ("fit_curves",),
    "softmodels.fitting.scoring": ("score", "Score"),
    "softmodels.runs.limits": ("Limit",),
    "softmodels.runs.model": ("Model", "Equilibrium", "Mode"),
    "softmodels.runs.outcomes": ("RunError",),
    "softmodels.runs.store": ("ResultsError",),
    "softmodels.casting.settings": ("MouldError",),
    "softmodels.casting.files": ("mould",),
    "softmodels.runs.api": ("export", "inflate", "run", "load", "limit"),
    "softmodels.runs.run": ("Run", "SolvedState"),
}
_NAMES, __getattr__, __dir__ = lazy_names(__name__, _PLACES)

__all__ = ["__version__", *_NAMES]
