"""Measured curves of test specimens: read a machine's file into stretch and nominal stress, or explain the error."""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from softmodels.common import columns as machine, errors, names, schema
from softmodels.common.arrays import Array
from softmodels.common.columns import KINDS, LEAST_POINTS, LOADS, CurveColumn, CurveTable, TensileError, in_si
from softmodels.common.names import checked
from softmodels.common.units import brief
from softmodels.materials import laws, specimens


@checked
@dataclasses.dataclass(frozen=True, eq=False)
class TensileCurve:
    """A loading ramp, or with times the whole history of a test.

    Attributes:
        name: Where it comes from.
        mode: ``"uniaxial"``, ``"planar"`` or ``"equibiaxial"``; a balloon's curve is equibiaxial.
        stretch: Rising, shape (n,); in the order of the test where there are times.
        stress: Nominal stress in Pa, shape (n,).
        remarks: Sentences on what was left out, and on the rate.
        noise: Standard deviation in Pa of the readings that its points are averages of, with times one per point; None if
            they are readings themselves.
        readings: Readings per point, with times one number per point.
        time: In s, not falling, shape (n,). Only fits of a memory look at it; a curve without times is taken there as
            so slow that the silicone is relaxed at each point.
        loop: Area between first loading and unloading over the work of the loading; 0 where it does not unload.
        origin: The slack and the load cell's zero that are taken off stretch and stress already; None for none.
        source: What was read from which columns of its file, a clause; empty for a curve from elsewhere.
        raw: Stretch and nominal stress in Pa of all readings of its file, shape (2, n); None for a curve from elsewhere.
    """

    name: str
    mode: str
    stretch: Array
    stress: Array
    remarks: tuple[str, ...] = ()
    noise: float | Array | None = None
    readings: float | Array = 1.0
    time: Array | None = None
    loop: float = 0.0
    origin: Origin | None = None
    source: str = ""
    raw: Array | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise TensileError(f"the name of a curve is {brief(self.name)}; it must be a text")
        if not isinstance(self.mode, str) or self.mode not in specimens.MODES:
            known = errors.known_are(self.mode, specimens.MODES)
            raise TensileError(f"{self.name}: the test {brief(self.mode)} is unknown; {known}")
        for name, kind in (
            ("stretch", schema.Quantity()),
            ("stress", schema.Quantity("Pa")),
            ("time", schema.Quantity("s")),
        ):
            if name != "time" or self.time is not None:
                object.__setattr__(self, name, self._column(name, getattr(self, name), kind))
        if len(self.stretch) != len(self.stress):
            raise TensileError(
                f"{self.name}: {len(self.stretch)} stretches but {len(self.stress)} stresses; give equal numbers"
            )
        if self.time is not None and (len(self.time) != len(self.stretch) or (np.diff(self.time) < 0.0).any()):
            raise TensileError(f"{self.name}: the times must be as many as the stretches ({len(self.stretch)}) and not fall")
        if not len(self.stretch):
            raise TensileError(f"{self.name}: the curve is empty; give stretches and stresses")
        names.keep_arrays(self)

    def _column(self, name: str, values: object, kind: schema.Quantity) -> Array:
        """Return a copy of a column, protected from changes; `TensileError` for something else than finite numbers."""
        try:
            if type(values) is np.ndarray and values.dtype.kind in "iuf" and values.ndim == 1:
                column = np.array(values, dtype=np.float64)
            else:
                column = np.array(schema.Several(kind).settled(name, values), dtype=np.float64)
        except errors.FieldError as error:
            raise TensileError(f"{self.name}: {error}") from None
        if not np.isfinite(column).all():
            raise TensileError(f"{self.name}: {name} has a number that is not finite")
        return column

    def check(self) -> TensileCurve:
        """Return the curve itself after checking that it is plausible for silicone in its unit.

        Raises:
            TensileError: Why not.
        """
        for why in self._implausible():
            raise TensileError(f"{self.name}: {why}")
        return self

    def _implausible(self) -> Iterator[str]:
        """Yield what is implausible; each is asked only where nothing before it is."""
        if len(self.stretch) < LEAST_POINTS:
            yield f"the curve has {len(self.stretch)} points; at least {LEAST_POINTS} are needed"
        low, high = self.stretch.min(), self.stretch.max()
        if high > MAX_STRAIN:
            yield (
                f"a stretch of {high:.4g} is more than any silicone can take ({MAX_STRAIN:g}); if these are percent, divide "
                "them by 100 (a strain in percent is a stretch of 1 + strain / 100)"
            )
        if low <= 0.0:
            hint = "; values starting at 0 are strains: add 1" if low == 0.0 else ""
            yield f"a stretch of {low:.4g} is not above zero{hint}"
        top = float(np.abs(self.stress).max())
        if low < MIN_FIRST_STRETCH and abs(self.stress[np.argmin(self.stretch)]) < AT_REST * top:
            yield f"the stretch starts at {low:.4g} without stress instead of near 1: these seem to be strains; add 1"
        if self.time is None and (np.diff(self.stretch) < 0.0).any():
            yield "the stretch does not rise from row to row; give one loading ramp, sorted"
        if top == 0.0:
            yield "every stress is zero"
        at_rest = np.abs(self.stress[np.abs(self.stretch - 1) < AT_STRETCH_1])
        if len(at_rest) and at_rest.min() > LARGEST_ZERO * top and high > 1.2:
            yield (
                f"the stress at stretch 1 is {at_rest.min() / 1e3:.4g} kPa instead of zero, more than half of the largest one; "
                "subtract the load cell's offset first"
            )
        modulus, least = small_modulus(taut(self)), SOFTEST_TEST
        if not modulus > 0.0:
            yield "the stress decreases with the stretch; check its sign and the columns"
        if not modulus >= least:
            yield (
                f"the curve starts with a shear modulus of {modulus / 1e3:.3g} kPa; silicones and soft rubbers have "
                f"{least / 1e3:g} kPa or more, so check the unit of the stress (a factor 1000?)"
            )

    @property
    def stiff(self) -> str:
        """A sentence if it is stiffer than silicones and soft rubbers; else empty."""
        modulus = small_modulus(self)
        if modulus <= laws.MAX_SHEAR_MODULUS:
            return ""
        return (
            f"{self.name} starts with a shear modulus of {modulus / 1e6:.3g} MPa; silicones and soft rubbers have at most "
            f"{laws.MAX_SHEAR_MODULUS / 1e6:g} MPa, so check the unit of the stress (a factor 1000?)"
        )

    def counting_from(self, slack: float, zero: float) -> TensileCurve:
        """Return the curve with another slack and zero of the load cell (Pa) taken off, see `origin`."""
        if self.origin is None:
            return self
        stretch, stress = self.stretch - (slack - self.origin.slack), self.stress - (zero - self.origin.zero)
        return dataclasses.replace(
            self, stretch=stretch, stress=stress, origin=dataclasses.replace(self.origin, slack=slack, zero=zero)
        )

    def within(self, low: float, high: float) -> TensileCurve:
        """Return the part between two stretches.

        Raises:
            TensileError: Too few points are left.
        """
        keep = (self.stretch >= low) & (self.stretch <= high)
        if self.time is not None:
            raise TensileError(f"{self.name}: a range of stretch cannot be cut out of a test with times; leave it out")
        if keep.sum() < LEAST_POINTS:
            raise TensileError(
                f"{self.name}: {keep.sum()} of its points are between stretch {low:g} and {high:g}; at least "
                f"{LEAST_POINTS} are needed. It covers {self.stretch[0]:.4g} to {self.stretch[-1]:.4g}"
            )
        return dataclasses.replace(self, stretch=self.stretch[keep], stress=self.stress[keep])

    def ramp(self) -> TensileCurve:
        """Return the loading ramp, with remarks on the rest of the test; without times the curve itself.

        Raises:
            TensileError: There is none.
        """
        return self if self.time is None else _ramp_of(self)


