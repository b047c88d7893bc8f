"""Bands of Yeoh's law fitted to outlines of disks of rubbers with a share of I2, against the rubbers' own stress.

    python -m tests.benchmarks.form_bands --rubbers 60

Each rubber is drawn (Mooney-Rivlin, Carroll, Ogden; shares of I2 from 0 to 0.5 at small strain), with noise, and errors of the
bench and the membrane as a fit expects them. Prints how many of the stresses in uniaxial tension (stretch 1.1 to 1.5) and in
equibiaxial tension (to 1.3, as in the disk) lie in the 95 % band, without and with the law's form, and the band's half width.
"""

from __future__ import annotations

import argparse
import dataclasses
import tempfile
from pathlib import Path

import numpy as np

import softmodels as sm
from softmodels.case.materials import MATERIAL
from softmodels.common.units import HALF_WIDTH_95
from softmodels.fitting.outlines.device import DeviceModel
from softmodels.fitting.outlines.residuals import LEAK_ERROR, LENGTH_ERROR, SCALE_ERROR, ZERO_ERROR
from softmodels.fitting.problem import FitOptions, LawChoice
from softmodels.materials.laws import FORM_RANGE, Carroll, MooneyRivlin, Ogden
from softmodels.materials.specimens import form_shares, respond
from softmodels.mechanics import mpi
from softmodels.mechanics.body import Body
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from tests.softmodels.test_outline_fit import DISK, PRESSURES
from tests.support.simulated import SimulatedCamera, simulated_outlines

TESTS = {"uniaxial": np.linspace(1.1, 1.5, 5), "equibiaxial": np.linspace(1.1, 1.3, 3)}
USUAL_MODULUS = 30e3
"""Modulus in Pa for which the pressures are meant."""


def rubber(random: np.random.Generator) -> tuple[sm.Material, str]:
    """Return a random rubber of a plausible share, and the name and terms of its law."""
    while True:
        mu, share, power = random.uniform(20e3, 40e3), random.uniform(*FORM_RANGE), random.uniform(1.3, 2.2)
        laws = {
            "mooney-rivlin": MooneyRivlin(mu * (1 - share) / 2, mu * share / 2, 0.5),
            "carroll": Carroll(mu * (1 - share) / 2, 1e-5 * mu * random.uniform(), 3**0.5 * mu * share, 0.5),
            "ogden3": Ogden((2 * mu * (1 - share) / power, 0.002 * mu, -mu * share), (power, 5.0, -2.0), 0.5),
        }
        name = random.choice([*laws])
        shares = form_shares(laws[name], 2.0)[2]
        if FORM_RANGE[0] - 0.02 < shares.min() and shares.max() < FORM_RANGE[1] + 0.02:
            return laws[name], name


def photographed(law: sm.Material, name: str, random: np.random.Generator, folder: Path) -> list[sm.Outline]:
    """Return outlines of a disk of a rubber."""
    errors = {"scale": SCALE_ERROR, "zero": ZERO_ERROR, "leak": LEAK_ERROR}
    camera = SimulatedCamera(bench={key: error * random.standard_normal() for key, error in errors.items()})
    disk = dataclasses.replace(DISK, membrane=DISK.membrane * (1 + LENGTH_ERROR * random.standard_normal()))
    body = Body.from_file(disk, disk.write(folder / "disk.msh"), mpi.start())
    model = DeviceModel(Solver(System(body, law)), LawChoice.from_text(name, 0.5))
    pressures = PRESSURES * law.shear_modulus_0 / USUAL_MODULUS
    return simulated_outlines(model, law.parameters, pressures, camera, rng=random)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rubbers", type=int, default=60)
    parser.add_argument("--seed", type=int, default=53)
    options = parser.parse_args()
    rows: dict[str, list[np.ndarray]] = {mode: [] for mode in TESTS}
    with tempfile.TemporaryDirectory() as folder:
        for number in range(options.rubbers):
            random = np.random.default_rng([options.seed, number])
            law, name = rubber(random)
            fit = sm.fit(DISK, photographed(law, name, random, Path(folder)), "yeoh", options=FitOptions(profiles=False)).chosen
            for mode, stretch in TESTS.items():
                response = respond(fit.material, stretch, mode, fit.errors.names)
                parts = (fit.errors.by_cause[MATERIAL], fit.errors.roots)
                without, with_form = (HALF_WIDTH_95 * np.linalg.norm(response.slopes @ part, axis=1) for part in parts)
                off = respond(law, stretch, mode).stress - response.stress
                rows[mode].append(np.array([off, without, with_form]) / response.stress)
            shown = " ".join(f"{100 * off:+.0f} +- {100 * half:.0f}," for off, _, half in rows["uniaxial"][-1].T)
            print(f"{name}, share {form_shares(law, 2.0)[2][0]:.2f}, uniaxial in %: {shown}", flush=True)
    for mode, made in rows.items():
        off, without, with_form = np.abs(np.array(made)).transpose(1, 0, 2)
        held = f"{np.mean(off <= with_form):.1%} in the band, {np.mean(off <= without):.1%} without the law's form"
        print(f"{mode}: {off.size} stresses, {held}; half width {np.median(with_form):.1%} and {np.median(without):.1%}")


if __name__ == "__main__":
    main()
