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
        self.pressures, self.values, self.slopes = table["pressures"], table["values"], table["slopes"]
        for names, causality in ((INPUTS, Fmi2Causality.input), (OUTPUTS, Fmi2Causality.output)):
            for name, (_, text) in names.items():
                setattr(self, name, 0.0)
                self.register_variable(Real(name, causality=causality, description=text))
        self.pressure_Pa = min(max(0.0, self.pressures[0]), self.pressures[-1])  # pythonfmu takes starts from here
        self.update()

    def to_xml(self, *options: object) -> ElementTree.Element:
        """Return the description of the model with units, and with the outputs as what follows from its start."""
        root = super().to_xml(*options)
        units = ElementTree.Element("UnitDefinitions")
        for name, base in UNITS.items():
            ElementTree.SubElement(ElementTree.SubElement(units, "Unit", name=name), "BaseUnit", base)
        root.insert([child.tag for child in root].index("CoSimulation") + 1, units)
        for variable in root.find("ModelVariables"):
            variable.find("Real").set("unit", {**INPUTS, **OUTPUTS}[variable.get("name")][0])
        structure = root.find("ModelStructure")
        ElementTree.SubElement(structure, "InitialUnknowns").extend(structure.find("Outputs"))
        return root

    def set_real(self, vrs: list[int], values: list[float]) -> None:
        """Set inputs; a ValueError, which ends the simulation, for one that is not finite."""
        for vr, value in zip(vrs, values, strict=True):
            if not math.isfinite(value):
                raise ValueError(f"{self.vars[vr].name} is {value}; give a finite number")
        super().set_real(vrs, values)

    def at(self, pressure: float) -> list[float]:
        """Return the row at a pressure: cubic Hermite curves through the table."""
        x, k = self.pressures, min(max(bisect.bisect(self.pressures, pressure), 1), len(self.pressures) - 1)
        h = x[k] - x[k - 1]
        t = (pressure - x[k - 1]) / h
        a, b, c, d = (1 + 2 * t) * (1 - t) ** 2, t * (1 - t) ** 2 * h, t * t * (3 - 2 * t), t * t * (t - 1) * h
        rows = zip(self.values[k - 1], self.slopes[k - 1], self.values[k], self.slopes[k], strict=True)
        return [a * y + b * dy + c * z + d * dz for y, dy, z, dz in rows]

    def update(self) -> None:
        """Compute the outputs; a ValueError, which ends the simulation, for a pressure outside the table, but for rounding."""
        low, high = self.pressures[0], self.pressures[-1]
        slack = 1e-9 * (high - low)
        if not low - slack <= self.pressure_Pa <= high + slack:
            raise ValueError(f"pressure_Pa is {self.pressure_Pa:.6g}; the table goes from {low:.6g} to {high:.6g} Pa")
        row, loads = self.at(self.pressure_Pa), [getattr(self, name) for name in list(INPUTS)[1:]]
        place, turn, volume, rate, C = row[:3], row[3:6], row[6], row[7:13], row[13:]
        moved = [sum(C[6 * i + j] * loads[j] for j in range(6)) for i in range(6)]
        pose = [place[i] + moved[i] for i in range(3)] + product(quaternion(moved[3:]), quaternion(turn))
        volume += sum(r * load for r, load in zip(rate, loads, strict=True))
        for name, value in zip(OUTPUTS, [*pose, volume], strict=True):
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
INPUTS = {
    "pressure_Pa": ("Pa", "gauge pressure in the cavity; of several, the run's ratios of it"),
    **{f"force_{axis}_N": ("N", f"force on the tip along {axis}") for axis in "xyz"},
    **{f"moment_{axis}_Nm": ("N.m", f"moment on the tip about {axis}") for axis in "xyz"},
}
OUTPUTS = {
    **{f"tip_{axis}_m": ("m", f"position of the tip's centre, {axis}") for axis in "xyz"},
    **{f"tip_q{axis}_1": ("1", f"rotation of the tip from rest, {axis} of the unit quaternion") for axis in "wxyz"},
    "added_volume_m3": ("m3", "volume of the cavity beyond that at rest"),
}


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
