"""Strategies for what people and other programs write: valid inputs, their neighbours, and what no program should choke on.

An `Attempt` is one call of a command with the files that it finds. Files start from a valid one; single values are replaced,
entries added, doubled or taken away, and in the end bytes are damaged.
"""

from __future__ import annotations

import dataclasses
import json
import tomllib
from typing import Any

import click
from hypothesis import strategies as st

KINDS = ("options", "case", "material", "photos", "setup")


@dataclasses.dataclass(frozen=True)
class Attempt:
    """A command and its files.

    Attributes:
        program: One of the programs that ``fuzz.py`` knows.
        words: Its arguments.
        files: Contents by name.
    """

    program: str
    words: tuple[str, ...]
    files: dict[str, bytes]


LENGTHS = ["3 mm", "0.5 mm", "12mm", "1e-2 m", "0.4 cm", "20000 um", "0", "0 mm"]
STRESSES = ["20 kPa", "8000 Pa", "0.03 MPa", "20kPa", "2 psi"]
NUMBERS = ["0.49", "0.5", "2", "1", "30", "5 %", "-0.3"]
ODD = [
    "", " ", "mm", "1,5 mm", "12,5kPa", "1.000,5 mm", "1 000 mm", "5 647 Pa", "10 0mm", "--2mm", "2*3mm", "9**9**9 mm",
    "9**9**9", "mm^9^9^9", "1 mm^99999999", "nan", "inf mm", "-inf", "1e400 mm", "1e-400 mm", "-3 mm", "3", "3 mn", "3 kPa",
    "5 kg", "45 deg", "2 s", "3 °", "\u0663 mm", "3\u00a0mm", "\u22123 mm", "3 mm; 4 mm", "(3) mm", "0x10 mm", "1_0 mm",
    "true", "None", "[3 mm]", "{}", "a" * 300, "9" * 20 + " mm", "9" * 400, "9" * 400 + " mm", "9" * 5000,
    "../..", "/dev/null", " " * 3000 + "x",
    ".", "-", "--", "0:5", "0:5:1", "5:0", "0:1e9:1e-9", "0,5,5", "1:2:3:4", ":", "0:", "0;5", "\U0001f480", "é", "$x$", "%s",
]  # fmt: skip
"""Texts that stand where a number, a unit, a name or a range belongs."""

good = st.sampled_from(LENGTHS + STRESSES + NUMBERS)
odd = st.sampled_from(ODD) | st.text(st.characters(exclude_categories=("Cs", "Cc")), max_size=12)
texts = st.one_of(good, odd)

RAW = ["[]", "{}", "[[]]", "[1, 2]", '["1"]', "true", "false", "nan", "inf", "-inf", "1e400", "0", "-1", "3", "2.5", "1e-300",
       "9" * 19, "9" * 400, "9" * 5000, "0x" + "f" * 60, "2020-01-01", "07:32:00", "{a = 1}", "[" * 30 + "]" * 30,
       "[" * 3000 + "]" * 3000, "[1, [2]]", '"', "'", '"\\u0000"', "", "=", "#", "1979-05-27T07:32:00Z"]  # fmt: skip
"""Values of a TOML table as they stand in the file, many of another type, some no TOML."""
values = st.one_of(st.sampled_from(RAW), texts.map(lambda text: json.dumps(text, ensure_ascii=False)),
                   st.floats().map(repr), st.integers().map(str))  # fmt: skip


# -- damage to a file's bytes ----------------------------------------------------------------------------------------------


@st.composite
def damaged(draw: Any, text: str) -> bytes:
    """A file's bytes: mostly whole, else with one damage."""
    data = text.encode("utf-8", "replace")
    kind = draw(st.sampled_from(["none"] * 30 + ["cut", "mark", "zero", "bytes", "wide", "twice", "line", "empty", "latin"]))
    place = draw(st.integers(0, len(data)))
    lines = text.splitlines(keepends=True)
    line = draw(st.integers(0, max(len(lines) - 1, 0)))
    return {
        "none": lambda: data,
        "cut": lambda: data[:place],
        "mark": lambda: b"\xef\xbb\xbf" + data,
        "zero": lambda: data[:place] + b"\0" + data[place:],
        "bytes": lambda: data[:place] + draw(st.binary(max_size=8)) + data[place:],
        "wide": lambda: text.encode("utf-16"),
        "twice": lambda: data + b"\n" + data,
        "line": lambda: "".join([*lines[: line + 1], *lines[line:]]).encode(),
        "empty": lambda: b"",
        "latin": lambda: text.encode("latin-1", "replace") + b"# \xe9",
    }[kind]()


# -- tables ----------------------------------------------------------------------------------------------------------------

