"""Components of a device besides silicone and air: base classes for further terms of its potential.

A part is a frozen dataclass whose fields come from `softmodels.common.schema`. Its ``table`` is its table in a case file:
``[table]`` for a single one, ``[table.name]`` for several. A user-defined kind, also outside the library:

    @register_component
    @dataclasses.dataclass(frozen=True)
    class Springs(EnergyComponent):
        table: ClassVar[str] = "springs"
        face: str = field_of(Words(), "face on springs")
        stiffness: float = field_of(Quantity("Pa/m"), "pressure per displacement")

        def term(self, setting):
            body = setting.body
            u, area = body.displacement(setting.displacement), body.sheet_face(self.face)[0]
            k = fem.Constant(body.mesh, self.stiffness * body.actuator.size)
            return EnergyTerm([setting.per_pascal * k / 2 * ufl.dot(u, u) * body.hoop * area])
"""

from __future__ import annotations

import abc
import copy
import dataclasses
import itertools
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, ClassVar, Protocol, Self

import numpy as np
import numpy.typing as npt

from geometries import Actuator
from geometries.actuator import Vector, cavity_roles
from softmodels.common import errors, names, schema, units
from softmodels.common.arrays import Array
from softmodels.common.errors import ComponentError
from softmodels.common.lazy import MPI, Expr, fem, ufl
from softmodels.materials.laws import Material
from softmodels.mechanics import body
from softmodels.mechanics.body import Body


