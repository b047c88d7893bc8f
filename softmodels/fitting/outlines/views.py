"""Side views of a device in a fit: place and angle of its tip in each photograph against the state of its face ``tip``.

A picture shows the plane in which the device moves, from either side, and turned by the bench's ``tilt``. Of a tip in the
plane, x, z from the middle of the face ``support`` and turned by the angle a from its normal at rest,

    place measured = (centre, zero) + (1 + scale) T (x or -x, z),    angle measured = tilt + a or tilt + pi - a

where T turns by the tilt. Pressures are those of outlines (`residuals`), and so are the hidden volumes of the photographs under
pressure; those without one show the device as it hangs.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.interpolate import PchipInterpolator

from geometries.actuator import ENDS
from measurement.outline.outline import History
from measurement.outline.silhouette import FACE_SHARE
from measurement.series.views import VIEW_COLUMNS
from softmodels.common import tables, units
from softmodels.common.arrays import Array
from softmodels.common.errors import reason
from softmodels.common.names import keep_arrays
from softmodels.fitting import problem
from softmodels.fitting.outlines import device, residuals, shapes
from softmodels.fitting.outlines.shapes import OutlineFitError, Shape, kept
from softmodels.mechanics import newton, sensitivity
from softmodels.mechanics.system import State, System
from softmodels.path import continuation, stability
from softmodels.runs import state_values


@dataclasses.dataclass(frozen=True, eq=False)
class SideView:
    """A tip seen from the side: place (2,) in m from the middle of the base, x to the right and z upwards, the angle in rad in
    which its face looks, from x to z, and their standard errors; pressure and its standard error in Pa, and what speaks against
    it."""

    source: str
    pressure: float
    pressure_error: float
    tip: Array
    tip_error: Array
    angle: float
    angle_error: float
    reasons: tuple[str, ...] = ()
    history: History = ()

    def __post_init__(self) -> None:
        keep_arrays(self)


TABLE = "views.csv"


def is_table(file: object) -> bool:
    """Return whether a file is a table of side views, or a folder with one."""
    if not isinstance(file, Path | str):
        return isinstance(file, SideView)
    path = Path(file)
    if path.is_dir():
        return (path / TABLE).exists()
    try:
        with path.open(encoding="utf-8", errors="replace") as lines:
            return {"tip_x_m", "tip_z_m", "angle_deg"} <= {name.strip() for name in lines.readline().split(",")}
    except OSError:
        return False


def seen_in(given: object) -> type[shapes.Silhouette]:
    """Return what photographs show of a device: its tip where one of them is a side view, or a table of these."""
    several = given if isinstance(given, Sequence) and not isinstance(given, str) else [given]
    return TipFace if any(map(is_table, several)) else shapes.Silhouette


def read_views(file: Path, untrusted: bool = False, exclude: Sequence[str] = ()) -> list[SideView]:
    """Read the ``views.csv`` that ``softmodels measure view`` writes, or that of its folder; rejected and excluded photographs
    are left out. `OutlineFitError` for a number that is none, or a view that is not trusted, unless ``untrusted``."""
    path = file / TABLE if file.is_dir() else file
    try:
        chosen = tables.pick(path, tables.read_sheets(path), lambda sheet: sheet.rows if _is_views(sheet.rows) else None)
    except OSError as error:
        raise OutlineFitError(f"{path} cannot be read: {reason(error)}") from None
    if chosen is None or len(chosen[1]) < 2:
        raise OutlineFitError(f"{path} is not a table of side views; make it with softmodels measure view")
    sheet, rows, views = chosen[0], tables.records(chosen[1]), list[SideView]()
    for place in kept([(row.get("file") or sheet.place(line), None) for line, row in rows], exclude):
        line, row = rows[place]
        trusted, remarks = (row.get("trusted") or "yes").strip(), row.get("remarks") or "no reason given"
        if trusted == "refused":
            continue
        if trusted not in ("yes", "anyway") and not untrusted:
            raise OutlineFitError(
                f"{path}, {sheet.place(line)}: this view is untrusted ({remarks}); exclude it, or use it with --untrusted"
            )
        try:
            p, p_error, x, x_error, z, z_error, angle, angle_error = (units.number(row[name]) for name in VIEW_COLUMNS[1:9])
        except units.UnitError as error:
            raise OutlineFitError(f"{path}, {sheet.place(line)}: {error}") from None
        views.append(
            SideView(
                row.get("file") or sheet.place(line), p, p_error, np.array([x, z]), np.array([x_error, z_error]),
                math.radians(angle), math.radians(angle_error), () if trusted == "yes" else (remarks,),
            )
        )  # fmt: skip
    return views


def _is_views(rows: Sequence[tables.Line]) -> bool:
    return bool(rows) and set(VIEW_COLUMNS[1:9]) <= {name.strip() for name in rows[0][1]}


@dataclasses.dataclass(frozen=True, eq=False)
class ViewShape(shapes.Shape):
    """A side view prepared for the fit: its one point is the tip, ``error`` (3,) that of x, z and the angle times ``arm``, all
    in m. ``height`` is the longest way in m that a tip moved in any of the views.

    Attributes:
        angle: Of the tip in rad.
        arm: Length of the device in m, by which angles are multiplied.
        resting: Whether the photograph shows the device without pressure.
    """

    angle: float = 0.0
    arm: float = 1.0
    resting: bool = False


MAX_LENGTH_CHANGE = 0.25
"""Difference between the tip's distances from the base without pressure, measured and of the case, over the latter, beyond
which the photographs show something else."""


def prepare(views: Sequence[SideView], model: device.DeviceModel) -> tuple[list[ViewShape], list[str]]:
    """Check side views, and return their shapes by rising pressure, and a sentence on each that is left out; `OutlineFitError`
    for what cannot be fitted."""
    shapes.check_readings(views)
    sucked = [view for view in views if view.pressure < -view.pressure_error]
    notes = [f"{view.source}: below the pressure of the room; photograph not used" for view in sucked]
    chosen = sorted((view for view in views if view not in sucked), key=lambda view: view.pressure)
    if not chosen or chosen[-1].pressure <= chosen[-1].pressure_error:
        raise OutlineFitError("no side view shows the device under pressure; give at least one")
    arm, first = model.silhouette.width, chosen[0]
    resting = [view for view in chosen if view.pressure <= view.pressure_error]
    for view in resting:
        far = float(np.linalg.norm(view.tip))
        if abs(far / arm - 1.0) > MAX_LENGTH_CHANGE and not model.loaded:
            raise OutlineFitError(
                f"{view.source}: without pressure the tip is {far * 1e3:.4g} mm from the middle of the base, and "
                f"{arm * 1e3:.4g} mm in the case; check --base and the scale of the photographs, and the case's device"
            )
    moved = max(
        math.hypot(float(np.linalg.norm(view.tip - first.tip)), arm * abs(_turned(view.angle - first.angle))) for view in chosen
    )
    prepared = [
        ViewShape(
            view.source, view.tip[None], np.r_[view.tip_error, arm * view.angle_error], np.arange(3), np.ones(3), view.pressure,
            view.pressure_error, moved, 0.0, level_error=BASE_ERROR, angle=view.angle, arm=arm, resting=view in resting,
        )
        for view in chosen
    ]  # fmt: skip
    return prepared, notes


BASE_ERROR = 0.5e-3
"""Prior of where the middle of the face ``support`` is in the pictures, in m: pixels of --base are chosen by eye."""


def _turned(angle: float) -> float:
    """Return an angle in rad from -pi to pi."""
    return math.remainder(angle, math.tau)


# ----------------------------------------------------------------------------------------------------------------------
# The tip of a simulated device, as side views show it.


SUPPORT = "support"

END_TOLERANCE = 1e-6
"""Distance of a corner from an end of its face, as a share of the face's height, up to which it is the end."""


