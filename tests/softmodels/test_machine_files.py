"""Tables of test machines as they come: read without an option, with the law's own numbers as the result.

Layouts follow real exports (Instron Bluehill, ZwickRoell testXpert, Shimadzu Trapezium, MTS TestSuite, Mark-10 MESURgauge,
Stable Micro Systems Exponent, Walter+Bai, Tinius Olsen, Hegewald & Peschke); the numbers are a
Mooney-Rivlin solid's, in closed form.
"""

from __future__ import annotations

import dataclasses
import io
from collections.abc import Sequence

import numpy as np
import openpyxl
import pytest

from softmodels.common import columns
from softmodels.fitting.curves.curve import TensileError, read_curves
from softmodels.fitting.curves.fit import fit_curves
from softmodels.fitting.problem import FitOptions

C10, C01 = 60e3, 25e3  # Pa
AREA, LENGTH = 8e-6, 25e-3  # m2, m: a strip of 4 x 2 mm
KGF, LBF = 9.80665, 4.4482216152605


def stress(stretch, factor=1.0):
    """Nominal stress in Pa of an incompressible Mooney-Rivlin solid in uniaxial tension."""
    return factor * 2 * (stretch - stretch**-2) * (C10 + C01 / stretch)


@dataclasses.dataclass(frozen=True)
class Pull:
    """A test of a strip: time in s, and the numbers of a machine's columns."""

    stretch: np.ndarray
    factor: float = 1.0

    @property
    def t(self):
        return np.linspace(0.0, 60.0, len(self.stretch))

    @property
    def strain(self):
        return self.stretch - 1

    @property
    def mm(self):
        return 1e3 * LENGTH * self.strain

    @property
    def S(self):
        return stress(self.stretch, self.factor)

    @property
    def N(self):
        return AREA * self.S


LONG = Pull(np.linspace(1.0, 5.0, 96))
PULL = Pull(np.linspace(1.0, 2.6, 61))
PRESS = Pull(np.linspace(1.0, 0.6, 41))
THREE = [Pull(np.linspace(1.0, top, 41), factor) for top, factor in ((2.4, 0.96), (2.6, 1.0), (2.2, 1.04))]


def rows(*values: Sequence[float], comma: bool = False, separator: str = ",", quoted: bool = False) -> str:
    lines = []
    for row in zip(*values, strict=True):
        cells = [f"{v:.12g}" for v in row]
        cells = [cell.replace(".", ",") for cell in cells] if comma else cells
        lines.append(separator.join(f'"{cell}"' for cell in cells) if quoted else separator.join(cells))
    return "\n".join(lines) + "\n"


def grouped(values: Sequence[float], mark: str = ",") -> list[str]:
    """Numbers with separators between their thousands."""
    return [f"{v:,.9f}".replace(",", "_").replace(".", "." if mark == "," else ",").replace("_", mark) for v in values]


def joined(*texts: Sequence[object], separator: str) -> str:
    return "\n".join(separator.join(str(cell) for cell in row) for row in zip(*texts, strict=True)) + "\n"


def bluehill(pull: Pull, number: int = 1) -> str:
    return (
        f'"Specimen label","{number}"\n"Width","4.00","(mm)"\n"Thickness","2.00","(mm)"\n"Length","25.0","(mm)"\n\n'
        '"Time","Extension","Load","Tensile strain (Extension)","Tensile stress","Tensile extension"\n'
        '"(s)","(mm)","(N)","(mm/mm)","(MPa)","(mm)"\n'
        + rows(pull.t, pull.mm, pull.N, pull.strain, pull.S / 1e6, pull.mm, quoted=True)
    )


RESULTS = (
    '"Results Table 1"\n"","Specimen label","Maximum Load","Tensile strain at Break","Tensile stress at Maximum Load"\n'
    '"","","(N)","(%)","(MPa)"\n"1","A","1.9","160.0","0.24"\n"2","B","1.8","150.0","0.23"\n\n'
)


def workbook(sheets: dict[str, list[list[object]]]) -> bytes:
    book, stream = openpyxl.Workbook(), io.BytesIO()
    book.remove(book.active)
    for name, lines in sheets.items():
        page = book.create_sheet(name)
        for line in lines:
            page.append(line)
    book.save(stream)
    return stream.getvalue()