@dataclasses.dataclass(frozen=True)
class Component(abc.ABC):
    """A component of a device.

    Attributes:
        name: Name that distinguishes it from others of its kind; empty for a single one.
        table: Its table in a case file.
        needs: What is missing where a field without a default is not given, a sentence.
        always_named: Whether ``[table]`` itself belongs to something else, so that each stands in a ``[table.name]``.
        distinct: Of kinds that share a table of named ones, the field by which those of this one are known; empty for one.
        optional: Whether command lines have options for one of it: ``--table`` for its first field, ``--table-field`` for the
            others.
        differentiable: Whether design gradients support it on every device; see `undesigned`.
        figure_texts: Short name and meaning of its columns of ``path.csv`` by a pattern of `re`; ``{0}`` is its first group.

    Raises:
        ComponentError: From the constructor: a field that is not of its kind, or a name that cannot be part of a column's.
    """

    name: str = dataclasses.field(default="", kw_only=True)
    table: ClassVar[str]
    needs: ClassVar[str] = ""
    always_named: ClassVar[bool] = False
    distinct: ClassVar[str] = ""
    figure_texts: ClassVar[Mapping[str, tuple[str, str]]] = {}
    optional: ClassVar[bool] = False
    differentiable: ClassVar[bool] = False

    def __post_init__(self) -> None:
        schema.settle(self, ComponentError)
        if not isinstance(self.name, str):
            raise ComponentError(f"[{self.table}]: name is {units.brief(self.name)}; it must be a text, such as 'tip'")
        if not re.fullmatch(r"([a-z]\w*)?", self.name):
            raise self.error("a name must consist of letters, digits and '_', starting with a lower-case letter")
        self.check()

    def check(self) -> None:  # noqa: B027
        """Check the fields for consistency; raise `ComponentError` if invalid."""

    def check_on(self, actuator: Actuator) -> None:  # noqa: B027
        """Raise `ComponentError` if it does not suit a device; before meshing."""

    @property
    def weighs(self) -> float:
        """Its own mass in kg, on which gravity acts; 0 for none."""
        return 0.0

    @property
    def lifted(self) -> bool:
        """Whether that mass is separate from the device and loads it only when lifted."""
        return False

    @property
    def acceleration(self) -> Array | None:
        """Of gravity in m/s2, shape (3,), in device coordinates, where it is gravity; else None."""
        return None

    def check_under(self, gravity: Array) -> None:  # noqa: B027
        """Raise `ComponentError` if it is invalid under gravity's acceleration in m/s2, shape (3,), in device coordinates."""

    @classmethod
    def read_table(cls, name: str, table: Mapping[str, object]) -> Component:
        """Return the part of a table of a case file; raise `FieldError` or the part's own error if invalid."""
        where = f"[{cls.table}{f'.{name}' if name else ''}]"
        values = schema.from_table(cls, table, where, f"{cls.table} ")
        cls.check_required(name, values)
        return cls(**values, name=name)

    @classmethod
    def check_required(cls, name: str, values: Mapping[str, object]) -> None:
        """Raise `FieldError` if a field without a default is missing."""
        where = f"[{cls.table}.{name}]" if name else f"[{cls.table}]"
        required = [field.name for field in dataclasses.fields(cls) if field.default is dataclasses.MISSING]
        if missing := [field for field in required if field not in values]:
            raise errors.FieldError(cls.needs or f"{where} needs {' and '.join(missing)}")

    def write_table(self, text: schema.Text) -> dict[str, object]:
        """Return its table in a case file, without its name."""
        return schema.to_table(self, text)

    @property
    def explained(self) -> Mapping[str, str]:
        """Descriptions of the entries of its table."""
        return {field.key or name: field.help for name, field in schema.about(self).items()}

    def undesigned(self, actuator: Actuator) -> str:
        """Return why design gradients do not support it, as a clause after its name; empty if they do."""
        return "" if self.differentiable else "whose gradients are not available"

    def inside(self, actuator: Actuator) -> tuple[str, ...]:
        """Return the regions that it belongs to: where lengths vary, the mesh has to follow their interfaces."""
        return ()

    @property
    def variable(self) -> Mapping[str, str]:
        """Units of its numbers that a design may vary, by name; empty units of pure numbers."""
        return {}

    def number(self, name: str) -> float:
        """Return one of `variable`."""
        return float(getattr(self, name))

    def varied(self, name: str, value: float) -> Self:
        """Return it with another value of one of `variable`; raise its own error if that is invalid."""
        return dataclasses.replace(self, **{name: value})  # type: ignore[arg-type]

    def nudged(self, name: str, by: complex) -> Self:
        """Return an unchecked copy with one of `variable` changed, possibly to a complex value."""
        made = copy.copy(self)
        object.__setattr__(made, name, getattr(self, name) + by)
        return made

    @property
    def key(self) -> str:
        """Its table without brackets, unique in a case: ``"gravity"``, ``"force.tip"``."""
        return f"{self.table}.{self.name}" if self.name else self.table

    @property
    def remembers(self) -> bool:
        """Whether its forces depend on earlier states, like friction's, and not only on the current one."""
        return False

    @property
    def connects(self) -> tuple[str, ...]:
        """Regions or faces between which it acts, so that bodies need not share faces."""
        return ()

    @property
    def steadies(self) -> tuple[str, ...]:
        """Regions or faces that it keeps in their place."""
        return ()

    @property
    def sealing(self) -> Sealing | None:
        """What it closes the first cavity with; None for nothing."""
        return None

    @property
    def files(self) -> Mapping[str, str]:
        """Files named by its fields, by field; their contents are part of its identity."""
        return {}

    @property
    def looked_up(self) -> tuple[object, ...]:
        """Functions and classes named by its fields, such as a fibre law, which may come from a user's file."""
        return ()

    @property
    def label(self) -> str:
        """Prefix of its columns: its name, or its table's."""
        return self.name or self.table

    @property
    def in_model(self) -> str:
        """Its addition to the sentence on the limits of the model, starting with '; '; empty for most."""
        return ""

    def hindrance(self, actuator: Actuator, figure: Callable[[str], float]) -> str:
        """Return how it may have ended a path and what to try, as a sentence without full stop; empty if unlikely. ``figure``
        gives a variable of the last state in SI, 0 where there is none."""
        return ""

    @property
    def where(self) -> str:
        """Its table in messages."""
        return f"[{self.table}.{self.name}]" if self.name else f"[{self.table}]"

    def error(self, text: str) -> ComponentError:
        """Return the error of a sentence on it, with its table in front."""
        return ComponentError(f"{self.where}: {text}")


@dataclasses.dataclass(frozen=True)
class Sealing:
    """A plane (point and normal in m, in device coordinates) that closes the first cavity where faces press on it: these are
    free, whatever the device holds them by."""

    roles: tuple[str, ...]
    point: Vector
    normal: Vector


class EnergyComponent(Component):
    """A part that stores energy, such as fibres or contact."""

    @abc.abstractmethod
    def term(self, setting: FormContext) -> EnergyTerm:
        """Return its term in the equations; `ComponentError` if it cannot be on this mesh."""


