"""Side views of a device in a fit: place and angle of its tip in each photograph against the state of its face ``tip``.

A picture shows the plane in which the device moves, from either side, and turned by the bench's ``tilt``. Of a tip in the
plane, x, z from the middle of the face ``support`` and turned by the angle a from its normal at rest,

    place measured = (centre, zero) + (1 + scale) T (x or -x, z),    angle measured = tilt + a or tilt + pi - a

where T turns by the tilt. A marker on the front face is a point of the device without pressure; two hidden parameters say
where. Its place in each photograph is that of this point, as a tip's, with the parallax of its motion towards the camera.
Pressures are those of outlines (`residuals`), and so are the hidden volumes of the photographs under pressure; those without
one show the device as it hangs.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.interpolate import PchipInterpolator

from geometries.actuator import ENDS
from measurement.outline.outline import History, OutlineError, read_history
from measurement.outline.silhouette import FACE_SHARE
from measurement.series import markers
from measurement.series.views import VIEW_COLUMNS
from softmodels.common import tables, units
from softmodels.common.arrays import Array
from softmodels.common.errors import reason
from softmodels.common.names import keep_arrays
from softmodels.fitting import problem
from softmodels.fitting.outlines import device, residuals, shapes
from softmodels.fitting.outlines.shapes import OutlineFitError, Shape, kept
from softmodels.mechanics import mpi, newton, sensitivity
from softmodels.mechanics.system import State, System
from softmodels.path import continuation, stability
from softmodels.runs import state_values


@dataclasses.dataclass(frozen=True, eq=False)
class SideView:
    """A tip seen from the side: place (2,) in m from the middle of the base, x to the right and z upwards, the angle in rad in
    which its face looks, from x to z, and their standard errors; pressure and its standard error in Pa, what speaks against
    it, what it shows of markers, and whether the tip counts beside them."""

    source: str
    pressure: float
    pressure_error: float
    tip: Array
    tip_error: Array
    angle: float
    angle_error: float
    reasons: tuple[str, ...] = ()
    history: History = ()
    markers: tuple[SeenMarker, ...] = ()
    counts_tip: bool = True

    def __post_init__(self) -> None:
        keep_arrays(self)


@dataclasses.dataclass(frozen=True, eq=False)
class SeenMarker:
    """A marker in a photograph: its name, its place (2,) in m from the middle of the base with its standard error (2,), the
    part of it that is the photograph's own, and by how much in m its place appears to move per m towards the camera (2,)."""

    name: str
    place: Array
    error: Array
    own_error: float
    parallax: Array


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
            header = {name.strip() for name in lines.readline().split(",")}
            return {"tip_x_m", "tip_z_m", "angle_deg"} <= header or set(markers.COLUMNS[3:11]) <= header
    except OSError:
        return False


def seen_in(given: object) -> type[shapes.Silhouette]:
    """Return what photographs show of a device: its tip where one of them is a side view, or a table of these."""
    several = given if isinstance(given, Sequence) and not isinstance(given, str) else [given]
    return TipFace if any(map(is_table, several)) else shapes.Silhouette


def read_views(file: Path, untrusted: bool = False, exclude: Sequence[str] = ()) -> list[SideView]:
    """Read the ``views.csv`` that ``softmodels measure view`` writes, or that of its folder, with the ``markers.csv`` beside
    it; of that table alone the tips under pressure are left out. Rejected and excluded photographs are left out.
    `OutlineFitError` for a number that is none, or a view that is not trusted, unless ``untrusted``."""
    path = file / TABLE if file.is_dir() else file.with_name(TABLE) if file.name == markers.TABLE else file
    marked = _read_markers(path.with_name(markers.TABLE), untrusted) if file.is_dir() or file.name == markers.TABLE else {}
    (sheet, rows), views = _rows_of(path, VIEW_COLUMNS[1:9], "table of side views; make it with softmodels measure view"), []
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
            history = read_history(f"{path}, {sheet.place(line)}", row.get("history_s_Pa") or "")
        except units.UnitError as error:
            raise OutlineFitError(f"{path}, {sheet.place(line)}: {error}") from None
        except OutlineError as error:
            raise OutlineFitError(str(error)) from None
        views.append(
            SideView(
                row.get("file") or sheet.place(line), p, p_error, np.array([x, z]), np.array([x_error, z_error]),
                math.radians(angle), math.radians(angle_error), () if trusted == "yes" else (remarks,), history,
                markers=tuple(marked.get(row.get("file") or "", ())), counts_tip=file.name != markers.TABLE or p <= p_error,
            )
        )  # fmt: skip
    return views