class TipFace(shapes.Silhouette):
    """The corners of the face ``tip`` of a body, in the plane in which it moves, from the middle of the face ``support``.
    Raises `OutlineFitError` for a section, or without these faces.

    The plane is the mirror plane of a half, and else that of x and z.

    Attributes:
        points: Undeformed corners of the face's triangles in device coordinates, m, shape (n, 3, 3).
        middle: Shares (n, 3) of the corners in the middle between the face's two ends in the plane.
        slope: What the places of the corners, shape (n, 3), are summed with for the direction of the line that they make.
        height: Of the face in the plane at rest in m.
        normal: Angle in rad of the face's normal at rest, from the plane's first direction to its second.
    """

    counts_heights = False
    flat = False

    def __init__(self, system: System):
        self.system = eq = system
        body, actuator = eq.body, eq.body.actuator
        if actuator.dimension != 3:
            raise OutlineFitError(
                "side views show how a body bends, and the case has the section of one; give its half or all of it (section)"
            )
        tip = next((role for role in ENDS if role in body.entities), ENDS[0])
        for role, what in ((tip, "at its end, whose place and angle side views show"), (SUPPORT, "at which it is held")):
            if role not in body.entities:
                raise OutlineFitError(
                    f"the case's device has no face called {role!r} {what}; name it, of an imported part such as surfaces = "
                    '["tip = x = 90 mm"]'
                )
        grid, own = state_values.Grid(eq), sensitivity.coordinates(body.mesh)[0]
        facets, held = (np.unique(body.entities[role][1]).astype(np.int32) for role in (tip, SUPPORT))
        self._mix, self._space = np.eye(3), grid.space
        self._nodes, self._held = (shapes.nodes_of(eq, grid.space, part, 2)[:, :3] for part in (facets, held))
        self._blocks, self._held_blocks = (shapes.nodes_of(eq, own, part, 2)[:, :3] for part in (facets, held))
        self._dofs = state_values.displacement_maps(eq, grid)[0][self._nodes]
        corners = np.round(self._everywhere(self._here()) / eq.length_unit * 1e7).astype(np.int64)
        middles = corners.sum(axis=1)  # a facet that two ranks have is the same
        self._order = np.unique(middles, axis=0, return_index=True)[1]
        self._turned = np.zeros(len(self._order), dtype=bool)
        self.follow()
        self.weight = _areas(self.points)
        first = self._in_plane(self.points)
        rest = first - np.einsum("n,nki->i", self.weight, first) / 3.0
        spread = np.einsum("n,nki,nkj->ij", self.weight, rest, rest)
        across = np.linalg.eigh(spread)[1][:, 0] if self.turns else np.array([0.0, 1.0])
        across = across * (math.copysign(1.0, float(across @ (self.points.mean(axis=(0, 1)) @ self._plane.T - self._base))))
        self.normal = math.atan2(across[1], across[0])
        # A silhouette shows the face's two ends alone: of half a disk their middle is not that of the area.
        high = rest @ [-across[1], across[0]]
        self.height = float(np.ptp(high))
        ends = [np.abs(high - end) <= END_TOLERANCE * self.height for end in (high.min(), high.max())]
        self.middle = np.asarray(sum(0.5 * end / end.sum() for end in ends))
        # The direction is that of a line through the part of the face that the measurement takes.
        high = high - 0.5 * (high.max() + high.min())
        near = self.weight[:, None] * (np.abs(high) <= FACE_SHARE * self.height)
        near = near if len(np.unique(np.round(high[near > 0.0] / self.height, 3))) > 2 else self.weight[:, None] + 0.0 * high
        near = near / near.sum()
        away = high - np.sum(near * high)
        self.slope = near * away / np.sum(near * away**2)

    @functools.cached_property
    def turns(self) -> bool:
        """Whether the device can bend at all: one with several mirror planes only lengthens."""
        return len(self.system.body.actuator.cut_planes) < 2

    @functools.cached_property
    def _plane(self) -> Array:
        """Unit vectors of the plane of motion, shape (2, 3); of a device that only lengthens those components that stay."""
        actuator = self.system.body.actuator
        sight = np.array(actuator.cut_planes[0].normal) if len(actuator.cut_planes) == 1 else np.array([0.0, 1.0, 0.0])
        up = np.array(actuator.lift) - sight * (sight @ np.array(actuator.lift))
        if np.linalg.norm(up) < 0.5:
            up = np.eye(3)[int(np.argmin(np.abs(sight)))]
            up = up - sight * (sight @ up)
        up = up / np.linalg.norm(up)
        plane = np.array([np.cross(sight, up), up])
        plane[0] *= math.copysign(1.0, plane[0] @ [1.0, 1e-3, 1e-6])
        if self.turns:
            return plane
        normals = np.array([cut.normal for cut in actuator.cut_planes])
        return np.asarray(plane @ (np.eye(3) - np.linalg.pinv(normals) @ normals))

    def follow(self) -> None:
        """Update the nodes from the current mesh."""
        super().follow()
        held = self._space.tabulate_dof_coordinates()[self._held]
        self._corners = self._in_plane(self._everywhere(held)).reshape(-1, 2)
        self._ends = np.array([self._corners.argmin(axis=0), self._corners.argmax(axis=0)])

    @property
    def _base(self) -> Array:
        """Middle of the support in the plane, shape (2,), m."""
        return np.asarray(self._corners[self._ends, [0, 1]].mean(axis=0))

    def curve(self, state: State) -> DeformedFace:  # type: ignore[override]
        """Return the deformed face on the current mesh."""
        self.follow()
        return DeformedFace(self, self._in_plane(self.points + self._displacement(state.w)) - self._base)

    def moved(self, w: Array, X: Array | None = None) -> Array:
        """Return the derivative of the face's corners in m, shape (n, 3, 2); see `Silhouette.moved`."""
        moved = self._in_plane(self._displacement(w))
        if X is not None:
            held = self._in_plane(self._everywhere(X[self._held_blocks])).reshape(-1, 2)
            base = held[self._ends, [0, 1]].mean(axis=0)
            moved = moved + self._in_plane(self._arranged(self._everywhere(X[self._blocks]))) - base
        return moved

    @property
    def width(self) -> float:
        """Distance of the undeformed tip from the middle of the support in m."""
        return float(np.linalg.norm(DeformedFace(self, self._in_plane(self.points) - self._base).place))

    tall = width