@dataclasses.dataclass(frozen=True, eq=False)
class FormContext:
    """The potential to which a part adds its term.

    Attributes:
        body: Mesh and roles.
        w: The unknowns.
        displacement: Skew components of the displacement in w, in UFL; `Body.displacement` makes u of it.
        per_pascal: One pascal in shear moduli of the silicone.
        gravity: Its acceleration in m/s2, shape (3,), in device coordinates; zero where the case has none.
    """

    body: Body
    w: fem.Function
    displacement: Expr
    per_pascal: fem.Constant
    gravity: Array


class MaterialCells(Protocol):
    """One of the materials of a device: its region's name, empty for the main one, its law, and its owned local cells."""

    name: str
    material: Material
    cells: npt.NDArray[np.int32]
    dx: ufl.Measure


class Equations(Protocol):
    """Interface of `System`, whose functions hold the state, for figures of terms and for dead loads."""

    @property
    def body(self) -> Body: ...
    @property
    def w(self) -> fem.Function: ...
    @property
    def comm(self) -> MPI.Comm: ...
    @property
    def stress_unit(self) -> float: ...
    @property
    def length_unit(self) -> float: ...
    @property
    def volume_unit(self) -> float: ...
    @property
    def matter(self) -> Sequence[MaterialCells]: ...
    @property
    def points(self) -> Array: ...
    @property
    def pressures(self) -> Array: ...
    @property
    def bcs(self) -> Sequence[fem.DirichletBC]: ...
    @property
    def form(self) -> Callable[[ufl.Form], fem.Form]: ...
    @property
    def space(self) -> fem.FunctionSpace: ...
    @property
    def mixed(self) -> bool: ...
    @property
    def material(self) -> Material: ...
    @property
    def n(self) -> int: ...
    def integral(self, form: fem.Form) -> float: ...
    def assemble(self, forms: list[fem.Form], held: bool = False) -> Array: ...


@dataclasses.dataclass(eq=False)
class EnergyTerm:
    """One part's share of a device's potential.

    Attributes:
        energies: UFL integrals of the slice, lengths in sizes of the device and stresses in shear moduli of the silicone:
            a stiffness in Pa is multiplied by `FormContext.per_pascal`, once, so that fits know its derivative.
        remembers: Whether its forces depend on the states before; see `commit`.
    """

    energies: list[ufl.Form]
    remembers: ClassVar[bool] = False

    def constants_of(self, part: Component) -> list[tuple[fem.Constant, Array]]:
        """Return the constants of `energies` that a part of the same kind may change, with its values, which may be
        complex."""
        return []

    def take(self, part: Component) -> None:
        """Set the numbers of another part of the same kind, without recompiling."""
        for constant, value in self.constants_of(part):
            constant.value = np.asarray(value, dtype=float)

    def follow_mesh(self) -> None:
        """Follow a mesh that has moved, in all that is not a form."""

    @property
    def stiffness(self) -> float:
        """Stiffness in Pa of a term with predicted stress in Newton's matrix, for a face in Pa times size; 0 for others."""
        return 0.0

    def tangent(self, mixed_points: MixedPointStress) -> list[ufl.Form] | None:
        """Return the second derivatives of `energies`, one for each, if their stress is predicted; None for the plain ones. A
        stiff term that is turned needs it, see `softmodels.mechanics.potential.Potential.predict_stress`."""
        return None

    def compile(self, equations: Equations) -> None:
        """Compile the forms of `figures` once."""

    def figures(self, equations: Equations) -> dict[str, float]:
        """Return the columns of ``path.csv`` and their values in the state that is loaded, of the whole device, on all
        ranks."""
        return {}

    def breakdown(self, equations: Equations) -> PathFailure | None:
        """Return the cause if it is unstable by itself in the loaded state, the same on all ranks;
        else None."""
        return None

    def update_lagged(self, w: Array) -> bool:
        """Adjust to a converged state's w (owned entries, perhaps more behind) what its forces take as given during a solve;
        return whether that has changed."""
        return False

    def margin(self, equations: Equations) -> float:
        """Return how far what it seals is from opening in the loaded state, the same on all ranks; 0 where it opens."""
        return math.inf

    def opened(self, equations: Equations) -> PathFailure | None:
        """Return the end of a path in the loaded state, in which `margin` is 0."""
        return None

    def commit(self, w: Array, reset: bool = False) -> None:
        """Accept a converged state's w (owned entries, perhaps more behind), and update the history to it; ``reset`` where a
        path begins there, and nothing of before counts."""

    def is_admissible(self, before: Array, after: Array) -> bool:
        """Return whether a step between two states' w is admissible, the same on all ranks."""
        return True