def _read_markers(path: Path, untrusted: bool) -> dict[str, list[SeenMarker]]:
    """Return the markers of a ``markers.csv`` by photograph, without those that are not trusted unless ``untrusted``; none
    where there is no such table."""
    if not path.exists():
        return {}
    marked: dict[str, list[SeenMarker]] = {}
    needed = ("file", *markers.COLUMNS[3:11], "trusted")
    sheet, rows = _rows_of(path, needed, "table of markers; make it with softmodels measure view --markers")
    for line, row in rows:
        if not row["x_m"] or (row["trusted"] != "yes" and not untrusted):
            continue
        try:
            x, x_error, z, z_error, own, *parallax = (units.number(row[name]) for name in markers.COLUMNS[4:11])
        except units.UnitError as error:
            raise OutlineFitError(f"{path}, {sheet.place(line)}: {error}") from None
        name = f"{path.parent.name}/{row['marker']}"
        marked.setdefault(row["file"], []).append(
            SeenMarker(name, np.array([x, z]), np.array([x_error, z_error]), own, np.array(parallax))
        )
    return marked


def _rows_of(path: Path, needed: Sequence[str], what: str) -> tuple[tables.Worksheet, list[tuple[int, dict[str, str]]]]:
    """Return the sheet of a table with the needed columns, and its rows by the columns' names; `OutlineFitError` for none."""

    def rows_in(sheet: tables.Worksheet) -> Sequence[tables.Line] | None:
        return sheet.rows if sheet.rows and set(needed) <= {name.strip() for name in sheet.rows[0][1]} else None

    try:
        chosen = tables.pick(path, tables.read_sheets(path), rows_in)
    except OSError as error:
        raise OutlineFitError(f"{path} cannot be read: {reason(error)}") from None
    if chosen is None or len(chosen[1]) < 2:
        raise OutlineFitError(f"{path} is not a {what}")
    return chosen[0], tables.records(chosen[1])


@dataclasses.dataclass(frozen=True, eq=False)
class ViewShape(shapes.Shape):
    """A side view prepared for the fit: its one point is the tip, ``error`` (3,) that of x, z and the angle times ``arm``, all
    in m. ``height`` is the longest way in m that a tip moved in any of the views.

    Attributes:
        angle: Of the tip in rad.
        arm: Length of the device in m, by which angles are multiplied.
        resting: Whether the photograph shows the device without pressure.
        markers: Names of its markers, and their places and parallaxes, shape (k, 2).
        counts_tip: Whether the tip is compared too.
    """

    angle: float = 0.0
    arm: float = 1.0
    resting: bool = False
    markers: tuple[str, ...] = ()
    places: Array = dataclasses.field(default_factory=lambda: np.empty((0, 2)))
    parallax: Array = dataclasses.field(default_factory=lambda: np.empty((0, 2)))
    counts_tip: bool = True


MAX_LENGTH_CHANGE = 0.25
"""Difference between the tip's distances from the base without pressure, measured and of the case, over the latter, beyond
which the photographs show something else."""


