"""The chain of a file in MuJoCo against the reduced model of a device: pose, deflection and first mode of the tip."""

from __future__ import annotations

import importlib
import math
from pathlib import Path
from types import ModuleType

import numpy as np
import scipy.linalg
from scipy.spatial.transform import Rotation

from softmodels.case.entries import CaseError
from softmodels.common import files
from softmodels.common.arrays import Array
from softmodels.decks import chains, hand, reduction
from softmodels.decks.reduction import PerPressure, ReducedModel

__all__ = ["check"]


def check(model: ReducedModel, file: Path) -> list[str]:
    """Return how the chain of a file differs from a device, sentences; `CaseError` for another file, or without MuJoCo."""
    mujoco = check_file(file)
    try:
        chain = ChainInMujoco(mujoco, file)
    except (ValueError, KeyError) as failure:
        raise CaseError(f"MuJoCo {mujoco.__version__} cannot read {file} ({failure}); write it again as NAME.xml") from failure
    low, high = model.span
    mode = _first_mode(model, chain)  # before the chain is damped
    chain.damp()
    start, end = np.atleast_1d(low), np.atleast_1d(high)
    pressures = np.linspace(start, end, CHECKED_PRESSURES)
    if len(end) > 1:
        pressures = np.vstack([np.where(np.eye(len(end), dtype=bool), end, start), (start + end) / 2, end])
    places, angles, deflections = [], [], []
    for pressure in pressures:
        at, (place, R) = model(*pressure), chain.tip(pressure)
        places.append(float(np.linalg.norm(place - at.position)) / model.length)
        angles.append(math.degrees(float(np.linalg.norm(Rotation.from_matrix(R.T @ at.rotation).as_rotvec()))))
        deflections.append(chains.deflection_errors(chain.compliance(pressure, at.compliance, model.length), at.compliance))
    worst = np.nan_to_num(deflections, nan=-1.0).max(axis=0)
    yields = ", ".join(f"{load} {100 * error:.2g} %" for load, error in zip(chains.LOADS, worst, strict=True) if error >= 0.0)
    return [
        f"at {len(pressures)} pressures from {reduction.in_kPa(low)} to {reduction.in_kPa(high)} kPa the tip of the chain is "
        f"within {100 * max(places):.2g} % of the length and {max(angles):.2g} degrees of the device's",
        f"its deflection by small loads, along the device's axes, differs by at most {yields}",
        *model.contact_notes,
        mode,
    ]


def check_file(file: Path) -> ModuleType:
    """Return the module of MuJoCo; `CaseError` if it is not installed, or a file is no chain of softmodels."""
    if not file.is_file() or not chains.is_own(file):
        raise CaseError(f"{file} is no chain of softmodels; write one by softmodels reduce FOLDER -o NAME.xml")
    if f'"{hand.WRIST}"' in files.read_text(file):
        raise CaseError(f"{file} has several fingers; write one alone (without --fingers), which is the same, and check that")
    try:
        return importlib.import_module("mujoco")
    except ImportError as failure:
        raise CaseError("--check needs MuJoCo; install it (pip install mujoco)") from failure


CHECKED_PRESSURES = 5
"""Pressures at which a chain over one is checked; one over several at the highest of each alone and of all, and in
their middle."""
SMALL_DEFLECTION = 1e-3
"""Deflection by a load, in lengths and radians."""
MIN_SETTLING_TIME, MAX_SETTLING_TIME = 0.2, 8.0
"""Time after which a damped chain may be at rest, and after which it is taken as it is, s."""
SPEED_AT_REST = 1e-5
"""Speed of each joint below which a chain is at rest, rad/s and m/s."""


def _first_mode(model: ReducedModel, chain: ChainInMujoco) -> str:
    device = model.first_mode
    pressure = sum(model.span) / 2 if device is None else device.pressure
    frequency, damping = chain.first_mode(pressure, model.case.actuator.dimension == 3 and bool(model.case.actuator.cut_planes))
    text = f"first mode at {reduction.in_kPa(pressure)} kPa: {frequency:.4g} Hz, damping ratio {damping:.3g}"
    if device is None:
        return f"{text}; that of the device is not known"
    known = f"damping ratio {device.damping:.3g}" if device.damping > 0.0 else "damping not known"
    return f"{text}; of the device: {device.frequency:.4g} Hz, {known}"


