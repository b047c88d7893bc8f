"""Studies: a case with some of its fields varied, each sample solved in a process of its own, and what the results depend on.

A study file names a case, the fields that vary by their place in the case file, and how they are sampled. Every sample is
written as soon as it is solved, so a killed study resumes. The results are one dataset of xarray. From it come surrogates
(Gaussian processes with cross-validated error) and Sobol indices, by SciPy: of the samples themselves where they are drawn for
it (``sampling = "saltelli"``; Saltelli et al. 2010, doi 10.1016/j.cpc.2009.09.018), else of the surrogate.
"""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import functools
import itertools
import json
import math
import re
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

import numpy as np
import numpy.typing as npt
import tomli_w

from softmodels.case import case, materials
from softmodels.case.case import Case, with_changes
from softmodels.case.entries import CaseError
from softmodels.common import cards, errors, files, folders, names, processes, tables, units
from softmodels.common.arrays import Array
from softmodels.common.lazy import scipy
from softmodels.design import trials
from softmodels.materials import specimens
from softmodels.materials.laws import Material
from softmodels.mechanics import mpi
from softmodels.runs import analyses, notes, outcomes, table
from softmodels.runs.simulation import Simulation, temporary_folder

if TYPE_CHECKING:
    import xarray

__all__ = ["Indices", "Input", "Study", "StudyError", "StudyPlan", "Surrogate", "study"]


class Study(cards.ResultCard):
    """Results of a study.

    Attributes:
        plan: The study.
        dataset: All results over the samples, and the requested states, with units.
    """

    def __init__(self, plan: StudyPlan, dataset: xarray.Dataset):
        self.plan, self.dataset = plan, dataset
        self._surrogates: dict[str, Surrogate] = {}

    def _line(self) -> str:
        return f"{self.plan.name}: {len(self.plan.points)} samples, {len(self.failures)} without a result"

    def _figures(self) -> cards.Table:
        figures = []
        for name in self.responses:
            values, unit = self.values(name), table.split(name)[1]
            low, middle, high = np.nanpercentile(values, (5, 50, 95))
            figures.append((name, f"{low:.4g} {unit} (5 %), {middle:.4g} {unit} (50 %), {high:.4g} {unit} (95 %)"))
        return figures

    def _remarks(self) -> list[str]:
        return [f"sample {k}: {text}" for k, text in list(self.failures.items())[:5]]

    @property
    def responses(self) -> tuple[str, ...]:
        """The columns that are analysed."""
        inputs = [variable.key for variable in self.plan.inputs]
        numbers = [
            name for name, variable in self.dataset.data_vars.items() if variable.dtype.kind == "f" and name not in inputs
        ]
        return self.plan.columns_analysed(list(map(str, numbers)))

    @property
    def failures(self) -> dict[int, str]:
        """Why samples have no result, by their numbers."""
        texts = self.dataset["failure"].values.tolist()
        return {k: text for k, text in enumerate(texts) if text}

    def values(self, response: str) -> Array:
        """Return a response of each sample, in the last requested state of a path; nan where there is none."""
        values = np.asarray(self.dataset[response].values, dtype=float)
        return values[:, -1] if values.ndim == 2 else values

    def surrogate(self, response: str) -> Surrogate:
        """Return a smooth function through a response; see `Surrogate`.

        Raises:
            StudyError: Too few samples have a result.
            ImportError: scikit-learn is not installed.
        """
        if response not in self._surrogates:
            self._surrogates[response] = surrogate_of(self.plan.inputs, self.plan.points, self.values(response))
        return self._surrogates[response]

    def indices(self, response: str) -> Indices:
        """Return the Sobol indices of a response: of the samples if they are drawn for it and complete, else of the surrogate.

        Raises:
            StudyError: Too few samples have a result.
            ImportError: scikit-learn is not installed.
        """
        values = self.values(response)
        if self.plan.sampling == "saltelli" and np.isfinite(values).all():
            return indices_of(self.plan.inputs, values)
        made = self.surrogate(response)
        error = made.error / made.spread if made.spread else 0.0
        return dataclasses.replace(indices_of(self.plan.inputs, made), surrogate_error=error)

    def save(self, file: str | Path) -> Path:
        """Write the dataset as netCDF, or as a folder NAME.zarr.

        Raises:
            StudyError: A folder of that name is no Zarr.
            ImportError: h5netcdf, or zarr, is not installed.
        """
        path = names.place("file", file, "a file")
        if path.suffix == ".zarr":
            errors.required("zarr", EXTRA)
            if path.exists() and not (path / ".zgroup").is_file():
                raise StudyError(f"{path} is there and no Zarr; name another folder")
            self.dataset.to_zarr(path, mode="w", zarr_format=2)
            return path
        errors.required("h5netcdf", EXTRA)
        files.replace(path, lambda aside: self.dataset.to_netcdf(aside, engine="h5netcdf"))
        return path