def prepare(views: Sequence[SideView], model: device.DeviceModel) -> tuple[list[ViewShape], list[str]]:
    """Check side views, and return their shapes by rising pressure, and a sentence on each that is left out; `OutlineFitError`
    for what cannot be fitted."""
    shapes.check_readings(views)
    sucked = [view for view in views if view.pressure < -view.pressure_error]
    notes = [f"{view.source}: below the pressure of the room; photograph not used" for view in sucked]
    vented = [view for view in views if model.spectrum and view.pressure <= view.pressure_error and len(view.history) > 1]
    notes += [f"{view.source}: without pressure after a test; photograph not used" for view in vented if view not in sucked]
    chosen = sorted((view for view in views if view not in sucked and view not in vented), key=lambda view: view.pressure)
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
    if not any(view.counts_tip or view.markers for view in chosen if view not in resting):
        raise OutlineFitError("no photograph has a trusted marker; measure them with softmodels measure view --markers")
    names = Counter(marker.name for view in chosen for marker in view.markers)
    before: dict[str, Array] = {}
    prepared = []
    for view in chosen:
        marked = [marker for marker in view.markers if names[marker.name] > 1]  # one photograph shows no motion
        ways = [np.linalg.norm(marker.place - before.setdefault(marker.name, marker.place)) for marker in marked]
        own = [
            np.sqrt(m.own_error**2 + (SHARED_SHARE * m.error) ** 2 + (MOTION_SHARE * way) ** 2)
            for m, way in zip(marked, ways, strict=True)
        ]  # fmt: skip
        tip = np.r_[view.tip_error, arm * view.angle_error] if view.counts_tip else np.empty(0)
        error = np.concatenate([tip, *own])
        prepared.append(ViewShape(
            view.source, view.tip[None], error, np.arange(len(error)), np.ones(len(error)), view.pressure, view.pressure_error,
            moved, 0.0, level_error=BASE_ERROR, history=view.history, angle=view.angle, arm=arm, resting=view in resting,
            markers=tuple(m.name for m in marked), places=np.array([m.place for m in marked]).reshape(-1, 2),
            parallax=np.array([m.parallax for m in marked]).reshape(-1, 2), counts_tip=view.counts_tip,
        ))  # fmt: skip
    return prepared, notes


