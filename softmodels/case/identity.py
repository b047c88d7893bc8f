"""What a run's numbers depend on, as texts by name: two runs with the same texts have the same numbers.

Every field of a case counts but those of `MAY_GROW`, and of each field everything inside it, so that a field of tomorrow
cannot be forgotten. Files count by their content, wherever they lie.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping

from measurement.user_file import file_digest
from softmodels.case.case import Case
from softmodels.mechanics.parts import Part

ALIKE = ("solver",)
"""Fields of a case that decide how its numbers are found, and not which."""
MAY_GROW = ("pressures_cm", "volumes_ml", "strokes_ml", "program")
"""Fields of a case with the requested values: a run that is gone on with may be asked for more. They are checked apart."""


def identity(case: Case) -> dict[str, str]:
    """Everything that decides a case's numbers: texts by dotted names, such as ``"material.c1"``.

    Raises:
        CaseError: A file that the case names cannot be read.
    """
    texts = {name: text for name, text in _texts("", case) if name not in ALIKE}
    for name, path in case.actuator.files.items():
        texts[f"actuator.{name}"] = f"SHA-256 {file_digest(path)}"
    return texts


def difference(old: Mapping[str, str], new: Mapping[str, str]) -> str | None:
    """The first name under which two identities differ, requested values aside; None if there is none."""
    for name in [*new, *(name for name in old if name not in new)]:
        grows = name.split(".")[0] in MAY_GROW or name == "driven.values"
        if not grows and old.get(name) != new.get(name):
            return name
    return None


def _texts(name: str, value: object) -> Iterator[tuple[str, str]]:
    if not dataclasses.is_dataclass(value):
        yield name, _text(value)
        return
    if name:
        yield name, type(value).__name__
    for field in dataclasses.fields(value):
        if not field.compare:
            continue
        yield from _texts(f"{name}.{field.name}" if name else field.name, getattr(value, field.name))


def _text(value: object) -> str:
    if isinstance(value, tuple | list):
        return f"({', '.join(map(_text, value))})"
    if isinstance(value, int | float) and not isinstance(value, bool):
        return repr(float(value))  # 10 and 10.0 are one number
    text = repr(value)
    if isinstance(value, Part):
        for path in value.files.values():
            text = text.replace(repr(path), f"SHA-256 {file_digest(path)}")
    return text
