"""Devices of other laboratories as cases, and what was measured on them.

The tables are facts from the publications named here; a device's material comes from another measurement than its own.
"""

from __future__ import annotations

import csv
import dataclasses
import itertools
import math
from collections.abc import Callable, Iterator
from pathlib import Path

import gmsh
import numpy as np
from scipy.interpolate import PchipInterpolator

import softmodels as sm
from geometries.meshing import private_model
from softmodels.case.case import Case
from softmodels.case.load import steps_of
from softmodels.common.units import COLUMN
from softmodels.materials.laws import Material
from softmodels.materials.silicones import silicone, spanning

HERE = Path(__file__).parent
G = 9.81


@dataclasses.dataclass(frozen=True)
class Measured:
    """Points measured on a device under one load.

    Attributes:
        group: The device's kind, and the row of the page that it belongs to.
        name: What the points are.
        given: What they were measured at, as ``given_label`` says.
        values: What was measured there, as ``label`` says.
        case: Its case, of a silicone.
        material: The silicone that is taken.
        product: Its name, and where it comes from.
        predict: Values at what is given, of a run; NaN where it ends before.
        spanned: Whether the other sources of its silicone are solved too; not where that takes long.
    """

    group: str
    name: str
    given: np.ndarray
    values: np.ndarray
    given_label: str
    label: str
    case: Callable[[Material], Case]
    material: Material
    product: str
    predict: Callable[[sm.Run, np.ndarray], np.ndarray]
    spanned: bool = True

    @property
    def sources(self) -> list[Material]:
        """The silicone by each of its published sources in tension."""
        return [source.material for source in spanning(self.product.partition(",")[0])]


def _table(name: str) -> list[dict[str, float | str]]:
    with (HERE / f"{name}.csv").open(encoding="utf-8") as file:
        return [
            {key: text if key == "membrane" else float(text or "nan") for key, text in row.items()}
            for row in csv.DictReader(file)
        ]


# ----------------------------------------------------------------------------------------------------------------------
# Ecoflex 00-30 membranes, 70 mm in radius, with a bonded plate that carries a weight, and stiff rings: Campbell and others,
# arXiv 2504.01156; medians of gmcampbell/SPA_Design, c97aae8 (MIT).


ECOFLEX = silicone("ecoflex-00-30/liao-2021")
RING = 6e3
"""Young's modulus times thickness in N/m of the authors' rings: Gent, 1 MPa, 2 mm."""
LIAO = "ecoflex-00-30, tensile curve of Liao and others 2021"


def membranes() -> Iterator[Measured]:
    """Yield each membrane under each weight: gauge pressure at which the plate stands at a height above the clamp."""
    for (name, weight), group in itertools.groupby(_table("membranes"), lambda row: (row["membrane"], row["weight_N"])):
        rows = list(group)
        kind = "plain membrane with a plate" if name == "plain" else "membranes with a plate and rings"
        yield Measured(
            kind, f"{name}, {weight / G:g} kg",
            np.array([row["height_mm"] for row in rows]), np.array([row["pressure_Pa"] for row in rows]) / 1e3,
            "height of the plate in mm", "pressure in kPa", _membrane(str(name), rows[0]), ECOFLEX, LIAO,
            lambda run, heights: _at(run.path["plate_z_mm"], run.path["pressure_Pa"] / 1e3, heights),
        )  # fmt: skip


def _membrane(name: str, row: dict[str, float]) -> Callable[[Material], Case]:
    places = [(row[f"ring{k}_radius_mm"], row[f"ring{k}_half_width_mm"]) for k in (1, 2)]
    rings = [1e-3 * (middle + side * half) for middle, half in places if middle > 0.0 for side in (-1, 1)]
    device = sm.Membrane(
        radius=0.070,
        thickness=1e-3 * row["thickness_mm"],
        plate_radius=1e-3 * row["plate_radius_mm"],
        rings=tuple(rings),
        chamber_depth=0.1,
    )
    parts = [sm.Rigid("plate", name="plate", mass=row["weight_N"] / G), sm.Gravity("-z", density=0.0)]
    if rings:
        parts.append(sm.Sheet("ring1, ring2", RING))
    volumes = np.linspace(0.0, 700.0 if rings else 1400.0, 29)
    return lambda material: Case(
        f"{name}-{row['weight_N']:.0f}N",
        device,
        material,
        components=tuple(parts),
        steps=steps_of(volume_ml=tuple(volumes.tolist())),
    )