SHARED_SHARE, MOTION_SHARE = 0.1, 0.002
"""Share of a marker's whole error that the bench's parameters do not explain, and of its motion that a mesh and a sticker on
a stretched wall leave, in the standard error with which its place counts."""


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
        points: Undeformed corners and middles of edges of triangles in device coordinates, m, shape (m, 6, 3): first those of
            the face, then those of the outer surface, on which markers are.
        count: Number n of the face's triangles.
        middle: Shares (n, 3) of the corners in the middle between the face's two ends in the plane.
        slope: What the places of the corners, shape (n, 3), are summed with for the direction of the line that they make.
        height: Of the face in the plane at rest in m.
        normal: Angle in rad of the face's normal at rest, from the plane's first direction to its second.
    """

    counts_heights = False
    flat = False
    up = np.zeros(3)

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
        outer = [role for role in (shapes.OUTER, *actuator.faces) if role in body.entities and role not in (tip, SUPPORT)]
        skin = np.unique(np.concatenate([np.empty(0), *(body.entities[role][1] for role in outer)])).astype(np.int32)
        self._space, every = grid.space, np.concatenate([facets, skin])
        self._nodes, self._held = shapes.nodes_of(eq, grid.space, every, 2), shapes.nodes_of(eq, grid.space, held, 2)[:, :3]
        self._blocks, self._held_blocks = (shapes.nodes_of(eq, own, part, 2) for part in (every, held))
        self._mix = np.eye(6) if self._blocks.shape[1] == 6 else MIDDLES
        self._dofs = state_values.displacement_maps(eq, grid)[0][self._nodes]
        corners = np.round(self._everywhere(self._here()) / eq.length_unit * 1e7).astype(np.int64)
        middles = corners.sum(axis=1)  # a facet that two ranks have is the same
        order = np.unique(middles, axis=0, return_index=True)[1]
        is_tip = mpi.everywhere(eq.comm, np.arange(len(every)) < len(facets))[order]
        self._order, self.count = order[np.argsort(~is_tip, kind="stable")], int(is_tip.sum())
        self.follow()
        face = self.points[: self.count, :3]
        self.weight = _areas(face)
        first = self._in_plane(face)
        rest = first - np.einsum("n,nki->i", self.weight, first) / 3.0
        spread = np.einsum("n,nki,nkj->ij", self.weight, rest, rest)
        across = np.linalg.eigh(spread)[1][:, 0] if self.turns else np.array([0.0, 1.0])
        across = across * (math.copysign(1.0, float(across @ (face.mean(axis=(0, 1)) @ self._plane.T - self._base))))
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
    def _sight(self) -> Array:
        """Unit vector (3,) across the plane of motion."""
        cuts = self.system.body.actuator.cut_planes
        return np.array(cuts[0].normal) if len(cuts) == 1 else np.array([0.0, 1.0, 0.0])

    @functools.cached_property
    def _toward(self) -> Array:
        """The same towards the one who sees the plane's first direction to the right and its second one upwards."""
        return np.asarray(self._sight * math.copysign(1.0, float(np.cross(*self._plane) @ self._sight)))

    @functools.cached_property
    def _plane(self) -> Array:
        """Unit vectors of the plane of motion, shape (2, 3); of a device that only lengthens those components that stay."""
        actuator, sight = self.system.body.actuator, self._sight
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

    def _arranged(self, values: Array) -> Array:
        return np.asarray(values[self._order])

    def _seen(self, vectors: Array) -> Array:
        """Return vectors (..., 3) by the plane's directions and towards the one who sees it from the side 1."""
        return np.asarray(vectors @ np.vstack([self._plane, self._toward]).T)

    @functools.cached_property
    def skin(self) -> Skin:
        """The outer surface of the device as it was first, on which markers are placed."""
        at_first = self._seen(self.points[self.count :]) - [*self._base, 0.0]
        halves = len(self.system.body.actuator.cut_planes) > 0
        return Skin(at_first, math.copysign(1.0, float(at_first[..., 2].mean())) if halves else 0.0)

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
        return DeformedFace(self, self._seen(self.points + self._displacement(state.w)) - [*self._base, 0.0])

    def moved(self, w: Array, X: Array | None = None) -> Array:
        """Return the derivative of the triangles' nodes in m, shape (m, 6, 3); see `Silhouette.moved`."""
        moved = self._seen(self._displacement(w))
        if X is not None:
            held = self._in_plane(self._everywhere(X[self._held_blocks[:, :3]])).reshape(-1, 2)
            base = held[self._ends, [0, 1]].mean(axis=0)
            there = self._everywhere(np.einsum("sk,mkd->msd", self._mix, X[self._blocks]))
            moved = moved + self._seen(self._arranged(there)) - [*base, 0.0]
        return moved

    @property
    def width(self) -> float:
        """Distance of the undeformed tip from the middle of the support in m."""
        return float(np.linalg.norm(DeformedFace(self, self._seen(self.points) - [*self._base, 0.0]).place))

    tall = width


def _areas(triangles: Array) -> Array:
    """Return the shares (n,) of triangles (n, 3, 3) in their area."""
    sides = triangles[:, 1:] - triangles[:, :1]
    areas = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    return np.asarray(areas / areas.sum())


MIDDLES = np.vstack([np.eye(3), [[0.0, 0.5, 0.5], [0.5, 0.0, 0.5], [0.5, 0.5, 0.0]]])
"""A triangle's corners and the middles of its edges, opposite to each corner, from its corners."""

MIN_SLOPE, OFF_SKIN = 0.2, 1e-3
"""Least cosine between the line of sight and the normal of a triangle on which a marker can be, and how far in m beside the
simulated surface a marker may be measured to be."""


