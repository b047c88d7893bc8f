"""Cases as values and as text: nothing is lost on the way to a file and back."""

from __future__ import annotations

import dataclasses
import itertools

import pytest

from geometries import HollowDisk
from softmodels.case.case import Case
from softmodels.case.entries import CaseError, series
from softmodels.case.load import steps_of
from softmodels.case.materials import material_from
from softmodels.materials.laws import Gent, MaterialError, MooneyRivlin, NeoHookean, Ogden, Yeoh
from softmodels.materials.silicones import SILICONES

# Numbers that no short text holds: a round trip must not cost them a bit.
THIRD = 1 / 3
MATERIALS = [
    NeoHookean(30e3),
    NeoHookean(1e5 * THIRD, 0.5),
    MooneyRivlin(12e3 * THIRD, 3e3, 0.47),
    Yeoh(7859.0, 94.3 * THIRD, -0.1),
    Ogden((20e3, -5e3 * THIRD), (1.3, -2.0 * THIRD), 0.495),
    Gent(25e3 * THIRD, 30.0 * THIRD, 0.49),
]
DISKS = [
    HollowDisk(),
    HollowDisk.variant("shadow"),
    HollowDisk(section="axisymmetric", membrane=0.02 * THIRD, fillet=0.0, order=1, support="base"),
    HollowDisk(angle=180.0 * THIRD, azimuth=10 * THIRD, cell_size=0.0031),
]
GEOMETRY = '[geometry]\ndevice = "HollowDisk"\n'
SMALL = f'{GEOMETRY}[load]\npressure_cm = "0:30"\n'


@pytest.mark.parametrize("material", MATERIALS, ids=lambda material: f"{material.name}-{material.poisson}")
@pytest.mark.parametrize("actuator", DISKS, ids=["default", "shadow", "axisymmetric", "slice"])
def test_case_survives_its_file_to_the_last_bit(material, actuator):
    by_pressure = Case(
        "a-b.1",
        actuator,
        material,
        steps_of(pressure_cm=(0.0, THIRD, 30.0), water_density=1000 * THIRD),
        water_density=1000 * THIRD,
        control="arc-length",
    )
    by_volume = Case("disk", actuator, material, steps_of(volume_ml=(0.1, THIRD)), control="volume")
    in_pascals = Case("disk", actuator, material, steps_of(pressure="0.1,0.7 kPa"), water_density=1000 * THIRD)
    of_another_column = dataclasses.replace(by_pressure, water_density=970.0)
    assert of_another_column.values == by_pressure.values
    for case in (by_pressure, by_volume, in_pascals, of_another_column):
        assert Case.from_toml(case.to_toml()) == case
        assert Case.from_toml(case.to_toml()).to_toml() == case.to_toml()


@pytest.mark.parametrize("name", SILICONES)
def test_a_silicone_by_name_is_its_law(name):
    case = Case.from_toml(f'{SMALL}[material]\nsilicone = "{name}"\n')
    assert case.material == SILICONES[name].material
    softer = Case.from_toml(f'{SMALL}[material]\nsilicone = "{name}"\npoisson = 0.49\n').material
    assert softer == dataclasses.replace(SILICONES[name].material, poisson=0.49)


@pytest.mark.parametrize(
    ("beside", "named"),
    [
        ('law = "neo-hookean"\nshear_modulus = "20 kPa"', "law and shear_modulus"),
        ('law = "yeoh"\nc1 = "20 kPa"', "law and c1"),
        ('c1 = "20 kPa"', "c1"),
        ('poisson = 0.49\nlaw = "yeoh"', "law"),
    ],
)
def test_a_silicone_beside_a_law_is_no_mixture_of_both(beside, named):
    with pytest.raises(CaseError, match=f"delete {named} to use the silicone, or delete silicone to use your own law"):
        Case.from_toml(f'{SMALL}[material]\nsilicone = "ecoflex-00-30"\n{beside}\n')
    values = {line.split(" = ")[0]: line.split(" = ")[1].strip('"') for line in beside.splitlines()}
    if "law" not in values:
        with pytest.raises(MaterialError, match="leave out c1, or name a law instead of the silicone"):
            material_from("ecoflex-00-30", values)
    assert material_from("ecoflex-00-30", {"poisson": "0.49"}).poisson == 0.49


def test_what_a_case_file_leaves_out_has_its_default():
    case = Case.from_toml(SMALL)
    assert case == Case("disk", HollowDisk(), NeoHookean(30e3, 0.5), steps_of(pressure_cm=(0.0, 30.0)), 970.0, "auto", "mixed")
    assert case.values == pytest.approx((0.0, 30 * 95.124505), rel=1e-12)
    assert Case("disk", HollowDisk(), NeoHookean(30e3), steps_of(volume_ml=(2.5,))).values == pytest.approx((2.5e-6,))


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("0:177", (0, 177)),
        ("0:177:60", (0, 60, 120, 177)),
        ("0:180:60", (0, 60, 120, 180)),
        ("0:0.3:0.1", (0, 0.1, 0.2, 0.3)),
        ("10:20:100", (10, 20)),
        ("0,70,130,177", (0, 70, 130, 177)),
        (" 5 , 6.5 ", (5, 6.5)),
        ("177", (177,)),
        ([0, 70.0, 130], (0, 70, 130)),
        (42, (42,)),
        ((), ()),
    ],
)
def test_series_of_requested_values(text, values):
    assert series(text, "pressure") == pytest.approx(values, rel=1e-15)