def _key(kind: type[Component]) -> str:
    return f"{kind.table}.{kind.distinct}" if kind.always_named else kind.table


COMPONENTS: names.Registry[type[Component]] = names.Registry("component", _key, made_known=schema.describe_fields)
"""Every kind by its table; those that always have a name by ``table.`` and what they are known by: ``[contact.ball]`` is none
of ``[contact]``, and one with ``between`` is of two bodies."""
register_component = COMPONENTS.register


def column_texts(*columns: tuple[str, str, str]) -> dict[str, tuple[str, str]]:
    """Return names and meanings of a load's columns by their patterns, without and with the load's own name."""
    texts = {}
    for column, title, text in columns:
        what, _, unit = column.rpartition("_")
        texts[column] = (title, text)
        texts[rf"{what}_(\w+)_{unit}"] = (title.replace(" the ", " ") + " {0}", text)
    return texts


def gravity_of(components: Sequence[Component]) -> Array:
    """Acceleration of gravity in m/s2, shape (3,), in device coordinates; zero where no component is one."""
    return next((part.acceleration for part in components if part.acceleration is not None), np.zeros(3))


# ----------------------------------------------------------------------------------------------------------------------
# What depends on earlier states, saved before a step that may fail.


class HistoryDependent(Protocol):
    """A part that depends on earlier states, such as friction. What `save` returns is not changed by later steps."""

    def save(self) -> object: ...
    def restore(self, saved: Any) -> None: ...


class Checkpoint:
    """The histories of parts, saved here; `restore` brings them back, as often as needed."""

    def __init__(self, parts: Iterable[HistoryDependent]):
        self._saved = [(part, part.save()) for part in parts]

    def restore(self) -> None:
        for part, saved in self._saved:
            part.restore(saved)


# ----------------------------------------------------------------------------------------------------------------------
# Physical causes of the end of a path, other than limit points.


@dataclasses.dataclass(frozen=True)
class PathFailure:
    """A cause (a clause on what happens there), with its advice, a sentence without its full stop. Where it ``snaps``, stable
    states may lie beyond to which no step leads; where it is ``of_mesh``, no limit of the device is known."""

    clause: str
    advice: str
    snaps: bool = False
    of_mesh: bool = False


# ----------------------------------------------------------------------------------------------------------------------
# Predicted stress of a term in Newton's matrix; see `softmodels.mechanics.potential.Potential.predict_stress`.


@dataclasses.dataclass(frozen=True, eq=False)
class MixedPointStress:
    """Data for the predicted stress of a term in Newton's matrix: the unknowns of another state, the skew components of their
    displacement, the move from there to the current state, and the matrix' two directions."""

    known: fem.Function
    displacement: Expr
    move: fem.Function
    test: Expr
    trial: Expr


# ----------------------------------------------------------------------------------------------------------------------
# Parse names of faces and regions, and look them up on a device.


def names_in(text: str) -> list[str]:
    """Split names separated by commas."""
    return [name.strip() for name in text.split(",") if name.strip()]


def bases(where: str, texts: Sequence[str], actuator: Actuator) -> list[str]:
    """Return the faces of which texts such as ``"tip within z > 14 mm"`` are pieces; see `softmodels.mechanics.body`.

    Raises:
        ComponentError: A text that is none, or uses a coordinate that an axisymmetric section does not have.
    """
    try:
        pieces = [piece for text in texts for piece in body.pieces_in(text)]
    except ComponentError as error:
        raise ComponentError(f"{where}: {error}") from None
    for piece in pieces if actuator.dimension == 2 else ():
        if other := next((name for name, _, _ in piece.bounds if name.strip("|") in "xy"), ""):
            raise ComponentError(
                f"{where}: {piece.text!r} uses {other}; an axisymmetric section has r and z. For others use {actuator.fuller}"
            )
    return [face for piece in pieces for face in piece.faces]


