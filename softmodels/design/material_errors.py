"""Errors of a fitted material: the covariance of its parameters, as ``softmodels fit`` leaves it."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from measurement.toml_file import TomlError, read_toml
from measurement.units import brief
from softmodels.case import material_table
from softmodels.case.case import Case
from softmodels.design.errors import DesignError
from softmodels.materials.laws import Material, MaterialError
from softmodels.mechanics.sensitivity import known_parameters

WIDTH_95 = 2 * 1.959964
"""Standard deviations in a 95 % interval."""


@dataclasses.dataclass(frozen=True, eq=False)
class MaterialErrors:
    """How uncertain a material is.

    Attributes:
        names: Parameters of the law.
        covariance: Of them, SI units, shape (n, n).
        how: Where it comes from, a clause.
    """

    names: tuple[str, ...]
    covariance: npt.NDArray[np.float64]
    how: str

    @classmethod
    def of(cls, given: object, case: Case, folder: Path | None = None) -> MaterialErrors:
        """As they are, or from a fitted material's file.

        Raises:
            DesignError: No fit, or one of another material than the case's.
        """
        if isinstance(given, MaterialErrors):
            return given
        if isinstance(given, dict) and set(given) == {"file"}:
            given = given["file"]
        if not isinstance(given, str | Path):
            raise DesignError(
                f'material_errors is {brief(given)}; give a fitted material, file = "results/fit/fitted.toml"'
            )
        return cls.from_file((folder or Path()) / given, case.material)

    @classmethod
    def from_file(cls, path: Path, material: Material) -> MaterialErrors:
        """From ``fitted.toml``; with ``fit.json`` beside it the whole covariance, else that of the 95 % intervals alone."""
        try:
            tables = read_toml(path)
        except TomlError as error:
            raise DesignError(f"the fitted material {path} {error}") from None
        fit = tables.get("fit")
        if not isinstance(fit, dict) or not isinstance(tables.get("material"), dict):
            raise DesignError(f"{path} holds no fit; give the fitted.toml that softmodels fit has written")
        try:
            fitted = material_table.from_table(tables["material"])
        except MaterialError as error:
            raise DesignError(f"{path}: {error}") from None
        if fitted != material:
            raise DesignError(
                f"{path} is another material than the case's; take it there too ([material] of the case), so that the errors "
                "are around the values"
            )
        known = known_parameters(material)
        found = cls._covariance(path, fitted.name) or cls._intervals(path, fit)
        kept = [k for k, name in enumerate(found.names) if name in known]  # a device's fit has the bench's numbers too
        if not kept:
            raise DesignError(f"{path} has no errors of {', '.join(known)}; a fit with free parameters is needed")
        return cls(tuple(found.names[k] for k in kept), found.covariance[np.ix_(kept, kept)], found.how)

    @classmethod
    def _covariance(cls, path: Path, law: str) -> MaterialErrors | None:
        try:
            told = json.loads(path.with_name("fit.json").read_text(encoding="utf-8"))
            one = next(one for one in told["laws"] if one["law"] == law)
            covariance = np.array(one["covariance"], dtype=float)
            names = tuple(map(str, one["free"]))
        except (OSError, ValueError, KeyError, TypeError, StopIteration):
            return None
        if covariance.shape != (len(names), len(names)) or not np.isfinite(covariance).all():
            return None
        return cls(names, covariance, f"covariance of {path.with_name('fit.json')}")

    @classmethod
    def _intervals(cls, path: Path, fit: Mapping[str, object]) -> MaterialErrors:
        found = fit.get("intervals_95")
        intervals = found if isinstance(found, dict) else {}
        try:
            widths = {str(name): float(high) - float(low) for name, (low, high) in intervals.items()}
        except (TypeError, ValueError):
            raise DesignError(f"{path}: the intervals of its fit cannot be read") from None
        if not widths or not all(0.0 < width < np.inf for width in widths.values()):
            raise DesignError(f"{path} has no finite 95 % intervals, so the material's errors are not known")
        sigma = np.array(list(widths.values())) / WIDTH_95
        return cls(tuple(widths), np.diag(sigma**2), f"95 % intervals of {path}, as if they were independent")