def _at(along: np.ndarray, values: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return values at places along a path that rises there; NaN beyond its end."""
    rising = np.r_[True, along[1:] > np.maximum.accumulate(along)[:-1]]
    return np.asarray(PchipInterpolator(along[rising], values[rising], extrapolate=False)(places))


# ----------------------------------------------------------------------------------------------------------------------
# A Dragon Skin 10 cantilever under its weight and a load at the top edge of its tip: srl-ethz/diffPD_sim2real, 825e7b7 (MIT).


def beam() -> Iterator[Measured]:
    """Yield the beam: the tip's drop under a load. The authors' modulus is of a test of the material."""
    rows = _table("beam")
    modulus, poisson = 263.8e3, 0.499
    device = sm.Beam(length=0.100, width=0.030, thickness=0.030, cell_size=0.0075)
    largest = max(float(row["load_N"]) for row in rows)
    parts = (sm.Gravity("-z", density=1070.0), sm.Force("edge of tip and top", "-z", name="tip"))

    def case(material: Material) -> Case:
        return Case("beam", device, material, components=parts, steps=steps_of(force_N=(0.0, largest), on="tip"))

    yield Measured(
        "beam under weight and load", "beam", np.array([row["load_N"] for row in rows]),
        np.array([row["tip_drop_mm"] for row in rows]), "load in N", "drop of the tip in mm", case,
        sm.NeoHookean(modulus / (2 * (1 + poisson)), poisson), "dragon-skin-10-medium, the authors' modulus",
        lambda run, loads: _at(run.path["force_tip_N"], -run.path["tip_z_mm"], loads),
    )  # fmt: skip


# ----------------------------------------------------------------------------------------------------------------------
# A bending cylinder of two silicones, one of whose two channels is inflated: Marchese, Katzschmann and Rus 2015, doi
# 10.1089/soro.2014.0022. The size of its stiff core is not published: 14 mm over a bore of 6 mm are taken.


LENGTH, BIG, SMALL, WIDTH, BORE, CHANNEL = 61.2, 9.8, 5.2, 33.5, 3.16, 40.0
CORE = (14.0, 6.0)


def cylinder(folder: Path) -> Iterator[Measured]:
    """Yield the cylinder, drawn into a folder: the pressure at which its end has turned by an angle."""
    rows = _table("cylinder")

    def case(material: Material) -> Case:
        drawing = folder / "cylinder.step"
        channel = draw_cylinder(drawing)
        core = sm.Region(silicone("mold-star-16-fast/marechal-2021"), name="solid_2")
        device = sm.ImportedActuator(
            file=str(drawing), support="x = 0 mm", cavities=(f"at {LENGTH / 2:g}, {channel:g}, 0.5 mm",),
            planes=("z = 0 mm",), rise="y", cell_size=0.0035,
        )  # fmt: skip
        steps = tuple(1e3 * pressure / COLUMN.pascal for pressure in (0.0, 16.3, 25.1, 30.3, 45.0))
        head = Case("cylinder", device, material, components=(core,), steps=steps_of(pressure_cm=steps))
        return Case.from_toml(f'{head.to_toml()}\n[angles]\nbend = "face x = {LENGTH:g} mm"\n')

    yield Measured(
        "bending cylinder of two silicones", "cylinder", np.array([row["bend_deg"] for row in rows]),
        np.array([row["pressure_kPa"] for row in rows]), "bend in degrees", "pressure in kPa",
        case, ECOFLEX, LIAO,
        lambda run, angles: _at(np.abs(run.path["bend_deg"]), run.path["pressure_Pa"] / 1e3, angles), spanned=False,
    )  # fmt: skip


def draw_cylinder(file: Path) -> float:
    """Draw the upper half of the cylinder as STEP: the silicone, then its core; return the channels' distance from the middle.

    The outline is the hull of a large circle between two small ones; its axis is x.
    """
    centre = WIDTH / 2 - SMALL
    lean = math.asin((BIG - SMALL) / centre)
    with private_model():
        occ = gmsh.model.occ

        def on(radius: float, middle: float, side: int) -> int:
            y, z = middle + side * radius * math.sin(lean), radius * math.cos(lean)
            return int(occ.addPoint(0.0, y, z))

        def half(x: float, y: float, length: float, diameter: float) -> list[tuple[int, int]]:
            whole = occ.addCylinder(x, y, 0.0, length, 0.0, 0.0, diameter / 2)
            box = occ.addBox(x - 1.0, y - diameter, 0.0, length + 2.0, 2 * diameter, diameter)
            return list(occ.intersect([(3, whole)], [(3, box)])[0])

        ends = [int(occ.addPoint(0.0, side * (centre + SMALL), 0.0)) for side in (1, -1)]
        middles = [int(occ.addPoint(0.0, y, 0.0)) for y in (centre, 0.0, -centre)]
        corners = [on(SMALL, centre, 1), on(BIG, 0.0, 1), on(BIG, 0.0, -1), on(SMALL, -centre, -1)]
        curves = [
            occ.addCircleArc(ends[0], middles[0], corners[0]), occ.addLine(corners[0], corners[1]),
            occ.addCircleArc(corners[1], middles[1], corners[2]), occ.addLine(corners[2], corners[3]),
            occ.addCircleArc(corners[3], middles[2], ends[1]), occ.addLine(ends[1], ends[0]),
        ]  # fmt: skip
        outline = occ.addPlaneSurface([occ.addCurveLoop(curves)])
        body = [one for one in occ.extrude([(2, outline)], LENGTH, 0.0, 0.0) if one[0] == 3]
        channels = [half((LENGTH - CHANNEL) / 2, y, CHANNEL, BORE) for y in (centre, -centre)]
        body, _ = occ.cut(body, [*channels[0], *channels[1]])
        core, bore = (half(0.0, 0.0, LENGTH, diameter) for diameter in CORE)
        body, _ = occ.cut(body, core, removeTool=False)
        core, _ = occ.cut(core, bore)
        occ.fragment(body, core)
        occ.synchronize()
        gmsh.write(str(file))
    return centre