EXTRA = "study"
"""The extra of this project that brings the libraries of this file."""


class StudyError(errors.OptionMessage, ValueError):
    """A study that cannot be made, or results that cannot be analysed; the message is a sentence."""


# ----------------------------------------------------------------------------------------------------------------------
# Inputs: what varies, as a study file writes it. Each maps the unit interval to its values.


@dataclasses.dataclass(frozen=True)
class Input:
    """A field that varies, such as ``"geometry.membrane"``, in the unit of the study file: over values one by one, or from
    ``low`` to ``high``, of a normal distribution two standard deviations from its mean."""

    key: str
    values: tuple[float | str, ...] = ()
    low: float = 0.0
    high: float = 1.0
    normal: bool = False
    unit: str = ""

    @classmethod
    def parse(cls, key: str, given: object) -> Input:
        """Read ``"1.8:2.2 mm"`` (uniform), ``"1.8:2.2:0.1 mm"`` (steps), ``"2 mm +- 0.2 mm"`` (normal, 95 %) or a list;
        StudyError if it is none of these."""
        how = f'[vary] {key} = {given!r} is not like "1.8:2.2 mm", "1.8:2.2:0.1 mm", "2 mm +- 0.2 mm" or a list of values'
        with contextlib.suppress(units.UnitError):
            listed = units.plain(given)
            each = [units.plain(text) for text in listed] if isinstance(listed, list | tuple) else []
            if each and all(isinstance(text, str | int | float) for text in each):
                return cls._listed(key, each)
        if not isinstance(given, str):
            raise StudyError(how)
        try:
            if match := re.fullmatch(r"(.+?)(?:\+/?-|±)(.+)", given):
                return cls._normal(key, match[1].strip(), match[2].strip())
            *ends, last = given.split(":")
            top, unit = units.number_and_unit(last)
            numbers = [*map(units.number, ends), top]
        except (units.UnitError, ValueError):
            raise StudyError(how) from None
        if len(numbers) == 3:
            low, high, step = numbers
            if not (high > low and 0.0 < step <= high - low):
                raise StudyError(f"[vary] {key} = {given!r} has no steps; write it as from:to:step, such as 1.8:2.2:0.1 mm")
            count = math.floor((high - low) / step * (1 + 1e-12))
            return cls(key, tuple(float(f"{low + k * step:.12g}") for k in range(count + 1)), unit=unit)
        if len(numbers) != 2:
            raise StudyError(how)
        if not numbers[1] > numbers[0]:
            raise StudyError(f"[vary] {key} = {given!r} is empty; write the smaller value first")
        return cls(key, (), numbers[0], numbers[1], unit=unit)

    @classmethod
    def _normal(cls, key: str, middle: str, half: str) -> Input:
        mean, unit = units.number_and_unit(middle)
        if half.endswith("%"):
            width = abs(mean) * units.number(half[:-1]) / 100
        else:
            width, own = units.number_and_unit(half)
            if own != unit:
                raise StudyError(f"[vary] {key} has the units {unit!r} and {own!r}; write both in one unit")
        if not width > 0.0:
            raise StudyError(f"[vary] {key} = '{middle} +- {half}' does not vary; the half width must be above 0")
        return cls(key, (), mean - width, mean + width, True, unit)

    @classmethod
    def _listed(cls, key: str, given: Sequence[str | float]) -> Input:
        """Return an input of listed values: numbers with one unit, plain numbers, or texts."""
        try:
            pairs = [
                units.number_and_unit(number) if isinstance(number, str) else (units.number(number), "") for number in given
            ]
        except units.UnitError:
            pairs = []
        if pairs and len({unit for _, unit in pairs}) == 1:
            return cls(key, tuple(value for value, _ in pairs), unit=pairs[0][1])
        return cls(key, tuple(map(str, given)))

    @property
    def named(self) -> bool:
        """Whether its values are texts."""
        return bool(self.values) and isinstance(self.values[0], str)

    def ppf(self, shares: Array) -> Array:
        """Return the values at shares of the probability; of listed ones their places."""
        if self.values:
            return np.minimum(np.floor(shares * len(self.values)), len(self.values) - 1.0)
        if self.normal:
            return np.asarray((self.low + self.high) / 2 + (self.high - self.low) / 4 * scipy.stats.norm.ppf(shares))
        return self.low + (self.high - self.low) * np.asarray(shares)

    def value(self, x: float) -> float | str:
        """Return the value for what `ppf` gives."""
        return self.values[int(x)] if self.values else float(x)

    def text(self, x: float) -> float | str:
        """Return it as a case file has it."""
        value = self.value(x)
        return f"{value!r} {self.unit}" if self.unit and not isinstance(value, str) else value


