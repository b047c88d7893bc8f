"""What is not known of a material: the covariance of a fitted one's parameters, the sources of a named one; a case's table."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator, Mapping, MutableMapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from geometries.errors import FieldError
from geometries.fields import About
from geometries.kinds import Text, Words
from measurement.arguments import checked
from measurement.read_only import read_only
from measurement.toml_file import TomlError, read_toml
from measurement.user_file import read_text
from softmodels.case import material_table
from softmodels.case.entries import MISSING, Entry, Missing, Option, Tables, Written, table_of
from softmodels.materials.laws import Material, MaterialError
from softmodels.materials.silicones import PRODUCTS, named, silicone_called
from softmodels.materials.spread import product_of, source_names, spanning
from softmodels.mechanics.sensitivity import known_parameters

WIDTH_95 = 2 * 1.959964
"""Standard deviations in a 95 % interval."""


@checked
@dataclasses.dataclass(frozen=True)
class MaterialErrors:
    """How uncertain a material is.

    Attributes:
        names: Parameters of the law.
        covariance: Of them, SI units, n rows of n numbers.
        how: Where it comes from, a clause.
        around: The material that they were found around; None where that is not known.
    """

    names: tuple[str, ...]
    covariance: tuple[tuple[float, ...], ...]
    how: str = dataclasses.field(default="", compare=False, repr=False)
    around: Material | None = dataclasses.field(default=None, compare=False, repr=False)

    @property
    def matrix(self) -> npt.NDArray[np.float64]:
        """The covariance, shape (n, n)."""
        return read_only(np.array(self.covariance))

    @property
    def roots(self) -> npt.NDArray[np.float64]:
        """Changes of the parameters, independent of each other and of one standard deviation each, shape (n, m)."""
        size = np.sqrt(np.diag(self.matrix))
        values, vectors = np.linalg.eigh(self.matrix / np.outer(size, size))
        return read_only(np.asarray(size[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))))

    @classmethod
    def from_file(cls, path: Path) -> MaterialErrors:
        """From ``fitted.toml``; with ``fit.json`` beside it the whole covariance, else that of the 95 % intervals alone.

        Raises:
            MaterialError: No fit, or one without errors.
        """
        try:
            tables = read_toml(path)
        except TomlError as error:
            raise MaterialError(f"the fitted material {path} {error}") from None
        fit = tables.get("fit")
        if not isinstance(fit, dict) or not isinstance(tables.get("material"), dict):
            raise MaterialError(f"{path} holds no fit; give the fitted.toml that softmodels fit has written")
        try:
            fitted = material_table.from_table(tables["material"])
        except MaterialError as error:
            raise MaterialError(f"{path}: {error}") from None
        known = known_parameters(fitted)
        names, covariance, how = _whole(path, fitted) or _intervals(path, fit)
        kept = [k for k, name in enumerate(names) if name in known]  # a device's fit has the bench's numbers too
        if not kept:
            raise MaterialError(f"{path} has no errors of {', '.join(known)}; a fit with free parameters is needed")
        rows = covariance[np.ix_(kept, kept)].tolist()
        return cls(tuple(names[k] for k in kept), tuple(map(tuple, rows)), how, fitted)

    def check(self, material: Material) -> None:
        """Refuse errors of another material, or numbers that are no covariance.

        Raises:
            MaterialError: Which.
        """
        if self.around is not None and self.around != material:
            raise MaterialError(
                f"the errors ({self.how}) are of another material than the case's; take that there too, so that they are "
                "around its values: file = ... in [material], or --material"
            )
        known = known_parameters(material)
        if unknown := [name for name in self.names if name not in known]:
            raise MaterialError(f"errors of {unknown[0]} are given, which {material.name} does not have")
        square = len(self.names) > 0 and all(len(row) == len(self.names) for row in self.covariance)
        matrix = self.matrix if square and len(self.covariance) == len(self.names) else np.full((1, 1), np.nan)
        if not np.isfinite(matrix).all() or (np.diag(matrix) <= 0.0).any() or not np.allclose(matrix, matrix.T):
            raise MaterialError(
                "the errors' covariance is not one: finite and symmetric, with variances above zero, a row for each parameter"
            )


@dataclasses.dataclass(frozen=True)
class SourceBand:
    """The sources of a named silicone, each of which a case is solved with.

    Attributes:
        product: The silicone's name without a source.
    """

    product: str

    def __post_init__(self) -> None:
        if self.product not in PRODUCTS:
            raise MaterialError(f"silicone {self.product!r} is unknown; known are {', '.join(PRODUCTS)}")
        if not spanning(self.product):
            raise MaterialError(
                f"{self.product} has one source here, so there is no band of its sources; leave out --band, or fit a cast of "
                "your own"
            )

    @property
    def how(self) -> str:
        """What it is, a clause."""
        return f"the sources of {self.product}"

    def check(self, material: Material) -> None:
        """Refuse another material than this silicone.

        Raises:
            MaterialError: It is none of the sources.
        """
        name = named(material)
        if name is None or product_of(name) != self.product:
            raise MaterialError(
                f"the band is that of the sources of {self.product}, and the case's material is none of them; take that "
                f"silicone (--material {self.product}), or leave out --band"
            )

    def others(self, material: Material) -> dict[str, Material]:
        """The other sources by name, from the softest to the stiffest, with a material's own Poisson's ratio."""
        own = named(material)
        names = [name for name in source_names(self.product) if name != own]
        found = {name: silicone_called(name) for name in names}
        return {
            name: dataclasses.replace(one.material, poisson=material.poisson)  # type: ignore[call-arg]
            for name, one in found.items()
            if one is not None
        }


type AnyBand = MaterialErrors | SourceBand


def band_of(text: str | Path) -> AnyBand:
    """The band of a silicone's sources by its name, or of a fitted material by its ``fitted.toml``.

    Raises:
        MaterialError: Neither, or one without errors.
    """
    if silicone_called(str(text)) is not None:
        return SourceBand(product_of(str(text)))
    return MaterialErrors.from_file(Path(text))


Found = tuple[tuple[str, ...], npt.NDArray[np.float64], str]


def _whole(path: Path, fitted: Material) -> Found | None:
    """Names and covariance of the ``fit.json`` beside a fitted material; None if there is none.

    Of several laws it is the one with the material's own numbers: fits call a sum of one term ``ogden1``, materials ``ogden``.
    """
    try:
        laws = json.loads(read_text(path.with_name("fit.json")))["laws"]
        told = [one for one in laws if "material" in one]
        same = (one for one in told if material_table.from_table(one["material"]) == fitted)
        one = next(same, None) or next(one for one in laws if one["law"] == fitted.name)
        covariance = np.array(one["covariance"], dtype=float)
        names = tuple(map(str, one["free"]))
    except (OSError, ValueError, KeyError, TypeError, StopIteration, MaterialError):
        return None
    if covariance.shape != (len(names), len(names)) or not np.isfinite(covariance).all():
        return None
    return names, covariance, f"covariance of {path.with_name('fit.json')}"


def _intervals(path: Path, fit: Mapping[str, object]) -> Found:
    found = fit.get("intervals_95")
    intervals = found if isinstance(found, dict) else {}
    try:
        widths = {str(name): float(high) - float(low) for name, (low, high) in intervals.items()}
    except (TypeError, ValueError):
        raise MaterialError(f"{path}: the intervals of its fit cannot be read") from None
    if not widths or not all(0.0 < width < np.inf for width in widths.values()):
        raise MaterialError(f"{path} has no finite 95 % intervals, so the material's errors are not known")
    sigma = np.array(list(widths.values())) / WIDTH_95
    return tuple(widths), np.diag(sigma**2), f"95 % intervals of {path}, as if they were independent"


class ErrorsEntry(Entry[AnyBand | None]):
    """The table ``[band]``: a fitted material's ``file``, its ``parameters`` and their ``covariance``, or a ``silicone``."""

    tables = ("band",)

    def read(self, tables: Tables) -> AnyBand | Missing:
        if "band" not in tables:
            return MISSING
        table = table_of(tables, "band")
        if unknown := set(table) - {"file", "parameters", "covariance", "silicone"}:
            raise FieldError(
                f"[band] has an unknown entry {min(unknown)!r}; known are file, parameters, covariance, silicone"
            )
        if isinstance(silicone := table.get("silicone"), str) and set(table) == {"silicone"}:
            return SourceBand(product_of(silicone))
        file = table.get("file")
        if isinstance(file, str) and set(table) == {"file"}:
            return MaterialErrors.from_file(Path(file))
        names, rows = table.get("parameters"), table.get("covariance")
        try:
            covariance = tuple(tuple(float(value) for value in row) for row in rows)  # type: ignore[attr-defined, union-attr]
            return MaterialErrors(tuple(map(str, names)), covariance, "[band] of the case")  # type: ignore[call-overload]
        except (TypeError, ValueError):
            raise FieldError(
                "[band] needs a fitted material (file = 'results/fit/fitted.toml'), parameters and their covariance in SI, "
                "or the sources of a silicone (silicone = 'ecoflex-00-30')"
            ) from None

    def write(self, value: AnyBand | None, text: Text) -> Written:
        if value is None:
            return {}
        if isinstance(value, SourceBand):
            return {"band": {"silicone": value.product}}
        return {"band": {"parameters": list(value.names), "covariance": [list(row) for row in value.covariance]}}

    def options(self) -> Iterator[Option]:
        text = (
            "a fitted material's fitted.toml: path.csv and the curves get the 95 % band that its errors make; or a silicone's "
            "name: each of its sources is solved, and the curves get the band that they span"
        )
        yield Option("band", About(Words(), text), None, "FILE|NAME")

    def arguments(self, field: str) -> dict[str, str]:
        return {"band": "band='fitted.toml', or a silicone's name"}

    def take(self, options: MutableMapping[str, object]) -> AnyBand | Missing:
        given = options.pop("band", None)
        return MISSING if given is None else band_of(str(given))
