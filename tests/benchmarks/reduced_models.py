"""Hold reduced models against fresh solves at random pressures, and their chains in MuJoCo against the table.

    uv run python tests/benchmarks/reduced_models.py 50 bellows tube bending pneunet

Each device is run to its pressure and reduced; then it is run again through random pressures over the inner 80 % of the range,
and reduced there too: these states are no part of the first table. Reported are the largest errors: of the tip over the length,
of its angle, of the compliance over its size; and of the chain in MuJoCo at 1 kHz, with its speed over that of time.
"""

from __future__ import annotations

import math
import sys
import tempfile
import time
from pathlib import Path

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

import softmodels as sm
from softmodels.decks.reduction import ReducedModel, relative

DEVICES = {
    "bellows": (sm.Bellows(), "ecoflex-00-30", 1.0),
    "tube": (sm.Cylinder(), "ecoflex-00-30", 5.0),
    "bending": (sm.BendingBellows(folds=2, cell_size=0.004), "dragon-skin-20", 15.0),
    "pneunet": (sm.PneuNet(), "ecoflex-00-30", 4.0),
}
"""Device, silicone and highest pressure in kPa."""


def turned(one: np.ndarray, other: np.ndarray) -> float:
    """Angle in degrees between two rotation matrices."""
    return math.degrees(float(np.linalg.norm(Rotation.from_matrix(one.T @ other).as_rotvec())))


def in_mujoco(model: ReducedModel) -> str:
    """Errors of the chain at five pressures, and its speed."""
    with tempfile.TemporaryDirectory() as folder:
        from softmodels.decks.chains import write

        chain = mujoco.MjModel.from_xml_path(str(write(model, Path(folder) / "chain.xml")))
    data, place, angle = mujoco.MjData(chain), 0.0, 0.0
    begun, steps = time.process_time(), 1000
    for share in (0.1, 0.3, 0.5, 0.7, 0.9):
        pressure = model.span[0] + share * (model.span[1] - model.span[0])
        data.ctrl[0] = pressure / 1e3
        mujoco.mj_step(chain, data, steps)
        at, site = model(pressure), data.site("tip")
        place = max(place, float(np.linalg.norm(site.xpos - at.position)) / model.length)
        angle = max(angle, turned(site.xmat.reshape(3, 3), at.rotation))
    faster = 5 * steps * chain.opt.timestep / (time.process_time() - begun)
    return f"MuJoCo: tip {100 * place:.2g} % of the length, angle {angle:.2g} deg, {faster:.0f} times faster than time"


def main(count: int, names: list[str]) -> None:
    for name in names:
        device, silicone, top = DEVICES[name]
        begun = time.process_time()
        model = sm.inflate(device, silicone, pressures=f"0:{top:g} kPa").reduce()
        low, high = model.span
        rng = np.random.default_rng(50)
        asked = np.sort(rng.uniform(low + 0.1 * (high - low), low + 0.9 * (high - low), count))
        again = sm.inflate(device, silicone, pressures=asked).reduce()
        places, angles, stiffnesses = [], [], []
        for state in again.states:
            if not np.isclose(asked, state.pressure).any():
                continue
            at = model(state.pressure)
            places.append(float(np.linalg.norm(at.position - state.position)) / model.length)
            angles.append(turned(at.rotation, state.rotation))
            stiffnesses.append(relative(at.compliance, state.compliance))
        angle = np.degrees(np.linalg.norm(model.turns[-1]))
        print(
            f"{name}: {len(model.states)} states to {high / 1e3:.3g} kPa, {angle:.3g} deg; at {len(places)} fresh pressures: "
            f"tip {100 * max(places):.2g} % of the length, angle {max(angles):.2g} deg, "
            f"compliance {100 * max(stiffnesses):.2g} %; "
            f"{in_mujoco(model)}; {time.process_time() - begun:.0f} s CPU",
            flush=True,
        )


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2:] or list(DEVICES))