# ----------------------------------------------------------------------------------------------------------------------
# The study: its samples, and the case of each.


SAMPLINGS = ("latin-hypercube", "sobol", "saltelli", "grid")
ANSWERS = ("path", "limit")
FIT = "fit"
"""What ``material`` is varied by: the covariance of the fit that is the case's band."""
MAX_SAMPLES = 100_000


@dataclasses.dataclass(frozen=True)
class StudyPlan:
    """A study file: a case, the inputs that vary in it, and one of `SAMPLINGS`. Of ``"saltelli"`` the number of samples is
    the base, of which there are two more than inputs; a grid has all combinations.

    The answer is ``"path"`` (requested states) or ``"limit"`` (as `softmodels.limit`); the responses are columns that are
    analysed, empty for the rise of the device's gauge, or the limit pressure.
    """

    name: str
    case: Case
    inputs: tuple[Input, ...]
    sampling: str = "latin-hypercube"
    samples: int = 32
    seed: int = 1
    answer: str = "path"
    responses: tuple[str, ...] = ()

    @classmethod
    def from_file(cls, path: Path, changes: Sequence[str] = ()) -> StudyPlan:
        """Read a study file, with fields of its case as of `with_changes`; StudyError if it cannot be read, or makes no
        study."""
        try:
            table = tables.read_toml(path)
        except tables.TomlError as error:
            raise StudyError(f"study file {path} {error}") from None
        known = ("name", "case", "sampling", "samples", "seed", "answer", "responses", "vary")
        for key in table:
            if key not in known:
                raise StudyError(f"{path} has an unknown entry {key!r}; {errors.known_are(key, known)}")
        varied, file = table.get("vary"), table.get("case")
        if not isinstance(file, str | dict):
            raise StudyError(f'{path} names no case; write case = "disk.toml", or its tables as [case.geometry] and so on')
        if not isinstance(varied, dict) or not varied:
            raise StudyError(f'{path} varies nothing; write [vary] and below it "geometry.membrane" = "1.8:2.2 mm"')
        try:
            if isinstance(file, dict):
                case = Case.from_toml(tomli_w.dumps(with_changes(file, changes)), path.parent)
            else:
                case = Case.from_file(path.parent / file, changes=changes)
        except CaseError as error:
            raise StudyError(str(error)) from None
        numbers = {key: table[key] for key in ("samples", "seed") if key in table}
        for key, value in numbers.items():
            if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= MAX_SAMPLES:
                raise StudyError(f"{path}: {key} is {value!r}; it must be a whole number up to {MAX_SAMPLES}")
        if why := names.unusable_name(table.get("name", "study")):
            raise StudyError(f"{path}: {why}")
        responses = table.get("responses", [])
        if not isinstance(responses, list) or not all(isinstance(response, str) for response in responses):
            raise StudyError(f"{path}: responses is {responses!r}; it must be a list of columns of path.csv")
        try:
            return cls(
                str(table.get("name", path.stem)), case, tuple(_inputs(varied, case)),
                str(table.get("sampling", SAMPLINGS[0])), answer=str(table.get("answer", ANSWERS[0])),
                responses=tuple(responses), **numbers,
            )  # fmt: skip
        except StudyError as error:
            raise StudyError(f"{path}: {error}") from None

    def __post_init__(self) -> None:
        for what, value, values in (("sampling", self.sampling, SAMPLINGS), ("answer", self.answer, ANSWERS)):
            if value not in values:
                raise StudyError(f"{what} is {value!r}; it must be one of {', '.join(values)}")
        if self.sampling == "grid":
            if unlisted := [variable.key for variable in self.inputs if not variable.values]:
                raise StudyError(f"a grid needs steps: write {unlisted[0]} as from:to:step, or as a list of values")
        elif self.samples < 1:
            raise StudyError(f"samples is {self.samples}; it must be 1 or more")
        if self.sampling in ("sobol", "saltelli") and self.samples & (self.samples - 1):
            raise StudyError(f"samples is {self.samples}; a Sobol sequence needs a power of two, such as 32 or 64")
        if len(self.points) > MAX_SAMPLES:
            raise StudyError(
                f"the study has {len(self.points)} samples; at most {MAX_SAMPLES} are solved, so take fewer or larger steps"
            )

    @functools.cached_property
    def points(self) -> Array:
        """The samples, see `Input.ppf`, shape (samples, inputs)."""
        if self.sampling == "grid":
            return np.array(list(itertools.product(*(range(len(variable.values)) for variable in self.inputs))), dtype=float)
        shares = unit_points(self.sampling, len(self.inputs), self.samples, self.seed)
        return np.column_stack([variable.ppf(column) for variable, column in zip(self.inputs, shares.T, strict=True)])

    def case_at(self, point: Array) -> Case:
        """Return the case of a sample; CaseError if its fields make none."""
        tables = copy.deepcopy(self._tables)
        steps = {variable.key: x for variable, x in zip(self.inputs, point, strict=True) if variable.key.startswith(f"{FIT}.")}
        if steps:
            tables["material"] = materials.to_table(_drawn_material(self.case, np.array(list(steps.values()))))
        for variable, x in zip(self.inputs, point, strict=True):
            if variable.key not in steps:
                _set(tables, variable.key, variable.text(float(x)))
        made = Case.from_toml(tomli_w.dumps(tables))
        return dataclasses.replace(made, name=self.case.name)

    @functools.cached_property
    def _tables(self) -> dict[str, object]:
        return tables.parse_toml(dataclasses.replace(self.case, band=None).to_toml())

    @functools.cached_property
    def cases(self) -> tuple[dict[int, Case], dict[int, str]]:
        """The case of each sample, and the sentences of those that have none; StudyError if no sample has one."""
        cases, failures = dict[int, Case](), dict[int, str]()
        for k, point in enumerate(self.points):
            try:
                cases[k] = self.case_at(point)
            except CaseError as error:
                failures[k] = errors.written(error)
        if not cases:
            raise StudyError(f"no sample makes a case; the first: {failures[0]}")
        return cases, failures

    @property
    def inputs_of_results(self) -> dict[str, str]:
        """All that the results depend on, by name."""
        told = {name: repr(getattr(self, name)) for name in ("inputs", "sampling", "samples", "seed", "answer")}
        return {**case.identity(self.case), **{f"study.{name}": text for name, text in told.items()}}

    def columns_analysed(self, known: Sequence[str]) -> tuple[str, ...]:
        """Return the responses, of the columns that there are; StudyError if one is not among them."""
        gauge = f"{self.case.actuator.gauge}_mm"
        wanted = self.responses or ((gauge,) if self.answer == "path" else ("limit_Pa",))
        for name in wanted:
            if name not in known:
                raise StudyError(f"the results have no column {name!r}; {errors.known_are(name, known)}")
        return wanted


