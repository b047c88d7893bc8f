"""What `random_cases.py` draws: devices with lengths of their own, silicones, parts and loads; the same of the same number."""

from __future__ import annotations

import collections
import dataclasses
import random
from collections.abc import Callable
from typing import Any

import numpy as np

import softmodels as sm
from geometries import ACTUATORS, Actuator, GeometryError
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.case.load import steps_of
from softmodels.common.schema import Choice, Length, about
from softmodels.components.fibres import Fabric, Fibres
from softmodels.components.loads import Force, Gravity, Mass, Moment
from softmodels.materials.silicones import SILICONES
from softmodels.mechanics.component import Component, ComponentError
from softmodels.mechanics.controls import LoadPart
from softmodels.path.steps import Steps

IMPORTED = ("ImportedActuator", "ImportedMesh")
MOST_CELLS = {False: 4000, True: 5000}
"""Expected cells of sections and of solids."""
SHAPED = ("section", "clamp", "part", "order", "angle", "channels", "folds", "chambers", "convolutions")
"""Choices that `device_of` makes by itself."""
REFUSED = (GeometryError, CaseError, ComponentError, ValueError)
DEEPEST = -900.0
"""Largest vacuum in cm of the column: a little less than all of the air's."""
CM = 95.1
"""Pa in one cm of the column, near enough to draw with."""


@dataclasses.dataclass(frozen=True)
class Draw:
    """A device and its silicone, to which parts are drawn, with the generator."""

    chance: random.Random
    device: Actuator
    material: Any

    @property
    def mu(self) -> float:
        return float(self.material.shear_modulus_0)

    @property
    def solid(self) -> bool:
        return self.device.dimension == 3

    @property
    def newtons(self) -> float:
        """A force that such a device feels."""
        return self.mu * self.device.size**2 * self.power(-3.0, -1.0)

    def power(self, low: float, high: float) -> float:
        """A number between two powers of ten."""
        return float(10 ** self.chance.uniform(low, high))

    def face(self) -> str:
        return self.chance.choice(list(self.device.faces))

    def along(self) -> str:
        """The lift, or against it."""
        sign = self.chance.choice([1, -1])
        return ", ".join(f"{sign * value:g}" for value in self.device.lift)


def device_of(chance: random.Random, solid: bool) -> Actuator:
    """A device with lengths of its own; GeometryError where they make none."""
    known = [kind for _, kind in sorted(ACTUATORS.items()) if kind.__module__.startswith("geom")]
    kind = chance.choice([kind for kind in known if kind.__name__ not in IMPORTED and (solid or "section" in about(kind))])
    changes: dict[str, Any] = {}
    if section := about(kind).get("section"):
        flat, *full = sorted(section.kind.choices)  # type: ignore[attr-defined]
        changes["section"] = chance.choice(full) if solid else flat
    scale = 10 ** chance.uniform(-0.3, 0.3)
    base = kind(**changes)
    for name, field in about(kind).items():
        value = getattr(base, name)
        if isinstance(field.kind, Choice) and name not in SHAPED and chance.random() < 0.3:
            changes[name] = chance.choice(field.kind.choices)
        elif name in ("folds", "chambers", "convolutions", "channels"):
            changes[name] = chance.choice([1, 2, 3])
        elif isinstance(field.kind, Length) and isinstance(value, float) and value > 0.0:
            low, high = (
                (1.5, 2.5) if name == "cell_size" and solid and base.ratios else (0.7, 1.0 if name == "rounding" else 1.33)
            )
            changes[name] = value * scale * chance.uniform(low, high)
    changes |= _regions_of(chance, kind.__name__, changes)
    device = dataclasses.replace(base, **changes)
    if device.expected_cells > MOST_CELLS[solid]:
        raise GeometryError("more cells than are wanted here")
    return device


def _regions_of(chance: random.Random, kind: str, lengths: dict[str, Any]) -> dict[str, Any]:
    """Rings, plates and sheets that a device has none of by itself."""
    if chance.random() < 0.5:
        return {}
    if kind == "Membrane":
        clamp = {"clamp": chance.choice(["both", "below", "slip"]), "clamp_width": 0.2 * lengths["radius"]}
        radius, thickness = lengths["radius"], lengths["thickness"]
        plate = {"plate_radius": radius * chance.uniform(0.2, 0.4), "plate_thickness": thickness}
        ring = {"rings": (radius * 0.5, radius * chance.uniform(0.6, 0.8)), "ring_thickness": thickness}
        return chance.choice([plate, ring, plate | ring, clamp])
    return {"paper": 0.4 * lengths["base"]} if kind == "PneuNet" else {}