class Skin:
    """The outer surface of a device at rest: nodes (m, 6, 3) in m of its triangles, in the plane and towards the camera; which
    side of the plane it is (1, -1), or 0 for both."""

    def __init__(self, nodes: Array, side: float):
        self.nodes, self.side = nodes, side
        corners = nodes[:, :3]
        ways = corners[:, 1:] - corners[:, :1]
        normal = np.cross(ways[:, 0], ways[:, 1])
        self._usable = np.abs(normal[:, 2]) > MIN_SLOPE * np.linalg.norm(normal, axis=1)
        flat = np.where(self._usable[:, None, None], ways[..., :2], np.eye(2))
        inner = np.linalg.inv(np.swapaxes(flat, 1, 2))
        self._rates = np.concatenate([-inner.sum(axis=1, keepdims=True), inner], axis=1)  # of areal coordinates (m, 3, 2)
        self._size = np.sqrt(np.linalg.norm(normal, axis=1))

    def toward(self, side: float) -> float:
        """Return the sign of places towards the camera of one who sees the plane from a side."""
        return self.side or side

    def _areal(self, place: Array) -> Array:
        """Return the areal coordinates (m, 3) of a place (2,) in all triangles."""
        return np.array([1.0, 0.0, 0.0]) + np.einsum("mkj,mj->mk", self._rates, place - self.nodes[:, 0, :2])

    def beside(self, place: Array) -> float:
        """Return about how far in m a place (2,) is beside all triangles; 0 within."""
        inside = np.where(self._usable, self._areal(place).min(axis=1) * self._size, -np.inf)
        return max(0.0, -float(inside.max()))

    def at(self, place: Array, side: float) -> tuple[int, Array, Array]:
        """Return the triangle towards the camera at a place (2,) of the plane, the weights of its nodes (6,) there, and their
        derivatives (6, 2) by the place; the nearest one beside the surface."""
        areal = self._areal(place)
        inside = np.where(self._usable, areal.min(axis=1), -np.inf)
        within = np.flatnonzero(inside >= -1e-9)
        depth = self.toward(side) * np.einsum("mk,mk->m", areal[within], self.nodes[within, :3, 2])
        number = int(within[np.argmax(depth)]) if len(within) else int(np.argmax(inside * self._size))
        a, rate = areal[number], self._rates[number]
        others = [(1, 2), (0, 2), (0, 1)]
        weights = np.r_[a * (2.0 * a - 1.0), [4.0 * a[i] * a[j] for i, j in others]]
        rates = np.vstack([(4.0 * a - 1.0)[:, None] * rate, *(4.0 * (a[i] * rate[j] + a[j] * rate[i]) for i, j in others)])
        return number, weights, rates