def _inputs(varied: Mapping[str, object], case: Case) -> Iterator[Input]:
    for key, given in trials.dotted(varied):
        if key == "material" and given == FIT:
            if not isinstance(case.band, materials.MaterialErrors):
                raise StudyError(f'material = "{FIT}" needs the errors of a fit; add [band] with its file to the case')
            for k in range(case.band.by_cause[materials.MATERIAL].shape[1]):
                yield Input(f"{FIT}.{k + 1}", (), -2.0, 2.0, True)
        else:
            yield Input.parse(key, given)


def _drawn_material(case: Case, steps: Array) -> Material:
    """Return the material some standard deviations away, along the independent directions of its errors."""
    assert isinstance(case.band, materials.MaterialErrors)
    material = case.material
    for name, change in zip(case.band.names, case.band.by_cause[materials.MATERIAL] @ steps, strict=True):
        material = specimens.nudged(material, name, float(change))
    return material


def _set(tables: dict[str, object], key: str, value: object) -> None:
    """Set an entry of a case's tables; a silicone, or a fitted material's file, takes the place of the whole table."""
    *where, last = key.split(".")
    table = tables
    for name in where:
        inner = table.setdefault(name, {})
        if not isinstance(inner, dict):
            raise CaseError(f"{key} is no place in the case file; {name} is a value there")
        table = inner
    if not where:
        raise CaseError(f"{key} is no place in the case file; write the table too, such as geometry.{key}")
    if last in ("silicone", "file") and where != ["geometry"]:
        table.clear()
    if where == ["load"]:
        for other in [name for name in table if name.split("_")[0] == last.split("_")[0]]:
            del table[other]
    table[last] = value