EQUILIBRIUM_RATE = 0.0
"""Rate of a test so slow that the silicone is relaxed at each point."""


def read_curves(
    path: Path,
    test: str = "uniaxial",
    columns: str = "",
    specimen: Specimen | None = None,
    *,
    history: bool = False,
    rate: float | None = None,
) -> list[TensileCurve]:
    """Read the curve of each specimen in a text or Excel workbook with one row per reading, under a header that names the
    columns with their units; or the units stand in a row below it. `TensileError`, which names the file, if it cannot be used.

    Args:
        test: One of `TESTS`, or a synonym; ``"compression"`` is uniaxial, with positive numbers for what is compressed.
        columns: Which columns to take, see `columns.columns_of_text`; empty to go by the headers.
        specimen: Its sizes, where the file has forces, extensions or pressures but no such sizes itself.
        history: Return the whole test with its times; else the loading ramp.
        rate: Of the stretch in 1/s, instead of a column of times; `EQUILIBRIUM_RATE` for none.
    """
    if not isinstance(test, str) or test.lower() not in SYNONYMS:
        raise TensileError(f"test {brief(test)} is not one of {', '.join(TESTS)}{errors.meant(test, SYNONYMS)}")
    told = machine.columns_of_text(columns) if columns else {}
    try:
        tables = machine.read_tables(path, told)
    except TensileError as error:
        raise TensileError(f"{path}: {error}") from None
    if test.lower() == COMPRESSION:
        tables = [_pressed(table) for table in tables]
    elif test.lower() == "uniaxial":
        _check_title(path, tables)
    kind = SYNONYMS[test.lower()]
    return [_curve_of(path, table, kind, bool(told), specimen or Specimen(), history, rate) for table in tables]


def _curve_of(
    path: Path, table: CurveTable, kind: str, told: bool, given: Specimen, history: bool, rate: float | None
) -> TensileCurve:
    name = f"{path.name} {table.label}".strip()
    where = f"{path}: {table.label}" if table.label else str(path)
    specimen, sized = given.completed(table.sizes, {table.deformation.kind, table.load.kind})
    try:
        table = _as_compression(table)
        if not told:
            _check_start(table.x, table.y, table.deformation, specimen)
        stretch = _stretch(table.x, table.deformation, specimen)
        stress = _nominal(table.y, table.load, stretch, kind, specimen)
        _check_directions(stretch, stress, table.deformation, table.load)
        time = table.time
        if rate is not None:
            way = np.cumsum(np.abs(np.diff(stretch, prepend=stretch[0])))
            time = None if rate == EQUILIBRIUM_RATE else way / rate
        if history and time is None and rate is None:
            raise TensileError(
                f"{table.untimed}; a fit of the memory needs times, or FILE:TEST:RATE, such as {path.name}:{kind}:0.05/s, "
                f"or {path.name}:{kind}:equilibrium for a test so slow that the silicone was relaxed"
            )
    except TensileError as error:
        raise TensileError(f"{where}: {error}") from None
    pressed = "compression" if direction(stretch) < 0 else ""
    source = "; ".join(filter(None, [f"{table.deformation.sentence}, {table.load.sentence}", sized, pressed]))
    mode = "equibiaxial" if kind == "balloon" else kind
    whole = TensileCurve(where, mode, stretch, stress, time=time, source=source, raw=np.array([stretch, stress]))
    whole = without_jumps(whole, [f"line {number}" for number in table.lines])
    curve = (_history_before_break(whole) if history and time is not None else _ramp_of(whole)).check()
    if curve.stiff:
        try:
            _check_units(table, stretch, stress, kind, specimen)
        except TensileError as error:
            raise TensileError(f"{where}: {error}") from None
    return dataclasses.replace(curve, name=name)


