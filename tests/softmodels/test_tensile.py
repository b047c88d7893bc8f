"""Reading curves: units, columns, ramps, and a sentence for everything that cannot be used."""

from __future__ import annotations

import datetime
import re

import numpy as np
import openpyxl
import pytest

from softmodels.common.columns import recognise
from softmodels.common.errors import spoken
from softmodels.fitting.curves.curve import MIN_POINTS_FOR_NOISE, Specimen, TensileError, small_modulus
from softmodels.fitting.curves.fit import prepared
from softmodels.fitting.curves.residuals import StressError, noise
from softmodels.materials.laws import NeoHookean
from softmodels.materials.specimens import balloon_pressure, respond
from tests.support.tables import read_curve

MU = 20e3
L = np.linspace(1.0, 3.0, 21)
S = MU * (L - L**-2)
SECTION, LENGTH = 18e-6, 0.033


def table(header, *columns, separator=",", above=""):
    rows = [separator.join(f"{v:.9g}" for v in row) for row in np.column_stack(columns)]
    return above + separator.join(header) + "\n" + "\n".join(rows) + "\n"


@pytest.fixture
def write(tmp_path):
    def write(text, name="curve.csv"):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


MARECHAL = "PARAMETER;INFO;URL;;\nStandard;ASTM D412;;;\nMaterial;EcoFlex30;;;\n;;;;\n"
SAME = {
    "stretch and stress": table(["stretch", "nominal_stress_MPa"], L, S / 1e6),
    "strain": table(["nominal_strain", "nominal_stress_MPa"], L - 1, S / 1e6),
    "percent": table(["Strain (%)", "Stress (kPa)"], 100 * (L - 1), S / 1e3),
    "percent in brackets": table(["Engineering strain [%]", "Engineering stress [Pa]"], 100 * (L - 1), S),
    "true": table(["True Strain", "True Stress (MPa)"], np.log(L), S * L / 1e6),
    "psi": table(["stretch", "stress (psi)"], L, S / 6894.757293168),
    "N/mm2": table(["stretch (-)", "stress (N/mm2)"], L, S / 1e6),
    "machine": table(["Time (s)", "Extension (mm)", "Load (N)"], L, (L - 1) * LENGTH * 1e3, S * SECTION),
    "a list of the columns": table(["% end"], L, 100 * (L - 1), S / 1e3, separator=", ").replace(
        "% end", "% by a program\n% column 1: Time [s]\n% column 2: Strain, engineering [%]\n% column 3: Stress [kPa]\n% end"
    ),
    "a list of the columns in comments": table(["#"], L - 1, S / 1e3, separator="\t").replace(
        "#", "# Column 1 = strain\n# Column 2 = stress (kPa)\n# 2, 3"
    ),
    "tabs": table(["strain", "stress (kPa)"], L - 1, S / 1e3, separator="\t"),
    "comments": table(["strain", "stress (kPa)"], L - 1, S / 1e3, above="# a, b\n# stress (MPa), strain\n"),
    "two headers": table(["strain", "stress"], L - 1, S / 1e3).replace("stress\n", "stress (kPa)\n-,kPa\n"),
    "decimal commas": table(["strain", "stress (kPa)"], L - 1, S / 1e3, separator=";").replace(".", ","),
    "a row of units": table(["Strain", "Stress"], 100 * (L - 1), S / 1e6, separator=";").replace(
        "Stress\n", "Stress\n%;N/mm²\n"
    ),
    "a row of units in brackets": table(["Strain", "Stress"], 100 * (L - 1), S / 1e3).replace("s\n", "s\n[%],[kPa]\n"),
    "a row of units after one of words": table(["Time", "Strain", "Stress"], L, L - 1, S / 1e3).replace(
        "Stress\n", "Stress\nclock,mean,mean\ns,mm/mm,kPa\n"
    ),
    "signs of percent": "strain,stress (Pa)\n" + "".join(
        f"{100 * (a - 1):.9g} %,{b:.9g}\n" for a, b in zip(L, S, strict=True)
    ),
    "UTF-16": table(["strain", "stress (kPa)"], L - 1, S / 1e3).encode("utf-16"),
    "all of Marechal's columns": table(
        ["Time (s)", "True Strain", "True Stress (MPa)", "Engineering Strain", "Engineering Stress (MPa)"],
        L, np.log(L), S * L / 1e6, L - 1, S / 1e6, separator=";", above=MARECHAL,
    ),
    "a byte order mark": b"\xef\xbb\xbf" + table(["strain", "stress (kPa)"], L - 1, S / 1e3).encode(),
    "old letters": table(["strain", "stress (kPa)"], L - 1, S / 1e3).encode().replace(b"strain", b"\xb5-strain strain"),
}  # fmt: skip


