"""A reduced model in the words of other programs: tables, a chain for MuJoCo, a scene for SOFA, a curve for FONSim, an FMU."""

from __future__ import annotations

import csv
import dataclasses
import io
import json
import math
import re
import sys
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from geometries.actuator import AXES
from softmodels.case.entries import CaseError
from softmodels.common.arrays import Array
from softmodels.common.errors import known_are, required
from softmodels.common.files import read_file, write_bytes
from softmodels.decks.deck import WRITTEN
from softmodels.decks.reduction import SAME, ReducedModel, TipState, across
from softmodels.runs.outcomes import RunError

MOTIONS = (*AXES, *(f"turn_{axis}" for axis in AXES))
LOADS = (*(f"f{axis}" for axis in AXES), *(f"m{axis}" for axis in AXES))


# ----------------------------------------------------------------------------------------------------------------------
# Tables: units in the heads of the columns, or beside the values.


def columns(model: ReducedModel) -> dict[str, Callable[[TipState], float]]:
    """Return the columns of the table by their heads, which end in the unit."""
    found: dict[str, Callable[[TipState], float]] = {"pressure_Pa": lambda one: one.pressure}
    device = model.case.actuator
    for k, ratio in enumerate(device.ratios, 1):
        if len(device.ratios) > 1:
            found[f"pressure_cavity{k}_Pa"] = lambda one, ratio=ratio: ratio * one.pressure  # type: ignore[misc]
    found |= {f"tip_{axis}_m": lambda one, i=i: one.position[i] for i, axis in enumerate(AXES)}  # type: ignore[misc]
    found |= {f"tip_q{axis}_1": lambda one, i=i: float(_quaternion(one)[i]) for i, axis in enumerate("wxyz")}  # type: ignore[misc]
    found |= {"added_volume_m3": lambda one: one.volume, "volume_rate_m3_per_Pa": lambda one: one.volume_rate}
    for i, motion in enumerate(MOTIONS):
        unit = "m" if i < 3 else "rad"
        for k in range(len(device.ratios)):
            head = (
                f"rate_{motion}_by_cavity{k + 1}_{unit}_per_Pa"
                if len(device.ratios) > 1
                else f"rate_{motion}_{unit}_per_Pa"
            )
            found[head] = lambda one, i=i, k=k: one.jacobian[i, k]  # type: ignore[misc]
    for i, motion in enumerate(MOTIONS):
        for j, load in enumerate(LOADS[: i + 1]):
            unit = f"{'m' if i < 3 else 'rad'}_per_{'N' if j < 3 else 'Nm'}"
            found[f"compliance_{motion}_{load}_{unit}"] = lambda one, i=i, j=j: one.compliance[i, j]  # type: ignore[misc]
    for i, load in enumerate(LOADS):
        unit = "N_per_Pa" if i < 3 else "Nm_per_Pa"
        found[f"blocked_{load}_{unit}"] = lambda one, i=i: model.blocked(one)[i]  # type: ignore[misc,assignment]
    found["effective_area_m2"] = model.effective_area
    for i, name in enumerate(("curvature_per_m", "arc_length_m", "bending_direction_rad")):
        found[name] = lambda one, i=i: model.constant_curvature(one)[i]  # type: ignore[misc]
    found["max_stretch_1"] = lambda one: one.stretch
    if np.isfinite(model.states[-1].spread).all():
        heads = [
            *(f"tip_{axis}_ci95_m" for axis in AXES),
            *(f"turn_{axis}_ci95_rad" for axis in AXES),
            "added_volume_ci95_m3",
        ]
        found |= {head: lambda one, i=i: one.spread[i] for i, head in enumerate(heads)}  # type: ignore[misc]
    return found


def _quaternion(one: TipState) -> Array:
    return np.asarray(Rotation.from_matrix(one.rotation).as_quat(canonical=True, scalar_first=True))


def table_csv(model: ReducedModel) -> str:
    """Return the table as CSV; empty cells where a value is not known."""
    out = io.StringIO(newline="")
    writer = csv.writer(out, lineterminator="\n")
    known = columns(model)
    writer.writerow(known)
    for one in model.states:
        values = [float(read(one)) for read in known.values()]
        writer.writerow([f"{value:.12g}" if math.isfinite(value) else "" for value in values])
    return out.getvalue()