@pytest.mark.parametrize("step", [0.1, 0.3, 0.7, 1.1, 3.0, 7.0, 59.0, 88.5])
def test_a_range_ends_at_its_end_once(step):
    values = series(f"0:177:{step}", "pressure")
    gaps = [after - before for before, after in itertools.pairwise(values)]
    assert values[0] == 0.0 and values[-1] == 177.0
    assert gaps[:-1] == pytest.approx([step] * (len(gaps) - 1)) and 1e-9 < gaps[-1] <= step * (1 + 1e-9)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("not toml", ["TOML"]),
        (GEOMETRY, ["[load]"]),
        ('[load]\npressure_cm = "0:30"\n', ["[geometry]"]),
        (f"{SMALL}[solvers]\n", ["solvers", "known"]),
        (f"{SMALL}pressures = 3\n", ["[load]", "pressures"]),
        (f'{SMALL}[solver]\nform = "mixed"\n', ["[solver]", "form"]),
        (f"load = 3\n{GEOMETRY}", ["load", "3", "table"]),
        (f"solver = 3\n{SMALL}", ["solver", "3", "table"]),
        (f'material = "yeoh"\n{SMALL}', ["material", "yeoh", "table"]),
        (SMALL.replace("[geometry]", "[[geometry]]"), ["geometry", "table"]),
        (SMALL.replace("HollowDisk", "Sphere"), ["device", "Sphere", "HollowDisk"]),
        (SMALL.replace("device", 'variant = "moon"\ndevice'), ["variant", "moon"]),
        (SMALL.replace("device", "membrane = 6\ndevice"), ["membrane", "'6'", "unit"]),
        (SMALL.replace("device", 'mebrane = "6 mm"\ndevice'), ["mebrane"]),
        (SMALL.replace('"0:30"', '[0, "a"]'), ["pressure", "'a'"]),
        (SMALL.replace('"0:30"', "true"), ["pressure", "True"]),
        (f'{SMALL}volume_ml = "0:3"\n', ["pressures", "volumes", "one of these"]),
        (f"{SMALL}water_density = 970\n", ["water_density", "970", "unit"]),
        (f"{SMALL}control = 3\n", ["control", "3"]),
        (f'{SMALL}[solver]\nformulation = ["mixed"]\n', ["formulation", "mixed"]),
        (f'{SMALL}[material]\nlaw = ["yeoh"]\n', ["law", "yeoh"]),
        (f'{SMALL}[material]\nsilicone = ["rtv615"]\n', ["silicone", "rtv615"]),
        (f'{SMALL}[material]\nlaw = "yeoh"\nc1 = nan\n', ["yeoh", "c1", "nan"]),
        (f"name = 3\n{SMALL}", ["name", "3"]),
        (f'name = "../elsewhere"\n{SMALL}', ["name", "../elsewhere"]),
        (f'name = ""\n{SMALL}', ["name", "''"]),
        (f'name = "{"a" * 5000}"\n{SMALL}', ["name 'aaa", "5000 bytes", "at most 200", "shorten it"]),
        (f'name = "{"ü" * 101}"\n{SMALL}', ["202 bytes"]),
    ],
)
def test_wrong_case_files_are_refused_by_name_and_value(text, words, tmp_path):
    with pytest.raises(CaseError) as refused:
        Case.from_toml(text)
    assert all(word in str(refused.value) for word in words), refused.value
    assert "\n" not in str(refused.value)
    (tmp_path / "my.toml").write_text(text)
    with pytest.raises(CaseError, match=r"my\.toml"):
        Case.from_file(tmp_path / "my.toml")


@pytest.mark.parametrize("value", ["[1]", "{a = 1}", "true", "nan", "[[]]", "2020-01-01", '"9**9 mm"'])
@pytest.mark.parametrize(
    ("table", "key"),
    [
        ("sheet", "stiffness"), ("sheet", "face"), ("supply", "syringe"), ("supply", "gas"), ("supply", "leak_per_m3"),
        ("supply", "dead_volume"), ("supply", "kind"), ("contact", "stiffness"), ("contact", "faces"), ("contact", "plane"),
        ("geometry", "membrane"), ("geometry", "order"), ("geometry", "support"), ("material", "poisson"),
        ("load", "water_density"), ("load", "control"), ("load", "load_unload"), ("solver", "formulation"),
        ("solver", "method"),
    ],
)  # fmt: skip
def test_what_is_no_number_or_word_is_a_sentence(table, key, value):
    tables = {
        "geometry": {"device": '"HollowDisk"'},
        "load": {"pressure_cm": "20"},
        "material": {"law": '"neo-hookean"', "shear_modulus": '"20 kPa"'},
        "sheet": {"face": '"top"', "stiffness": '"1 kN/m"'},
        "contact": {"faces": '"top"', "plane": '"z = 20 mm"'},
    }
    if table == "supply":
        tables["load"], tables["supply"] = {"stroke_ml": "20"}, {}
    tables.setdefault(table, {})[key] = value
    text = "\n".join(f"[{name}]\n" + "\n".join(f"{k} = {v}" for k, v in each.items()) for name, each in tables.items())
    if (key, value) == ("load_unload", "true"):
        assert Case.from_toml(text)
        return
    with pytest.raises(CaseError) as refused:
        Case.from_toml(text)
    assert " " in str(refused.value)


def test_ten_micrometres_are_ten_micrometres():
    """The least length that is taken, and no rounding below it: 10 um is 9.999999999999999e-06 m."""
    for text in ("10 um", "0.01 mm", "1e-5 m"):
        case = Case.from_toml(f'{GEOMETRY}fillet = "{text}"\n[load]\npressure_cm = 20\n')
        assert case.actuator.fillet == pytest.approx(1e-5)
    with pytest.raises(CaseError, match="fillet is 9 um"):
        Case.from_toml(f'{GEOMETRY}fillet = "9 um"\n[load]\npressure_cm = 20\n')