class ChainInMujoco:
    """A chain of `chains.mjcf`, loaded."""

    def __init__(self, mujoco: ModuleType, file: Path):
        self._mujoco, self._model = mujoco, mujoco.MjModel.from_xml_path(str(file))
        self._model.opt.gravity[:] = 0.0
        self._data = mujoco.MjData(self._model)
        self._tip = self._data.site("tip")
        self._body = self._model.site_bodyid[self._tip.id]
        self._joints = {self._model.joint(k).name: k for k in range(self._model.njnt)}

    def tip(self, pressure: PerPressure, load: Array | None = None) -> tuple[Array, Array]:
        """Return place (m) and rotation of the tip at one or several pressures in Pa, with force (N) and moment (N m)."""
        data, wrench = self._data, np.zeros(6) if load is None else load
        self._mujoco.mj_resetData(self._model, data)
        data.ctrl[:] = np.atleast_1d(pressure) / 1e3
        while data.time < MIN_SETTLING_TIME or (np.abs(data.qvel).max() > SPEED_AT_REST and data.time < MAX_SETTLING_TIME):
            lever = self._tip.xpos - data.xipos[self._body]
            data.xfrc_applied[self._body] = np.concatenate([wrench[:3], wrench[3:] + np.cross(lever, wrench[:3])])
            self._mujoco.mj_step(self._model, data)
        return self._tip.xpos.copy(), self._tip.xmat.reshape(3, 3).copy()

    def compliance(self, pressure: PerPressure, of_device: Array, length: float) -> Array:
        """Return the compliance of the tip where that of the device is known, nan elsewhere, shape (6, 6)."""
        C = np.full((6, 6), math.nan)
        for k in np.flatnonzero(np.nan_to_num(np.diag(of_device)) > 0.0):
            load = np.zeros(6)
            load[k] = SMALL_DEFLECTION * (length if k < 3 else 1.0) / of_device[k, k]
            (low, behind), (high, ahead) = self.tip(pressure, -load), self.tip(pressure, load)
            C[:, k] = np.concatenate([high - low, Rotation.from_matrix(ahead @ behind.T).as_rotvec()]) / (2 * load[k])
        return C

    def first_mode(self, pressure: PerPressure, in_plane: bool) -> tuple[float, float]:
        """Return frequency in Hz and damping ratio of the first mode, or of the first within the plane of bending."""
        kinds = ("hinge", "slide", "shear") if in_plane else tuple(chains.JOINTS)
        dofs = [dof for name, dof in self._joints.items() if name.rstrip("0123456789") in kinds]
        self.tip(pressure)
        M, K, data = np.zeros((self._model.nv, self._model.nv)), np.zeros((len(dofs), len(dofs))), self._data
        self._mujoco.mj_fullM(self._model, data, M)
        for column, dof in enumerate(dofs):
            forces = []
            for step in (-STIFFNESS_STEP, 2 * STIFFNESS_STEP):
                data.qpos[dof] += step
                self._mujoco.mj_forward(self._model, data)
                forces.append(data.qfrc_spring[dofs].copy())
            data.qpos[dof] -= STIFFNESS_STEP
            K[:, column] = (forces[0] - forces[1]) / (2 * STIFFNESS_STEP)
        values, shapes = scipy.linalg.eigh((K + K.T) / 2, M[np.ix_(dofs, dofs)], subset_by_index=[0, 0])
        rate = math.sqrt(max(values[0], 0.0))
        return rate / (2 * math.pi), float(self._model.dof_damping[dofs] @ shapes[:, 0] ** 2) / (2 * rate)

    def damp(self) -> None:
        """Damp the joints of the links so that the chain settles soon; its equilibria stay."""
        links = [dof for name, dof in self._joints.items() if name.rstrip("0123456789") in chains.JOINTS]
        self._model.dof_damping[links] *= SETTLING_FACTOR


STIFFNESS_STEP = 1e-6
"""Step of a joint by which its stiffness is measured, rad and m."""
SETTLING_FACTOR = 5.0
"""Damping with which a chain settles, over its own."""