def _pressed(table: CurveTable) -> CurveTable:
    """Return the table of a compression: columns without a sign whose numbers are positive say it."""
    own = [
        dataclasses.replace(column, sign=-1) if not column.sign and (column.kind == "stretch" or values.sum() > 0.0) else column
        for column, values in ((table.deformation, table.x), (table.load, table.y))
    ]
    return dataclasses.replace(table, deformation=own[0], load=own[1])


def _check_title(path: Path, tables: Sequence[CurveTable]) -> None:
    """Reject numbers that count as tension where the lines above them or the file's name say compression or bending."""
    for table in tables:
        said = table.title
        for name in (path.name, table.deformation.header, table.load.header):
            said = said or (name if machine.BENDING_TEST.search(name.replace("_", " ")) else "")
        if machine.BENDING_TEST.search(said.replace("_", " ")):
            raise TensileError(
                f"{path}: {said!r} says bending, and a force over a deflection is no curve of tension; for a test of tension "
                f"give {path.name}:tension"
            )
        said = said or (path.name if machine.COMPRESSION_TEST.search(path.name) else "")
        rest = 1.0 if table.deformation.kind == "stretch" else 0.0
        if said and not table.deformation.sign and not table.load.sign and (table.x - rest).sum() > 0.0:
            raise TensileError(
                f"{path}: {said!r} says compression, but {table.deformation.header!r} and {table.load.header!r} are positive, "
                f"as in tension; give the test as compression or tension, such as {path.name}:{COMPRESSION}"
            )


def _as_compression(table: CurveTable) -> CurveTable:
    """Return a table whose two columns say compression and hold negative numbers as one whose numbers count as in tension."""
    if table.deformation.sign < 0 and table.load.sign < 0 and table.x.max() <= -table.x.min() * WRONG_SIGN:
        own = [dataclasses.replace(column, sign=0) for column in (table.deformation, table.load)]
        if table.deformation.kind != "stretch" and table.y.max() <= -table.y.min() * WRONG_SIGN:
            return dataclasses.replace(table, deformation=own[0], load=own[1])
    return table


def _history_before_break(curve: TensileCurve) -> TensileCurve:
    """Return a history up to the break: where more than half of a large stress is lost for good from one reading to the next,
    and not by unloading."""
    way = direction(curve.stretch)
    x, y = way * curve.stretch, way * curve.stress
    lost = (
        (_falling_envelope(y)[1:] < BREAK_STRESS_SHARE * y[:-1])
        & (y[:-1] > BREAK_STRESS_SHARE * y.max())
        & (x[1:] > x[:-1] - REVERSAL_TOLERANCE * np.ptp(x))
    )
    if not lost.any():
        return curve
    end = int(np.argmax(lost)) + 1
    x, y = curve.stretch, curve.stress
    remarks = (*curve.remarks, f"{len(x) - end} points after the break at stretch {x[end - 1]:.4g} are left out")
    assert curve.time is not None
    return dataclasses.replace(curve, stretch=x[:end], stress=y[:end], time=curve.time[:end], remarks=remarks)


def _stretch(x: Array, column: CurveColumn, specimen: Specimen) -> Array:
    values = _tension_positive(in_si(x, column), column)
    if column.kind in ("strain", "true-strain") and (most := float(np.abs(values).max())) > MAX_STRAIN:
        raise TensileError(
            f"the column {column.header!r} reaches a strain of {most:.4g}; if it is in percent, give "
            f"--columns '{column.kind}={column.place + 1}[%]'"
        )
    if column.kind == "strain":
        stretch = 1 + values
    elif column.kind == "true-strain":
        stretch = np.exp(values)
    elif column.kind == "extension":
        if specimen.gauge_length is None:
            raise TensileError(f"the column {column.header!r} is a length; give the specimen's with --gauge-length")
        stretch = 1 + values / specimen.gauge_length
    elif column.kind == "radius":
        if specimen.radius is None:
            raise TensileError(f"the column {column.header!r} is a radius; give the undeformed one with --radius")
        stretch = values / specimen.radius
    else:
        stretch = values
    if stretch.min() <= 0.0:
        strains = f"; a column starting at 0 holds strains: --columns strain={column.place + 1}"
        hint = strains if column.kind == "stretch" else ""
        raise TensileError(f"the column {column.header!r} gives a stretch of {stretch.min():.4g}{hint}")
    if column.kind != "strain" and stretch.max() > MAX_STRAIN:
        raise TensileError(f"the column {column.header!r} gives a stretch of {stretch.max():.4g}; check its unit")
    return np.asarray(stretch, dtype=float)


def _check_start(x: Array, y: Array, column: CurveColumn, specimen: Specimen) -> None:
    """Reject a column that does not start near the undeformed state, as its header requires; one given with --columns may."""
    values = in_si(x, column)
    place, name = column.place + 1, column.header
    if column.kind in ("strain", "true-strain") and MAX_FIRST_STRAIN <= values.min() < MAX_STRAIN:
        shown = f"{x.min():.5g}" + (" %" if column.unit == "percent" else "")
        unit = "[%]" if column.unit == "percent" else ""
        raise TensileError(
            f"the column {name!r} starts at {shown} instead of near 0, so it seems to hold stretches; rename it to "
            f"'stretch' or give --columns stretch={place}{unit}; if the curve really starts at that strain, give "
            f"--columns {column.kind}={place}{unit}"
        )
    length = specimen.gauge_length
    if column.kind == "extension" and length and values.min() >= MAX_FIRST_STRAIN * length:
        raise TensileError(
            f"the column {name!r} begins at {x.min():.5g} {column.unit} instead of near 0, so it seems to "
            f"hold the specimen's length; subtract the first length, or give "
            f"--columns 'extension={place}[{column.unit}]' if the curve really starts there"
        )
    at_rest = abs(y[np.argmin(values)]) < AT_REST * np.abs(y).max()
    if column.kind == "stretch" and 0.0 < values.min() < MIN_FIRST_STRETCH and at_rest:
        raise TensileError(
            f"the column {name!r} begins at {x.min():.5g} without stress instead of near 1, so it seems "
            f"to hold strains; rename it to 'strain' or give --columns strain={place}"
        )