Tables = dict[str, dict[str, str]]
SECTION: Tables = {
    "geometry": {"device": '"HollowDisk"', "section": '"axisymmetric"', "cell_size": '"3 mm"', "refinement": "1.0"},
    "material": {"law": '"neo-hookean"', "shear_modulus": '"20 kPa"', "poisson": "0.49"},
    "load": {"pressure_cm": "[0, 5]", "control": '"auto"', "water_density": '"970 kg/m^3"'},
}
MORE: Tables = {
    "geometry": {"variant": '"shadow"', "membrane": '"4 mm"', "fillet": '"0 mm"', "order": "2", "support": '"base"',
                 "angle": '"45 deg"', "azimuth": '"0 deg"', "device": '"SeminarActuator"', "channels": "5", "file": '"a.step"',
                 "cavities": '["at 1, 2, 3 mm"]', "planes": '["y = 0 mm"]', "pressure_ratios": "[1]",
                 "surfaces": '["pad = coloured red"]'},
    "material": {"law": '"yeoh"', "c1": '"8 kPa"', "c2": '"90 Pa"', "mu": '["3 kPa"]', "alpha": "[2]", "limit": "30",
                 "silicone": '"ecoflex-00-30"', "young": '"60 kPa"', "convention": '"mu/alpha"'},
    "load": {"volume_ml": '"0:1"', "stroke_ml": '"0:5"', "load_unload": "true", "cavity1.pressure_cm": "[0, 5]",
             "control": '"volume"'},
    "solver": {"formulation": '"displacement"'},
    "sheet": {"face": '"top"', "stiffness": '"1 kN/m"'},
    "contact": {"faces": '"top"', "plane": '"z = 17 mm"', "stiffness": "300"},
    "supply": {"kind": '"syringe"', "syringe": '"20 ml"', "dead_volume": '"5 ml"', "gas": '"isothermal"', "leak_per_m3": "0.0",
               "ambient": '"101 kPa"'},
}  # fmt: skip


def written(tables: Tables) -> str:
    return "\n".join(
        (f"[{name}]\n" if name else "") + "".join(f"{key} = {value}\n" for key, value in table.items())
        for name, table in sorted(tables.items())
    )


@st.composite
def changed(draw: Any, tables: Tables, more: Tables) -> Tables:
    """Tables with up to three entries set to anything, valid ones added, or some taken away."""
    made = {name: dict(table) for name, table in tables.items()}
    for _ in range(draw(st.sampled_from([0, 1, 1, 2, 3]))):
        name = draw(st.sampled_from(sorted({*made, *more})))
        known = sorted({*made.get(name, {}), *more.get(name, {})}) or ["x"]
        key = draw(st.sampled_from(known))
        how = draw(st.sampled_from(["any", "any", "valid", "valid", "none", "unknown"]))
        table = made.setdefault(name, {})
        if how == "any":
            table[key] = draw(values)
        elif how == "valid":
            table[key] = more.get(name, {}).get(key) or table.get(key, "1")
        elif how == "none":
            table.pop(key, None)
        else:
            table[draw(st.sampled_from(["x", "Membrane", "a.b.c", '""', "-"]))] = draw(values)
    return made


@st.composite
def cases(draw: Any) -> Attempt:
    text = written(draw(changed(SECTION, MORE)))
    words = ("run", "case.toml", "--no-pictures", "--quiet", "-o", "out")
    return Attempt("softmodels", words, {"case.toml": draw(damaged(text))})


@st.composite
def materials(draw: Any) -> Attempt:
    base = draw(st.sampled_from([SECTION["material"], {"law": '"yeoh"', "c1": '"8 kPa"', "c2": '"90 Pa"'},
                                 {"law": '"ogden"', "mu": '["3 kPa", "1 kPa"]', "alpha": "[2, -2]"},
                                 {"silicone": '"ecoflex-00-30"'}]))  # fmt: skip
    text = written(draw(changed({"material": base}, {"material": MORE["material"]})))
    curve = ("curve", "--material", "m.toml", "--no-pictures", "--quiet", "-o", "out")
    disk = (
        "--material",
        "m.toml",
        "--pressure-cm",
        "0:2",
        "--section",
        "axisymmetric",
        "--no-pictures",
        "--quiet",
        "-o",
        "out",
    )
    program, words = draw(st.sampled_from([("softmodels", curve), ("disk", disk)]))
    return Attempt(program, words, {"m.toml": draw(damaged(text))})


# -- lists of photographs and setups ---------------------------------------------------------------------------------------