@pytest.mark.parametrize("name", SAME)
def test_one_curve_in_many_clothes(name, write):
    curve = read_curve(write(SAME[name]), specimen=Specimen(cross_section=SECTION, gauge_length=LENGTH))
    assert curve.stretch == pytest.approx(L, rel=1e-7)
    assert curve.stress == pytest.approx(S, rel=1e-6, abs=1e-3)
    assert small_modulus(curve) == pytest.approx(MU, rel=1e-5)


TOLD = {
    "strain=1[%],stress=2[kPa]": table(["a", "b"], 100 * (L - 1), S / 1e3),
    "strain=Dehnung[%],stress=Spannung[kPa]": table(["Zeit", "Dehnung", "Spannung"], L, 100 * (L - 1), S / 1e3),
    "stretch=2,stress=3[kPa]": "\n".join(f"{i},{a:.9g},{b:.9g}" for i, (a, b) in enumerate(zip(L, S / 1e3, strict=True))),
    "strain=1,stress=2": table(["a", "b"], 100 * (L - 1), S / 1e3).replace("b\n", "b\n%,kPa\n"),
    "strain=1[],stress=2[kPa]": table(["a", "b"], L - 1, S / 1e3).replace("b\n", "b\n%,MPa\n"),
    "strain=strain,stress=stress": table(["strain [%]", "stress [kPa]", "stress (MPa)"], 100 * (L - 1), S / 1e3, S),
}


HEADED = table(["Time (s)", "Strain [%]", "Stress [MPa]"], L, 100 * (L - 1), S / 1e6)
TOLD |= {
    "strain=2,stress=3": HEADED,  # units of the header above the numbers
    "strain=Dehnung,stress=Spannung": HEADED.replace("Strain", "Dehnung").replace("Stress", "Spannung"),
    "strain=2,stress=3[MPa]": HEADED.replace("Strain", "x").replace("Stress", "y"),
    # the rest by the headers
    "stress=3[MPa]": HEADED.replace("Stress [MPa]", "stress"),
    "strain=2[%]": HEADED.replace("Strain [%]", "strain"),
    "stress=y[MPa]": HEADED.replace("Stress [MPa]", "y"),
}


@pytest.mark.parametrize("told", TOLD)
def test_columns_can_be_told(told, write):
    curve = read_curve(write(TOLD[told]), columns=told)
    assert curve.stretch == pytest.approx(L, rel=1e-7) and curve.stress == pytest.approx(S, rel=1e-6, abs=1e-3)


def workbook(path, rows, sheet="Data", more=()):
    """An Excel file of rows, with more sheets by their names."""
    book = openpyxl.Workbook()
    book.active.title = sheet
    for name, table in [(sheet, rows), *more]:
        page = book[name] if name in book.sheetnames else book.create_sheet(name)
        for row in table:
            page.append(row)
    book.save(path)
    return path


def cells(text):
    """Rows of a comma-separated text, numbers as numbers."""
    return [[float(c) if re.fullmatch(r"[-+.\de]+", c) and c != "-" else c for c in line.split(",")]
            for line in text.splitlines()]  # fmt: skip


@pytest.mark.parametrize("name", ["strain", "percent", "machine", "comments", "two headers", "a row of units in brackets"])
def test_a_workbook_gives_the_curve_of_its_csv(name, write, tmp_path):
    specimen = Specimen(cross_section=SECTION, gauge_length=LENGTH)
    plain = read_curve(write(SAME[name]), specimen=specimen)
    path = workbook(tmp_path / "curve.xlsx", [["Machine", 5], [], *cells(SAME[name])], more=[("Notes", [["by", "me"]])])
    curve = read_curve(path, specimen=specimen)
    assert np.array_equal(curve.stretch, plain.stretch) and np.array_equal(curve.stress, plain.stress)
    assert curve.name == "curve.xlsx"