def _nominal(y: Array, column: CurveColumn, stretch: Array, test: str, specimen: Specimen) -> Array:
    values = _tension_positive(in_si(y, column), column)
    if (column.kind == "pressure") != (test == "balloon"):
        raise TensileError(f"a {test} test cannot have a column {column.header!r}")
    if column.kind == "pressure":
        if specimen.radius is None or specimen.thickness is None:
            raise TensileError("a balloon needs its undeformed --radius and --thickness")
        # The sheet's nominal stress in a thin sphere: P = 2 (t/R) S / stretch^2.
        return np.asarray(values * stretch**2 * specimen.radius / (2 * specimen.thickness))
    if column.kind == "true-stress":
        return np.asarray(values / stretch)  # ratio of the deformed area at constant volume
    if column.kind == "force":
        if specimen.cross_section is None:
            raise TensileError(f"the column {column.header!r} is a force; give the specimen's --cross-section")
        return np.asarray(values / specimen.cross_section)
    return values


def _ramp_of(curve: TensileCurve) -> TensileCurve:
    """Return the loading ramp of a test, up to the first reversal or the break, in rising order."""
    try:
        stretch, stress, remarks, used = _ramp(curve.stretch, curve.stress)
    except TensileError as error:
        raise TensileError(f"{curve.name}: {error}") from None
    paced = [] if curve.time is None else pace(curve.time[used], curve.stretch[used])
    area = loop(curve.stretch, curve.stress)
    return dataclasses.replace(
        curve, stretch=stretch, stress=stress, time=None, loop=area, remarks=(*curve.remarks, *remarks, *paced)
    )


def _ramp(stretch: Array, stress: Array) -> tuple[Array, Array, list[str], slice]:
    """Return the loading ramp, remarks on what was left out, and the place of the ramp."""
    remarks = []
    span = float(np.ptp(stretch))
    if span < 1e-3:
        raise TensileError(f"the stretch does not change ({stretch.min():.4g} to {stretch.max():.4g})")
    way = direction(stretch)
    fallen = np.maximum.accumulate(way * stretch) - way * stretch > REVERSAL_TOLERANCE * span
    if fallen.any():
        end = int(np.argmax((way * stretch)[: np.argmax(fallen) + 1])) + 1
        if stretch[:end].max() - stretch[:end].min() < 0.5 * span or end < LEAST_POINTS:
            raise TensileError("the stretches are not in order; sort the rows, or cut one loading ramp out of the cycles")
        remarks.append(f"{len(stretch) - end} points after the reversal of the stretch at {stretch[end - 1]:.4g} are left out")
        stretch, stress = stretch[:end], stress[:end]
    load = way * stress
    peak = int(np.argmax(load))
    if (
        load[peak] > BREAK_STRESS_SHARE * np.abs(load).max()
        and (_falling_envelope(load)[peak:] < BREAK_STRESS_SHARE * load[peak]).any()
    ):
        end = peak + 1
        remarks.append(f"{len(stretch) - end} points after the break at stretch {stretch[end - 1]:.4g} are left out")
        stretch, stress = stretch[:end], stress[:end]
    used = slice(0, len(stretch))
    order = np.argsort(stretch, kind="stable")  # the remaining disorder is noise of the strain
    stretch, stress = stretch[order], stress[order]
    if len(stretch) < LEAST_POINTS:
        raise TensileError(f"the loading ramp has {len(stretch)} points; at least {LEAST_POINTS} are needed")
    return stretch, stress, remarks, used


def _falling_envelope(load: Array) -> Array:
    """Return the largest value from each reading on, shape (n,): what falls below half of a load for good is broken."""
    return np.asarray(np.maximum.accumulate(load[::-1])[::-1])


# ----------------------------------------------------------------------------------------------------------------------
# Signs and units of columns compared with each other.


WRONG_SIGN = 0.05
"""Largest value of the wrong sign, as a share of the largest one, that is noise."""


def _tension_positive(values: Array, column: CurveColumn) -> Array:
    """Return a column's numbers in SI units with tension positive (a stretch above 1); `TensileError` where they contradict
    what its header says."""
    if not column.sign:
        return values
    own = (values - 1.0 if column.kind == "stretch" else values) * (column.sign if column.kind == "stretch" else 1)
    # A load may well change its sign on the way back, a deformation does not.
    worst = float(own[np.argmax(np.abs(own))] if column.kind in LOADS else own.min())
    if worst < -WRONG_SIGN * float(np.abs(own).max()):
        said, other = ("compression", "tension") if column.sign < 0 else ("tension", "compression")
        raise TensileError(
            f"the column {column.header!r} says {said}, but a value of it is {other} ({float(values[np.argmin(own)]):.4g} "
            f"{KINDS[column.kind]}".rstrip()
            + f"); correct its sign, or call it {column.kind!r}, which is positive in tension"
        )
    return values if column.kind == "stretch" else column.sign * values


OTHER_UNIT = 10.0
"""Ratio of a file's loads from which on their units contradict each other."""


