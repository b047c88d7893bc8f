"""A reduced model in the words of other programs: tables, a MuJoCo model, an FMU."""

from __future__ import annotations

import csv
import dataclasses
import hashlib
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

from geometries import actuator
from softmodels.case.entries import CaseError
from softmodels.common import errors, files
from softmodels.common.arrays import Array
from softmodels.components.loads import Gravity
from softmodels.decks import deck, reduction
from softmodels.decks.reduction import ReducedModel
from softmodels.runs.outcomes import RunError

__all__ = ["WRITERS", "Chain", "chain_of", "is_own", "kind_of", "write"]


DRIVERS = ("bend", "uneven", "extension", "lean", "uneven_lean", "twisting")
JOINT_VARIABLES = {
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
        advances: Coefficients of each of `ADVANCES` over the one before, the first over the pressure's share of ``top``, shape
            (3, 5).
        quartics: The numbers (rad and m) over the advance: five coefficients each, shape (3, 5), or (6, 5) where the tip leaves
            the plane.
        top: The highest pressure, Pa.
        stiffness: Of one joint of each kind, N m/rad and N/m; 0 where it is not known, or there is none.
        error: Largest distance of the tip from the table's over the length, and angle in degrees.
    """

    base: Array
    axes: Array
    length: float
    advances: Array
    quartics: Array
    top: float
    stiffness: dict[str, float]
    error: tuple[float, float] = (0.0, 0.0)

    def follows(self, kind: str) -> bool:
        """Return whether joints of a kind follow the pressure, and not only yield to loads."""
        return self.stiffness[kind] > 0.0 and DRIVERS.index(JOINT_VARIABLES[kind][0]) < len(self.quartics)


DEFAULT_SEGMENTS = 8
MOST_TURN = math.radians(0.5)
"""Rotation up to which a device only extends."""
PLANE_TOLERANCE = 0.02
"""Distance of the tip from the plane of bending, in lengths, up to which a chain stays in it."""
TIME_CONSTANT = 0.01
"""Time constant in s of the pressure behind its command."""
DAMPING_TIME = 0.01
"""Damping of a joint over its spring's stiffness, s."""
DRIVER_MASS = 1e-7
"""Mass of a driver in masses of the device."""
DRIVER_INERTIA = 1e-6
"""Moment of inertia of a driver in masses of the device times its length squared."""
DRIVER_TURN = 1000.0
"""Angle by which drivers turn over the range, rad."""
ADVANCES = ("onset", "rise", "advance")
"""What follows from the pressure, each from the one before, by a quartic from 0 at 0 to 1 at 1."""
FIT_SAMPLES = 61
"""Pressures at which a chain is fitted to the table's curves, beside the table's own."""


def reached(numbers: Array, length: float) -> tuple[Array, Array]:
    """Return place (m) and rotation of the end of a chain by its numbers, along its axes at rest."""
    bend, uneven, extension, lean, uneven_lean, twist = np.append(numbers, np.zeros(len(DRIVERS) - len(numbers)))
    link, along = length / DEFAULT_SEGMENTS, np.arange(DEFAULT_SEGMENTS) - (DEFAULT_SEGMENTS - 1) / 2
    angles = [
        bend / DEFAULT_SEGMENTS + uneven * along,
        lean / DEFAULT_SEGMENTS + uneven_lean * along,
        np.full(DEFAULT_SEGMENTS, twist / DEFAULT_SEGMENTS),
    ]
    place, R = np.array([link / 2, 0.0, 0.0]), np.eye(3)
    for k, joint in enumerate(Rotation.from_euler("ZYX", np.transpose(angles)).as_matrix()):
        R = R @ joint
        place += (link * (0.5 if k == DEFAULT_SEGMENTS - 1 else 1.0) + extension / DEFAULT_SEGMENTS) * R[:, 0]
    return place, R


def _tip_error(numbers: Array, place: Array, R: Array, length: float) -> Array:
    """Return how far the end of a chain is from a pose, in lengths and radians."""
    at, turned = reached(numbers, length)
    return np.concatenate([(at - place) / length, Rotation.from_matrix(R.T @ turned).as_rotvec()])


def chain_of(model: ReducedModel) -> Chain:
    """Return the chain that follows a reduced model; `RunError` if the tip's stiffness is not known in a direction in which it
    moves."""
    along = (model.states[0].position - model.base) / model.length
    turn = model.turns[-1]
    hinges = float(np.linalg.norm(turn)) > MOST_TURN
    normal = turn / np.linalg.norm(turn) if hinges else reduction.across(along)[1]
    normal = normal - (normal @ along) * along
    normal /= np.linalg.norm(normal)
    axes = np.column_stack([along, np.cross(normal, along), normal])
    top = float(model.pressures[np.argmax(np.abs(model.pressures))])
    shares = model.pressures / top
    sampled = np.union1d(shares, np.linspace(shares.min(), 1.0, FIT_SAMPLES))
    poses = [model(share * top) for share in sampled]
    places = np.array([pose.position - model.base for pose in poses]) @ axes
    turned = [axes.T @ pose.rotation @ axes for pose in poses]
    out = float(np.abs(places[:, 2]).max())
    stiffness = _stiffness(model, axes, hinges)
    if out > PLANE_TOLERANCE * model.length and not (stiffness["side"] and stiffness["twist"]):
        raise RunError(
            f"the tip leaves the plane of bending by {1e3 * out:.3g} mm, and its stiffness across that is not known; reduce a "
            f"model of the whole device, or write a table (.csv, .json)"
        )
    count, links = 6 if out > PLANE_TOLERANCE * model.length else 3, []
    for place, R, angle in zip(places, turned, np.interp(sampled, shares, model.turns @ normal), strict=True):
        if not hinges:
            links.append([0.0, 0.0, place[0] - model.length])
            continue
        # Away from zero: the derivatives are by differences in proportion.
        guess = [angle + 0.01, 0.01, float(np.linalg.norm(place)) - 0.99 * model.length, 0.01, 0.01, 0.01][:count]
        solved = least_squares(_tip_error, guess, xtol=1e-14, gtol=1e-14, args=(place, R, model.length))
        links.append(solved.x)
    advances, quartics = _fitted_coefficients(sampled, np.array(links))
    misses = np.array([
        _tip_error(quartics @ at ** np.arange(5), place, R, model.length)
        for at, place, R in zip(_advance(advances, sampled), places, turned, strict=True)
    ])  # fmt: skip
    angles = np.linalg.norm(misses[:, 3:], axis=1) * hinges
    error = float(np.linalg.norm(misses[:, :3], axis=1).max()), math.degrees(float(angles.max()))
    return Chain(model.base, axes, model.length, advances, quartics, top, stiffness, error)


def _advance(advances: Array, shares: Array) -> Array:
    """Return the advance at shares of the highest pressure."""
    for coefficients in advances:
        shares = np.polynomial.Polynomial(coefficients)(shares)
    return shares


def _fitted_coefficients(shares: Array, numbers: Array) -> tuple[Array, Array]:
    """Return coefficients of the advances, shape (3, 5), and of the numbers over the last of them, shape (numbers, 5), that fit
    the numbers (in columns) best, each by its size."""
    powers = np.arange(1 if abs(shares[0]) < 1e-9 else 0, 5)
    scaled = numbers / np.maximum(np.abs(numbers).max(axis=0), reduction.ZERO_LOAD_TOLERANCE)

    def advances(inner: Array) -> Array:
        a, b, c = inner.reshape(-1, 3).T  # x + x (x - 1) (a + b x + c x^2)
        return np.column_stack([0.0 * a, 1.0 - a, a - b, b - c, c])

    def solved(inner: Array, of: Array) -> tuple[Array, Array]:
        terms = _advance(advances(inner), shares)[:, None] ** powers
        coefficients = np.linalg.lstsq(terms, of, rcond=None)[0]
        return coefficients, (terms @ coefficients - of).ravel()

    inner = least_squares(lambda inner: solved(inner, scaled)[1], np.zeros(3 * len(ADVANCES))).x
    quartics = np.zeros((numbers.shape[1], 5))
    quartics[:, powers] = solved(inner, numbers)[0].T
    return advances(inner), quartics


def _stiffness(model: ReducedModel, axes: Array, hinges: bool) -> dict[str, float]:
    """Return the stiffness of one joint of each kind: of rotations in the middle of the range, of extension at rest."""
    turning = np.nan_to_num(model((model.span[0] + model.span[1]) / 2).compliance[3:, 3:])
    twisting, aside, bending = (float(e @ turning @ e) for e in axes.T)
    stretching = float(axes[:, 0] @ np.nan_to_num(model.states[0].compliance[:3, :3]) @ axes[:, 0])
    if stretching <= 0.0 or (hinges and bending <= 0.0):
        raise RunError("the stiffness of the tip is not known in the plane of bending; reduce a model of the whole device")
    known = reduction.ZERO_LOAD_TOLERANCE * max(bending, aside, twisting)
    soft = {"hinge": bending * hinges, "side": aside, "twist": twisting}
    return {
        "slide": DEFAULT_SEGMENTS / stretching,
        **{kind: DEFAULT_SEGMENTS / C if known < C else 0.0 for kind, C in soft.items()},
    }


def mjcf(model: ReducedModel) -> str:
    """Return a chain as MJCF: ``ctrl`` is the pressure in kPa; the site ``tip`` has the tip's pose."""
    chain, link = chain_of(model), model.length / DEFAULT_SEGMENTS
    mass = model.mass / (DEFAULT_SEGMENTS + 1)
    # A weight that is in the table must not act once more in a scene with gravity.
    links = {"gravcomp": "1"} if any(isinstance(part, Gravity) for part in model.case.components) else {}
    root = ElementTree.Element("mujoco", model=model.case.name)
    text = f" {deck.WRITTEN_BY}: {model.case.name}, {model.span[0] / 1e3:.4g} to {model.span[1] / 1e3:.4g} kPa; tip within " \
           f"{100 * chain.error[0]:.2g} % of the length and {chain.error[1]:.2g} degrees of the table "  # fmt: skip
    root.append(ElementTree.Comment(text))
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="true")
    ElementTree.SubElement(root, "option", timestep="0.001", integrator="implicitfast", gravity="0 0 0")
    world = ElementTree.SubElement(root, "worldbody")
    quaternion = Rotation.from_matrix(chain.axes).as_quat(canonical=True, scalar_first=True)
    body = ElementTree.SubElement(world, "body", links, name="base", pos=_words(chain.base), quat=_words(quaternion))
    _drivers(body, model, len(chain.quartics))
    radius = 0.12 * model.length
    _link(body, link / 2, radius, mass)
    for k in range(DEFAULT_SEGMENTS):
        long = link * (0.5 if k == DEFAULT_SEGMENTS - 1 else 1.0)
        place = _words([link / 2 if k == 0 else link, 0, 0])
        body = ElementTree.SubElement(body, "body", links, name=f"link{k}", pos=place)
        for kind, axis in (("hinge", "0 0 1"), ("side", "0 1 0"), ("twist", "1 0 0")):
            if chain.stiffness[kind]:
                _joint(body, chain, kind, k, type="hinge", axis=axis, armature="1e-7")
        _joint(body, chain, "slide", k, type="slide", axis="1 0 0", armature="1e-4")
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
        gainprm=_words([1 / TIME_CONSTANT**2 / top]), biasprm=_words([0, -1 / TIME_CONSTANT**2, -2 / TIME_CONSTANT]),
    )  # fmt: skip
    ElementTree.indent(root, " ")
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _drivers(base: ElementTree.Element, model: ReducedModel, count: int) -> None:
    """Add the joints of the pressure, of the advances and of the numbers."""
    mass, inertia = DRIVER_MASS * model.mass, DRIVER_INERTIA * model.mass * model.length**2
    for name in ("pressure", *ADVANCES, *DRIVERS[:count]):
        body = ElementTree.SubElement(base, "body", name=name)
        armature = {"armature": "1"} if name == "pressure" else {}
        ElementTree.SubElement(body, "inertial", pos="0 0 0", mass=f"{mass:.9g}", diaginertia=_words([inertia] * 3))
        ElementTree.SubElement(body, "joint", armature, name=name, type="hinge", axis="1 0 0")