def table_json(model: ReducedModel) -> str:
    """Return the table as JSON, with what it is of, where it ends and its errors in between."""
    known, low_high = columns(model), model.span
    rows = {head: [_plain(float(read(one))) for one in model.states] for head, read in known.items()}
    about = {
        "written_by": WRITTEN, "case": model.case.name, "device": type(model.case.actuator).__name__, "tip": model.face,
        "support_m": model.base.tolist(), "length_m": model.length, "from_Pa": low_high[0], "to_Pa": low_high[1],
        "notes": model.notes,
        "errors_between_states": {
            "position_per_length": model.errors["position"], "angle_deg": model.errors["angle_deg"],
            "volume_relative": model.errors["volume"], "compliance_relative": model.errors["compliance"],
        },
        "interpolation": "position, rotation vector, volume: cubic Hermite with the rates; compliance: cubic spline",
        "table": rows,
    }  # fmt: skip
    return json.dumps(about, indent=1) + "\n"


def _plain(value: float) -> float | None:
    return value if math.isfinite(value) else None


def fonsim_csv(model: ReducedModel) -> str:
    """Return the volume of the air and its gauge pressure for FONSim's ``PVCurve(..., pressure_reference="relative")``."""
    rest = model.case.actuator.cavity_volume * 1e6
    states = sorted(model.states, key=lambda one: one.volume)
    rows = [f"{rest + one.volume * 1e6:.9g},{one.pressure / 1e3:.9g}" for one in states]
    return "\n".join(["volume,pressure", "ml,kPa", *rows]) + "\n"


# ----------------------------------------------------------------------------------------------------------------------
# A chain of joints for MuJoCo: hinges and slides with springs, whose rest positions follow the pressure.
#
# Segments of equal length. Their angles grow linearly along the chain, and all slides move by the same: three numbers give the
# tip any place and angle in the plane of bending, three more (leaning out of it, evenly and not, and twist) any pose at all.
# As functions of the pressure they are quartics. In MuJoCo a joint stands for the pressure, joints are tied to it by these
# quartics, and tendons are the springs between those and the chain.


SEGMENTS = 8
MOST_TURN = math.radians(0.5)
"""Rotation up to which a device only extends."""
FLAT = 0.02
"""Distance of the tip from the plane of bending, in lengths, up to which a chain stays in it."""
LAG = 0.01
"""Time constant in s of the pressure behind its command."""
DAMPING = 0.01
"""Damping of a spring over its stiffness, s."""
DRIVERS = ("bend", "uneven", "extension", "lean", "uneven_lean", "twisting")
FOLLOWED = {
    "hinge": ("bend", "uneven"),
    "slide": ("extension", ""),
    "side": ("lean", "uneven_lean"),
    "twist": ("twisting", ""),
}
"""The numbers that a joint of each kind follows: its share of the first, and of the second by its place along the chain."""


@dataclasses.dataclass(frozen=True, eq=False)
class Chain:
    """The chain of a device.

    Attributes:
        base: Its beginning, m.
        axes: In columns its direction at rest, the one across it towards which it bends, and the normal of that plane.
        length: At rest, m.
        quartics: The numbers (rad and m) over the pressure's share of ``top``: five coefficients each, shape (3, 5), or (6, 5)
            where the tip leaves the plane.
        top: The highest pressure, Pa.
        stiffness: Of one joint of each kind, N m/rad and N/m; 0 where it is not known, or there is none.
        error: Largest distance of the tip from the table's over the length, and angle in degrees.
    """

    base: Array
    axes: Array
    length: float
    quartics: Array
    top: float
    stiffness: dict[str, float]
    error: tuple[float, float] = (0.0, 0.0)

    def follows(self, kind: str) -> bool:
        """Return whether joints of a kind follow the pressure, and not only yield to loads."""
        return self.stiffness[kind] > 0.0 and DRIVERS.index(FOLLOWED[kind][0]) < len(self.quartics)