def _check_units(table: CurveTable, stretch: Array, stress: Array, test: str, specimen: Specimen) -> None:
    """Reject a stress that another load of the same file contradicts by a factor of ten or more."""
    for read in table.others:
        with contextlib.suppress(TensileError):  # one that cannot be used contradicts nothing
            other = read()
            ratio = float(stress @ stress) / float(stress @ _nominal(other.y, other.load, stretch, test, specimen))
            if not 1 / OTHER_UNIT < ratio < OTHER_UNIT:
                break
    else:
        return
    raise TensileError(
        f"the columns {table.load.header!r} and {other.load.header!r} contradict each other: the first gives {ratio:.3g} times "
        "the stress of the second; check their units, and the cross-section"
    )


def _check_directions(stretch: Array, stress: Array, deformation: CurveColumn, load: CurveColumn) -> None:
    """Reject a tension in one column that is a compression in the other."""
    work = stress * (stretch - 1.0)
    if work.sum() < -0.5 * np.abs(work).sum():
        compressed = next((column.header for column in (deformation, load) if column.sign < 0), None)
        why = f" ({compressed!r} means compression)" if compressed else ""
        raise TensileError(
            f"the columns {deformation.header!r} and {load.header!r} contradict each other: one is tension where the other is "
            f"compression{why}; check the signs and the columns"
        )


TESTS = (*specimens.MODES, "balloon")
SYNONYMS = {
    "uniaxial": "uniaxial", "ut": "uniaxial", "tension": "uniaxial", "compression": "uniaxial",
    "planar": "planar", "pure-shear": "planar", "ps": "planar",
    "equibiaxial": "equibiaxial", "biaxial": "equibiaxial", "et": "equibiaxial", "bulge": "equibiaxial",
    "balloon": "balloon",
}  # fmt: skip
COMPRESSION = "compression"
"""The synonym that says in which direction the numbers are positive."""
SOFTEST_TEST = 1e3
"""Minimum shear modulus in Pa of a silicone's test; below it a wrong unit is assumed."""
AT_STRETCH_1 = 0.005
"""Largest distance from stretch 1 of an undeformed specimen."""
LARGEST_ZERO = 0.5
"""Largest stress at stretch 1, as a share of the largest one, that can be the load cell's zero."""
REVERSAL_TOLERANCE = 0.02
"""Decrease of the stretch, relative to the range, that counts as a reversal."""
BREAK_STRESS_SHARE = 0.5
"""Fraction of the largest stress below which a specimen counts as broken."""
MAX_FIRST_STRAIN, MIN_FIRST_STRETCH = 0.5, 0.3
"""Maximum first value of a strain column, and minimum of a stretch column."""
AT_REST = 0.05
"""Fraction of the largest stress below which a specimen counts as stress-free."""
MAX_STRAIN = 30.0
"""Strain no silicone can take: a column that reaches it is in percent."""


@checked
@dataclasses.dataclass(frozen=True)
class Specimen:
    """Undeformed specimen data not in the file: cross-section in m2 for forces, gauge length in m for extensions, radius
    and thickness in m of a balloon."""

    cross_section: float | None = None
    gauge_length: float | None = None
    radius: float | None = None
    thickness: float | None = None

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if value is not None and not (math.isfinite(value) and value > 0.0):
                raise TensileError(f"{name.replace('_', ' ')} is {value:g}; it must be above zero")

    def completed(self, sizes: Mapping[str, float], kinds: Collection[str]) -> tuple[Specimen, str]:
        """Return the sizes with those of a file (see `columns.SIZES`) that columns of these kinds need and are not given, and a
        clause that names them."""
        area, length = sizes.get("cross_section"), sizes.get("gauge_length", sizes.get("length"))
        if area is None and "width" in sizes and "thickness" in sizes:
            area = sizes["width"] * sizes["thickness"]
        elif area is None and "diameter" in sizes:
            area = math.pi / 4 * sizes["diameter"] ** 2
        area = area if "force" in kinds and self.cross_section is None else None
        length = length if "extension" in kinds and self.gauge_length is None else None
        said = [
            *([f"cross-section {area * 1e6:.4g} mm2 by the file"] if area else []),
            *([f"gauge length {length * 1e3:.4g} mm by the file"] if length else []),
        ]
        own = {name: value for name, value in (("cross_section", area), ("gauge_length", length)) if value}
        return (dataclasses.replace(self, **own) if own else self), ", ".join(said)


@dataclasses.dataclass(frozen=True)
class Origin:
    """What the rows of a test count from: the stretch at which the specimen is taut and the stress in Pa without a load, as
    recorded, with standard errors of what is known of each before a fit; None where that is nothing."""

    slack: float
    zero: float
    slack_error: float | None = None
    zero_error: float | None = None


# ----------------------------------------------------------------------------------------------------------------------
# The course of a test in time.


CORNER_TOLERANCE = 0.005
"""Tolerance of the straight parts of a history of stretch, relative to its range."""
MIN_HOLD_SHARE = 0.05
"""Share of a test's time from which on a hold is reported."""
MOST_CORNERS = 400


def corners(time: Array, stretch: Array) -> list[int]:
    """Return the places between which the stretch is straight in time (Douglas & Peucker 1973), first and last included.
    Noise beyond `CORNER_TOLERANCE` of the range widens the tolerance, so that it makes no corners."""
    tolerance = CORNER_TOLERANCE * float(np.ptp(stretch))
    while True:
        corners, open_ends = {0, len(time) - 1}, [(0, len(time) - 1)]
        while open_ends and len(corners) <= MOST_CORNERS:
            a, b = open_ends.pop()
            if b - a < 2:
                continue
            line = np.interp(time[a : b + 1], (time[a], time[b]), (stretch[a], stretch[b]))
            off = np.abs(stretch[a : b + 1] - line)
            middle = a + int(off.argmax())
            if off.max() > tolerance and a < middle < b:
                corners.add(middle)
                open_ends += [(a, middle), (middle, b)]
        if len(corners) <= MOST_CORNERS:
            return sorted(corners)
        tolerance *= 2


