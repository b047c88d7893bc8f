"""The columns of ``path.csv`` in words: unit, short name and what each is, with the definition of every extreme.

One place for reports, plots and messages, so that a column has one name wherever it is read. A column that nobody knows of
here is still shown, under its own name.
"""

from __future__ import annotations

import dataclasses
import re

UNITS = {
    "N_per_m": "N/m", "Pa_per_mm2": "Pa/mm²", "per_m": "1/m", "cm": "cm", "mm": "mm", "ml": "ml", "Pa": "Pa", "kPa": "kPa",
    "mJ": "mJ", "N": "N", "deg": "°",
}  # fmt: skip
"""How a column's name ends, the longer before the shorter, and the unit."""


@dataclasses.dataclass(frozen=True)
class Term:
    """A column: its short name, its unit ("" for a number) and what it is, a sentence without its stop."""

    name: str
    unit: str
    text: str

    def __str__(self) -> str:
        return f"{self.name} ({self.unit})" if self.unit else self.name


AT_POINTS = "over all integration points of the cells, of the whole device and not only of what a picture shows"
"""Where the largest stretch and stress are taken: the one definition that every table, picture and message uses."""

TEXTS = {
    "step": ("step", "number of the state along the path, from rest"),
    "pressure_cm": ("pressure", "of the air in the cavity, as the height of the water column that balances it"),
    "pressure_Pa": ("pressure", "the same in pascal, above the pressure around"),
    "added_volume_ml": (
        "added volume",
        "volume of the whole device's cavities less that at rest; with pressure ratios, what the common pressure works on",
    ),
    "load_step": ("load step", "how many steps a program of several cavities has come"),
    "stroke_ml": ("stroke", "how far the syringe's piston has moved, as a volume"),
    "gas_energy_mJ": ("gas energy", "work stored in the gas of syringe, tubes and cavity"),
    "stroke_limit": ("stroke limit", "1 where the stroke has a limit point of its own: beyond it the device jumps"),
    "stable_under_supply": ("stable under the syringe", "1 if the gas behind this state holds it, 0 if the device jumps"),
    "tip_x_mm": ("tip place x", "x of the middle of the tip's edge, deformed, from the clamped base"),
    "tip_z_mm": (
        "tip place z",
        "z of the middle of the tip's edge, deformed, from the middle of the thickness; the rise is of its upper edge",
    ),
    "lift_angle_deg": ("lift angle", "of the line from the middle of the clamped base to the middle of the tip's edge"),
    "curvature_per_m": ("curvature", "of the circle that leaves the base along x and passes through the tip"),
    "tip_stiffness_N_per_m": ("tip stiffness", "force along the lift, spread over the tip, per rise of it at this pressure"),
    "blocked_force_N": ("blocked force", "with which the whole device pushes along its lift on what holds its tip"),
    "contact_force_N": ("contact force", "of the whole device on the rigid plane, along the plane's normal"),
    "contact_depth_mm": ("contact depth", "how deep the stopped faces have sunk into the rigid plane"),
    "max_displacement_mm": ("largest displacement", "longest displacement of any node"),
    "max_stretch": ("largest stretch", f"length over length at rest, in the direction where it is most; {AT_POINTS}"),
    "break_margin": ("break margin", "stretch at which the silicone broke when pulled over the largest one; below 1 it tears"),
    "max_stretch_x_mm": ("place of the largest stretch, x", "in the undeformed device"),
    "max_stretch_y_mm": ("place of the largest stretch, y", "in the undeformed device"),
    "max_stretch_z_mm": ("place of the largest stretch, z", "in the undeformed device"),
    "max_von_mises_kPa": ("largest von Mises stress", f"Cauchy stress that changes the shape; {AT_POINTS}"),
    "J_min": ("smallest J", "J is the silicone's own volume over that at rest; rubber keeps it at 1; over the cells' vertices"),
    "J_max": ("largest J", "of the same, over the cells' vertices"),
    "newton_iterations": ("Newton iterations", "that the equilibrium of this state took"),
    "stored_energy_mJ": ("stored energy", "elastic energy of the whole device"),
    "walls_touch": ("walls touch", "1 from where walls that face each other have met; they pass through each other there"),
    "requested": ("requested", "1 for a state that was asked for"),
    "limit": ("limit point", "1 where the pressure has a maximum or minimum: under a pressure alone the device jumps"),
    "jump": ("jump", "1 for the state of rest in which a jump landed"),
    "bifurcation": ("bifurcation", "1 where another branch of equilibria leaves the path, for another shape"),
    "stable_under_pressure": ("stable under a pressure", "1 if the state stands while the pressure is kept"),
    "stable_under_volume": ("stable under a volume", "1 if the state stands while the amount of liquid in the cavity is kept"),
    "negative_eigenvalues": (
        "negative eigenvalues",
        "in how many independent directions the energy at this pressure falls: 0 is stable, each more is one way out",
    ),
    "lowest_eigenvalue_Pa_per_mm2": ("lowest eigenvalue", "of the tangent at this pressure; zero where stability is lost"),
    "following": ("following", "what the step followed: pressure, volume, a syringe's line or the arc length"),
}  # fmt: skip
"""Short name and meaning by column; probes and cavities, whose names depend on the device, are in `term`."""


def term(column: str, probes: tuple[str, ...] = ()) -> Term:
    """What a column of ``path.csv`` is.

    Args:
        column: Its name.
        probes: Names of the device's probes, whose columns are rises.
    """
    stem, unit = split(column)
    if column in TEXTS and not (re.fullmatch(r"tip_[xz]_mm", column) and probes and "tip_below" not in probes):
        name, text = TEXTS[column]
        return Term(name, unit, text)
    if unit == "mm" and stem in probes:
        return Term(f"rise of the {stem.replace('_', ' ')}", unit, "displacement of that point along the device's lift")
    if unit == "mm" and (found := re.fullmatch(r"(\w+)_([xyz])", stem)):
        return Term(f"{found[1].replace('_', ' ')}, {found[2]}", unit, "place of that named point in this state")
    if unit == "°":
        return Term(
            stem.replace("_", " "), unit, "named angle: by how much its line has turned, or between its two lines"
        )
    if found := re.fullmatch(r"(pressure|added_volume)_(\d+)", stem):
        return Term(
            f"{found[1].replace('_', ' ')} of cavity{found[2]}", unit, f"of the device's cavity{found[2]} alone"
        )
    return Term(stem.replace("_", " "), unit, "")


def split(column: str) -> tuple[str, str]:
    """A column's name without its unit, and the unit: ``apex_mm`` is ("apex", "mm")."""
    for ending, unit in UNITS.items():
        if column.endswith(f"_{ending}"):
            return column.removesuffix(f"_{ending}"), unit
    return column, ""