def _areas(triangles: Array) -> Array:
    """Return the shares (n,) of triangles (n, 3, 3) in their area."""
    sides = triangles[:, 1:] - triangles[:, :1]
    areas = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    return np.asarray(areas / areas.sum())


class DeformedFace:
    """A face with the corners (n, 3, 2) in m of its triangles in the plane of motion."""

    def __init__(self, face: TipFace, nodes: Array):
        self.face, self.nodes = face, nodes
        self.place = np.einsum("nk,nki->i", face.middle, nodes)
        """Its middle (2,) in m."""

    def _along(self, nodes: Array) -> Array:
        return np.asarray(np.einsum("nk,nki->i", self.face.slope, nodes))

    @property
    def angle(self) -> float:
        """Direction of its normal in rad."""
        x, z = self._along(self.nodes)
        return math.atan2(-x, z) if self.face.turns else self.face.normal

    @property
    def unevenness(self) -> float:
        """Root mean square distance in m of its corners from the line that it makes in the plane."""
        normal = np.array([math.cos(self.angle), math.sin(self.angle)])
        return float(np.sqrt(np.einsum("n,nk->", self.face.weight, ((self.nodes - self.place) @ normal) ** 2) / 3.0))

    def rates(self, rate: Array) -> tuple[Array, float]:
        """Return the derivatives of place (2,) and angle from those of the corners, shape (n, 3, 2)."""
        (x, z), (by_x, by_z) = self._along(self.nodes), self._along(rate)
        turned = (x * by_z - z * by_x) / (x**2 + z**2) if self.face.turns else 0.0
        return np.einsum("nk,nki->i", self.face.middle, rate), float(turned)