def segments(time: Array, stretch: Array) -> list[tuple[int, int, bool]]:
    """Return the straight parts of a history of stretch: first and last place, and whether it is held there."""
    places, still = corners(time, stretch), REVERSAL_TOLERANCE * float(np.ptp(stretch))
    return [(a, b, bool(abs(stretch[b] - stretch[a]) < still)) for a, b in itertools.pairwise(places)]


def pace(time: Array, stretch: Array) -> list[str]:
    """Return remarks on the rate of a test, and on the time for which it was held."""
    parts = segments(time, stretch)
    dt = np.array([time[b] - time[a] for a, b, _ in parts])
    dx = np.array([abs(stretch[b] - stretch[a]) for a, b, _ in parts])
    moving = np.array([not held for *_, held in parts])
    said = []
    if dt[moving].sum() > 0.0:
        said.append(f"stretched at {dx[moving].sum() / dt[moving].sum():.2g} /s; the modulus is that of this rate")
    if (held := float(dt[~moving].sum())) > MIN_HOLD_SHARE * float(dt.sum()):
        said.append(f"held for {held:.3g} s")
    return said


def direction(stretch: Array) -> int:
    """Return the direction in which a test leaves rest: 1 upwards, -1 downwards, as in compression."""
    first = stretch[turns(stretch)[1]]
    falls = first < stretch[0] and (first == stretch[-1] or abs(stretch[0] - 1) <= abs(first - 1))
    return -1 if falls else 1


def turns(stretch: Array) -> list[int]:
    """Return the places of the reversals of a history of stretch, first and last included."""
    room, places, way = REVERSAL_TOLERANCE * float(np.ptp(stretch)), [0], 0
    last = 0
    for i, value in enumerate(stretch):
        if way == 0:
            if abs(value - stretch[0]) > room:
                way, last = (1 if value > stretch[0] else -1), i
        elif (value - stretch[last]) * way >= 0.0:
            last = i
        elif (stretch[last] - value) * way > room:
            places.append(last)
            way, last = -way, i
    return [*places, len(stretch) - 1]


def loop(stretch: Array, stress: Array) -> float:
    """Return the area between the first loading and unloading over the work of the loading; 0 without an unloading."""
    if len(stretch) < LEAST_POINTS:
        return 0.0
    way, places = direction(stretch), turns(stretch)
    stretch, stress = way * stretch, way * stress
    if len(places) < 3:
        return 0.0
    up, down = (slice(a, b + 1) for a, b in itertools.pairwise(places[:3]))
    if down.stop - down.start < LEAST_POINTS or stretch[places[1]] < stretch[0]:
        return 0.0
    low = float(max(stretch[up].min(), stretch[down].min()))

    def work(part: slice) -> float:
        order = np.argsort(stretch[part], kind="stable")
        x, y = stretch[part][order], stress[part][order]
        grid = np.r_[low, x[x > low]]
        return float(np.trapezoid(np.interp(grid, x, y), grid))

    return max(1.0 - work(down) / work(up), 0.0) if work(up) > 0.0 else 0.0


# ----------------------------------------------------------------------------------------------------------------------
# Noise, and single readings that jump.


MIN_POINTS_FOR_NOISE = 30
"""Minimum number of points to separate the noise of a curve from its curvature."""
MIN_JUMP_SHARE, MIN_JUMP_ERRORS, MIN_JUMP_RANGES = 0.02, 8.0, 3.0
"""Least distance of a jump from the readings around it: as a share of the largest value, in standard deviations of the
noise, and in ranges of these readings."""
NAMED_JUMPS = 5


def noise_of(curve: TensileCurve) -> float | Array:
    """Return the standard deviation in Pa of a curve's noise, 0 where the points are too few to tell it from the bend; with
    times one per reading, (n,): that of the moving or of the holding parts, because a drive that runs shakes the load cell."""
    if curve.time is None:
        return _scatter(np.diff(curve.stress, 3))
    noise = np.full(len(curve.stress), _scatter(np.diff(curve.stress, 3)))
    parts = segments(curve.time, curve.stretch)
    for still in (False, True):
        of_kind = [slice(a, b + 1) for a, b, held in parts if held is still]
        differences = [np.diff(curve.stress[part], 3) for part in of_kind]
        if sum(map(len, differences)) >= MIN_POINTS_FOR_NOISE - 3:
            for part in of_kind:
                noise[part] = _scatter(np.concatenate(differences))
    return noise


def _scatter(differences: Array) -> float:
    """Return the standard deviation of noise from third differences, which suppress smooth curvature; the median makes jumps
    count little."""
    if len(differences) < MIN_POINTS_FOR_NOISE - 3:
        return 0.0
    return float(np.median(np.abs(differences))) / 0.6745 / math.sqrt(20)


def without_jumps(curve: TensileCurve, names: Sequence[str] = ()) -> TensileCurve:
    """Return a curve without single readings that jump away from those around them, such as a 0 in a hold, which a remark
    names; ``names`` are those of all readings."""
    if curve.noise is not None or len(curve.stretch) < 7:
        return curve
    still = np.full(len(curve.stretch), 0.0)
    jumps = _jumps(curve.stress, noise_of(curve), curve.stretch) | _jumps(curve.stretch, still, curve.stretch)
    if not jumps.any():
        return curve
    said = []
    for place in np.flatnonzero(jumps)[:NAMED_JUMPS]:
        when = "" if curve.time is None else f" at {curve.time[place]:.4g} s"
        name = names[place] if names else f"reading {place + 1}"
        said.append(f"{name} ({curve.stress[place] / 1e3:.4g} kPa at stretch {curve.stretch[place]:.4g}{when})")
    more = int(jumps.sum()) - len(said)
    remark = f"single readings that jump are left out: {', '.join(said)}{f' and {more} more' if more else ''}"
    kept = ~jumps
    time = None if curve.time is None else curve.time[kept]
    return dataclasses.replace(
        curve, stretch=curve.stretch[kept], stress=curve.stress[kept], time=time, remarks=(*curve.remarks, remark)
    )