def reached(numbers: Array, length: float) -> tuple[Array, Array]:
    """Return place (m) and rotation of the end of a chain by its numbers, along its axes at rest."""
    bend, uneven, extension, lean, uneven_lean, twist = np.append(numbers, np.zeros(len(DRIVERS) - len(numbers)))
    link, along = length / SEGMENTS, np.arange(SEGMENTS) - (SEGMENTS - 1) / 2
    angles = [
        bend / SEGMENTS + uneven * along,
        lean / SEGMENTS + uneven_lean * along,
        np.full(SEGMENTS, twist / SEGMENTS),
    ]
    place, R = np.array([link / 2, 0.0, 0.0]), np.eye(3)
    for k, joint in enumerate(Rotation.from_euler("ZYX", np.transpose(angles)).as_matrix()):
        R = R @ joint
        place += (link * (0.5 if k == SEGMENTS - 1 else 1.0) + extension / SEGMENTS) * R[:, 0]
    return place, R


def _missed(numbers: Array, place: Array, R: Array, length: float) -> Array:
    """Return how far the end of a chain is from a pose, in lengths and radians."""
    at, turned = reached(numbers, length)
    return np.concatenate([(at - place) / length, Rotation.from_matrix(R.T @ turned).as_rotvec()])


def chain_of(model: ReducedModel) -> Chain:
    """Return the chain that follows a reduced model; `RunError` if the tip's stiffness is not known in a direction in which it
    moves."""
    along = (model.states[0].position - model.base) / model.length
    turn = model.turns[-1]
    hinges = float(np.linalg.norm(turn)) > MOST_TURN
    normal = turn / np.linalg.norm(turn) if hinges else across(along)[1]
    normal = normal - (normal @ along) * along
    normal /= np.linalg.norm(normal)
    axes = np.column_stack([along, np.cross(normal, along), normal])
    places = np.array([one.position - model.base for one in model.states]) @ axes
    turned = [axes.T @ one.rotation @ axes for one in model.states]
    out = float(np.abs(places[:, 2]).max())
    stiffness = _stiffness(model, axes, hinges)
    if out > FLAT * model.length and not (stiffness["side"] and stiffness["twist"]):
        raise RunError(
            f"the tip leaves the plane of bending by {1e3 * out:.3g} mm, and its stiffness across that is not known; reduce a "
            f"model of the whole device, or write a table (.csv, .json)"
        )
    count, found = 6 if out > FLAT * model.length else 3, []
    for place, R, angle in zip(places, turned, model.turns @ normal, strict=True):
        if not hinges:
            found.append([0.0, 0.0, place[0] - model.length])
            continue
        # Away from zero: the derivatives are by differences in proportion.
        guess = [angle + 0.01, 0.01, float(np.linalg.norm(place)) - 0.99 * model.length, 0.01, 0.01, 0.01][:count]
        solved = least_squares(_missed, guess, xtol=1e-14, gtol=1e-14, args=(place, R, model.length))
        found.append(solved.x)
    top = float(model.pressures[np.argmax(np.abs(model.pressures))])
    shares = model.pressures / top
    powers = shares[:, None] ** np.arange(1 if abs(shares[0]) < 1e-9 else 0, 5)
    fitted = np.linalg.lstsq(powers, np.array(found), rcond=None)[0].T
    quartics = np.hstack([np.zeros((len(fitted), 5 - fitted.shape[1])), fitted])
    misses = np.array([
        _missed(quartics @ share ** np.arange(5), place, R, model.length)
        for share, place, R in zip(shares, places, turned, strict=True)
    ])  # fmt: skip
    angles = np.linalg.norm(misses[:, 3:], axis=1) * hinges
    error = float(np.linalg.norm(misses[:, :3], axis=1).max()), math.degrees(float(angles.max()))
    return Chain(model.base, axes, model.length, quartics, top, stiffness, error)


def _stiffness(model: ReducedModel, axes: Array, hinges: bool) -> dict[str, float]:
    """Return the stiffness of one joint of each kind: of rotations in the middle of the range, of extension at rest."""
    turning = np.nan_to_num(model((model.span[0] + model.span[1]) / 2).compliance[3:, 3:])
    twisting, aside, bending = (float(e @ turning @ e) for e in axes.T)
    stretching = float(axes[:, 0] @ np.nan_to_num(model.states[0].compliance[:3, :3]) @ axes[:, 0])
    if stretching <= 0.0 or (hinges and bending <= 0.0):
        raise RunError(
            "the stiffness of the tip is not known in the plane of bending; reduce a model of the whole device"
        )
    known = SAME * max(bending, aside, twisting)
    soft = {"hinge": bending * hinges, "side": aside, "twist": twisting}
    return {"slide": SEGMENTS / stretching, **{kind: SEGMENTS / C if known < C else 0.0 for kind, C in soft.items()}}