def _joint(body: ElementTree.Element, chain: Chain, kind: str, k: int, **more: str) -> None:
    """Add a joint of the chain. Its damping is the joint's even where a tendon is the spring: all integrators of MuJoCo take
    that of joints implicitly."""
    stiffness = chain.stiffness[kind]
    spring = {} if chain.follows(kind) else {"stiffness": f"{stiffness:.9g}"}
    ElementTree.SubElement(body, "joint", spring | more, name=f"{kind}{k}", damping=f"{DAMPING_TIME * stiffness:.9g}")


def _link(body: ElementTree.Element, length: float, radius: float, mass: float) -> None:
    ElementTree.SubElement(
        body, "geom", type="capsule", fromto=_words([0, 0, 0, length, 0, 0]), size=f"{radius:.6g}", mass=f"{mass:.9g}",
        rgba="0.18 0.44 0.62 1", contype="0", conaffinity="0",
    )  # fmt: skip


def _springs(root: ElementTree.Element, chain: Chain) -> None:
    """Add the springs of the chain, and tie the numbers to the last of the advances, and the first to the pressure."""
    tendon, equality = ElementTree.SubElement(root, "tendon"), ElementTree.SubElement(root, "equality")
    largest = np.abs(chain.quartics @ np.linspace(0.0, 1.0, FIT_SAMPLES) ** np.arange(5)[:, None]).max(axis=1)
    per_turn = np.where(largest > 0.0, largest, 1.0) / DRIVER_TURN
    numbers = dict(zip(DRIVERS, per_turn, strict=False))
    for kind in filter(chain.follows, JOINT_VARIABLES):
        first, second = JOINT_VARIABLES[kind]
        for k in range(DEFAULT_SEGMENTS):
            stiffness = f"{chain.stiffness[kind]:.9g}"
            spring = ElementTree.SubElement(tendon, "fixed", name=f"{kind}_spring{k}", springlength="0", stiffness=stiffness)
            ElementTree.SubElement(spring, "joint", joint=f"{kind}{k}", coef="1")
            for name, factor in (first, -1 / DEFAULT_SEGMENTS), (second, (DEFAULT_SEGMENTS - 1) / 2 - k):
                if name:
                    ElementTree.SubElement(spring, "joint", joint=name, coef=f"{factor * numbers[name]:.9g}")
    of_turn = DRIVER_TURN ** -np.arange(5.0)
    first, *others = DRIVER_TURN * chain.advances
    ties = [(ADVANCES[0], "pressure", first), *zip(ADVANCES[1:], ADVANCES, [other * of_turn for other in others], strict=False)]
    for name, quartic in zip(numbers, chain.quartics, strict=True):
        ties.append((name, ADVANCES[-1], quartic * of_turn / numbers[name]))
    for name, of, quartic in ties:
        ElementTree.SubElement(
            equality, "joint", joint1=name, joint2=of, polycoef=_words(quartic), solref="0.002 1", solimp="0.999 0.9999 0.001"
        )