def material_of(chance: random.Random) -> Any:
    """A silicone by its name, or a law with a modulus of its own."""
    mu, nu = 10 ** chance.uniform(4.0, 5.2), chance.choice([0.45, 0.49, 0.495, 0.5])
    laws = [
        sm.NeoHookean(mu, nu), sm.MooneyRivlin(0.4 * mu, 0.1 * mu, nu), sm.Yeoh(mu / 2, mu / 100, mu / 5000, nu),
        sm.Gent(mu, chance.uniform(10, 60), nu), sm.Ogden((mu * 1.2, mu * 0.002, -mu * 0.02), (1.3, 5.0, -2.0), nu),
    ]  # fmt: skip
    return chance.choice([*laws, SILICONES[chance.choice(sorted(SILICONES))].material])


def _ball(draw: Draw) -> Component:
    """A sphere or a cylinder in front of the farthest probe, or around all of a section."""
    size, chance = draw.device.size, draw.chance
    lift, radius, far = np.asarray(draw.device.lift), size * chance.uniform(0.2, 1.0), size * chance.uniform(0.02, 0.2)
    tip = max((np.array(point) for point in draw.device.probes.values()), key=lambda point: float(point @ lift))
    place = tip + lift * (radius + far)
    if draw.solid:
        shape = chance.choice(["sphere", "cylinder"])
        planes = [plane.normal for plane in draw.device.cut_planes]
        along = planes[0] if len(planes) == 1 else tuple(lift)
        return sm.RigidShape(shape, draw.face(), at=tuple(place), radius=radius, along=along, name="ball")
    place[:2] = 0.0
    if chance.random() < 0.3:
        widest = max(float(np.hypot(*point[:2])) for point in draw.device.probes.values())
        around = {"at": (0.0, 0.0, 0.0), "along": (0.0, 0.0, 1.0), "radius": widest + far, "hollow": True}
        return sm.RigidShape("cylinder", draw.face(), **around, name="tube")
    return sm.RigidShape("sphere", draw.face(), at=tuple(place), radius=radius, name="ball")


def _fibres(draw: Draw) -> Component:
    """In the whole body, in a region or on a face."""
    chance, slack = draw.chance, draw.chance.random() < 0.5
    angle, law = chance.choice([0.0, 30.0, 54.7, 90.0]), chance.choice(["standard", "exponential"])
    if chance.random() < 0.5:
        where = chance.choice(["", *draw.device.regions])
        return Fibres(where, angle, modulus=draw.mu * draw.power(-0.5, 2.0), slack=slack, law=law, name="threads")
    stiffness = draw.mu * draw.device.size * draw.power(-1.5, 1.0)
    return Fibres(draw.face(), angle, stiffness=stiffness, slack=slack, law=law, name="threads")


def _fabric(draw: Draw) -> Component:
    along, across = (draw.mu * draw.device.size * draw.power(-1.5, 1.0) for _ in range(2))
    return Fabric(draw.face(), along, across, shear=0.1 * along, slack=draw.chance.random() < 0.5, name="cloth")


def _rigid(draw: Draw) -> Component:
    kind, regions = draw.chance.choice(["free", "guided", "held"]), draw.device.regions
    if regions and draw.chance.random() < 0.5:
        return sm.Rigid(region=draw.chance.choice(list(regions)), kind=kind, name="plate")
    mass = draw.newtons / 9.81 * draw.chance.choice([0.0, 0.2])
    return sm.Rigid(face=draw.face(), kind=kind, mass=mass, name="plate")


def _region(draw: Draw) -> Component:
    other = draw.chance.choice([material_of(draw.chance), sm.NeoHookean(draw.mu * draw.power(-0.5, 3.0), 0.45)])
    return sm.Region(other, name=draw.chance.choice(list(draw.device.regions)))


def _moment(draw: Draw) -> Component:
    planes = [plane.normal for plane in draw.device.cut_planes]
    axis = ", ".join(f"{value:g}" for value in (planes[0] if planes else (0.0, 1.0, 0.0)))
    return Moment(draw.face(), axis, draw.newtons * draw.device.size, name="turn")


def _walls(draw: Draw) -> Component:
    names = {"PneuNet": ["chamber_walls", "cavity"], "BendingBellows": ["folds", "cavity"]}
    return sm.Walls(draw.chance.choice(names.get(type(draw.device).__name__, ["outer", "cavity", draw.face()])))


def _clamp(draw: Draw) -> Component:
    way = draw.chance.choice([{"along": "z"}, {"slip": "z"}, {}])
    return sm.Clamp(draw.face(), **way, name="grip")