def test_a_cell_of_percents_is_read_as_it_is_shown(tmp_path):
    path = workbook(tmp_path / "curve.xlsx", [["strain (%)", "stress (Pa)"], *zip(L - 1, S, strict=True)])
    book = openpyxl.load_workbook(path)
    for (cell,) in book.active.iter_rows(min_row=2, max_col=1):
        cell.number_format = "0.00%"
    book.save(path)
    assert read_curve(path).stretch == pytest.approx(L, rel=1e-12)


@pytest.mark.parametrize(
    ("rows", "more", "words"),
    [
        ([["strain", "stress (kPa)"], [0.1, "=A2*3"]], [], "row 2 of the sheet 'Data': '=A2.3' in the column 'stress .kPa.' "
         "is a formula, not a number; save the workbook in a spreadsheet program to store its value"),
        ([["strain", "stress (kPa)"], [0.1, 3], [0.2, "x"]], [], "row 3 of the sheet 'Data': 'x'"),
        ([["strain", "stress (kPa)"], ["%", "MPa"], [0.1, 3]], [], "MPa in row 2 of the sheet 'Data'"),
        ([["a", "b"], [1, 2]], [("More", [["c"]])], "no row of the sheets 'Data' and 'More' names a deformation"),
        ([["strain", "stress (kPa)"], [0.1, 3]], [("More", [["stretch", "stress (kPa)"], [0.1, 3]])],
         "a table on each of the sheets 'Data' and 'More'; save the right sheet"),
        ([], [], "the file is empty"),
        ([["strain", "stress (kPa)"], [0.1, datetime.date(2026, 2, 1)]], [], "'2026-02-01 00:00:00'.*not a number"),
        ([["strain", "stress (kPa)"], [0.1, True]], [], "'TRUE'.*not a number"),
    ],
)  # fmt: skip
def test_workbooks_are_refused_in_a_sentence(rows, more, words, tmp_path):
    with pytest.raises(TensileError, match=words):
        read_curve(workbook(tmp_path / "curve.xlsx", rows, more=more))


@pytest.mark.parametrize("test", ["planar", "ps", "equibiaxial", "ET"])
def test_true_stress_of_other_tests(test, write):
    mode = "planar" if test in ("planar", "ps") else "equibiaxial"
    stress = respond(NeoHookean(MU, 0.5), L, mode).stress
    curve = read_curve(write(table(["stretch", "true stress (kPa)"], L, stress * L / 1e3)), test)
    assert curve.mode == mode and curve.stress == pytest.approx(stress, rel=1e-6, abs=1e-3)


def test_balloon(write):
    """Pressure against radius is the sheet's equibiaxial stress."""
    law, radius, thickness = NeoHookean(MU, 0.5), 0.02, 0.001
    text = table(["radius (mm)", "pressure (kPa)"], L * radius * 1e3, balloon_pressure(law, L, thickness / radius) / 1e3)
    curve = read_curve(write(text), "balloon", specimen=Specimen(radius=radius, thickness=thickness))
    assert curve.mode == "equibiaxial"
    assert curve.stress == pytest.approx(respond(law, L, "equibiaxial").stress, rel=1e-6, abs=1e-3)


def test_break_and_return_are_cut(write):
    torn = table(["stretch", "stress (kPa)"], [*L, 3.02, 3.05], [*S / 1e3, 2.0, 1.0])
    curve = read_curve(write(torn))
    assert curve.stretch[-1] == 3.0 and "2 points after the break at stretch 3 are left out" in curve.remarks
    cycle = table(["stretch", "stress (kPa)"], [*L, *L[-2::-1]], [*S / 1e3, *0.8 * S[-2::-1] / 1e3])
    curve = read_curve(write(cycle))
    assert len(curve.stretch) == len(L) and "20 points after the reversal of the stretch at 3" in curve.remarks[0]


def test_compression_may_be_written_as_it_was_done(write):
    down = np.linspace(1.0, 0.5, 11)
    stress = MU * (down - down**-2)
    curve = read_curve(write(table(["stretch", "stress (kPa)"], down, stress / 1e3)))
    assert (np.diff(curve.stretch) > 0).all() and curve.stress[0] == pytest.approx(stress[-1])