def _words(values: Iterable[float]) -> str:
    return " ".join(f"{value:.9g}" for value in values)


MOTIONS = (*actuator.AXES, *(f"turn_{axis}" for axis in actuator.AXES))
LOADS = (*(f"f{axis}" for axis in actuator.AXES), *(f"m{axis}" for axis in actuator.AXES))


# ----------------------------------------------------------------------------------------------------------------------
# Tables: units in the heads of the columns, or beside the values.


def columns(model: ReducedModel) -> dict[str, Callable[[reduction.TipState], float]]:
    """Return the columns of the table by their heads, which end in the unit."""
    columns: dict[str, Callable[[reduction.TipState], float]] = {"pressure_Pa": lambda state: state.pressure}
    device = model.case.actuator
    for k, ratio in enumerate(device.ratios, 1):
        if len(device.ratios) > 1:
            columns[f"pressure_cavity{k}_Pa"] = lambda state, ratio=ratio: ratio * state.pressure  # type: ignore[misc]
    columns |= {f"tip_{axis}_m": lambda state, i=i: state.position[i] for i, axis in enumerate(actuator.AXES)}  # type: ignore[misc]
    columns |= {f"tip_q{axis}_1": lambda state, i=i: float(_quaternion(state)[i]) for i, axis in enumerate("wxyz")}  # type: ignore[misc]
    columns |= {"added_volume_m3": lambda state: state.volume, "volume_rate_m3_per_Pa": lambda state: state.volume_rate}
    for i, motion in enumerate(MOTIONS):
        unit = "m" if i < 3 else "rad"
        for k in range(len(device.ratios)):
            head = f"rate_{motion}_by_cavity{k + 1}_{unit}_per_Pa" if len(device.ratios) > 1 else f"rate_{motion}_{unit}_per_Pa"
            columns[head] = lambda state, i=i, k=k: state.jacobian[i, k]  # type: ignore[misc]
    for i, motion in enumerate(MOTIONS):
        for j, load in enumerate(LOADS[: i + 1]):
            unit = f"{'m' if i < 3 else 'rad'}_per_{'N' if j < 3 else 'Nm'}"
            columns[f"compliance_{motion}_{load}_{unit}"] = lambda state, i=i, j=j: state.compliance[i, j]  # type: ignore[misc]
    for i, load in enumerate(LOADS):
        unit = "N_per_Pa" if i < 3 else "Nm_per_Pa"
        columns[f"blocked_{load}_{unit}"] = lambda state, i=i: model.blocked(state)[i]  # type: ignore[misc,assignment]
    columns["effective_area_m2"] = model.effective_area
    for i, name in enumerate(("curvature_per_m", "arc_length_m", "bending_direction_rad")):
        columns[name] = lambda state, i=i: model.constant_curvature(state)[i]  # type: ignore[misc]
    columns["max_stretch_1"] = lambda state: state.stretch
    if np.isfinite(model.states[-1].spread).all():
        heads = [
            *(f"tip_{axis}_ci95_m" for axis in actuator.AXES),
            *(f"turn_{axis}_ci95_rad" for axis in actuator.AXES),
            "added_volume_ci95_m3",
        ]
        columns |= {head: lambda state, i=i: state.spread[i] for i, head in enumerate(heads)}  # type: ignore[misc]
    return columns