def mjcf(model: ReducedModel) -> str:
    """Return a chain as MJCF: ``ctrl`` is the pressure in kPa; the site ``tip`` has the tip's pose."""
    chain, link = chain_of(model), model.length / SEGMENTS
    mass = model.case.actuator.solid_volume * model.density / (SEGMENTS + 1)
    root = ElementTree.Element("mujoco", model=model.case.name)
    text = f" {WRITTEN}: {model.case.name}, {model.span[0] / 1e3:.4g} to {model.span[1] / 1e3:.4g} kPa; tip within " \
           f"{100 * chain.error[0]:.2g} % of the length and {chain.error[1]:.2g} degrees of the table "  # fmt: skip
    root.append(ElementTree.Comment(text))
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="true")
    ElementTree.SubElement(root, "option", timestep="0.001", integrator="implicitfast", gravity="0 0 0")
    world = ElementTree.SubElement(root, "worldbody")
    _drivers(world, len(chain.quartics))
    quaternion = Rotation.from_matrix(chain.axes).as_quat(canonical=True, scalar_first=True)
    body = ElementTree.SubElement(world, "body", name="base", pos=_words(chain.base), quat=_words(quaternion))
    radius = 0.12 * model.length
    _link(body, link / 2, radius, mass)
    for k in range(SEGMENTS):
        long = link * (0.5 if k == SEGMENTS - 1 else 1.0)
        body = ElementTree.SubElement(body, "body", name=f"link{k}", pos=_words([link / 2 if k == 0 else link, 0, 0]))
        for kind, axis in (("hinge", "0 0 1"), ("side", "0 1 0"), ("twist", "1 0 0")):
            if not (stiffness := chain.stiffness[kind]):
                continue
            spring = {} if chain.follows(kind) else _spring(stiffness)
            ElementTree.SubElement(body, "joint", spring, name=f"{kind}{k}", type="hinge", axis=axis, armature="1e-7")
        ElementTree.SubElement(body, "joint", name=f"slide{k}", type="slide", axis="1 0 0", armature="1e-4")
        _link(body, long, radius, mass)
    turned = Rotation.from_matrix(chain.axes.T).as_quat(canonical=True, scalar_first=True)
    ElementTree.SubElement(
        body, "site", name="tip", pos=_words([link / 2, 0, 0]), quat=_words(turned), size=f"{radius / 3:.6g}"
    )
    _springs(root, chain)
    actuator = ElementTree.SubElement(root, "actuator")
    top = chain.top / 1e3
    ends = sorted((model.states[0].pressure / 1e3, top))
    ElementTree.SubElement(
        actuator, "general", name="pressure_kPa", joint="pressure", ctrlrange=_words(ends), biastype="affine",
        gainprm=_words([1 / LAG**2 / top]), biasprm=_words([0, -1 / LAG**2, -2 / LAG]),
    )  # fmt: skip
    ElementTree.indent(root, " ")
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _drivers(world: ElementTree.Element, count: int) -> None:
    """Add the joints of the pressure and of the numbers, of 1 kg: in MuJoCo equalities are as firm as the mass."""
    for name in ("pressure", *DRIVERS[:count]):
        body = ElementTree.SubElement(world, "body", name=name, gravcomp="1")
        ElementTree.SubElement(body, "inertial", pos="0 0 0", mass="1", diaginertia="1e-3 1e-3 1e-3")
        ElementTree.SubElement(body, "joint", name=name, type="slide", axis="1 0 0")


def _spring(stiffness: float) -> dict[str, str]:
    return {"stiffness": f"{stiffness:.9g}", "damping": f"{DAMPING * stiffness:.9g}"}


def _link(body: ElementTree.Element, length: float, radius: float, mass: float) -> None:
    ElementTree.SubElement(
        body, "geom", type="capsule", fromto=_words([0, 0, 0, length, 0, 0]), size=f"{radius:.6g}", mass=f"{mass:.9g}",
        rgba="0.18 0.44 0.62 1", contype="0", conaffinity="0",
    )  # fmt: skip