def _jumps(values: Array, noise: float | Array, stretch: Array) -> npt.NDArray[np.bool_]:
    """Return which readings jump, shape (n,): far from the nearest four, which lie close together. The first never does, and
    the last only in a hold: a step may begin there, or a specimen break."""
    n = len(values)
    around = np.clip(np.arange(n) - 2, 0, n - 5)[:, None] + np.arange(5)
    others = around[around != np.arange(n)[:, None]].reshape(n, 4)
    near = values[others]
    off = np.abs(values - np.median(near, axis=1))
    jumps = (
        (off > MIN_JUMP_SHARE * np.abs(values).max())
        & (off > MIN_JUMP_ERRORS * noise)
        & (off > MIN_JUMP_RANGES * np.ptp(near, axis=1))
    )
    jumps[0] = False
    jumps[-1] &= bool(np.ptp(stretch[-5:]) < REVERSAL_TOLERANCE * np.ptp(stretch))
    return jumps


# ----------------------------------------------------------------------------------------------------------------------
# Slack of the specimen and the load cell's zero: rows at constant load while the strain rises, and a first stress off zero.


START_SHARE, MIN_OFFSET, MIN_SECANT_SHARE = 0.2, 0.02, 0.4
"""First part of a test's travel on which its slope is measured; a first stretch off 1 from which, and the slope to the origin
over that slope below which, a test counts from elsewhere: a rubber's first slope is the steepest."""
SLACK_ROWS, SLACK_LEAST = 3, 0.005
"""Least number of rows at constant load, and least change of the stretch over them."""
MAX_LEVEL_SLOPE, MIN_STEEPER_ERRORS = 0.2, 6.0
"""Largest slope of the load over them, as a share of that beyond, and how much steeper this is, in standard errors."""
MIN_ZERO_ERRORS = 4.0
"""Least first stress in its standard errors that is off zero."""
NOTICED_STRAIN = 0.01
"""The same in the stress of a strain this large."""
START_POINTS = 60
"""Number of averages over steps of stretch in which the start of a test is looked at."""


def taut(curve: TensileCurve) -> TensileCurve:
    """Return a curve that counts from where its specimen is taut and its load cell at zero, with a remark, if rows at constant
    load while the strain rises, or a first stress off zero, show that it does not; see `Origin`. Rows of a slack specimen are
    left out. The values are first estimates, for a fit to refine."""
    if curve.noise is not None or curve.origin is not None or len(curve.stretch) < 8:
        return curve
    if curve.time is None:
        way = -1 if abs(curve.stretch[-1] - 1) < abs(curve.stretch[0] - 1) else 1
        leg = slice(None, None, way)
    else:
        way, leg = direction(curve.stretch), slice(0, turns(curve.stretch)[1] + 1)
    x, y = way * (curve.stretch[leg] - curve.stretch[leg][0]), way * curve.stress[leg]
    start, first = _start(x, y), float(curve.stretch[leg][0])
    if start is not None and start.slack:
        origin = Origin(first + way * start.slack - 1.0, way * start.zero, zero_error=start.error)
        said = (
            f"slack: over its first {start.slack:.3g} of stretch the load stays at {origin.zero / 1e3:.3g} kPa; "
            "{} rows of a slack specimen are left out, and the slack and the load cell's zero are fitted"
        )
        return _counted_from(curve, origin, way, said)
    begun, offset = x <= START_SHARE * x.max(), way * (first - 1.0)
    load, slope = np.polynomial.polynomial.polyfit(x[begun], y[begun], 1) if begun.sum() > 3 else (0.0, 0.0)
    if MIN_OFFSET < offset < x.max() / START_SHARE and load < MIN_SECANT_SHARE * slope * offset:
        origin = Origin(first - 1.0 - way * float(load / slope), 0.0, zero_error=1e-3 * float(np.abs(y).max()))
        said = (
            f"the stretch begins at {first:.4g} with {way * load / 1e3:.3g} kPa, too little for that stretch: it counts from "
            "elsewhere, as a position of the crosshead does; where the specimen is taut is fitted"
        )
        return _counted_from(curve, origin, way, said)
    if start is None or abs(first - 1.0) > AT_STRETCH_1:
        return curve
    # The same first stress would come of a slack below zero: a preload at which the stretch was set to 1.
    origin = Origin(0.0, way * start.zero, slack_error=start.zero / start.slope)
    said = (
        f"the stress at stretch 1 is {origin.zero / 1e3:.3g} kPa: the load cell's zero, or a preload; the zero and a shift of "
        "the stretch are fitted"
    )
    stress = curve.stress - origin.zero
    return dataclasses.replace(curve, stress=stress, origin=origin, remarks=(*curve.remarks, said))


def _counted_from(curve: TensileCurve, origin: Origin, way: int, said: str) -> TensileCurve:
    """Return a curve that counts from an origin, with the rows at which its specimen is loaded, and a remark on the others."""
    moved = dataclasses.replace(curve, stretch=curve.stretch - origin.slack, stress=curve.stress - origin.zero)
    loaded = way * (moved.stretch - 1.0) > 0.0
    remarks = (*curve.remarks, said.format(int((~loaded).sum())))
    return _kept_rows(dataclasses.replace(moved, origin=origin, remarks=remarks), loaded)