MAKERS: dict[str, Callable[[Draw], Component]] = {
    "gravity": lambda draw: Gravity(density=1070.0, direction=draw.along()),
    "force": lambda draw: Force(draw.face(), draw.along(), draw.newtons, name="pull"),
    "moment": _moment, "rigid": _rigid, "ball": _ball, "walls": _walls, "fibres": _fibres, "fabric": _fabric,
    "region": _region, "clamp": _clamp, "mass": lambda draw: Mass(draw.face(), draw.newtons / 9.81, name="weight"),
}  # fmt: skip


def parts_of(draw: Draw) -> list[Component]:
    """Up to three parts of kinds that the device can have; gravity where something hangs."""
    can = [kind for kind in MAKERS if (kind != "moment" or draw.solid) and (kind != "region" or draw.device.regions)]
    kinds = draw.chance.sample(can, draw.chance.choice([0, 1, 1, 1, 2, 2, 3]))
    if not draw.device.ratios and not {"force", "gravity"} & set(kinds):
        kinds.append("force")
    if "mass" in kinds and "gravity" not in kinds:
        kinds.append("gravity")
    return [MAKERS[kind](draw) for kind in kinds]


def whole_of(draw: Draw) -> dict[str, Any]:
    """A sheet, a plane in the way or the other formulation, seldom."""
    found: dict[str, Any] = {}
    if draw.chance.random() < 0.15:
        found["components"] = [sm.Sheet(draw.face(), draw.mu * draw.device.size * draw.power(-1.0, 1.5))]
    if draw.chance.random() < 0.15:
        top = max(point[2] for point in draw.device.probes.values())
        height = (top + draw.device.size * draw.chance.uniform(0.05, 0.4)) * 1e3
        found["components"] = [*found.get("components", ()), sm.Obstacle(draw.face(), f"z = {height:.4f} mm")]
    if draw.chance.random() < 0.1:
        found["formulation"] = "displacement"
    return found


def load_of(draw: Draw, components: list[Component], vacuum: bool = False) -> dict[str, Any]:
    """What is asked, and how it is followed; a load that is driven loses its amount among the parts."""
    chance, device = draw.chance, draw.device
    cm, ml = draw.mu * draw.power(-1.5, 0.3) / CM, 1e6 * device.cavity_volume * draw.power(-0.7, 0.6)
    if vacuum:
        return _vacuum(draw, max(-cm, DEEPEST), -1e6 * device.cavity_volume * chance.uniform(0.05, 0.7))
    loads = [part for part in components if isinstance(part, Gravity | Force)]
    kinds = ["pressure", "pressure", "volume", "program", "cycle"] if device.ratios else []
    kinds += ["stroke"] if device.ratios and not any(isinstance(part, LoadPart) for part in components) else []
    kind = chance.choice([*kinds, *(["driven", "driven", "driven", "steps", "steps"] if loads else [])] or ["pressure"])
    if kind == "pressure":
        return {
            "steps": steps_of(pressure_cm=(0.0, cm)),
            "control": chance.choice(["auto", "auto", "pressure", "volume", "arc-length"]),
        }
    if kind == "volume":
        return {"steps": steps_of(volume_ml=(0.0, ml)), "control": chance.choice(["auto", "volume", "arc-length"])}
    if kind == "cycle":
        return {"steps": steps_of(pressure_cm=(0.0, cm)), "load_unload": True}
    if kind == "stroke":
        syringe = sm.Syringe(3e-6 * ml, dead_volume=device.cavity_volume * draw.power(-1.0, 1.0))
        return {"steps": steps_of(stroke_ml=(0.0, ml)), "supply": syringe}
    if kind == "program":
        return {"steps": _air(draw, cm, ml)}
    load = chance.choice(loads)
    components[components.index(load)] = dataclasses.replace(load, amount=0.0) if isinstance(load, Force) else load
    newtons, size = draw.newtons * 3, 1e3 * device.size
    asked = {"share": (0.0, 1.0)} if isinstance(load, Gravity) else {"force_N": (0.0, newtons), "travel_mm": (0.0, 0.2 * size)}
    key = chance.choice(list(asked))
    if kind == "driven":
        pressure = chance.choice([0.0, 0.1 * cm]) if device.ratios else 0.0
        cycle = key != "travel_mm" and chance.random() < 0.2
        return {"steps": steps_of(**{key: asked[key]}, on=load.name, at_pressure_cm=pressure), "load_unload": cycle}
    most = asked[key][-1]
    values = [most, most] if device.ratios else [most, most / 2]
    air = {f"cavity{i}": {"pressure_cm": [0.0, cm / 2, cm]} for i in range(1, len(device.ratios) + 1)}
    values += [most] if air else []
    dead = {"gravity": {key: values}} if key == "share" else {"force": {load.name: {key: values}}}
    return {"steps": steps_of(**air, **dead)}