# ----------------------------------------------------------------------------------------------------------------------
# Residuals of side views.


@dataclasses.dataclass(frozen=True)
class Placement:
    """How the device stands in the pictures: seen from its other side (-1) or not (1), turned by an angle in rad."""

    side: float
    tilt: float

    def place(self, there: Array, rate: bool = False) -> Array:
        """Return places (..., 2) of the plane in the picture, or their derivative by the tilt."""
        turned = self.tilt + (0.5 * math.pi if rate else 0.0)
        c, s = math.cos(turned), math.sin(turned)
        return np.asarray(there * [self.side, 1.0] @ np.array([[c, s], [-s, c]]))

    def angle(self, there: Array | float) -> Array:
        """Return angles of the plane in the picture."""
        return np.asarray(self.tilt + (0.0 if self.side > 0.0 else math.pi) + self.side * np.asarray(there))


class MatchedView(residuals.MatchedPhotograph):
    """A side view compared with a state: residuals of x, z and angle, model minus measured, and of the pressure.

    Attributes:
        seen, seen_angle: Place (2,) in m and angle in rad of the simulated tip in the picture.
    """

    shape: ViewShape
    curve: DeformedFace  # type: ignore[assignment]

    def __init__(self, *matched, placement: Placement, bulge: float):  # type: ignore[no-untyped-def]
        self.placement, self.bulge = placement, bulge
        super().__init__(*matched)

    def _compare(self) -> None:
        shape, values = self.shape, self.values
        self.placement = dataclasses.replace(self.placement, tilt=math.radians(values["tilt"]))
        self.error = np.hypot(shape.error, self.bulge * np.array([1.0, 1.0, shape.arm / self.curve.face.height]))
        self.seen = self.factor * self.placement.place(self.curve.place) + [values["centre"], values["zero"]]
        self.seen_angle = float(self.placement.angle(self.curve.angle))
        self.distances = np.r_[self.seen - shape.points[0], shape.arm * _turned(self.seen_angle - shape.angle)]
        self.residuals = self.distances / self.error

    def moved(self, rate: Array) -> Array:
        place, turned = self.curve.rates(rate)
        there = self.factor * self.placement.place(place)
        return np.r_[there, self.shape.arm * self.placement.side * turned] / self.error

    def _placed(self) -> dict[str, Array]:
        there, turned = (self.placement.place(self.curve.place, rate) for rate in (False, True))
        slopes = {
            "scale": [*there, 0.0], "zero": [0.0, 1.0, 0.0], "centre": [1.0, 0.0, 0.0],
            "tilt": np.radians([*self.factor * turned, self.shape.arm]),
        }  # fmt: skip
        return {name: np.array(slope) / self.error for name, slope in slopes.items()}


