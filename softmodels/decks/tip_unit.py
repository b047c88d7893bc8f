"""The program of a unit for co-simulation (FMI 2.0), which pythonfmu starts in another process: a reduced model's tip.

Each unit holds a copy of this file under a name of its own, because a process imports a name only once, and ``table.json``.
Plain Python: where a unit runs, there is only pythonfmu, which comes along.
"""

import bisect
import json
import math
import pathlib
from xml.etree import ElementTree

from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Tip(Fmi2Slave):
    """The tip in equilibrium with the pressure in the cavity, and with force and moment on it to first order; SI units."""

    def __init__(self, **kwargs: object) -> None:
        super().__init__(**kwargs)
        table = json.loads((pathlib.Path(self.resources) / "table.json").read_text(encoding="utf-8"))
        self.modelName, self.description = table["identifier"], table["description"]
        self.axes, self.knots, names = table["axes"], table["knots"], table["pressures"]
        air = "gauge pressure in the cavity" + ("; of several, the run's ratios of it" if len(names) == 1 else "")
        self.pressures = {f"{name}_Pa": ("Pa", air) for name in names}
        volumes = {f"{name.replace('pressure', 'added_volume')}_m3": ("m3", VOLUME) for name in names}
        self.inputs, self.outputs = {**self.pressures, **LOADS}, {**POSE, **volumes}
        for variables, causality in ((self.inputs, Fmi2Causality.input), (self.outputs, Fmi2Causality.output)):
            for name, (_, text) in variables.items():
                setattr(self, name, 0.0)
                self.register_variable(Real(name, causality=causality, description=text))
        for name, x in zip(self.pressures, self.axes, strict=True):
            setattr(self, name, min(max(0.0, x[0]), x[-1]))  # pythonfmu takes starts from here
        self.update()

    def to_xml(self, *options: object) -> ElementTree.Element:
        """Return the description of the model with units, and with the outputs as what follows from its start."""
        root = super().to_xml(*options)
        units = ElementTree.Element("UnitDefinitions")
        for name, base in UNITS.items():
            ElementTree.SubElement(ElementTree.SubElement(units, "Unit", name=name), "BaseUnit", base)
        root.insert([child.tag for child in root].index("CoSimulation") + 1, units)
        for variable in root.find("ModelVariables"):
            variable.find("Real").set("unit", {**self.inputs, **self.outputs}[variable.get("name")][0])
        structure = root.find("ModelStructure")
        ElementTree.SubElement(structure, "InitialUnknowns").extend(structure.find("Outputs"))
        return root

    def set_real(self, vrs: list[int], values: list[float]) -> None:
        """Set inputs; a ValueError, which ends the simulation, for one that is not finite."""
        for vr, value in zip(vrs, values, strict=True):
            if not math.isfinite(value):
                raise ValueError(f"{self.vars[vr].name} is {value}; give a finite number")
        super().set_real(vrs, values)

    def at(self, pressures: list[float]) -> list[float]:
        """Return the row at pressures: cubic Hermite curves through the table, along one pressure after the other."""
        terms = [(0, 0, 1.0)]
        for x, pressure in zip(self.axes, pressures, strict=True):
            k = min(max(bisect.bisect(x, pressure), 1), len(x) - 1)
            h = x[k] - x[k - 1]
            t = (pressure - x[k - 1]) / h
            weights = [
                (k - 1, 0, (1 + 2 * t) * (1 - t) ** 2), (k - 1, 1, t * (1 - t) ** 2 * h),
                (k, 0, t * t * (3 - 2 * t)), (k, 1, t * t * (t - 1) * h),
            ]  # fmt: skip
            terms = [(node * len(x) + j, 2 * by + d, a * b) for node, by, a in terms for j, d, b in weights]
        rows = [(weight, self.knots[node][by]) for node, by, weight in terms if weight]
        return [sum(weight * row[k] for weight, row in rows) for k in range(len(self.knots[0][0]))]

    def update(self) -> None:
        """Compute the outputs; a ValueError, which ends the simulation, for a pressure outside the table, but for rounding."""
        pressures, m = [getattr(self, name) for name in self.pressures], len(self.axes)
        for name, pressure, x in zip(self.pressures, pressures, self.axes, strict=True):
            slack = 1e-9 * (x[-1] - x[0])
            if not x[0] - slack <= pressure <= x[-1] + slack:
                raise ValueError(f"{name} is {pressure:.6g}; the table goes from {x[0]:.6g} to {x[-1]:.6g} Pa")
        row, loads = self.at(pressures), [getattr(self, name) for name in LOADS]
        place, turn, volumes, rates, C = row[:3], row[3:6], row[6 : 6 + m], row[6 + m : -36], row[-36:]
        moved = [sum(C[6 * i + j] * loads[j] for j in range(6)) for i in range(6)]
        pose = [place[i] + moved[i] for i in range(3)] + product(quaternion(moved[3:]), quaternion(turn))
        volumes = [volume + sum(rates[m * j + k] * loads[j] for j in range(6)) for k, volume in enumerate(volumes)]
        for name, value in zip(self.outputs, [*pose, *volumes], strict=True):
            setattr(self, name, value)

    def exit_initialization_mode(self) -> None:
        """Compute the outputs of the start."""
        self.update()

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Compute the outputs of the inputs, which hold to the end of the step."""
        self.update()
        return True


UNITS = {
    "Pa": {"kg": "1", "m": "-1", "s": "-2"},
    "N": {"kg": "1", "m": "1", "s": "-2"},
    "N.m": {"kg": "1", "m": "2", "s": "-2"},
    "m": {"m": "1"},
    "m3": {"m": "3"},
    "1": {},
}
"""The units of the variables, by their exponents of base units."""
LOADS = {
    **{f"force_{axis}_N": ("N", f"force on the tip along {axis}") for axis in "xyz"},
    **{f"moment_{axis}_Nm": ("N.m", f"moment on the tip about {axis}") for axis in "xyz"},
}
POSE = {
    **{f"tip_{axis}_m": ("m", f"position of the tip's centre, {axis}") for axis in "xyz"},
    **{f"tip_q{axis}_1": ("1", f"rotation of the tip from rest, {axis} of the unit quaternion") for axis in "wxyz"},
}
VOLUME = "volume of the cavity beyond that at rest"


def product(a: list[float], b: list[float]) -> list[float]:
    """Return the product of two quaternions, w first."""
    return [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]


def quaternion(turn: list[float]) -> list[float]:
    """Return the quaternion of a rotation vector."""
    angle = math.sqrt(sum(x * x for x in turn))
    share = math.sin(angle / 2) / angle if angle > 1e-9 else 0.5
    return [math.cos(angle / 2), *(share * x for x in turn)]