class DeformedFace:
    """A face with the corners (n, 3, 2) in m of its triangles in the plane of motion, and the outer surface's nodes (m, 6, 3)
    in the plane and towards the camera."""

    def __init__(self, face: TipFace, nodes: Array):
        self.face, self.nodes, self.skin = face, nodes[: face.count, :3, :2], nodes[face.count :]
        self.place = np.einsum("nk,nki->i", face.middle, self.nodes)
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
        """Return the derivatives of place (2,) and angle from those of all nodes, shape (m, 6, 3)."""
        rate = rate[: self.face.count, :3, :2]
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

    def __init__(self, *matched, placement: Placement, bulge: tuple[float, float]):  # type: ignore[no-untyped-def]
        self.placement, self.bulge = placement, bulge
        super().__init__(*matched)

    def _compare(self) -> None:
        shape, values, side = self.shape, self.values, self.placement.side
        size, looks = self.bulge
        outwards = self.placement.place(np.array([[math.cos(looks), math.sin(looks)], [-math.sin(looks), math.cos(looks)]]))
        turned = side * shape.arm / self.curve.face.height
        self._bulges = size * np.block([[outwards.T, np.zeros((2, 1))], [np.zeros((1, 2)), turned]])
        own = OWN_BULGE_SHARE * size * np.array([1.0, 1.0, abs(turned)])
        self.error = np.hypot(shape.error, np.r_[own[: self._tip_count], np.zeros(2 * len(shape.markers))])
        self.placement = dataclasses.replace(self.placement, tilt=math.radians(values["tilt"]))
        origin = np.array([values["centre"], values["zero"]])
        self.seen = self.factor * self.placement.place(self.curve.place) + origin
        self.seen_angle = float(self.placement.angle(self.curve.angle))
        tip = np.r_[self.seen - shape.points[0], shape.arm * _turned(self.seen_angle - shape.angle)]
        tip = tip + self._bulges @ [values[name] for name in BULGES]
        skin = self.curve.face.skin
        on_skin = [skin.at(np.array([values[key] for key in place_names(name)]), side) for name in shape.markers]
        self._triangles = np.array([number for number, *_ in on_skin], dtype=int)
        self._weights = np.array([weights for _, weights, _ in on_skin]).reshape(-1, 6)
        self._weight_rates = np.array([rates for *_, rates in on_skin]).reshape(-1, 6, 2)
        self._way = self.curve.skin[self._triangles].copy()
        self._way[..., 2] -= skin.nodes[self._triangles, :, 2]  # what it moved towards the camera
        self.seen_markers = self._in_picture(np.einsum("ka,kai->ki", self._weights, self._way)) + origin
        self.distances = np.r_[tip[: self._tip_count], (self.seen_markers - shape.places).ravel()]
        self.residuals = self.distances / self.error

    @property
    def _tip_count(self) -> int:
        return 3 if self.shape.counts_tip else 0

    def _in_picture(self, there: Array, tilts: bool = False) -> Array:
        """Return where places (k, 3) of markers are in the picture, (k, 2) in m, or the derivative by the tilt."""
        placed = self.factor * self.placement.place(there[:, :2], tilts)
        toward = self.curve.face.skin.toward(self.placement.side)
        return placed if tilts else placed + toward * self.shape.parallax * there[:, 2:]

    def moved(self, rate: Array) -> Array:
        place, turned = self.curve.rates(rate)
        tip = np.r_[self.factor * self.placement.place(place), self.shape.arm * self.placement.side * turned]
        skin = rate[self.curve.face.count :][self._triangles]
        there = self._in_picture(np.einsum("ka,kai->ki", self._weights, skin))
        return np.r_[tip[: self._tip_count], there.ravel()] / self.error

    def _placed(self) -> dict[str, Array]:
        there, turned = (self.placement.place(self.curve.place, rate) for rate in (False, True))
        marked = np.einsum("ka,kai->ki", self._weights, self._way)
        ones = np.ones((len(marked), 1))
        slopes = {
            "scale": (np.r_[there, 0.0], self.placement.place(marked[:, :2])),
            "zero": (np.array([0.0, 1.0, 0.0]), ones * [0.0, 1.0]), "centre": (np.array([1.0, 0.0, 0.0]), ones * [1.0, 0.0]),
            "tilt": (np.radians([*self.factor * turned, self.shape.arm]), np.radians(self._in_picture(marked, True))),
            **{name: (by, 0.0 * marked[:, :2]) for name, by in zip(BULGES, self._bulges.T, strict=True)},
        }  # fmt: skip
        made = {name: np.r_[tip[: self._tip_count], mark.ravel()] / self.error for name, (tip, mark) in slopes.items()}
        for k, name in enumerate(self.shape.markers):
            for axis, key in enumerate(place_names(name)):
                slope = np.zeros(len(self.error))
                first = self._tip_count + 2 * k
                by = np.einsum("ka,kai->ki", self._weight_rates[..., axis], self._way)
                slope[first : first + 2] = self._in_picture(by)[k]
                made[key] = slope / self.error
        return made


BULGES = ("bulge outwards", "bulge across", "bulge turning")
"""Hidden parameters: by how many times its unevenness a tip that bulges is seen out of the middle between its ends, outwards
and along its face, and by how many times that over its height turned. All photographs show it so in the same way."""

OWN_BULGE_SHARE = 0.3
"""Share of a tip's unevenness by which each photograph shows it out of place by itself."""


def place_names(marker: str) -> tuple[str, str]:
    """Return the names of the hidden parameters of a marker's place on the undeformed device."""
    return f"place along of marker {marker}", f"place across of marker {marker}"


