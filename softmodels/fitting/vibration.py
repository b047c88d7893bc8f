"""Free vibrations of a device: frequency and decay of its first mode, read from a table, and as residuals of a memory."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import scipy.optimize

from softmodels.case.case import Case
from softmodels.common import columns as machine
from softmodels.common.arrays import Array
from softmodels.common.columns import TensileError, in_si
from softmodels.components import loads
from softmodels.fitting import problem
from softmodels.fitting.curves import residuals
from softmodels.fitting.curves.oscillation import FrequencyResiduals, FrequencyTest
from softmodels.materials import silicones, specimens
from softmodels.materials.laws import Material, MaterialError, NeoHookean
from softmodels.path import stability
from softmodels.runs import simulation

TEST = "vibration"


@dataclasses.dataclass(frozen=True, eq=False)
class Vibration(FrequencyTest):
    """The first mode of a device that rings about its undeformed shape.

    Attributes:
        name: Where it comes from.
        root: It goes as exp(root t), 1/s.
        errors: Standard errors of the root's real and imaginary parts, 1/s.
        relaxed, creeping: Stiffness over mass of a shear modulus of 1 Pa, and of branches of share 1, 1/s2, of shape (m, m)
            over a space whose first vector is the mode; see `softmodels.Model.first_mode_stiffness`.
        remarks: Sentences on what was left out.
        source: What was read from which columns of its file.
    """

    name: str
    root: complex
    errors: tuple[float, float]
    relaxed: Array
    creeping: Array
    remarks: tuple[str, ...] = ()
    source: str = ""
    _last: dict[object, complex] = dataclasses.field(default_factory=dict, repr=False)

    @functools.cached_property
    def frequency(self) -> Array:  # type: ignore[override]
        return np.array([self.root.imag / (2 * math.pi)])

    @property
    def measured(self) -> Mapping[str, Array]:  # type: ignore[override]
        return {"frequency": self.frequency, "damping-ratio": np.array([-self.root.real / abs(self.root)])}

    @property
    def start_modulus(self) -> float:
        return float(abs(self.root) ** 2 / self.relaxed[0, 0])

    @property
    def sentence(self) -> str:
        frequency, damping = (float(values[0]) for values in self.measured.values())
        about = "".join(f"; {remark}" for remark in (*filter(None, [self.source]), *self.remarks))
        return f"{self.name} (vibration): {frequency:.5g} Hz, damping ratio {damping:.4g}{about}"

    def root_of(self, modulus: float, shares: Sequence[float], times: Sequence[float]) -> complex:
        """Return the root of its first mode for a shear modulus in Pa and branches; it remembers the last one."""
        known = modulus, tuple(shares), tuple(times)
        if known in self._last:
            return self._last[known]

        def creeping(s: complex) -> Array:
            added = sum(share * s * time / (1.0 + s * time) for share, time in zip(shares, times, strict=True))
            return np.asarray(modulus * added * self.creeping)

        root = stability.damped_roots(modulus * np.diag(self.relaxed)[:1], modulus * self.relaxed, creeping)[0]
        self._last.clear()
        self._last[known] = root
        return root

    def predicted(self, material: Material) -> dict[str, Array]:
        branches = material.memory.branches if material.memory else ()
        root = self.root_of(material.shear_modulus_0, [b.share for b in branches], [b.time for b in branches])
        return dict(dataclasses.replace(self, root=root).measured)

    def sources(
        self, choice: problem.LawChoice, error: residuals.StressError, spectrum: residuals.Spectrum, gauge: str
    ) -> list[FrequencyResiduals[Vibration]]:
        least = 0.0 if error.stated else MODE_ERROR * abs(self.root)
        return [VibrationResiduals(self, choice, spectrum, np.hypot(self.errors, least), gauge)]


MODE_ERROR = 1e-3
"""Error of a mode by mesh, geometry and other modes, as a share of its root, unless errors are stated."""


@dataclasses.dataclass(frozen=True, eq=False)
class VibrationResiduals(FrequencyResiduals[Vibration]):
    """Residuals against a vibration.

    The root s of (s^2 + mu (K + z(s) C)) x = 0, with z = sum g s tau/(1 + s tau), changes by any parameter p as
    -(x.D_p x)/(x.D_s x), D the matrix in brackets, because it is symmetric.

    Attributes:
        errors: Of real and imaginary part.
    """

    unit = "1/s"

    @property
    def label(self) -> str:
        return f"{self.test.name} (vibration)"

    def evaluate(self, values: Mapping[str, float], derivatives: bool) -> tuple[Array, Array | None, list[str]]:
        """See `softmodels.fitting.problem.Residuals`."""
        times = np.array(self.spectrum.times_at(values))
        shares = np.array([values[name] for name in self.spectrum.names])
        gauge = values[self.gauge] if self.gauge else 1.0
        try:
            material = self.choice.material(values)
            modulus = gauge * material.shear_modulus_0
            s = self.test.root_of(modulus, shares.tolist(), times.tolist())
        except (MaterialError, stability.newton.NoConvergence) as error:
            raise problem.CannotEvaluate(str(error)) from None
        off = s - self.test.root
        rows, labels = np.array([off.real, off.imag]) / self.errors, [self.label] * 2
        if not derivatives:
            return rows, None, labels
        K, C, falls = self.test.relaxed, self.test.creeping, 1.0 + s * times
        stiffness = K + shares @ (s * times / falls) * C
        squares, shapes = np.linalg.eig(np.linalg.inv(modulus * stiffness))
        x = shapes[:, int(np.argmin(np.abs(squares * s**2 + 1.0)))]
        pulled, creeps = x @ stiffness @ x, modulus * (x @ C @ x)
        by_s = 2.0 * s * (x @ x) + creeps * (shares @ (times / falls**2))
        slopes = [gauge * slope * pulled for slope in specimens.modulus_slopes(material, self.choice.names)]
        slopes += list(creeps * s * times / falls)
        if self.spectrum.fitted:
            slopes += list(creeps * s * shares / falls**2)
        if self.gauge:
            slopes.append(material.shear_modulus_0 * pulled)
        changes = -np.array(slopes) / by_s
        return rows, np.array([changes.real, changes.imag]) / self.errors[:, None], labels


# ----------------------------------------------------------------------------------------------------------------------
# The root of a recorded vibration.


MIN_PERIODS = 3
MIN_READINGS_PER_PERIOD = 6
NO_GRAVITY = 1e-9
"""Acceleration in m/s2 that stands for none: masses and plates need a gravity."""


def read(path: Path, case: Path, columns: str = "", poisson: float = 0.5) -> list[Vibration]:
    """Read the free vibrations of a table with columns of time and displacement or acceleration.

    Args:
        case: Case file of the device, whose first mode it shows.
        columns: Which columns to take, such as ``"time=1[s],extension=2[mm]"``; empty to go by the headers.
        poisson: Poisson's ratio of the fitted material.

    Raises:
        TensileError: The file cannot be used.
        CaseError, RunError: The device cannot.
    """
    told = machine.columns_of_text(columns, machine.VIBRATION) if columns else {}
    try:
        recorded = machine.read_tables(path, told, machine.VIBRATION)
        roots = []
        for table in recorded:
            time = in_si(table.x, table.deformation) if table.deformation.unit else table.x
            roots.append(root_of(time, table.y))
    except TensileError as error:
        raise TensileError(f"{path}: {error}") from None
    relaxed, creeping, remarks = stiffness_of(Case.from_file(case), poisson)
    return [
        Vibration(
            f"{path.name} {table.label}".strip(), root, errors, relaxed, creeping, remarks,
            f"first mode of {case.name}, {table.deformation.sentence}, {table.load.sentence}",
        )
        for table, (root, errors) in zip(recorded, roots, strict=True)
    ]  # fmt: skip


def stiffness_of(case: Case, poisson: float) -> tuple[Array, Array, tuple[str, ...]]:
    """Return `Vibration.relaxed` and ``creeping`` of a device, and remarks on what of its case is left out."""
    if any(getattr(part, "material", None) is not None for part in case.components):
        raise TensileError(f"{case.name} has regions of other silicones, whose branches a vibration does not tell apart")
    law, unit = NeoHookean(case.material.shear_modulus_0, poisson), 1.0 / case.material.shear_modulus_0
    parts = tuple(
        dataclasses.replace(part, magnitude=NO_GRAVITY) if isinstance(part, loads.Gravity) else part
        for part in loads.weighed(case.components, case.material)
    )
    hangs = any(isinstance(part, loads.Gravity) for part in parts)
    if not hangs:
        unit *= silicones.density_of(law) / silicones.density_of(case.material)
    model = simulation.Model(case.actuator, law.with_memory(branches=[(1.0, 1.0)]), parts)
    relaxed, creeping = model.first_mode_stiffness()
    return unit * relaxed, unit * creeping, ("about the undeformed device: its weight is left out",) if hangs else ()


def root_of(time: Array, values: Array) -> tuple[complex, tuple[float, float]]:
    """Return the root of a ringing signal in 1/s, and the standard errors of its parts, from its scatter: a damped sine, what
    creeps back by an exponential, and a constant, whose amplitudes enter linearly. Its first period is left out, in which
    branches as fast as it creep back too.

    Args:
        time: In s, rising, shape (n,).
        values: In any unit, shape (n,).

    Raises:
        TensileError: It does not ring, or is too short.
    """
    if len(time) < MIN_PERIODS * MIN_READINGS_PER_PERIOD or (np.diff(time) <= 0.0).any():
        raise TensileError(f"a vibration needs {MIN_PERIODS * MIN_READINGS_PER_PERIOD} readings or more, at times that rise")
    time, size = time - time[0], float(np.ptp(values))
    duration = float(time[-1])
    even = np.linspace(0.0, duration, len(time))
    power = np.abs(np.fft.rfft((np.interp(even, time, values) - values.mean()) * np.hanning(len(time))))
    power[:2] = 0.0
    turn = 2 * math.pi * int(np.argmax(power)) / duration
    periods = turn * duration / (2 * math.pi)
    if not size > 0.0 or periods < MIN_PERIODS or len(time) < MIN_READINGS_PER_PERIOD * periods:
        raise TensileError(
            f"no vibration of {MIN_PERIODS} periods or more with {MIN_READINGS_PER_PERIOD} readings in each was found; record "
            "it longer, or more often"
        )
    kept = time >= 2 * math.pi / turn
    time, values, duration = time[kept], values[kept], duration - 2 * math.pi / turn

    def waves(x: Array) -> Array:
        fall, turn, creep = x / duration
        ringing = np.exp(-fall * time)
        basis = [ringing * np.cos(turn * time), ringing * np.sin(turn * time), np.exp(-creep * time), np.ones_like(time)]
        return np.column_stack(basis)

    def misfit(x: Array) -> Array:
        A = waves(x)
        return np.asarray(A @ np.linalg.lstsq(A, values / size, rcond=None)[0] - values / size)

    least, most = 1e-3, 10 * periods
    starts = [[fall, turn * duration, 3.0] for fall in (1.0, 5.0)]
    bounds = [least, 0.5 * turn * duration, 0.5], [most, 2.0 * turn * duration, most]
    fits = [scipy.optimize.least_squares(misfit, start, bounds=bounds, x_scale=[1.0, periods, 1.0]) for start in starts]
    best = min(fits, key=lambda fit: fit.cost)
    spread = math.sqrt(2 * best.cost / max(len(time) - 7, 1)) * math.sqrt(problem.autocorrelation_time(best.fun))
    information = best.jac.T @ best.jac
    errors = spread * np.sqrt(np.diag(np.linalg.pinv(information))) / duration
    fall, turn, _ = best.x / duration
    if errors[0] > fall or fall <= 1.01 * least / duration:
        raise TensileError("the vibration does not decay by more than its noise; record it longer")
    return complex(-fall, turn), (float(errors[0]), float(errors[1]))