def _springs(root: ElementTree.Element, chain: Chain) -> None:
    """Add the springs of the chain, and tie the numbers to the pressure."""
    tendon, equality = ElementTree.SubElement(root, "tendon"), ElementTree.SubElement(root, "equality")
    for kind in filter(chain.follows, FOLLOWED):
        first, second = FOLLOWED[kind]
        for k in range(SEGMENTS):
            spring = ElementTree.SubElement(
                tendon, "fixed", _spring(chain.stiffness[kind]), name=f"{kind}_spring{k}", springlength="0"
            )
            for name, factor in (f"{kind}{k}", 1.0), (first, -1 / SEGMENTS), (second, (SEGMENTS - 1) / 2 - k):
                if name:
                    ElementTree.SubElement(spring, "joint", joint=name, coef=f"{factor:.9g}")
    for name, quartic in zip(DRIVERS, chain.quartics, strict=False):
        ElementTree.SubElement(
            equality,
            "joint",
            joint1=name,
            joint2="pressure",
            polycoef=_words(quartic),
            solref="0.002 1",
            solimp="0.999 0.9999 0.001",
        )


def _words(values: Iterable[float]) -> str:
    return " ".join(f"{value:.9g}" for value in values)


# ----------------------------------------------------------------------------------------------------------------------
# A scene for SOFA (SofaPython3): the tip as a rigid body on a spring, whose rest pose follows the table.


SOFA = '''"""{written}: {name}. Run by: runSofa {file}

The tip is a rigid body on springs whose rest pose follows the pressure; pressures from {low:.6g} to {high:.6g} kPa.
Units: m, kg, s, N. Set `pressure_kPa` of the controller, or press the keys + and -.
"""

import numpy as np
import Sofa

PRESSURES = np.array({pressures})  # kPa
POSES = np.array({poses})  # m, and the quaternion x, y, z, w
STIFFNESS = np.array({stiffness})  # N/m and N m/rad: mean of the free directions


def at(pressure_kPa):
    """Return pose and stiffnesses at a pressure, linear between the {count} rows of the table."""
    row = [np.interp(pressure_kPa, PRESSURES, column) for column in POSES.T]
    row[3:] = row[3:] / np.linalg.norm(row[3:])
    return row, [np.interp(pressure_kPa, PRESSURES, column) for column in STIFFNESS.T]


class Pressure(Sofa.Core.Controller):
    """Moves the rest pose of the tip's springs with the pressure."""

    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        self.rest, self.springs = kwargs["rest"], kwargs["springs"]
        self.pressure_kPa = float(PRESSURES[0])

    def onAnimateBeginEvent(self, event):
        pose, (stiffness, angular) = at(self.pressure_kPa)
        self.rest.position.value = [pose]
        self.springs.stiffness.value = [stiffness]
        self.springs.angularStiffness.value = [angular]

    def onKeypressedEvent(self, event):
        step = (PRESSURES[-1] - PRESSURES[0]) / 20 * {{"+": 1, "-": -1}}.get(event["key"], 0)
        self.pressure_kPa = float(np.clip(self.pressure_kPa + step, PRESSURES[0], PRESSURES[-1]))


def createScene(root):
    root.dt = 0.001
    root.gravity = [0, 0, 0]
    for plugin in ("Component.ODESolver.Backward", "Component.LinearSolver.Iterative", "Component.StateContainer",
                   "Component.Mass", "Component.SolidMechanics.Spring"):
        root.addObject("RequiredPlugin", name="Sofa." + plugin)
    root.addObject("DefaultAnimationLoop")
    first, (stiffness, angular) = at(PRESSURES[0])
    rest = root.addChild("rest").addObject("MechanicalObject", template="Rigid3d", name="rest", position=[first])
    tip = root.addChild("tip")
    tip.addObject("EulerImplicitSolver", rayleighStiffness=0.01)
    tip.addObject("CGLinearSolver", iterations=25, tolerance=1e-9, threshold=1e-9)
    tip.addObject("MechanicalObject", template="Rigid3d", name="tip", position=[first], showObject=True,
                  showObjectScale={size:.6g})
    tip.addObject("UniformMass", totalMass={mass:.6g})
    springs = tip.addObject("RestShapeSpringsForceField", stiffness=[stiffness], angularStiffness=[angular],
                            external_rest_shape=rest.getLinkPath(), points=[0], external_points=[0])
    root.addObject(Pressure(name="pressure", rest=rest, springs=springs))
    return root
'''
ROWS = 101
"""Rows of the table in a scene, which is linear in between."""