def _quaternion(state: reduction.TipState) -> Array:
    return np.asarray(Rotation.from_matrix(state.rotation).as_quat(canonical=True, scalar_first=True))


def table_csv(model: ReducedModel) -> str:
    """Return the table as CSV; empty cells where a value is not known."""
    out = io.StringIO(newline="")
    writer = csv.writer(out, lineterminator="\n")
    known = columns(model)
    writer.writerow(known)
    for state in model.states:
        values = [float(read(state)) for read in known.values()]
        writer.writerow([f"{value:.12g}" if math.isfinite(value) else "" for value in values])
    return out.getvalue()


def table_json(model: ReducedModel) -> str:
    """Return the table as JSON, with what it is of, where it ends and its errors in between."""
    known, low_high = columns(model), model.span
    rows = {head: [files.json_number(float(read(state))) for state in model.states] for head, read in known.items()}
    about = {
        "written_by": deck.WRITTEN_BY, "case": model.case.name, "device": type(model.case.actuator).__name__, "tip": model.face,
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


# ----------------------------------------------------------------------------------------------------------------------
# A unit for co-simulation (FMI 2.0, by pythonfmu): the interpolant, and loads on the tip by its compliance.


EXTRA = "fmu"
"""The extra of this project that brings pythonfmu."""
PROGRAM = Path(__file__).with_name("tip_unit.py")


def fmu(model: ReducedModel) -> bytes:
    """Return a unit for co-simulation; loads in directions of unknown compliance do not move it."""
    from pythonfmu import FmuBuilder

    low, high = model.span
    program = PROGRAM.read_bytes()
    text = f"{deck.WRITTEN_BY}: the tip of {model.case.name}, {low:.6g} to {high:.6g} Pa; SI units"
    table = {"description": text, **model.knots()}
    # Units of one name in a process would share a module, so the name follows from what the unit holds.
    digest = hashlib.sha256(program + json.dumps(table).encode()).hexdigest()[:12]
    name = re.sub(r"[^A-Za-z0-9_]", "_", f"softmodels_{model.case.name[:40]}_{digest}")
    before = list(sys.path)
    with tempfile.TemporaryDirectory() as folder:
        script, data, made = (Path(folder) / file for file in (f"{name}.py", "table.json", "made.fmu"))
        script.write_bytes(program)
        data.write_text(json.dumps({"identifier": name, **table}), encoding="utf-8")
        try:
            FmuBuilder.build_FMU(script, made, project_files=[data])
        finally:
            sys.path[:] = before
            sys.modules.pop(name, None)
        return made.read_bytes()


# ----------------------------------------------------------------------------------------------------------------------
# Which file is which.


WRITERS: dict[str, Callable[[ReducedModel], str | bytes]] = {"csv": table_csv, "json": table_json, "mjcf": mjcf, "fmu": fmu}
ENDINGS = {".csv": "csv", ".json": "json", ".xml": "mjcf", ".fmu": "fmu"}
"""What a file is by its ending."""


def write(model: ReducedModel, file: Path, kind: str = "") -> Path:
    """Write a reduced model for another program, as one of `WRITERS`; by the file's ending if the kind is empty.

    Raises:
        CaseError: Another kind or ending, or a file that this program has not written.
        RunError, ImportError: The model cannot be written as that, or what writes it is not installed.
    """
    made = WRITERS[kind_of(file, kind)](model)
    files.write_bytes(file, made if isinstance(made, bytes) else made.encode())
    return file


def is_own(file: Path) -> bool:
    """Return whether a file is a reduced model of this program, which may be replaced."""
    try:
        content = files.read_file(file)
    except OSError:
        return False
    if content.startswith(b"PK"):
        return re.search(rb"resources/softmodels_\w+\.py", content) is not None
    head = content[:4000].decode(errors="replace")
    return deck.WRITTEN_BY in head or head.startswith("pressure_Pa,")


def kind_of(file: Path, kind: str = "") -> str:
    """Return the kind of a file; `CaseError` or `ImportError` as `write`."""
    chosen = kind or ENDINGS.get(file.suffix.lower(), "")
    if kind and kind not in WRITERS:
        raise CaseError(f"as {kind!r} no reduced model is written; {errors.known_are(kind, WRITERS)}")
    if not chosen:
        named = ", ".join(f"{ending} ({name})" for ending, name in ENDINGS.items())
        raise CaseError(f"{file} has no ending of a reduced model; take {named}, or name the kind (kind=..., --as)")
    if file.is_dir():
        raise CaseError(f"{file} is a folder; name a file")
    if chosen == "fmu":
        errors.required("pythonfmu", EXTRA)
    return chosen