def unit_points(sampling: str, inputs: int, count: int, seed: int) -> Array:
    """Return samples of the unit cube, shape (samples, inputs).

    Those of ``"saltelli"`` are A, B, and A with each column in turn from B, of ``count`` rows each.
    """
    if sampling == "latin-hypercube":
        return np.asarray(scipy.stats.qmc.LatinHypercube(inputs, rng=np.random.default_rng(seed)).random(count))
    if sampling == "sobol":
        return np.asarray(scipy.stats.qmc.Sobol(inputs, rng=np.random.default_rng(seed)).random(count))
    both = scipy.stats.qmc.Sobol(2 * inputs, rng=np.random.default_rng(seed)).random(count)
    A, B = both[:, :inputs], both[:, inputs:]
    mixed = [np.where(np.arange(inputs) == k, B, A) for k in range(inputs)]
    return np.vstack([A, B, *mixed])


# ----------------------------------------------------------------------------------------------------------------------
# One sample, in the process that solves it.


def solved(task: tuple[Case, str]) -> dict[str, object]:
    """Solve a case; return its rows by column, and why it ends early, if it does.

    Called in a process of its own, see `softmodels.common.processes`.
    """
    case, answer = task
    materials.import_own_modules()
    if answer == "limit":
        limit = analyses.limit_of(case)
        row = {
            "limit_Pa": limit.pressure, "added_volume_ml": limit.added_volume * 1e6, "max_stretch": limit.stretch,
            **{f"{name}_mm": rise * 1e3 for name, rise in limit.rises.items()},
        }  # fmt: skip
        return {"rows": [row], "ended": limit.why, "kind": limit.kind}
    comm, rows, ended = mpi.start(), table.PathTable(), ""
    simulation = Simulation(case, comm)
    try:
        with notes.sentences(), temporary_folder(comm) as folder:
            mesh = folder / f"{case.name}.msh"
            simulation.write_mesh(mesh)
            simulation.prepare(mesh)
            for step in simulation.steps():
                rows.append(step.row)
    except outcomes.PathEnded as end:
        ended = errors.written(end)
    except outcomes.RunError as error:
        if not rows:
            raise
        ended = errors.written(error)
    finally:
        simulation.release()
    limits = rows.where("limit")
    asked = [{k: v for k, v in row.cells.items() if isinstance(v, int | float)} for row in rows.where("requested")]
    return {"rows": asked, "ended": ended, "limit_Pa": limits[0]["pressure"] if limits else math.nan}


_SOLVER_PROCESS = threading.local()
"""The process beside this one that solves for a thread, on a machine of a cluster."""


def solved_beside(task: tuple[Case, str]) -> processes.Answer:
    """Return the answer for a sample of a process beside this one: what a worker of dask calls."""
    worker: processes.Worker = _SOLVER_PROCESS.__dict__.setdefault("worker", processes.Worker(__name__))
    return worker.answer(solved.__name__, task)


def _by_cluster(scheduler: str, tasks: Mapping[int, tuple[Case, str]]) -> Iterator[tuple[int, processes.Answer]]:
    """Yield the answers of a cluster of dask; a worker that is lost is replaced, and its samples are solved elsewhere.
    StudyError if the scheduler does not answer."""
    distributed = errors.required("distributed", EXTRA)
    try:
        client = distributed.Client(scheduler, timeout=10, set_as_default=False)
    except (OSError, ValueError) as error:
        raise StudyError(
            f"the scheduler {scheduler} does not answer ({errors.reason(error)}); start one by: dask scheduler, and workers "
            f"by: dask worker {scheduler} --nthreads 1"
        ) from None
    with client, client.as_current():
        numbers = {client.submit(solved_beside, task, pure=False): k for k, task in tasks.items()}
        for future in distributed.as_completed(list(numbers)):
            failed = future.status != "finished"
            yield numbers[future], (False, errors.reason(future.exception())) if failed else future.result()
            future.release()


# ----------------------------------------------------------------------------------------------------------------------
# The folder of a study, to which every sample is added as soon as it is solved.


SAMPLES, DATASET, PAGE = "samples.jsonl", "study.nc", "report.html"
FILES = (SAMPLES, DATASET, PAGE, "study.csv", "parallel.png")