def sofa_scene(model: ReducedModel) -> str:
    """Return a scene for SOFA."""
    low, high = model.span
    pressures = np.linspace(low, high, ROWS)
    poses, stiffness = [], []
    for pressure in pressures:
        one = model(float(pressure))
        w, *vector = one.quaternion.tolist()
        poses.append([*(float(f"{x:.9g}") for x in one.position), *(float(f"{x:.9g}") for x in (*vector, w))])
        C = one.compliance
        stiffness.append([float(f"{_mean_stiffness(np.diag(C)[part]):.6g}") for part in (slice(0, 3), slice(3, 6))])
    return SOFA.format(
        written=WRITTEN, name=model.case.name, file="SCENE.py", low=low / 1e3, high=high / 1e3,
        pressures=[float(f"{x / 1e3:.9g}") for x in pressures], poses=poses, stiffness=stiffness, count=ROWS,
        size=0.2 * model.length, mass=model.case.actuator.solid_volume * model.density / 3,
    )  # fmt: skip


def _mean_stiffness(compliances: Array) -> float:
    """Return one over the mean of the known compliances; stiff where none is known."""
    known = compliances[np.isfinite(compliances) & (compliances > 0.0)]
    return float(1 / known.mean()) if known.size else 1e6


# ----------------------------------------------------------------------------------------------------------------------
# A unit for co-simulation (FMI 2.0, by pythonfmu): the interpolant, and loads on the tip by its compliance.


EXTRA = "fmu"
"""The extra of this project that brings pythonfmu."""
MODULE = "softmodels_slave"
SLAVE = '''"""{written}: {name}.

The tip in equilibrium with the pressure in the cavity, and with force and moment on it to first order; SI units.
Pressures from {low:.6g} to {high:.6g} Pa; beyond them the ends of the table. Plain Python.
"""

import bisect
import json
import math
import pathlib
from xml.etree import ElementTree

from pythonfmu import Fmi2Causality, Fmi2Slave, Real
from pythonfmu.enums import Fmi2Status

INPUTS = ("pressure_Pa", "force_x_N", "force_y_N", "force_z_N", "moment_x_Nm", "moment_y_Nm", "moment_z_Nm")
OUTPUTS = ("tip_x_m", "tip_y_m", "tip_z_m", "tip_qw_1", "tip_qx_1", "tip_qy_1", "tip_qz_1", "added_volume_m3")


def product(a, b):
    """Product of two quaternions, w first."""
    return [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]


def quaternion(turn):
    """Quaternion of a rotation vector."""
    angle = math.sqrt(sum(x * x for x in turn))
    share = math.sin(angle / 2) / angle if angle > 1e-9 else 0.5
    return [math.cos(angle / 2), *(share * x for x in turn)]


class Tip(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.modelName, self.description = "{identifier}", "{written}: {name}"
        table = json.loads((pathlib.Path(__file__).parent / "table.json").read_text())
        self.pressures, self.values, self.slopes = table["pressures"], table["values"], table["slopes"]
        for name in INPUTS:
            setattr(self, name, 0.0)
            self.register_variable(Real(name, causality=Fmi2Causality.input, start=0.0))
        for name in OUTPUTS:
            setattr(self, name, 0.0)
            self.register_variable(Real(name, causality=Fmi2Causality.output))
        self.update()

    def to_xml(self, *options):
        """Description of the model, with the outputs as what follows from its start."""
        root = super().to_xml(*options)
        structure = root.find("ModelStructure")
        ElementTree.SubElement(structure, "InitialUnknowns").extend(structure.find("Outputs"))
        return root

    def at(self, pressure):
        """Cubic Hermite interpolant of the table."""
        x, k = self.pressures, min(max(bisect.bisect(self.pressures, pressure), 1), len(self.pressures) - 1)
        h = x[k] - x[k - 1]
        t = (pressure - x[k - 1]) / h
        a, b, c, d = (1 + 2 * t) * (1 - t) ** 2, t * (1 - t) ** 2 * h, t * t * (3 - 2 * t), t * t * (t - 1) * h
        rows = zip(self.values[k - 1], self.slopes[k - 1], self.values[k], self.slopes[k])
        return [a * y + b * dy + c * z + d * dz for y, dy, z, dz in rows]

    def update(self):
        within = min(max(self.pressure_Pa, self.pressures[0]), self.pressures[-1])
        found, loads = self.at(within), [getattr(self, name) for name in INPUTS[1:]]
        place, turn, volume, rate, C = found[:3], found[3:6], found[6], found[7:13], found[13:]
        moved = [sum(C[6 * i + j] * loads[j] for j in range(6)) for i in range(6)]
        pose = [place[i] + moved[i] for i in range(3)] + product(quaternion(moved[3:]), quaternion(turn))
        for name, value in zip(OUTPUTS, [*pose, volume + sum(r * load for r, load in zip(rate, loads))]):
            setattr(self, name, value)
        return within == self.pressure_Pa

    def exit_initialization_mode(self):
        self.update()

    def do_step(self, current_time, step_size):
        if not self.update():
            self.log("the pressure is outside the table", Fmi2Status.warning)
        return True
'''