def test_noise_of_the_strain_is_no_disorder(write):
    noisy = L + np.random.default_rng(2).normal(0.0, 5e-3, L.size)
    assert len(read_curve(write(table(["stretch", "stress (kPa)"], noisy, S / 1e3))).stretch) == len(L)


@pytest.mark.parametrize(
    ("header", "kind", "unit"),
    [
        ("Engineering Stress (MPa)", "stress", "MPa"),
        ("True Strain", "true-strain", ""),
        ("nominal_stress_MPa", "stress", "MPa"),
        ("Tensile stress, MPa", "stress", "MPa"),
        ("Kraft/Force [N]", "force", "N"),
        ("Elongation %", "strain", "percent"),
        ("extension ratio", "stretch", ""),
        ("strain rate (1/s)", None, ""),
        ("Time (s)", "time", "s"),
        ("t", "time", ""),
        ("t [min]", "time", "min"),
        ("Total time_s", "time", "s"),
        ("elapsed_time", "time", ""),
        ("t (mm)", None, ""),
        ("timeout", None, ""),
        ("stress error (kPa)", None, ""),
    ],
)
def test_headers(header, kind, unit):
    column = recognise(header, 0)
    assert (column.kind, column.unit) == (kind, unit) if kind else column is None


PLAIN = table(["stretch", "stress (kPa)"], L, S / 1e3)
REFUSED = {
    "empty": ("", {}, "the file is empty"),
    "blank": ("\n\n", {}, "the file is empty"),
    "no header": ("1,2\n2,3\n3,4\n", {}, "no line names a deformation and a load"),
    "one column": ("stretch\n1\n2\n", {}, "no line names a deformation and a load"),
    "no unit": (table(["stretch", "stress"], L, S), {}, "'stress' has no unit"),
    "wrong unit": (table(["stretch", "stress (mm)"], L, S), {}, "'stress .mm.'.*cannot be read in Pa"),
    "unknown unit": (table(["stretch", "stress (kPq)"], L, S), {}, "unknown unit"),
    "strain in kPa": (table(["strain (kPa)", "stress (kPa)"], L - 1, S), {}, "'strain \\(kPa\\)'"),
    "no numbers": ("stretch,stress (kPa)\n", {}, "no numbers below the header"),
    "a word": (PLAIN + "3.1,much\n", {}, "line 23: 'much'.*not a number"),
    "a gap": (PLAIN + "3.1,\n3.2,70\n", {}, "line 23: ''.*not a number"),
    "nan": (PLAIN + "3.1,nan\n", {}, "line 23 has a value that is not finite"),
    "inf": (PLAIN + "inf,60\n", {}, "line 23 has a value that is not finite"),
    "two stresses": (table(["stretch", "stress (kPa)", "stress (MPa)"], L, S, S), {}, "mean the same"),
    "shuffled": (table(["stretch", "stress (kPa)"], np.roll(L, 11)[::-1], S / 1e3), {}, "not in order"),
    "few": (table(["stretch", "stress (kPa)"], L[:3], S[:3] / 1e3), {}, "has 3 points"),
    "no stretching": (table(["stretch", "stress (kPa)"], 1 + 0 * L, S / 1e3), {}, "does not change"),
    "kPa called MPa": (
        table(["stretch", "stress (MPa)", "true stress (kPa)"], L, S / 1e3, S * L / 1e3),
        {},
        "contradict.*1e\\+03 times",
    ),
    "kPa called MPa beside a force": (
        table(["stretch", "force (N)", "stress (MPa)"], L, S * SECTION, S / 1e3),
        {"specimen": Specimen(cross_section=SECTION)},
        "'stress .MPa.' and 'force .N.' contradict each other",
    ),
    "MPa called kPa": (table(["stretch", "stress (kPa)"], L, S / 1e6), {}, "0.02 kPa.*factor 1000"),
    "percent unsaid": (table(["strain", "stress (kPa)"], 100 * (L - 1), S / 1e3), {}, "if it is in percent"),
    "strain called stretch": (table(["stretch", "stress (kPa)"], L - 1, S / 1e3), {}, "starting at 0 holds strains"),
    "stretch called strain, from a first reading": (
        table(["strain", "stress (kPa)"], L[1:] - 0.0996, S[1:] / 1e3),
        {},
        "starts at 1.0004.*--columns stretch=1",
    ),
    "stretch in percent called strain": (
        table(["strain (%)", "stress (kPa)"], 100 * L + 0.04, S / 1e3),
        {},
        "starts at 100.04 %.*--columns stretch=1",
    ),
    "true strain that is a stretch": (
        table(["true strain", "stress (kPa)"], L, S / 1e3),
        {},
        "seems to hold stretches",
    ),
    "strain called stretch, from a first reading": (
        table(["stretch", "stress (kPa)"], L - 0.9996, S / 1e3),
        {},
        "seems to hold strains.*--columns strain=1",
    ),
    "length called extension": (
        table(["extension (mm)", "force (N)"], 33 * L, S * 1e-5),
        {"specimen": Specimen(cross_section=1e-5, gauge_length=0.033)},
        "seems to hold the specimen's length",
    ),
    "stretch called strain": (table(["strain", "stress (kPa)"], L, S / 1e3), {}, "seems to hold stretches"),
    "not tared": (table(["stretch", "stress (kPa)"], L, S / 1e3 + 100), {}, "stress at stretch 1 is 100 kPa"),
    "falling": (
        table(["stretch", "stress (kPa)"], L, -S / 1e3),
        {},
        "'stretch' and 'stress .kPa.' contradict each other",
    ),
    "zero": (table(["stretch", "stress (kPa)"], L, 0 * S), {}, "every stress is zero"),
    "binary": (b"\x7fELF\0\0stretch,stress", {}, "not a text file"),
    "half a workbook": (b"PK\x03\x04\0\0stretch,stress", {}, "not an Excel workbook .*, or a damaged one"),
    "an old workbook": (b"\xd0\xcf\x11\xe0\0stretch,stress", {}, "with a password or in the format before 2007"),
    "units that contradict the header": (
        table(["strain", "stress (kPa)"], L - 1, S / 1e3).replace("(kPa)\n", "(kPa)\n%,MPa\n"),
        {},
        "'stress .kPa.' is kPa in its header and MPa in line 2; correct one of them, or give --columns 'stress=2.kPa.'",
    ),
    "percents that contradict the header": (
        table(["strain (-)", "stress"], L - 1, S / 1e3).replace("stress\n", "stress\n%,kPa\n"),
        {},
        "'strain .-.' is dimensionless in its header and percent in line 2",
    ),
    "a unit of another kind": (
        table(["strain", "stress"], L - 1, S / 1e3).replace("stress\n", "stress\n%,mm\n"),
        {},
        "'stress'.*cannot be read in Pa",
    ),
    "an unknown unit below": (
        table(["strain", "stress"], L - 1, S / 1e3).replace("stress\n", "stress\n[%],[kPq]\n"),
        {},
        "unknown unit",
    ),
    "a formula": (PLAIN + "3.1,=B2*2\n", {}, "line 23: '=B2.2' in the column .* is a formula, not a number"),
    "a spreadsheet's error": (PLAIN + "#N/A,60\n", {}, "line 23: '#N/A'.*not a number"),
    "percents of stress": (PLAIN + "3.1,60 %\n", {}, "'60 %' in the column 'stress .kPa.' is a percentage"),
    "force": (table(["stretch", "force (N)"], L, S * SECTION), {}, "--cross-section"),
    "extension": (table(["extension (mm)", "stress (kPa)"], L - 1, S / 1e3), {}, "--gauge-length"),
    "pressure": (table(["stretch", "pressure (kPa)"], L, S / 1e3), {}, "cannot have a column"),
    "balloon": (table(["stretch", "pressure (kPa)"], L, S / 1e3), {"test": "balloon"}, "--radius and --thickness"),
    "unknown test": (PLAIN, {"test": "torsion"}, "test 'torsion' is not one of uniaxial"),
    "a bending test by a line above": (
        "Results : Flexure extension at Maximum Load,1.5,mm\n" + PLAIN,
        {},
        "'Results : Flexure extension at Maximum Load' says bending.*curve.csv:tension",
    ),
    "a bending test by its header": (table(["Biegedehnung (%)", "Biegespannung (kPa)"], L, S), {}, "says bending"),
    "told a foreign kind": (PLAIN, {"columns": "strein=1,stress=2"}, "'strein=1' is not KIND=COLUMN"),
    "told twice": (PLAIN, {"columns": "strain=1,stretch=2"}, "no more than one deformation.*and one load"),
    "told half, of no header": (table(["a", "b"], L, S), {"columns": "strain=1"}, "no line names a deformation and a load"),
    "told a column that is not there": (PLAIN, {"columns": "stress=7[kPa]"}, "no line names a deformation and a load"),
    "told absent": (
        PLAIN,
        {"columns": "strain=Dehnung,stress=Spannung"},
        "no line of the file has the columns 'Dehnung'",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refusals_are_sentences(name, write):
    text, more, words = REFUSED[name]
    with pytest.raises(TensileError) as caught:
        read_curve(write(text), **more)
    assert re.search(spoken(words), str(caught.value))
    assert "\n" not in str(caught.value) and "--" not in str(caught.value)


# ----------------------------------------------------------------------------------------------------------------------
# Compression: what a header says about the sign.


SQUEEZED = np.linspace(1.0, 0.6, 21)
PRESSED = 30e3 * (SQUEEZED**-2 - SQUEEZED)  # Pa, positive in compression, of a neo-Hookean of 30 kPa
SHORTER = 1.0 - SQUEEZED
BODY = Specimen(cross_section=SECTION, gauge_length=LENGTH)
PRESSES = {
    "strain and stress": (["Compressive strain (%)", "Compressive stress (kPa)"], 100 * SHORTER, PRESSED / 1e3),
    "load and extension": (
        ["Compressive extension (mm)", "Compressive load (N)"], 1e3 * LENGTH * SHORTER, PRESSED * SECTION
    ),
    "compression": (["Compression (mm)", "Compression force (N)"], 1e3 * LENGTH * SHORTER, PRESSED * SECTION),
    "a share of the height": (["compression [%]", "compressive stress [Pa]"], 100 * SHORTER, PRESSED),
    "true": (["True compressive strain", "Compressive stress (Pa)"], -np.log(SQUEEZED), PRESSED),
    "stretch": (["Compressive stretch", "Compressive stress (Pa)"], SQUEEZED, PRESSED),
    "one signed": (["Strain (%)", "Compressive stress (Pa)"], -100 * SHORTER, PRESSED),
    "abbreviated": (["Comp. strain (%)", "Comp. stress (kPa)"], 100 * SHORTER, PRESSED / 1e3),
    "in Italian": (["Deformazione a compressione (%)", "Sforzo di compressione (kPa)"], 100 * SHORTER, PRESSED / 1e3),
    "in Japanese": (["圧縮ひずみ (%)", "圧縮応力 (kPa)"], 100 * SHORTER, PRESSED / 1e3),
    "both signed": (["Strain (%)", "Stress (Pa)"], -100 * SHORTER, -PRESSED),
}  # fmt: skip


@pytest.mark.parametrize("back", [False, True])
@pytest.mark.parametrize("name", PRESSES)
def test_compression_is_a_stretch_below_one(name, back, write):
    """Also where the specimen is let go again."""
    header, *columns = PRESSES[name]
    if back:
        columns = [np.r_[one, one[-2::-1]] for one in columns]
    curve = read_curve(write(table(header, *columns)), specimen=BODY)
    assert curve.stretch == pytest.approx(SQUEEZED[::-1], abs=1e-7)
    assert curve.stress == pytest.approx(-PRESSED[::-1], rel=1e-5, abs=1e-3)
    assert small_modulus(curve) == pytest.approx(30e3, rel=1e-5)


@pytest.mark.parametrize(
    ("header", "told"),
    [
        (["Stauchung", "Druckspannung"], "strain=Stauchung[%],stress=Druckspannung[kPa]"),
        (["Stauchung", "Druckspannung"], "strain=2[%],stress=3[kPa]"),
        (
            ["Compression (%)", "Contrainte de compression"],
            "strain=Compression[%],stress=Contrainte de compression[kPa]",
        ),
    ],
)
def test_a_told_column_says_compression_in_its_own_language(header, told, write):
    curve = read_curve(write(table(["t", *header], SHORTER, 100 * SHORTER, PRESSED / 1e3)), columns=told)
    assert small_modulus(curve) == pytest.approx(30e3, rel=1e-5) and curve.stretch.max() == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("header", "signs", "words"),
    [
        (["Compressive strain (%)", "Compressive stress (kPa)"], (-1, 1), "'Compressive strain .%.' says compression"),
        (
            ["Compressive strain (%)", "Compressive stress (kPa)"],
            (1, -1),
            "'Compressive stress .kPa.' says compression",
        ),
        (["Compressive strain (%)", "Stress (kPa)"], (1, 1), "contradict each other.*'Compressive strain .%.' means"),
        (["Strain (%)", "Compressive stress (kPa)"], (1, 1), "contradict each other"),
        (["Strain (%)", "Stress (kPa)"], (-1, 1), "contradict each other"),
        (["Tensile strain (%)", "Stress (kPa)"], (-1, -1), "'Tensile strain .%.' says tension, but a value of it is"),
        (["Tensile strain (%)", "Compressive stress (kPa)"], (1, 1), "contradict each other"),
    ],
)
def test_a_sign_that_contradicts_its_header_or_the_other_column_is_refused(header, signs, words, write):
    path = write(table(header, 100 * signs[0] * SHORTER, signs[1] * PRESSED / 1e3))
    with pytest.raises(TensileError, match=words):
        read_curve(path)


@pytest.mark.parametrize("title", ["Test type,Compression", "Stauchversuch DIN 53421,", ""])
def test_a_title_or_a_files_name_that_says_compression_is_asked_about(title, write, tmp_path):
    """Where the columns are positive and do not say it."""
    rows = table(["Displacement (mm)", "Force (N)"], 1e3 * LENGTH * SHORTER, PRESSED * SECTION)
    path = write(f"{title}\n{rows}" if title else rows)
    path = path if title else path.rename(tmp_path / "compression_1.csv")
    with pytest.raises(TensileError, match=r"says compression, but .* are positive, as in tension; give the test as"):
        read_curve(path, specimen=BODY)
    curve = read_curve(path, "compression", specimen=BODY)
    assert curve.stretch == pytest.approx(SQUEEZED[::-1], abs=1e-7) and small_modulus(curve) == pytest.approx(30e3, rel=1e-5)
    assert read_curve(path, "tension", specimen=BODY).stretch == pytest.approx(1 + SHORTER, abs=1e-7)


@pytest.mark.parametrize("signs", [(1, 1), (-1, -1), (-1, 1), (1, -1)])
def test_a_test_told_as_compression_may_have_any_signs(signs, write):
    path = write(table(["Strain (%)", "Stress (kPa)"], 100 * signs[0] * SHORTER, signs[1] * PRESSED / 1e3))
    curve = read_curve(path, "compression")
    assert curve.stretch.max() == pytest.approx(1.0) and small_modulus(curve) == pytest.approx(30e3, rel=1e-5)


def test_the_loop_of_a_compression_is_measured(write):
    lower = np.r_[PRESSED, 0.8 * PRESSED[-2::-1]]
    path = write(table(["Compressive strain", "Compressive stress (Pa)"], np.r_[SHORTER, SHORTER[-2::-1]], lower))
    assert read_curve(path).loop == pytest.approx(0.2, abs=0.02)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(TensileError, match=r"none.csv.*No such file"):
        read_curve(tmp_path / "none.csv")


def test_range_needs_points(write):
    curve = read_curve(write(PLAIN))
    assert curve.within(1.2, 2.0).stretch[[0, -1]] == pytest.approx([1.2, 2.0])
    with pytest.raises(TensileError, match=r"1 of its points are between stretch 2\.95 and 4"):
        curve.within(2.95, 4.0)


def test_stress_errors(write):
    curve = read_curve(write(PLAIN))
    assert StressError.from_text("2%+0.5kPa").of(curve) == pytest.approx(np.hypot(0.02 * S, 500.0), rel=1e-6)
    assert StressError.from_text("0.5kPa").stated and not StressError.from_text("auto").stated
    assert np.ptp(StressError.from_text("constant").of(curve)) == 0.0
    for text, words in (("2%", "absolute part"), ("-1kPa", "above zero"), ("much", "'much'"), ("5", "no unit")):
        with pytest.raises(TensileError, match=words):
            StressError.from_text(text)


def test_noise_is_told_from_the_bend(write):
    stretch = np.linspace(1.0, 3.0, 400)
    stress = MU * (stretch - stretch**-2) + np.random.default_rng(4).normal(0.0, 300.0, 400)
    curve = read_curve(write(table(["stretch", "stress (Pa)"], stretch, stress)))
    assert noise(curve) == pytest.approx(300.0, rel=0.2)
    assert noise(read_curve(write(PLAIN))) == 0.0 and len(L) < MIN_POINTS_FOR_NOISE


@pytest.mark.parametrize("name", ["cross_section", "gauge_length", "radius", "thickness"])
def test_impossible_specimens(name):
    with pytest.raises(TensileError, match="above zero"):
        Specimen(**{name: -1.0})


def test_who_says_what_a_column_holds_is_believed(write):
    """A strain that does begin at 100 % is refused by its header alone, and read as strain where --columns says so."""
    path = write(table(["strain", "stress (kPa)"], L + 0.0004, 20 + S / 1e3))
    with pytest.raises(TensileError, match="if the curve really starts at that strain, give columns strain=1"):
        read_curve(path)
    assert read_curve(path, columns="strain=1,stress=2[kPa]").stretch[0] == pytest.approx(2.0004)


def test_lines_of_numbers_are_not_searched_for_a_header(write, monkeypatch):
    """Patterns look at lines of words alone: a raw curve has 37,512 lines of numbers."""
    asked = []
    monkeypatch.setattr("softmodels.common.columns.recognise", lambda text, *rest: asked.append(text) or recognise(text, *rest))
    rows = "".join(f"{1 + i / 500:.4f},{i}\n" for i in range(1000))
    assert len(read_curve(write("stretch,stress (kPa)\n" + rows)).stretch) == 1000
    assert len(asked) < 10


def test_the_peaks_of_a_stepwise_test_are_no_jumps(write):
    """Eight steps, each held while a tenth of the stress relaxes: among the readings at which the stretch still rises a peak
    stands alone, but not among all."""
    stretch, stress = [1.0], [0.0]
    for step in range(8):
        rise = np.linspace(stretch[-1], 1.2 + 0.2 * step, 9)[1:]
        hold = rise[-1] + 1e-5 * np.sin(np.arange(60.0))
        relaxed = MU * (rise[-1] - rise[-1] ** -2) * (1 - 0.1 * (1 - np.exp(-np.arange(60) / 5)))
        stretch += [*rise, *hold]
        stress += [*(MU * (rise - rise**-2)), *relaxed]
    file = write(
        table(["time (s)", "stretch", "stress (kPa)"], np.arange(len(stretch)), np.array(stretch), np.array(stress) / 1e3)
    )
    (curve,) = prepared([read_curve(file)])
    assert not any("jump" in remark for remark in curve.remarks)


@pytest.mark.parametrize(("sign", "name"), [(1, "tension"), (-1, "compression")])
def test_a_position_of_the_crosshead_is_no_extension(sign, name, write):
    """The machine's position is 12 mm where the strip of 33 mm is taut, and the first reading has a small preload."""
    stretch = np.linspace(1.0 + sign * 0.01, 1.0 + sign * 0.5, 60)
    stress = MU * (stretch - stretch**-2)
    moved, force = 12.0 + 33.0 * np.abs(stretch - 1.0), np.abs(stress) * SECTION
    text = table(["Position (mm)", "Load (N)"], moved, force)
    curve = read_curve(write(text), test=name, specimen=Specimen(cross_section=SECTION, gauge_length=LENGTH))
    (shifted,) = prepared([curve])
    assert shifted.origin.slack == pytest.approx(sign * 12.0 / 33.0, abs=5e-3)
    assert any("counts from elsewhere" in remark for remark in shifted.remarks)
    (plain,) = prepared([read_curve(write(table(["stretch", "stress (kPa)"], stretch, stress / 1e3)), test="uniaxial")])
    assert plain.origin is None


def test_a_specimen_may_be_slack_over_half_of_its_length(write):
    stretch = np.linspace(1.0, 3.0, 101)
    taut = np.maximum(stretch - 0.6, 1.0)
    curve = read_curve(write(table(["strain", "stress (kPa)"], stretch - 1.0, 20.0 * (taut - taut**-2))))
    (read,) = prepared([curve])
    assert read.origin.slack == pytest.approx(0.6, abs=0.03) and small_modulus(read) == pytest.approx(20e3, rel=0.1)