class StudyFolder:
    """A study's folder, locked; without a path the answers are only kept in memory. To resume keeps the samples that are
    there. Inputs are never written. StudyError if the folder cannot be used."""

    def __init__(self, plan: StudyPlan, output: folders.OwnFolder | None, resume: bool, inputs: Sequence[Path] = ()):
        errors.required("xarray", EXTRA)  # this and the next raise before anything is written
        _ = plan.cases
        self.own, self.answers = output, dict[int, dict[str, object]]()
        self._file: TextIO | None = None
        if output is None:
            return
        try:
            output.take()
            try:
                output.check_inputs(inputs)
                before = output.about.get("inputs")
                if resume and before is not None:
                    self._check(before, plan.inputs_of_results)
                    self.answers = _read(output.path / SAMPLES)
                else:
                    output.remove(output.files)
                output.claim(FILES, {"inputs": plan.inputs_of_results})
                self._rewrite()
            except BaseException:
                output.leave()
                raise
        except (folders.InUseError, folders.OwnFolderError) as error:
            raise StudyError(str(error)) from None
        except OSError as error:
            raise StudyError(f"the folder {output.path} cannot be written ({errors.reason(error)})") from None

    def _check(self, before: Mapping[str, str], now: Mapping[str, str]) -> None:
        changed = [name for name in {**before, **now} if before.get(name) != now.get(name)]
        if changed:
            assert self.own is not None
            raise StudyError(
                f"{self.own.path} holds samples of another study: {changed[0]} changed; run without --resume, or use another "
                "folder (--output)"
            )

    def _rewrite(self) -> None:
        """Write the whole samples again: a killed study may have left half a line."""
        assert self.own is not None
        file, text = self.own.path / SAMPLES, "".join(map(_line, self.answers.items()))
        files.replace(file, lambda aside: aside.write_text(text, encoding="utf-8"))
        self._file = file.open("a", encoding="utf-8")

    def add(self, number: int, answer: dict[str, object]) -> None:
        """Keep the answer for a sample; OSError if it cannot be written."""
        self.answers[number] = answer
        if self._file is not None:
            self._file.write(_line((number, answer)))
            self._file.flush()

    def leave(self) -> None:
        """Release the folder."""
        if self._file is not None:
            self._file.close()
        if self.own is not None:
            self.own.forget_unwritten()
            self.own.leave()


def _line(sample: tuple[int, dict[str, object]]) -> str:
    return json.dumps({"sample": sample[0], **sample[1]}) + "\n"


def _read(file: Path) -> dict[int, dict[str, object]]:
    """Return the answers in a file by their samples; half a line at its end is not one."""
    answers = {}
    for line in files.read_text(file).splitlines() if file.exists() else ():
        try:
            answer = files.parse_json(line)
            answers[int(answer.pop("sample"))] = answer
        except (ValueError, KeyError, TypeError, AttributeError):
            continue
    return answers


# ----------------------------------------------------------------------------------------------------------------------
# The call.


@names.checked
def study(
    file: StudyPlan | str | Path,
    folder: str | Path | None = None,
    *,
    jobs: int = 0,
    scheduler: str = "",
    resume: bool = False,
    progress: Callable[[str], object] | None = None,
) -> Study:
    """Solve a case many times with some of its fields varied.

    Args:
        file: The study file, or a plan.
        folder: Where every sample is kept as soon as it is solved; None for memory only.
        jobs: Samples solved at a time on this machine; 0 for the number of its cores.
        scheduler: Address of a dask scheduler, such as ``"tcp://10.0.0.1:8786"``, whose workers solve instead.
        resume: Keep the samples that an interrupted study has left in the folder.
        progress: Gets a line for each sample.

    Returns:
        The results; samples without one have the sentence why.

    Raises:
        StudyError: Invalid input, before anything is solved; or no sample has a result.
        ImportError: xarray, or dask for a scheduler, is not installed.
    """
    plan = file
    if not isinstance(plan, StudyPlan):
        plan = StudyPlan.from_file(names.place("file", plan, "a study file, or a StudyPlan"))
    names.callback("progress", progress)
    count = names.whole("jobs", jobs, 0)
    address = names.one_of("scheduler", scheduler, str, "an address, or an empty text")
    again = names.flag("resume", resume)
    output = None if folder is None else folders.OwnFolder(names.place("folder", folder, "a folder"), KIND)
    kept = StudyFolder(plan, output, again)
    try:
        return solve_into(kept, plan, count, address, progress)
    finally:
        kept.leave()


KIND = "study"


def open_folder(plan: StudyPlan, output: Path | None, resume: bool, inputs: Sequence[Path]) -> StudyFolder:
    """Return the folder of a command, ``results/NAME`` unless one is given; StudyError if it cannot be used."""
    try:
        default = Path("results") / plan.name
        own = folders.OwnFolder(output, KIND) if output else folders.take_default(default, KIND, plan.inputs_of_results)
    except (folders.InUseError, folders.OwnFolderError) as error:
        raise StudyError(str(error)) from None
    except OSError as error:
        raise StudyError(f"the folder {output or default} cannot be written ({errors.reason(error)})") from None
    return StudyFolder(plan, own, resume, inputs)