def _kept_rows(curve: TensileCurve, kept: npt.NDArray[np.bool_]) -> TensileCurve:
    """Return the rows of a curve that are kept; a history begins at rest, where its specimen becomes taut."""
    if curve.time is None:
        return dataclasses.replace(curve, stretch=curve.stretch[kept], stress=curve.stress[kept])
    first = int(np.argmax(kept))
    ends = [max(first - 1, 0), first]
    begin = float(np.interp(0.0, np.abs(curve.stretch[ends] - 1.0) * np.array([-1.0, 1.0]), curve.time[ends]))
    columns = ((begin, curve.time), (1.0, curve.stretch), (0.0, curve.stress))
    time, stretch, stress = (np.r_[start, values[kept]] for start, values in columns)
    return dataclasses.replace(curve, time=time - begin, stretch=stretch, stress=stress)


@dataclasses.dataclass(frozen=True)
class _Start:
    """The start of a test: its slack (a change of the stretch, 0 for none), the load cell's zero with its standard error and
    the slope beyond in Pa, positive in the direction of the test."""

    slack: float
    zero: float
    error: float
    slope: float


def _start(x: Array, y: Array) -> _Start | None:
    """Return how a test starts, from the way x of its stretch and the stresses y in Pa, shape (n,); None where nothing is off.

    The load is fitted by a level followed by a parabola, over what lies before a tenth of the largest load and as much beyond.
    """
    x = np.maximum.accumulate(x)
    way, load = _averages(x, y, 4 * START_POINTS)
    level = float(np.median(y[:SLACK_ROWS]))
    risen = np.flatnonzero(_falling_envelope(level + 0.1 * (load.max() - level) - load) <= 0.0)  # for good
    reach = 2.0 * float(way[risen[0]]) if len(risen) else 0.0
    least = float(x[min(7, len(x) - 1)])
    nearer = [_level_and_parabola(x, y, max(reach / part, least)) for part in (1, 2, 4, 8)]
    if slack := next((place.slack for place in nearer if place.slack), 0.0):
        fitted = _level_and_parabola(x, y, max(slack + max(slack, 0.1), least))
        return fitted if fitted.slack else None
    # A bend that is no parabola shows in the difference of two reaches.
    both = nearer[:2]
    off = min(abs(float(y[0])), *(abs(place.zero) for place in both))
    agree = min(place.zero * float(y[0]) for place in both) > 0.0
    if agree and off > max(MIN_ZERO_ERRORS * both[1].error, NOTICED_STRAIN * both[0].slope, abs(both[0].zero - both[1].zero)):
        return both[1]
    return None


def _averages(x: Array, y: Array, count: int) -> tuple[Array, Array]:
    """Return the means of both over at most so many equal steps of x."""
    if len(x) <= count or x[-1] <= x[0]:
        return x, y
    place = np.clip(((x - x[0]) / (x[-1] - x[0]) * count).astype(int), 0, count - 1)
    counts = np.bincount(place, minlength=count)
    here = counts > 0
    means = [np.bincount(place, values, count)[here] / counts[here] for values in (x, y)]
    return means[0], means[1]


def _level_and_parabola(x: Array, y: Array, reach: float) -> _Start:
    """Return the start of a test from its rows within a reach, with a slack only where the load is level over it."""
    x, y = _averages(x[x <= reach], y[x <= reach], START_POINTS)

    def fit(slack: float) -> tuple[float, Array, float]:
        u = np.maximum(x - slack, 0.0)
        A = np.column_stack([np.ones_like(u), u, u**2])
        coefficients, *_ = np.linalg.lstsq(A, y, rcond=None)
        squares = float(np.sum((A @ coefficients - y) ** 2))
        variance = squares / max(len(x) - 4, 1) * float(np.linalg.pinv(A.T @ A)[0, 0])
        return squares, coefficients, math.sqrt(variance)

    _, coefficients, error = fit(0.0)
    plain = _Start(0.0, float(coefficients[0]), error, max(float(coefficients[1]), 1e-300))
    tried = [(fit(float(at)), float(at)) for at in x[SLACK_ROWS - 1 : -3] if at > 0.0]
    if not tried:
        return plain
    (squares, coefficients, _), slack = min(tried, key=lambda trial: trial[0][0])
    before = x <= slack
    count = int(before.sum())
    if slack < SLACK_LEAST or count < SLACK_ROWS or coefficients[1] <= 0.0:
        return plain
    rest = y[before]
    line = np.polynomial.polynomial.polyfit(x[before], rest, 1)
    off = rest - np.polynomial.polynomial.polyval(x[before], line)
    noise = math.sqrt(max(float(off @ off) / max(count - 2, 1), squares / max(len(x) - 4, 1)))
    doubt = noise * math.sqrt(12.0 / count) / slack  # standard error of the line's slope
    if abs(line[1]) > MAX_LEVEL_SLOPE * coefficients[1] + doubt or coefficients[1] - abs(line[1]) < MIN_STEEPER_ERRORS * doubt:
        return plain
    return _Start(slack, float(rest.mean()), max(noise / math.sqrt(count), 1e-3 * abs(float(y.max()))), float(coefficients[1]))


def small_modulus(curve: TensileCurve) -> float:
    """Return the shear modulus in Pa of a neo-Hookean fit to the first part of a ramp (to stretch 1.5, or its first half)."""
    top = max(1.5, float(curve.stretch[curve.stretch > 1][:LEAST_POINTS].max(initial=1.0)))
    part = (curve.stretch <= top) & (np.abs(curve.stretch - 1) > 1e-9)
    L, last = curve.stretch[part], {"uniaxial": -2.0, "planar": -3.0, "equibiaxial": -5.0}[curve.mode]
    shape = L - L**last
    if not len(L):
        return math.nan
    return float(shape @ curve.stress[part] / (shape @ shape))