class ViewResiduals(residuals.OutlineResiduals):
    """Residuals of a device against side views that are prepared."""

    bench, what, size_words = (*problem.BENCH, problem.TILT), "side views", "on a way of up to"
    shapes: tuple[ViewShape, ...]

    def _hidden(self) -> tuple[list[int], tuple[str, ...]]:
        pressed = [i for i, shape in enumerate(self.shapes) if not shape.resting]
        return pressed, tuple(f"volume{i + 1}" for i in pressed)

    @property
    def in_words(self) -> str:
        """The amount of measurements, in words."""
        angles = [shape.angle for shape in self.shapes]
        turned = math.degrees(max(abs(_turned(angle - angles[0])) for angle in angles))
        return f"{len(self.shapes)} side views to {turned:.3g} deg at {self.most / 1e3:.4g} kPa"

    def bench_parameters(self) -> list[problem.Parameter]:
        """Return the parameters of the bench; see `OutlineResiduals`."""
        made = [
            dataclasses.replace(p, prior=problem.Prior(0.0, BASE_ERROR)) if p.name == "centre" else p
            for p in super().bench_parameters()
        ]
        tilt = math.degrees(self._start.placement.tilt)
        return [*made, problem.Parameter(problem.TILT, "degree", tilt, tilt - 90.0, tilt + 90.0)]

    def starts(
        self, held: Mapping[str, float], doubted: Collection[str]
    ) -> tuple[list[dict[str, float]], residuals.NeoHookeanDevice]:
        """Return starting values; see `OutlineResiduals`."""
        path = self._start.path
        pressed = [self.shapes[i] for i in self.read]
        errors = [s.pressure_error * (residuals.IGNORED_ERROR_FACTOR if s.source in doubted else 1.0) for s in pressed]
        return residuals.starts(self.model, path, np.array([s.pressure for s in pressed]), np.array(errors), held)

    def _matched(self, shape: Shape, state: State, own: Mapping[str, float]) -> MatchedView:
        number, start = self.shapes.index(shape), self._start  # type: ignore[arg-type]
        bulge = start.bulges[number]
        matched = shape, state, self.model.curve(state), self.model.pressure(state), own, self.most
        return MatchedView(*matched, placement=start.placement, bulge=bulge)

    def _states(self, own: Mapping[str, float]) -> list[State]:
        pressed = dict(zip(self.read, super()._states(own), strict=True))
        resting = self.model.apply_preload(())[0] if len(pressed) < len(self.shapes) else None
        return [pressed.get(i, resting) for i in range(len(self.shapes))]  # type: ignore[misc]

    def _slopes(self, number: int, state: State, names: Sequence[str]) -> tuple[dict[str, float], dict[str, Array]]:
        if not self.shapes[number].resting:
            return super()._slopes(self.read.index(number), state, names)
        return {}, self.model.slopes(state, names, "pressure").nodes

    @functools.cached_property
    def _start(self) -> Start:
        return start_of(self.model, self.shapes)