def check_condition(where: str, text: str, actuator: Actuator) -> None:
    """Raise `ComponentError` for a condition such as ``"5 mm < r < 9 mm"`` that is none, or not of this device."""
    try:
        body.condition_of(text)
    except ComponentError as error:
        raise ComponentError(f"{where}: {error}") from None
    bases(where, [f"cells{body.WITHIN}{text}"], actuator)


def faces_of(actuator: Actuator) -> tuple[str, ...]:
    """Return the faces of a device that can be reinforced: its own, the walls of its cavities, and what else its mesh has."""
    return tuple(dict.fromkeys([*actuator.faces, *cavity_roles(actuator), *(actuator.unbonded or ())]))


def check_faces(where: str, actuator: Actuator, names: Sequence[str]) -> None:
    """Raise `ComponentError` for names that are not faces of the device."""
    for name in bases(where, names, actuator):
        if name not in faces_of(actuator):
            raise ComponentError(
                f"{where}: {name!r} is not a face of {type(actuator).__name__}; it has {', '.join(faces_of(actuator))}"
            )


def check_on_mesh(where: str, actuator: Actuator, names: Sequence[str]) -> None:
    """Raise `ComponentError` for faces that the device's mesh will not have, as far as known before meshing."""
    if actuator.unbonded is None:
        return
    others = (hold.role for hold in actuator.holds), (plane.name for plane in actuator.cut_planes), actuator.unbonded
    known = list(dict.fromkeys([*actuator.faces, *cavity_roles(actuator), *itertools.chain(*others)]))
    for name in bases(where, names, actuator):
        if name not in known:
            raise ComponentError(f"{where}: {type(actuator).__name__} has no face {name!r}; it has {', '.join(known)}")


def check_regions(where: str, actuator: Actuator, names: Sequence[str]) -> None:
    """Raise `ComponentError` for names that are not regions of the device."""
    for name in names:
        if name not in actuator.regions:
            known = f"its regions are {', '.join(actuator.regions)}" if actuator.regions else "it has no regions"
            raise ComponentError(f"{where}: {type(actuator).__name__} has no region {name!r}; {known}")


# ----------------------------------------------------------------------------------------------------------------------
# Directions of loads: parse them, and check them against a device's symmetry.


IN_PLANE_TOLERANCE = 1e-9
"""Cosine up to which a direction lies in a plane."""


def direction(text: str, where: str) -> Vector:
    """Return the unit vector of a text such as ``"-z"`` or ``"0.6, 0, -0.8"``, in device coordinates.

    Raises:
        ComponentError: It is none.
    """
    if match := re.fullmatch(r"\s*([+-]?)\s*([xyz])\s*", text):
        sign, axis = (-1.0 if match[1] == "-" else 1.0), "xyz".index(match[2])
        vector = sign * np.eye(3)[axis]
    else:
        try:
            vector = np.array([float(part) for part in text.split(",")])
        except ValueError:
            vector = np.zeros(0)
        length = float(np.linalg.norm(vector)) if len(vector) == 3 else 0.0
        if not (0.0 < length < np.inf):
            raise ComponentError(f"{where}: {text!r} is not a direction; write one like -z, or three numbers like 0.6, 0, -0.8")
        vector = vector / length
    return float(vector[0]), float(vector[1]), float(vector[2])


def check_direction(vector: Vector, actuator: Actuator, where: str) -> None:
    """Raise `ComponentError` for a direction across the axis of a section, or out of a cut plane."""
    if actuator.dimension == 2 and abs(vector[2]) < 1 - IN_PLANE_TOLERANCE:
        raise ComponentError(
            f"{where}: an axisymmetric section takes loads along its axis, z or -z; for others use {actuator.fuller}"
        )
    for plane in actuator.cut_planes if actuator.dimension == 3 else ():
        if abs(float(np.dot(vector, plane.normal))) > IN_PLANE_TOLERANCE:
            across = ", ".join(f"{x:g}" for x in plane.normal)
            raise ComponentError(
                f"{where}: its direction leaves the symmetry plane normal to ({across}); "
                f"use one in that plane, or {actuator.fuller}"
            )