def fmu(model: ReducedModel) -> bytes:
    """Return a unit for co-simulation; loads in directions of unknown compliance do not move it."""
    from pythonfmu import FmuBuilder

    low, high = model.span
    identifier = re.sub(r"\W", "_", f"softmodels_{model.case.name}")
    text = SLAVE.format(written=WRITTEN, name=model.case.name, identifier=identifier, low=low, high=high)
    before = list(sys.path)
    with tempfile.TemporaryDirectory() as name:
        script, table, made = (Path(name) / file for file in (f"{MODULE}.py", "table.json", "made.fmu"))
        script.write_text(text, encoding="utf-8")
        table.write_text(json.dumps(model.knots()))
        try:
            FmuBuilder.build_FMU(script, made, project_files=[table])
        finally:
            sys.path[:] = before
            sys.modules.pop(MODULE, None)
        return made.read_bytes()


# ----------------------------------------------------------------------------------------------------------------------
# Which file is which.


WRITERS: dict[str, Callable[[ReducedModel], str | bytes]] = {
    "csv": table_csv, "json": table_json, "mjcf": mjcf, "sofa": sofa_scene, "fonsim": fonsim_csv, "fmu": fmu,
}  # fmt: skip
ENDINGS = {".csv": "csv", ".json": "json", ".xml": "mjcf", ".py": "sofa", ".fmu": "fmu"}
"""What a file is by its ending; FONSim's is named, as it is CSV too."""


def write(model: ReducedModel, file: Path, kind: str = "") -> Path:
    """Write a reduced model for another program, as one of `WRITERS`; by the file's ending if the kind is empty.

    Raises:
        CaseError: Another kind or ending, or a file that this program has not written.
        RunError, ImportError: The model cannot be written as that, or what writes it is not installed.
    """
    made = WRITERS[kind_of(file, kind)](model)
    write_bytes(file, made if isinstance(made, bytes) else made.encode())
    return file


def is_own(file: Path) -> bool:
    """Return whether a file is a reduced model of this program, which may be replaced."""
    try:
        content = read_file(file)
    except OSError:
        return False
    if content.startswith(b"PK"):
        return f"resources/{MODULE}.py".encode() in content
    head = content[:4000].decode(errors="replace")
    return WRITTEN in head or head.startswith(("pressure_Pa,", "volume,pressure\nml,kPa\n"))


def kind_of(file: Path, kind: str = "") -> str:
    """Return the kind of a file; `CaseError` or `ImportError` as `write`."""
    chosen = kind or ENDINGS.get(file.suffix.lower(), "")
    if kind and kind not in WRITERS:
        raise CaseError(f"as {kind!r} no reduced model is written; {known_are(kind, WRITERS)}")
    if not chosen:
        named = ", ".join(f"{ending} ({name})" for ending, name in ENDINGS.items())
        raise CaseError(f"{file} has no ending of a reduced model; take {named}, or name the kind (kind=..., --as)")
    if file.is_dir():
        raise CaseError(f"{file} is a folder; name a file")
    if chosen == "fmu":
        required("pythonfmu", EXTRA)
    return chosen


__all__ = ["WRITERS", "Chain", "chain_of", "is_own", "kind_of", "write"]