@st.composite
def photos(draw: Any, setup: str, pictures: dict[str, bytes]) -> Attempt:
    mark = draw(st.sampled_from([",", ",", ";", "\t"]))
    usual = [["file", "pressure"], ["file", "pressure", "error"], ["file", "left", "right"], ["File", "Pressure"]]
    header = draw(st.sampled_from([*3 * usual, ["file"], ["pressure", "file"], ["file", "pressure", "x"]]))
    right = st.sampled_from(["0 cm", "5 cm", "3 mm", "12.5 cm"])
    cells = st.one_of(right, right, right, st.sampled_from(["1.2 kPa", "35 mmH2O", "2,8 cm", '"2,8 cm"', "5 647 Pa"]), texts)
    files = st.sampled_from(list(pictures))
    names = st.one_of(*6 * [files], st.sampled_from(["none.png", "0001", ".", "a/b.png", "REST.JPG"]), texts)
    rows = [header]
    if header == ["file", "pressure"]:
        rows.append(["rest.jpg", "0 cm"])
    for _ in range(draw(st.integers(1, 3))):
        rows.append([draw(names if name.lower() == "file" else cells) for name in header])
    if draw(st.integers(0, 9)) == 0:
        rows.append([draw(texts)])
    text = "\n".join(mark.join(row) for row in rows) + "\n"
    words = ("photos", "photos.csv", "--setup", "setup.toml", "--no-pictures", "--quiet", "--jobs", "1", "-o", "out")
    return Attempt("measurement", words, {"photos.csv": draw(damaged(text)), "setup.toml": setup.encode(), **pictures})


@st.composite
def setups(draw: Any, setup: str, pictures: dict[str, bytes]) -> Attempt:
    tables: Tables = {"": {}}
    for name, value in tomllib.loads(setup).items():
        if isinstance(value, dict):
            tables[name] = {key: json.dumps(one) for key, one in value.items()}
        else:
            tables[""][name] = json.dumps(value)
    more = {"": {"roi": "[0, 0, 600, 400]", "zero": "[[0.0, 0.0], [0.01, 0.0]]", "shadow_colour": "[20, 20, 20]"}}
    text = written(draw(changed(tables, more)))
    listed = b"file,pressure\nrest.jpg,0 cm\nsecond.jpg,10 cm\n"
    words = ("photos", "photos.csv", "--setup", "setup.toml", "--no-pictures", "--quiet", "--jobs", "1", "-o", "out")
    return Attempt("measurement", words, {"photos.csv": listed, "setup.toml": draw(damaged(text)), **pictures})


# -- options ---------------------------------------------------------------------------------------------------------------

STARTS = {
    ("disk",): ("--section", "axisymmetric", "--pressure-cm", "0:5", "--no-pictures", "--quiet", "-o", "out"),
    ("seminar",): ("--pressure-cm", "0:5", "--no-pictures", "--quiet", "-o", "out"),
    ("softmodels", "limit"): ("-o", "out"),
    ("softmodels", "curve"): ("--material", "ecoflex-00-30", "--no-pictures", "--quiet", "-o", "out"),
    ("softmodels", "fit"): ("--tensile", "pull.csv", "--no-pictures", "--quiet", "-o", "out"),
    ("measurement", "setup"): ("grid.jpg", "--lens", "none", "-o", "out/setup.toml"),
    ("measurement", "photos"): ("photos.csv", "--no-pictures", "--quiet", "--jobs", "1", "-o", "out"),
    ("geometries", "HollowDisk"): ("--section", "axisymmetric", "-o", "out/a.msh"),
}
"""Programs with their subcommands, and what makes each of them run."""
NEVER = {"help", "output", "overlay", "petsc", "jobs"}
"""Options that are left alone: they say where to write, or how many processes to start."""


@st.composite
def options(draw: Any, commands: dict[tuple[str, ...], click.Command], files: dict[str, bytes]) -> Attempt:
    """Up to four options of a command, any of those it has, with a value that fits or any other."""
    start = draw(st.sampled_from(sorted(STARTS)))
    words = [*start[1:], *STARTS[start]]
    known = [p for p in commands[start].params if isinstance(p, click.Option) and p.name not in NEVER]
    for _ in range(draw(st.integers(0, 4))):
        option = draw(st.sampled_from(known))
        flag = option.opts[0]
        if option.is_flag:
            words.append(flag)
            continue
        choices = list(option.type.choices) if isinstance(option.type, click.Choice) else []
        value = draw(st.one_of(st.sampled_from(choices), texts) if choices else st.one_of(good, texts))
        words += [f"{flag}={value}"] if draw(st.booleans()) else [flag, value]
    if draw(st.integers(0, 9)) == 0:
        words.insert(draw(st.integers(0, len(words))), draw(texts))
    return Attempt(start[0], tuple(words), files)