def zwick_book() -> bytes:
    sheets: dict[str, list[list[object]]] = {
        "Parameter": [["Prüfgeschwindigkeit", 50, "mm/min"], ["Probendicke a0", 2, "mm"], ["Probenbreite b0", 4, "mm"]],
        "Ergebnisse": [["Nr", "Fmax", "Dehnung bei Fmax", "Spannung bei Fmax"], ["", "N", "%", "MPa"], [1, 2, 140, 0.2]],
    }
    for i, pull in enumerate(THREE, 1):
        sheets[f"Probe {i}"] = [
            [f"Probe {i}"], ["Prüfzeit", "Dehnung", "Zugspannung"], ["s", "%", "N/mm²"],
            *map(list, zip(pull.t, 100 * pull.strain, pull.S / 1e6, strict=True)),
        ]  # fmt: skip
    return workbook(sheets)


def trapezium() -> str:
    count = max(len(pull.stretch) for pull in THREE)
    head = ",".join(f'"1 _ {i}",""' for i in (1, 2, 3)) + "\n" + ",".join(['"Strain","Stress"'] * 3) + "\n"
    cells = [["" if k >= len(v) else f"{v[k]:.12g}" for pull in THREE for v in (100 * pull.strain, pull.S / 1e6)]
             for k in range(count)]  # fmt: skip
    return head + ",".join(['"%","N/mm2"'] * 3) + "\n" + "\n".join(map(",".join, cells)) + "\n"


