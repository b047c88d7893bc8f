"""Designs that were evaluated: none twice, each kept as soon as it is known."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from softmodels.design.evaluation import Evaluation
from softmodels.design.squares import Squares

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True, eq=False)
class Trial:
    """A design with its values.

    Attributes:
        number: Counted from 1.
        start: Of which start, counted from 1.
        theta: Values of the problem's `names`, SI units.
        mesh: Of which mesh, counted from 1; the same design may be evaluated again on another one.
        values: By the keys of the quantities; empty of a failure.
        gradients: By key, by the problem's `names`.
        material_gradients: By key and parameter of the law; empty where they are not known.
        newton: Newton iterations.
        seconds: What it took.
        quality: Of the worst cell against the mesh as made.
        remeshed: Whether it was meshed anew.
        squares: Of the targets that are followed, by key.
        notes: What has to be known of the values.
        failure: Why it could not be judged; empty if it could.
    """

    number: int
    start: int
    theta: tuple[float, ...]
    mesh: int = 1
    values: Mapping[str, float] = dataclasses.field(default_factory=dict)
    gradients: Mapping[str, Sequence[float]] = dataclasses.field(default_factory=dict)
    material_gradients: Mapping[str, Mapping[str, float]] = dataclasses.field(default_factory=dict)
    newton: int = 0
    seconds: float = 0.0
    quality: float = 1.0
    remeshed: bool = False
    squares: Mapping[str, Squares] = dataclasses.field(default_factory=dict)
    notes: tuple[str, ...] = ()
    failure: str = ""

    @property
    def failed(self) -> bool:
        return bool(self.failure)

    def to_json(self) -> str:
        """All of it, numbers to the last bit."""
        squares = {key: found.to_table() for key, found in self.squares.items()}
        return json.dumps({**dataclasses.asdict(self), "squares": squares}, indent=1)

    @classmethod
    def from_json(cls, text: str) -> Trial:
        """What `to_json` has written.

        Raises:
            ValueError: It is something else.
        """
        told = json.loads(text)
        try:
            squares = {key: Squares.from_table(table) for key, table in told.get("squares", {}).items()}
            theta, notes = tuple(map(float, told["theta"])), tuple(told["notes"])
            return cls(**{**told, "theta": theta, "notes": notes, "squares": squares})
        except (TypeError, KeyError, AttributeError) as error:
            raise ValueError(str(error)) from None

    @classmethod
    def of(cls, place: tuple[int, int, tuple[float, ...], int], evaluated: Evaluation, seconds: float) -> Trial:
        """An `Evaluation` as it is kept; ``place`` has the number, start, values and mesh."""
        return cls(
            *place,
            {key: float(value) for key, value in evaluated.values.items()},
            {key: [float(slope) for slope in slopes] for key, slopes in (evaluated.gradients or {}).items()},
            {key: {name: float(slope) for name, slope in slopes.items()}
             for key, slopes in evaluated.material_gradients.items()},
            int(evaluated.newton), seconds, float(evaluated.quality), bool(evaluated.remeshed),
            dict(evaluated.squares), tuple(evaluated.notes),
        )  # fmt: skip


class Trials:
    """All trials of a run, in memory; see `softmodels.design.folder` for those on disk."""

    def __init__(self) -> None:
        self.all: list[Trial] = []
        self._known: dict[tuple[int, bytes], Trial] = {}

    def add(self, trial: Trial) -> None:
        self.all.append(trial)
        self._known[trial.mesh, _bits(trial.theta)] = trial

    def find(self, theta: Sequence[float] | Array, mesh: int = 1) -> Trial | None:
        """The trial of these values to the last bit on a mesh; None if there was none."""
        return self._known.get((mesh, _bits(theta)))


def _bits(theta: Sequence[float] | Array) -> bytes:
    return (np.asarray(theta, dtype=float) + 0.0).tobytes()  # + 0.0: -0.0 is 0.0