def solve_into(
    kept: StudyFolder, plan: StudyPlan, jobs: int = 0, scheduler: str = "", progress: Callable[[str], object] | None = None
) -> Study:
    """Solve the samples that a folder does not have yet; see `study`."""
    cases, failures = plan.cases
    for k, text in failures.items():
        if k not in kept.answers:
            kept.add(k, {"failure": text})
    tasks = {k: (case, plan.answer) for k, case in cases.items() if k not in kept.answers}
    count = len(plan.points)
    beside = processes.answers(__name__, solved.__name__, tasks, jobs or processes.cores())
    solve_sample = _by_cluster(scheduler, tasks) if scheduler and tasks else beside
    for k, (done, value) in solve_sample:
        kept.add(k, value if done else {"failure": str(value)})
        if progress is not None:
            failed = sum("failure" in answer for answer in kept.answers.values())
            progress(f"{len(kept.answers)} of {count} samples" + (f", {failed} failed" if failed else ""))
    if all("failure" in answer for answer in kept.answers.values()):
        raise StudyError(f"no sample was solved; the first: {kept.answers[min(kept.answers)]['failure']}")
    return Study(plan, dataset_of(plan, kept.answers))


def dataset_of(plan: StudyPlan, answers: Mapping[int, Mapping[str, object]]) -> xarray.Dataset:
    """Return the results of all samples as one dataset, with the unit of each variable."""
    library = errors.required("xarray", EXTRA)
    order = range(len(plan.points))
    variables: dict[str, tuple[object, ...]] = {}
    for variable, column in zip(plan.inputs, plan.points.T, strict=True):
        about = {"units": variable.unit, "long_name": f"input {variable.key}"}
        variables[variable.key] = ("sample", [variable.value(x) for x in column], about)
    rows = {k: list(answers[k].get("rows", ())) for k in order}  # type: ignore[call-overload]
    states = max(map(len, rows.values()))
    names = dict.fromkeys(name for own in rows.values() for row in own for name in row)
    for name in names:
        values = np.full((len(order), states), np.nan)
        for k, own in rows.items():
            values[k, : len(own)] = [row.get(name, math.nan) for row in own]
        dims = ("sample", "state") if plan.answer == "path" else ("sample",)
        label, unit = table.split(name)
        shaped = values if plan.answer == "path" else values[:, 0]
        variables[name] = (dims, shaped, {"units": unit, "long_name": label.replace("_", " ")})
    if plan.answer == "path":
        limits = [float(answers[k].get("limit_Pa", math.nan)) for k in order]  # type: ignore[arg-type]
        variables["limit_Pa"] = ("sample", limits, {"units": "Pa", "long_name": "limit pressure"})
    else:
        kinds = [str(answers[k].get("kind", "")) for k in order]
        variables["kind"] = ("sample", kinds, {"long_name": "kind of the limit"})
    for name, words in (("failure", "why there is no result"), ("ended", "why the path ends early")):
        variables[name] = ("sample", [str(answers[k].get(name, "")) for k in order], {"long_name": words})
    made: xarray.Dataset = library.Dataset(
        variables,
        coords={"sample": list(order), "state": list(range(states))} if plan.answer == "path" else {"sample": list(order)},
        attrs={"study": plan.name, "case": plan.case.to_toml(), "sampling": plan.sampling, "seed": plan.seed},
    )
    return made


# ----------------------------------------------------------------------------------------------------------------------
# What a study shows: the dataset, surrogates, Sobol indices.


FOLD_COUNT = 10
"""Parts of the samples; each is predicted by a surrogate of the others."""
MIN_SURROGATE_SAMPLES = 8
BASE_SAMPLES = 2**12
"""Base samples of a surrogate's indices."""
BOOTSTRAP_SAMPLES = 100


@dataclasses.dataclass(frozen=True, eq=False)
class Surrogate:
    """A response as a smooth function of the inputs, its cross-validated error (rms) and its standard deviation over the
    samples, in the response's unit."""

    inputs: tuple[Input, ...]
    error: float
    spread: float
    _predict: Callable[[Array], Array]

    def __call__(self, points: Array) -> Array:
        """Return the response at points, shape (n, inputs), see `Input.ppf`."""
        return self._predict(features(self.inputs, points))