# ----------------------------------------------------------------------------------------------------------------------
# Where a fit to side views starts.
#
# The pressure at a tip is in proportion to the silicone's stiffness, but for dead loads: one path at any modulus gives tips
# over pressures, and the factor on the pressures at which they are nearest to the measured ones, from which side they are seen
# and how far they are turned. Under dead loads the path is repeated with the modulus until that converges.


FACTOR_COUNT = 240
"""Factors on a path's pressures that are compared."""
MAX_FACTOR = 30.0
"""Largest of them over the smallest."""
FLOOR_SHARE = 0.02
"""Error of places and angles at the start, as a share of the longest way that the tip moves."""
OVERSHOOT_RATIO = 1.15
"""How much further than measured the tip is followed."""


@dataclasses.dataclass(frozen=True, eq=False)
class Start:
    """The device at the views' pressures, how it stands in the pictures, and by how much in m each view's face is uneven."""

    path: residuals.NeoHookeanDevice
    placement: Placement
    bulges: tuple[float, ...]


@dataclasses.dataclass(frozen=True, eq=False)
class _TipPath:
    """Tips on the first branch of a path: added volume in m3, pressure in Pa, place in m, angle in rad, each (n, ...)."""

    volumes: Array
    pressures: Array
    places: Array
    angles: Array


def start_of(model: device.DeviceModel, views: Sequence[ViewShape]) -> Start:
    """Return where a fit starts; `OutlineFitError` where no stiffness fits the loads and the readings."""
    for _ in range(residuals.MAX_MODULUS_ROUNDS):
        values = model.choice.from_modulus(model.modulus)
        try:
            tips = _followed(model, values, views)
        except problem.CannotEvaluate:
            if not model.loaded:
                raise
            model.modulus *= 2.0
            continue
        factor, placement = _best(tips, views)
        if not model.loaded or abs(factor - 1.0) <= residuals.MODULUS_TOLERANCE:
            pressures = np.array([view.pressure for view in views if not view.resting]) / factor
            volumes = PchipInterpolator(tips.pressures, tips.volumes)(pressures)
            path = residuals.plain_device(model, values, volumes, float(tips.volumes[0]))
            bulges = iter([model.curve(state).unevenness for state in path.states])  # type: ignore[attr-defined]
            return Start(path, placement, tuple(0.0 if view.resting else next(bulges) for view in views))
        model.modulus *= min(max(factor, 1.0 / residuals.MAX_MODULUS_FACTOR), residuals.MAX_MODULUS_FACTOR)
    raise OutlineFitError(
        "no stiffness fits the case's loads and the measured pressures; check masses, density and forces, and the direction of "
        "gravity"
    )