def _vacuum(draw: Draw, cm: float, ml: float) -> dict[str, Any]:
    """Air that is drawn out: a pressure, a volume, a pull and a push in turn, or a cycle."""
    kind = draw.chance.choice(["pressure", "pressure", "volume", "program", "cycle"])
    if kind == "pressure":
        return {
            "steps": steps_of(pressure_cm=(0.0, cm)),
            "control": draw.chance.choice(["auto", "auto", "pressure", "arc-length"]),
        }
    if kind == "volume":
        return {"steps": steps_of(volume_ml=(0.0, ml)), "control": draw.chance.choice(["auto", "volume", "arc-length"])}
    if kind == "cycle":
        return {"steps": steps_of(pressure_cm=(0.0, cm)), "load_unload": True}
    shares = [(-share, share / 2, -share / 2) for share in (draw.chance.uniform(0.1, 0.6) for _ in draw.device.ratios)]
    return {"steps": _cavities("pressure_cm", [[-cm * share for share in one] for one in shares])}


def _cavities(key: str, values: list[list[float]]) -> Steps:
    """A program of values for each cavity."""
    return steps_of(**{f"cavity{i}": {key: one} for i, one in enumerate(values, 1)})


def _air(draw: Draw, cm: float, ml: float) -> Steps:
    """Three steps of every cavity."""
    key, most = draw.chance.choice([("pressure_cm", cm), ("volume_ml", ml / len(draw.device.ratios))])
    shares = [draw.chance.sample([0.25, 0.5, 0.75, 1.0, 0.1], 3) for _ in draw.device.ratios]
    return _cavities(key, [[most * share for share in one] for one in shares])


def case_of(number: int, seed: int, solid: bool, vacuum: bool = False) -> tuple[Case, collections.Counter[str]]:
    """A case that can be meant, and what was refused before it was drawn."""
    chance = random.Random(f"{seed} {number} {solid}{' vacuum' if vacuum else ''}")
    refused = collections.Counter[str]()
    while True:
        try:
            draw = Draw(chance, device_of(chance, solid), material_of(chance))
            if vacuum and not draw.device.ratios:
                continue
            components = parts_of(draw)
            whole = whole_of(draw)
            components += whole.pop("components", [])
            whole |= load_of(draw, components, vacuum)
            return Case(f"case{number}", draw.device, draw.material, components=tuple(components), **whole), refused
        except REFUSED as error:
            refused[str(error)[:80]] += 1


FINGERS: dict[str, dict[str, Any]] = {"PneuNet": {"chambers": 2, "cell_size": 5e-3}, "BendingBellows": {"folds": 2}}
"""Devices that close around an object, few cells each."""


def grasp_of(number: int, seed: int) -> tuple[Case, dict[str, Any], collections.Counter[str]]:
    """The case of a finger at a cylinder, what `softmodels.runs.grasp.grasp` asks besides, and what was refused before."""
    chance = random.Random(f"{seed} {number} grasp")
    refused = collections.Counter[str]()
    while True:
        kind = chance.choice(sorted(FINGERS))
        base = ACTUATORS[kind](**FINGERS[kind])
        lengths = {
            name: getattr(base, name) * chance.uniform(0.85, 1.15)
            for name, field in about(type(base)).items()
            if isinstance(field.kind, Length) and name != "cell_size" and getattr(base, name) > 0.0
        }
        try:
            device = dataclasses.replace(base, **lengths)
            if device.expected_cells > MOST_CELLS[True]:
                raise GeometryError("more cells than are wanted here")
            material = material_of(chance)
            tip = np.array(device.probes[device.gauge])
            radius = float(np.linalg.norm(tip)) * chance.uniform(0.1, 0.5)
            low = min(point[2] for point in device.probes.values())
            at = (float(tip[0]) * chance.uniform(0.6, 1.05), 0.0, low - radius - device.size * chance.uniform(0.0, 0.1))
            rod = sm.RigidShape(
                "cylinder", "bottom, tip", at=at, radius=radius, along=(0.0, 1.0, 0.0), name="rod",
                friction=chance.choice([0.0, 0.2, 0.5, 0.8]),
            )  # fmt: skip
            mu = float(material.shear_modulus_0)
            cm = mu * 10 ** chance.uniform(-1.8, -0.8) / CM
            case = Case(f"grasp{number}", device, material, components=(rod,), steps=steps_of(pressure_cm=(cm / 2, cm)))
            turn = chance.uniform(0.0, 2.0 * np.pi)
            load = chance.choice([0.0, 1.0]) * mu * device.size**2 * 10 ** chance.uniform(-4.5, -3.0)
            asked = {"fingers": chance.choice([2, 3, 3, 4]), "load": load, "steps": 4}
            return case, asked | {"direction": np.array([np.cos(turn), 0.0, np.sin(turn)])}, refused
        except REFUSED as error:
            refused[str(error)[:80]] += 1
