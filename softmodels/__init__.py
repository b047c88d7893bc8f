"""Simulation of pneumatic soft actuators with FEniCSx: load paths through limit points and bifurcations.

    import softmodels as sm

    disk = sm.HollowDisk(section="axisymmetric")
    run = sm.inflate(disk, sm.Yeoh(14e3, 60.0), pressures="0:177 cm")
    run.pressure, run.apex, run.limit

Every name is loaded when it is first used. Numbers are in SI units, both in arguments and results; strings carry a unit. Calls
print nothing, set no signal handler and never exit: errors are exceptions with the message that the command line prints.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from softmodels.common.names import lazy_names

if TYPE_CHECKING:
    from geometries import (
        Balloon as Balloon,
        Beam as Beam,
        Bellows as Bellows,
        BendingBellows as BendingBellows,
        ChannelCell as ChannelCell,
        ChannelPlate as ChannelPlate,
        Cylinder as Cylinder,
        GeometryError as GeometryError,
        HollowDisk as HollowDisk,
        ImportedActuator as ImportedActuator,
        ImportedMesh as ImportedMesh,
        Membrane as Membrane,
        MeshFileError as MeshFileError,
        MeshingError as MeshingError,
        PneuNet as PneuNet,
        SeminarActuator as SeminarActuator,
        SuctionCup as SuctionCup,
    )
    from softmodels.api.calls import (
        compare as compare,
        export as export,
        inflate as inflate,
        limit as limit,
        load as load,
        modes as modes,
        run as run,
    )
    from softmodels.api.run import Run as Run, SolvedState as SolvedState
    from softmodels.case.case import Case as Case
    from softmodels.case.entries import CaseError as CaseError
    from softmodels.case.materials import Region as Region
    from softmodels.casting.files import mould as mould
    from softmodels.casting.settings import MouldError as MouldError
    from softmodels.common.folders import InUseError as InUseError, OwnFolderError as OwnFolderError
    from softmodels.common.names import ArgumentError as ArgumentError, ImplausibleWarning as ImplausibleWarning
    from softmodels.components.contact import (
        BodyContact as BodyContact,
        Obstacle as Obstacle,
        RigidShape as RigidShape,
        Walls as Walls,
    )
    from softmodels.components.fibres import Fabric as Fabric, Fibres as Fibres, Sheet as Sheet
    from softmodels.components.loads import Force as Force, Gravity as Gravity, Mass as Mass, Moment as Moment
    from softmodels.components.rigid import Clamp as Clamp, Rigid as Rigid, Spring as Spring
    from softmodels.decks.reduction import ReducedModel as ReducedModel
    from softmodels.design.optimise import optimise as optimise
    from softmodels.design.problem import DesignProblem as DesignProblem, Keep as Keep
    from softmodels.design.study import Study as Study, StudyError as StudyError, study as study
    from softmodels.design.trials import DesignError as DesignError
    from softmodels.fitting.curves.curve import TensileCurve as TensileCurve, TensileError as TensileError
    from softmodels.fitting.curves.fit import fit_curves as fit_curves
    from softmodels.fitting.leak import Leak as Leak, fit_leak as fit_leak
    from softmodels.fitting.outlines.fit import fit as fit, fit_heights as fit_heights
    from softmodels.fitting.problem import FitError as FitError, FitOptions as FitOptions
    from softmodels.fitting.scoring import Score as Score, score as score
    from softmodels.materials.laws import (
        Carroll as Carroll,
        FungDemiray as FungDemiray,
        Gent as Gent,
        Material as Material,
        MaterialError as MaterialError,
        MooneyRivlin as MooneyRivlin,
        NeoHookean as NeoHookean,
        Ogden as Ogden,
        Polynomial as Polynomial,
        Yeoh as Yeoh,
    )
    from softmodels.materials.silicones import silicone as silicone
    from softmodels.mechanics.component import ComponentError as ComponentError
    from softmodels.mechanics.mpi import StartError as StartError
    from softmodels.path.supply import Reservoir as Reservoir, SupplyError as SupplyError, Syringe as Syringe
    from softmodels.pictures.comparison import Comparison as Comparison, ComparisonError as ComparisonError
    from softmodels.runs.analyses import Limit as Limit, NaturalFrequencies as NaturalFrequencies
    from softmodels.runs.outcomes import RunError as RunError
    from softmodels.runs.simulation import Equilibrium as Equilibrium, Mode as Mode, Model as Model
    from softmodels.runs.states import Line as Line
    from softmodels.runs.store import ResultsError as ResultsError


__version__ = "0.1.0"

_NAMES, __getattr__, __dir__ = lazy_names(__name__)

__all__ = ["__version__", *_NAMES]