def _followed(model: device.DeviceModel, values: dict[str, float], views: Sequence[ViewShape]) -> _TipPath:
    """Follow the tip further than it was seen to move, as far as the pressure rises; `CannotEvaluate` for no path."""
    first = views[0]
    far = max(float(np.linalg.norm(view.points[0] - first.points[0])) for view in views)
    wide = max(abs(_turned(view.angle - first.angle)) for view in views)
    model.set_parameters(values)
    unit, rest = model.system.volume_unit, model.rest_volume
    start = model.apply_preload(())[0]
    face: DeformedFace = model.curve(start)  # type: ignore[assignment]
    rows = [((start.V - rest) * unit, 0.0, *face.place, face.angle)]
    path = model.path("volume")
    goals = model.begins(path) + rest * np.geomspace(0.01, 0.95 * continuation.MAX_GROWTH, 40)
    try:
        for point in continuation.trace(path, goals.tolist()):
            state, face = point.state, model.curve(point.state)  # type: ignore[assignment]
            pressure = model.pressure(state)
            if pressure <= rows[-1][1]:
                if len(rows) > 1:
                    break
                continue
            angle = rows[-1][4] + _turned(face.angle - rows[-1][4])
            rows.append(((state.V - rest) * unit, pressure, *face.place, angle))
            moved = float(np.linalg.norm(face.place - np.array(rows[0][2:4])))
            if moved > OVERSHOOT_RATIO * far and abs(angle - rows[0][4]) > OVERSHOOT_RATIO * wide - 3.0 * FLOOR_SHARE:
                break
    except (stability.PathEnd, newton.NoConvergence) as end:
        if len(rows) < 3:
            raise problem.CannotEvaluate(f"the device has no path: {end}") from None
    if len(rows) < 3:
        raise problem.CannotEvaluate("the pressure of the device does not rise")
    table = np.array(rows)
    return _TipPath(table[:, 0], table[:, 1], table[:, 2:4], table[:, 4])


def _best(tips: _TipPath, views: Sequence[ViewShape]) -> tuple[float, Placement]:
    """Return the factor on the pressures of a path, and the placement, that are nearest to what was seen."""
    readings = np.array([0.0 if view.resting else view.pressure for view in views])
    measured, angles = np.array([view.points[0] for view in views]), np.array([view.angle for view in views])
    floor, arm = FLOOR_SHARE * views[0].height, views[0].arm
    place_of, angle_of = (PchipInterpolator(tips.pressures, part) for part in (tips.places, tips.angles))
    best = math.inf, 1.0, Placement(1.0, 0.0)
    lowest = readings.max() / tips.pressures[-1]
    for factor in np.geomspace(lowest * (1.0 + 1e-9), lowest * MAX_FACTOR, FACTOR_COUNT).tolist():
        places, turned = place_of(readings / factor), angle_of(readings / factor)
        for side in (1.0, -1.0):
            off = angles - Placement(side, 0.0).angle(turned)
            placement = Placement(side, float(np.angle(np.exp(1j * off).mean())))
            away = np.angle(np.exp(1j * (off - placement.tilt)))
            apart = placement.place(places) - measured
            apart = apart - apart.mean(axis=0) / (1.0 + (floor / BASE_ERROR) ** 2 / len(views))
            left = np.column_stack([apart, arm * away]) / floor
            cost = float(np.sum(np.sqrt(1.0 + left**2) - 1.0))
            if cost < best[0]:
                best = cost, factor, placement
    return best[1], best[2]
