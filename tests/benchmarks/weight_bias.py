"""By how much a fit that leaves the weight out is off, by device and stiffness.

    uv run python tests/benchmarks/weight_bias.py [--picture docs/pages/img/weight.png]

Outlines without noise of devices that bear their own weight, one of them a disk of brass too, are fitted by a case without
gravity. Heights count from the upper edge of the shadow at zero pressure, as a photograph there shows it. Five pressures each,
in proportion to the shear modulus, so that all rise about as high; a point's error is 10 um, a reading's 10 Pa. A fit with
gravity gives the modulus back to 1e-8.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import softmodels as sm
from geometries import Actuator, HollowDisk, Membrane
from softmodels.case.case import Case
from softmodels.case.load import steps_of
from softmodels.components.loads import Gravity, Mass
from softmodels.fitting.outlines.device import MeasuredDevice
from softmodels.fitting.problem import LawChoice
from softmodels.mechanics.component import Component
from softmodels.mechanics.mpi import start
from tests.support.simulated import SimulatedCamera, simulated_outlines

DOWN = Gravity("-z")
DEVICES: dict[str, tuple[Actuator, tuple[Component, ...], tuple[float, ...]]] = {
    "default disk, 6 mm": (HollowDisk(section="axisymmetric"), (DOWN,), (0.08, 0.17, 0.26, 0.36, 0.46)),
    "thin disk, 2 mm": (HollowDisk.variant("shadow", section="axisymmetric"), (DOWN,), (0.01, 0.03, 0.06, 0.1, 0.13)),
    "membrane, 1 mm": (Membrane(clamp_width=0.005), (DOWN,), (0.005, 0.015, 0.03, 0.05, 0.07)),
    "default disk with 5 g on it": (
        HollowDisk(section="axisymmetric"),
        (DOWN, Mass("top", 0.005, name="brass")),
        (0.08, 0.17, 0.26, 0.36, 0.46),
    ),
}
"""Devices, what they bear, and their pressures in shear moduli."""
MODULI = (5e3, 7e3, 10e3, 15e3, 25e3, 40e3, 70e3)
LAW = LawChoice.from_text("neo-hookean", 0.49)
HALF = 1.959964
"""Half a 95 % interval in standard errors."""


def without_weight(
    device: Actuator, components: tuple[Component, ...], shares: tuple[float, ...], modulus: float
) -> tuple[float, float, bool]:
    """Error of the modulus and half its 95 % interval, in percent, and whether the fit may be used."""
    law = sm.NeoHookean(modulus, 0.49)
    case = Case("device", device, law, steps=steps_of(pressure_cm=(1.0,)), components=components)
    model = MeasuredDevice.of(case).model(LAW, start())
    values = {"shear_modulus": modulus}
    outlines = simulated_outlines(model, values, [share * modulus for share in shares], SimulatedCamera())
    plain = Case("device", device, law, steps=steps_of(pressure_cm=(1.0,)))
    found = sm.fit(plain, outlines, "neo-hookean", sm.FitOptions(poisson=0.49, profiles=False)).chosen
    off, width = found.fit.values["shear_modulus"] / modulus - 1, HALF * found.fit.error("shear_modulus") / modulus
    return 100 * off, 100 * width, found.sound and not found.judgement.warnings


def drawn(table: dict[str, list[tuple[float, float, bool]]]) -> Figure:
    import matplotlib as mpl

    from softmodels.pictures.style import DPI, STYLE, WIDTH_INCHES

    with mpl.rc_context(STYLE):
        figure = Figure((WIDTH_INCHES, 5.2), dpi=DPI, layout="constrained")
        axes = figure.subplots()
        for (name, rows), colour in zip(table.items(), ("#2f6f9f", "#c0392b", "#b7791f", "#5b3f8c"), strict=True):
            off, width, good = np.array(rows).T
            x = np.array(MODULI) / 1e3
            axes.fill_between(x, off - width, off + width, color=colour, alpha=0.1, linewidth=0)
            axes.plot(x, off, color=colour, label=name)
            axes.plot(x[good > 0], off[good > 0], "o", color=colour)
            axes.plot(x[good == 0], off[good == 0], "o", color=colour, markerfacecolor="white")
        axes.axhline(0.0, color="#102a43", linewidth=1.0)
        axes.plot([], [], "o", color="#334e68", markerfacecolor="white", label="the fit warns, or is refused")
        axes.set_xscale("log")
        axes.set_xticks(x, [f"{value:g}" for value in x])
        axes.minorticks_off()
        axes.set(xlabel="shear modulus in kPa", ylabel="fitted shear modulus, too high by %")
        axes.set_title("A fit that leaves the weight out (bands: its 95 % intervals)")
        axes.legend()
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--picture", type=Path)
    asked = parser.parse_args()
    table: dict[str, list[tuple[float, float, bool]]] = {}
    for name, asked_of in DEVICES.items():
        table[name] = []
        for modulus in MODULI:
            found = without_weight(*asked_of, modulus)
            table[name].append(found)
            told = "" if found[2] else ", warns or is refused"
            print(f"{name:28s} {modulus / 1e3:3g} kPa: {found[0]:+6.2f} % +- {found[1]:.2f} %{told}")
    if asked.picture:
        drawn(table).savefig(asked.picture)


if __name__ == "__main__":
    main()