ZWICK = "Prüfprotokoll;;\nMaschine;Z010;\nProbendicke a0;2,00;mm\nProbenbreite b0;4,00;mm\nMesslänge L0;25;mm\n\n"
ONE: dict[str, tuple[str | bytes, Pull]] = {
    "Bluehill raw data": (bluehill(PULL), PULL),
    "Bluehill raw data with a results table above": (RESULTS + bluehill(PULL), PULL),
    "Bluehill forces and extensions, sizes above": (
        '"Width","4.00","(mm)"\n"Thickness","2.00","(mm)"\n"Length","25.0","(mm)"\n\n"Time","Extension","Load"\n'
        '"(s)","(mm)","(N)"\n' + rows(PULL.t, PULL.mm, PULL.N, quoted=True), PULL,
    ),
    "Bluehill in UTF-16 without its mark": (bluehill(PULL).encode("utf-16-le"), PULL),
    "Bluehill compression, negative": (
        "Time,Displacement,Force,Compressive strain (Displacement),Compressive stress\n(s),(mm),(N),(%),(kPa)\n"
        + rows(PRESS.t, PRESS.mm, PRESS.N, 100 * PRESS.strain, PRESS.S / 1e3), PRESS,
    ),
    "Bluehill compression, positive": (
        "Time,Displacement,Force,Compressive strain (Displacement),Compressive stress\n(s),(mm),(N),(%),(kPa)\n"
        + rows(PRESS.t, -PRESS.mm, -PRESS.N, -100 * PRESS.strain, -PRESS.S / 1e3), PRESS,
    ),
    "Bluehill in German": (
        ("Abmessung : Querschnitt;8,00000;mm^2\nDehnung : Zugdehnung (Traversenweg) Messlänge;25,00000;mm\n"
         "Allgemein : Startdatum;16.08.2018 16:07:51\n"
         "Abmessung : Länge;25,00000;mm\n\nZeit;Traversenweg;Last\n(sec);(mm);(kN)\n"
         + rows(PULL.t, PULL.mm, PULL.N / 1e3, comma=True, separator=";")).encode("cp1252"), PULL,
    ),
    "Bluehill in Chinese, compression": (
        "时间,位移,载荷,压缩应变 (位移),压缩应力,循环计数\n(s),(mm),(N),(%),(MPa),\n"
        + rows(PRESS.t, -PRESS.mm, -PRESS.N, -100 * PRESS.strain, -PRESS.S / 1e6, 0 * PRESS.t), PRESS,
    ),
    "Bluehill with the gauge length of the strain": (
        'Area,8.0,mm^2\nStrain : Tensile strain (Extension) gauge length,"25.00000",mm\n\nTime,Extension,Load\n(s),(mm),(N)\n'
        + rows(PULL.t, PULL.mm, PULL.N, quoted=True), PULL,
    ),
    "testXpert in Latin-1": (
        (ZWICK + "Prüfzeit;Standardkraft;Standardweg\ns;N;mm\n" + rows(PULL.t, PULL.N, PULL.mm, comma=True, separator=";")
         ).encode("cp1252"), PULL,
    ),
    "testXpert, standard force in MPa": (
        "Dehnung;Standardkraft\n%;MPa\n" + rows(100 * PULL.strain, PULL.S / 1e6, comma=True, separator=";"), PULL,
    ),
    "testXpert, compression": (
        "Stauchung;Druckspannung\n%;kPa\n" + rows(-100 * PRESS.strain, -PRESS.S / 1e3, comma=True, separator=";"), PRESS,
    ),
    "Trapezium, sizes in a row": (
        'Name,Thickness,Width,Gauge_Length\nUnits,mm,mm,mm\n1 _ 1,2.0,4.0,25.0\n\nTime,Force,Stroke\nsec,N,mm\n'
        + rows(PULL.t, PULL.N, PULL.mm), PULL,
    ),
    "MTS TestSuite in inches and pounds": (
        "Test Run Name:,Run 4\nArea: 8 mm^2\nGage Length: 25 mm\n\nCrosshead\tLoad\tTime\nin\tlbf\tsec\n"
        + rows(PULL.mm / 25.4, PULL.N / LBF, PULL.t, separator="\t"), PULL,
    ),
    "MTS TestSuite in columns of spaces": (
        "Axial Strain  Axial Stress  Time\n(mm/mm)       (psi)         (Sec)\n"
        + rows(PULL.strain, PULL.S / 6894.757293168, PULL.t, separator="     "), PULL,
    ),
    "Mark-10": (
        "Gauge Length: 25 mm\nCross-sectional area: 0.08 cm2\n\nReading,Load [lbF],Travel [in],Time [sec]\n"
        + rows(np.arange(1, 62), PULL.N / LBF, PULL.mm / 25.4, PULL.t), PULL,
    ),
    "Exponent of a texture analyser, in grams": (
        "Length: 25 mm\nDiameter: 3.19153824321146 mm\n\nForce (g)\tDistance (mm)\tTime (sec)\n"
        + rows(PULL.N / KGF * 1e3, PULL.mm, PULL.t, separator="\t"), PULL,
    ),
    "Walter+Bai in French": (
        ("Essai de traction;\nÉpaisseur;2,0;mm\nLargeur;4,0;mm\nLongueur initiale L0;25,0;mm\n\n"
         "Temps [s];Déplacement [mm];Charge [kN]\n" + rows(PULL.t, PULL.mm, PULL.N / 1e3, comma=True, separator=";")
         ).encode("cp1252"), PULL,
    ),
    "French strain and stress": (
        "Allongement (%)\tContrainte (N/cm2)\n" + rows(100 * PULL.strain, PULL.S / 1e4, comma=True, separator="\t"), PULL,
    ),
    "kgf/mm2": ("Strain (mm/mm),Stress (kgf/mm2)\n" + rows(PULL.strain, PULL.S / KGF / 1e6), PULL),
    "Tinius Olsen, commas between thousands": (
        "Strain (%),Stress (Pa)\n" + joined([f"{100 * v:.9g}" for v in LONG.strain],
                                            [f'"{v}"' for v in grouped(LONG.S)], separator=","), LONG,
    ),
    "LabMaster, points between thousands": (
        "Messlänge;25,0;mm\n\nWeg [mm];Spannung [Pa]\n"
        + joined(grouped(LONG.mm, "."), grouped(LONG.S, "."), separator=";"), LONG,
    ),
    "a strain gauge beside the crosshead's strain": (
        "Strain 1 (%),Tensile strain (Extension) (%),Tensile stress (kPa)\n"
        + rows(100 * PULL.strain, 130 * PULL.strain, PULL.S / 1e3), PULL,
    ),
}  # fmt: skip
SEVERAL: dict[str, tuple[str | bytes, list[str]]] = {
    "Bluehill, below each other": (RESULTS + "\n".join(bluehill(p, i) for i, p in enumerate(THREE, 1)), ["specimen 1"]),
    "testXpert, a sheet each": (zwick_book(), ["Probe 1", "Probe 2", "Probe 3"]),
    "Trapezium, side by side": (trapezium(), ["1 _ 1", "1 _ 2", "1 _ 3"]),
    "named in a column": (
        "Specimen,Strain (%),Stress (kPa)\n"
        + "".join(rows(p.strain * 0 + i, 100 * p.strain, p.S / 1e3) for i, p in enumerate(THREE)),
        ["0", "1", "2"],
    ),
}  # fmt: skip
SINGLE = FitOptions(gauge_error=0.0, profiles=False)


@pytest.fixture
def write(tmp_path):
    def write(text):
        path = tmp_path / ("test.xlsx" if isinstance(text, bytes) and text.startswith(b"PK") else "test.csv")
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