class ViewResiduals(residuals.OutlineResiduals):
    """Residuals of a device against side views that are prepared."""

    bench, what, size_words = (*problem.BENCH, problem.TILT), "side views", "on a way of up to"
    shapes: tuple[ViewShape, ...]

    def _hidden(self) -> tuple[list[int], tuple[str, ...]]:
        pressed = [i for i, shape in enumerate(self.shapes) if not shape.resting]
        self.markers = tuple(dict.fromkeys(name for shape in self.shapes for name in shape.markers))
        places = [key for name in self.markers for key in place_names(name)]
        return pressed, (*(f"volume{i + 1}" for i in pressed), *BULGES, *places)

    def hidden_parameters(self, volumes: Sequence[float] | Array, hangs: float = 0.0) -> list[problem.Parameter]:
        """Return the hidden added volumes, what bulges of the tip do in all photographs alike, and the places of markers on the
        device without pressure, m."""
        reach = 0.1 * self.model.silhouette.width
        common = [
            problem.Parameter(
                self.named(name), "", 0.0, -10.0, 10.0, problem.Prior(0.0, 1.0), hidden=True, title=f"the tip's {name}",
                device=self.device,
            ) for name in BULGES
        ]  # fmt: skip
        return [*super().hidden_parameters(volumes, hangs), *common, *(
            problem.Parameter(
                self.named(key), "m", start, start - reach, start + reach, hidden=True, title=f"the {key}", device=self.device
            )
            for name in self.markers
            for key, start in zip(place_names(name), self._start.places[name].tolist(), strict=True)
        )]  # fmt: skip

    @property
    def in_words(self) -> str:
        """The amount of measurements, in words."""
        angles = [shape.angle for shape in self.shapes]
        turned = math.degrees(max(abs(_turned(angle - angles[0])) for angle in angles))
        marked = f", {len(self.markers)} markers" if self.markers else ""
        return f"{len(self.shapes)} side views to {turned:.3g} deg at {self.most / 1e3:.4g} kPa{marked}"

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
        pressed = [shape for shape in self.shapes if not shape.resting]
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
    """The device at the views' pressures, how it stands in the pictures, by how much in m each view's face is uneven and the
    angle in rad in which it looks, and where each marker is on the undeformed device, (2,) in m."""

    path: residuals.NeoHookeanDevice
    placement: Placement
    bulges: tuple[tuple[float, float], ...]
    places: Mapping[str, Array]


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
            pressed = iter([model.curve(state) for state in path.states])
            at_rest = model.curve(model.apply_preload(())[0]) if any(view.resting for view in views) else None
            faces: list[DeformedFace] = [at_rest if view.resting else next(pressed) for view in views]  # type: ignore[misc]
            bulges = tuple(
                (0.0 if view.resting else face.unevenness, face.angle) for view, face in zip(views, faces, strict=True)
            )
            return Start(path, placement, bulges, _marked(faces, views, placement))
        model.modulus *= min(max(factor, 1.0 / residuals.MAX_MODULUS_FACTOR), residuals.MAX_MODULUS_FACTOR)
    raise OutlineFitError(
        "no stiffness fits the case's loads and the measured pressures; check masses, density and forces, and the direction of "
        "gravity"
    )


def _marked(faces: Sequence[DeformedFace], views: Sequence[ViewShape], placement: Placement) -> dict[str, Array]:
    """Return where each marker is on the undeformed device, by the first view that shows it; `OutlineFitError` for one beside
    the device."""
    places: dict[str, Array] = {}
    back = placement.place(np.eye(2))
    for face, view in zip(faces, views, strict=True):
        skin = face.face.skin
        for name, seen in zip(view.markers, view.places, strict=True):
            if name in places:
                continue
            wanted = back @ seen
            place, off = wanted.copy(), np.inf
            for _ in range(MAX_PLACE_ROUNDS):
                number, weights, rates = skin.at(place, placement.side)
                missed = wanted - weights @ face.skin[number, :, :2]
                place = place + np.linalg.solve(face.skin[number, :, :2].T @ rates, missed)
                off = float(np.linalg.norm(missed))
                if off < 1e-9:
                    break
            if not off < OFF_SKIN or skin.beside(place) > OFF_SKIN:
                raise OutlineFitError(
                    f"{view.source}: marker {name} lies beside the face of the case's device that the camera sees; check "
                    "--base, the scale and the case, or remove its rows from markers.csv"
                )
            places[name] = place
    return places


MAX_PLACE_ROUNDS = 30
"""Steps in which the place on the undeformed device is found that a state brings to where a marker is seen."""


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
