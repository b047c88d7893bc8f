"""Reference pages: one for each public name of ``softmodels``, one for each of the packages beside it."""

from __future__ import annotations

import dataclasses
import itertools
from pathlib import Path
from typing import TYPE_CHECKING

import geometries
import measurement
import softmodels
from softmodels.common import errors

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files

GROUPS = {
    "Runs": "inflate run limit load compare Case Run SolvedState Line Limit Comparison Syringe Reservoir",
    "Devices": "HollowDisk SeminarActuator PneuNet BendingBellows Cylinder Membrane Balloon Bellows Beam ChannelPlate "
    "ChannelCell ImportedActuator ImportedMesh",
    "Materials": "NeoHookean MooneyRivlin Yeoh Ogden Gent Carroll Polynomial FungDemiray silicone Material Region",
    "Loads, contact and parts": "Gravity Mass Force Moment Rigid RigidShape Obstacle Walls Fibres Fabric Sheet Clamp",
    "Fits": "fit fit_heights fit_curves fit_leak score FitOptions TensileCurve Score Leak",
    "Design, studies, mould, export": "optimise DesignProblem Keep study Study ReducedModel mould export",
}
"""Names by subject. A public name that is in no group is listed under "More"; errors and warnings have a group of their own."""
EXAMPLES = Path(__file__).parent / "examples"
NAMES = EXAMPLES / "names.md"
"""An example of each public name with its output; a test runs them."""
PACKAGES = {"measurement": measurement, "geometries": geometries}


def groups() -> dict[str, list[str]]:
    """Return every public name of ``softmodels``, each in exactly one group."""
    public = [name for name in softmodels.__all__ if not name.startswith("_")]
    grouped = {title: [name for name in names.split() if name in public] for title, names in GROUPS.items()}
    rest = [name for name in public if not any(name in names for names in grouped.values())]
    grouped["More"] = [name for name in rest if not name.endswith(("Error", "Warning"))]
    grouped["Errors and warnings"] = [name for name in rest if name.endswith(("Error", "Warning"))]
    return {title: names for title, names in grouped.items() if names}


def place(name: str) -> str:
    """Return the page of a name. ``Run`` and ``run`` differ by case only, so classes and functions have a folder each."""
    return f"reference/{'classes' if name[0].isupper() else 'functions'}/{name}.md"


def fields_table(item: object) -> str:
    """Return a table of a dataclass' fields, or of a call's options, with units, defaults and help; empty where they have no
    help."""
    fields = dataclasses.fields(item) if isinstance(item, type) and dataclasses.is_dataclass(item) else ()
    described = [(field.name, field.metadata.get("about"), field.metadata, field.default) for field in fields]
    described += [(one.name, one.about, {}, one.default) for one in getattr(item, "options", ())]
    rows = []
    for name, about, metadata, default in described:
        text = metadata.get("help") or getattr(about, "text", "")
        unit = metadata.get("unit") or getattr(getattr(about, "kind", None), "unit", "")
        shown = "" if default in (dataclasses.MISSING, None) else f"`{default!r}`"
        if text:
            rows.append(f"| `{name}` | {shown} | {unit} | {errors.spoken(text).replace('|', '/')} |")
    return "\n".join(["| argument | default | unit | meaning |", "|---|---|---|---|", *rows]) + "\n" if rows else ""


def examples() -> dict[str, str]:
    """Return the examples of public names, as typed and printed in Python, by name."""
    _, *parts = NAMES.read_text(encoding="utf-8").split("\n## ")
    return {name.strip(): code.strip() for name, _, code in (part.partition("\n") for part in parts)}


def example(name: str) -> str:
    """Return the part of a name's page with its example; empty where it has none."""
    code = examples().get(name)
    return f"\n## Example\n\n```pycon\n{code}\n```\n" if code else ""


def pages() -> dict[str, str]:
    """Return the text of every reference page by its path."""
    texts = {}
    for name in itertools.chain(*groups().values()):
        item = getattr(softmodels, name)
        table = fields_table(item)
        # Arguments and class docstring are what a user needs of a device, a law or a part; the rest is for the solver.
        members = "true" if item is softmodels.Case else "false"
        options = (
            f"    options: {{members: {members}, merge_init_into_class: false, show_signature: false}}\n\n"
            if table and isinstance(item, type)
            else "\n"
        )
        texts[place(name)] = f"::: softmodels.{name}\n{options}{table}{example(name)}"
    for package, module in PACKAGES.items():
        own = [name for name in module.__all__ if name[0] != "_" and name not in softmodels.__all__]
        texts[f"reference/{package}.md"] = f"# {package}\n\n" + "\n".join(
            f"::: {package}.{name}\n    options: {{heading_level: 2}}\n" for name in own
        )
    lists = "\n".join(
        f"\n## {title}\n\n" + "\n".join(f"- [`sm.{name}`]({place(name).removeprefix('reference/')})" for name in names)
        for title, names in groups().items()
    )
    intro = (
        "Public names of `import softmodels as sm`, and of the packages [measurement](measurement.md) and "
        "[geometries](geometries.md).\n"
    )
    texts["reference/index.md"] = f"# Reference\n\n{intro}{lists}\n"
    return texts


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """MkDocs calls this before it reads the pages: fill the part "Reference" of the navigation."""
    entries: list[object] = ["reference/index.md"]
    entries += [{title: [{name: place(name)} for name in names]} for title, names in groups().items()]
    entries += [{package: f"reference/{package}.md"} for package in PACKAGES]
    assert config.nav is not None
    config.nav = [{"Reference": entries} if "Reference" in entry else entry for entry in config.nav]
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """MkDocs calls this with the list of pages: add those of the reference, and the gallery's files to download."""
    from mkdocs.structure.files import File

    for path, text in pages().items():
        files.append(File.generated(config, path, content=text))
    for file in sorted(EXAMPLES.glob("*.py")):
        files.append(File.generated(config, f"examples/{file.name}", abs_src_path=str(file)))
    return files