@pytest.mark.parametrize("layout", ONE)
def test_a_layout_is_read_without_an_option(layout, write):
    text, pull = ONE[layout]
    (curve,) = read_curves(write(text))
    way = 1 if pull.stretch[-1] > 1 else -1
    assert curve.stretch == pytest.approx(pull.stretch[::way], rel=1e-8)
    report = fit_curves(write(text), "mooney-rivlin", SINGLE)
    assert (report.material.c10, report.material.c01) == pytest.approx((C10, C01), rel=1e-6)
    assert "from column" in report.ranges[0] and ("compression" in report.ranges[0]) == (way < 0)


@pytest.mark.parametrize("layout", SEVERAL)
def test_specimens_are_told_apart(layout, write):
    text, labels = SEVERAL[layout]
    curves = read_curves(write(text))
    assert len(curves) == 3 and all(label in curve.name for label, curve in zip(labels, curves, strict=False))
    for curve, pull in zip(curves, THREE, strict=True):
        assert curve.stretch == pytest.approx(pull.stretch, rel=1e-8)
        assert curve.stress == pytest.approx(pull.S, rel=1e-8, abs=1e-5)


@pytest.mark.parametrize(
    ("cells", "mark"),
    [
        (["0,5", "1,25"], ","), (["0.5", "1.25"], "."), (["1,234.5", "12.0"], "."), (["1.234,5", "12,0"], ","),
        (["0,125", "1,250"], ","), (["998", "1,002"], "."), (["1,002", "1,004"], ","), (["1,234,567", "12"], "."),
        (["1.234.567", "12"], ","), (["12", "13"], "."),
    ],
)  # fmt: skip
def test_decimal_signs(cells, mark):
    assert columns.numerals(cells) == mark


def test_slack_offset_and_compression_are_named(write):
    slack = np.r_[np.linspace(0.0, 0.06, 13), 0.06 + PULL.strain[1:]]
    load = np.r_[np.zeros(13), PULL.S[1:]] / 1e3
    report = fit_curves(write("Strain (%),Stress (kPa)\n" + rows(100 * slack, load)), "mooney-rivlin", SINGLE)
    assert "slack: over its first" in report.ranges[0]
    assert (report.material.c10, report.material.c01) == pytest.approx((C10, C01), rel=1e-4)
    report = fit_curves(
        write("Strain (%),Stress (kPa)\n" + rows(100 * PULL.strain, 20 + PULL.S / 1e3)), "mooney-rivlin", SINGLE
    )
    assert "the load cell's zero" in report.ranges[0]


def test_a_word_and_a_unit_are_added_by_a_line(write, monkeypatch):
    monkeypatch.setitem(columns.WORDS, "stress", list(columns.WORDS["stress"]))
    monkeypatch.setitem(columns.UNITS, "dyn/cm2", "0.1 Pa")
    text = "Strain (%),Voltage (kPa)\n" + rows(100 * PULL.strain, PULL.S / 1e3)
    with pytest.raises(TensileError, match=r"no line names .*; above its numbers are the columns 1 'Strain \(%\)', 2 'Voltage"):
        read_curves(write(text))
    columns.register_words("stress", "Voltage")
    assert read_curves(write(text))[0].stress == pytest.approx(PULL.S, abs=1e-6)
    monkeypatch.undo()
    columns._pattern.cache_clear()


@pytest.mark.parametrize(
    ("header", "kind", "unit"),
    [
        ("Tensile strain (Extension)", "strain", ""), ("Extension (mm)", "extension", "mm"),
        ("Elongation (mm)", "extension", "mm"), ("Standardkraft [N]", "force", "N"), ("Nenndehnung", "strain", ""),
        ("Längenänderung [mm]", "extension", "mm"), ("Load (MPa)", "stress", "MPa"), ("Prüfzeit [s]", "time", "s"),
        ("Force (kg)", "force", "kgf"), ("Stress (kg/cm2)", "stress", "kgf/cm^2"),
        ("True stress (Cauchy) [MPa]", "true-stress", "MPa"),
        ("Tensile stress at Maximum Load (MPa)", None, ""), ("Prüfgeschwindigkeit [mm/min]", None, ""),
        ("Stress (foo)", "stress", "foo"), ("Kraft (lbF)", "force", "lbf"), ("Position (mm)", "extension", "mm"),
    ],
)  # fmt: skip
def test_headers(header, kind, unit):
    column = columns.recognise(header, 0)
    assert (column.kind, column.unit) == (kind, unit) if kind else column is None