@dataclasses.dataclass(frozen=True)
class Indices:
    """Sobol indices of a response, shares of its variance by each input by itself (``first``) and with all its interactions
    (``total``), with half widths of their 95 % intervals. The surrogate's error (rms) is over the response's standard
    deviation; 0 if they are of the samples themselves."""

    inputs: tuple[str, ...]
    first: tuple[float, ...]
    total: tuple[float, ...]
    first_half: tuple[float, ...]
    total_half: tuple[float, ...]
    surrogate_error: float = 0.0

    @property
    def doubt(self) -> str:
        """A sentence if indices contradict each other; empty if all lie between 0 and the total one, as exact ones do."""
        pairs = zip(self.inputs, self.first, self.total, strict=True)
        wrong = [
            f"{key} ({first:.3f} of {total:.3f})"
            for key, first, total in pairs
            if first < -INDEX_TOLERANCE or first > total + INDEX_TOLERANCE
        ]
        if not wrong:
            return ""
        return (
            f"the first-order index is below 0 or above the total one for {', '.join(wrong)}: that is scatter of too few "
            "samples, as wide as the intervals; take more samples"
        )


INDEX_TOLERANCE = 0.01
"""Share of the variance by which an index may contradict another without a word."""


def features(inputs: Sequence[Input], points: Array) -> Array:
    """Return points as numbers of size one: shares of each input's range; of texts a column for each."""
    columns = []
    for variable, x in zip(inputs, np.atleast_2d(points).T, strict=True):
        if variable.named:
            columns += [(x == k).astype(float) for k in range(len(variable.values))]
        elif variable.values:
            listed = np.array(variable.values, dtype=float)
            columns.append((listed[x.astype(int)] - listed.min()) / (np.ptp(listed) or 1.0))
        else:
            columns.append((x - variable.low) / (variable.high - variable.low))
    return np.column_stack(columns)


def surrogate_of(inputs: tuple[Input, ...], points: Array, values: Array) -> Surrogate:
    """Return a Gaussian process through the values at points, with its error in a tenfold cross-validation. StudyError if
    there are too few; ImportError if scikit-learn is not installed."""
    errors.required("sklearn", EXTRA)
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
    from sklearn.model_selection import KFold, cross_val_predict

    known = np.isfinite(values)
    if known.sum() < MIN_SURROGATE_SAMPLES:
        raise StudyError(f"{known.sum()} samples have a result; a surrogate needs at least {MIN_SURROGATE_SAMPLES}")
    X, y = features(inputs, points[known]), values[known]
    spread = float(y.std())
    if spread <= 1e-12 * float(np.abs(y).max()):
        return Surrogate(inputs, 0.0, 0.0, lambda at: np.full(len(at), y[0]))
    kernel = ConstantKernel(1.0, (1e-2, 1e5)) * RBF(np.ones(X.shape[1]), (0.05, 1e3)) + WhiteKernel(1e-6, (1e-12, 1e-1))
    # Where the likelihood is flat or an input has no effect; the error below is measured.
    with warnings.catch_warnings(action="ignore"):
        process = GaussianProcessRegressor(kernel, normalize_y=True, random_state=0).fit(X, y)
    again = GaussianProcessRegressor(process.kernel_, optimizer=None, normalize_y=True)
    folds = KFold(min(FOLD_COUNT, len(y)), shuffle=True, random_state=0)
    error = float(np.sqrt(np.mean((cross_val_predict(again, X, y, cv=folds) - y) ** 2)))
    return Surrogate(inputs, error, spread, process.predict)


def indices_of(inputs: tuple[Input, ...], response: Callable[[Array], Array] | Array, draws: int = BASE_SAMPLES) -> Indices:
    """Return the Sobol indices of a function of points (n, inputs), or of values at the points of ``"saltelli"``."""
    if callable(response):
        shares = unit_points("saltelli", len(inputs), draws, 0)
        response = response(np.column_stack([variable.ppf(x) for variable, x in zip(inputs, shares.T, strict=True)]))
    if len(inputs) == 1:  # by definition all of the variance; SciPy's estimate takes no single input
        share = (float(np.ptp(response) > 0.0),)
        return Indices((inputs[0].key,), share, share, (0.0,), (0.0,))
    parts = np.array(np.split(response, len(inputs) + 2))  # of A, B, and A with each column from B

    def estimated(chosen: npt.NDArray[np.int64]) -> Array:
        own = parts[:, chosen]
        values = {"f_A": own[:1], "f_B": own[1:2], "f_AB": own[2:, None]}
        sobol = scipy.stats.sobol_indices(func=values, n=own.shape[1])
        return np.vstack([np.ravel(sobol.first_order), np.ravel(sobol.total_order)])

    count, rng = parts.shape[1], np.random.default_rng(0)
    sobol = estimated(np.arange(count))
    again = np.array([estimated(rng.integers(0, count, size=(count,))) for _ in range(BOOTSTRAP_SAMPLES)])
    first, total, first_half, total_half = map(tuple, np.vstack([sobol, units.HALF_WIDTH_95 * again.std(axis=0)]).tolist())
    return Indices(tuple(variable.key for variable in inputs), first, total, first_half, total_half)
