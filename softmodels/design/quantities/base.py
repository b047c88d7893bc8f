"""Base classes of quantities: a name, a unit, and the evaluation on a meshed device.

Add a quantity as a class with `@quantity`, also in other modules.
"""

from __future__ import annotations

import abc
import dataclasses
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from softmodels.common.arrays import Array
from softmodels.common.names import Registry
from softmodels.common.units import quantity as read_quantity
from softmodels.design.loads import JudgedLoad

if TYPE_CHECKING:
    import ufl

    from softmodels.design.body import DesignedBody
    from softmodels.mechanics.system import State


@dataclasses.dataclass(frozen=True, eq=False)
class Slopes:
    """A quantity at a state, and its partial derivatives.

    Attributes:
        value: In SI units.
        w: By the owned unknowns of the state, shape (n,); None if it does not depend on them.
        P: By the dimensionless pressure.
        X: By the dimensionless places of the mesh's nodes at fixed unknowns, flat over `MeshMotion.space`; None for none.
        note: A sentence on how far the value can be trusted; empty for none.
    """

    value: float
    w: Array | None = None
    P: float = 0.0
    X: Array | None = None
    note: str = ""


class Measure(abc.ABC):
    """A quantity prepared on a meshed device, with its compiled forms."""

    @abc.abstractmethod
    def slopes(self, state: State | None) -> Slopes:
        """Return value and derivatives; the state is loaded into the equations. None if it needs no state."""

    def value(self, state: State | None) -> float:
        """Return only the value, after `slopes` on this mesh."""
        return self.slopes(state).value


class TargetMeasure(Measure):
    """Distances from a target.

    Attributes:
        run: Correlation length of the target's errors, in points.
        sigma: Standard error of one in SI units; 0 where it is not known.
    """

    run: float = 1.0
    sigma: float = 0.0

    @abc.abstractmethod
    def residuals(self, state: State) -> Array:
        """Return the distances in SI units, shape (k,)."""

    @abc.abstractmethod
    def moved(self, state: State, w: Array, X: Array) -> Array:
        """Return the derivative of the distances, shape (k,).

        Args:
            state: The state that is loaded.
            w: Derivative of its dof values, with ghosts.
            X: That of the mesh's dimensionless nodes, shape (nodes of `MeshMotion.space`, d), with ghosts.
        """


@dataclasses.dataclass(frozen=True, kw_only=True)
class DesignQuantity(abc.ABC):
    """A quantity of a design.

    Attributes:
        at: The state at which it is taken, a `Load` or a pressure in Pa.
    """

    name: ClassVar[str]
    unit: ClassVar[str]
    """SI unit of its values; "1" for a pure number."""
    help: ClassVar[str]
    """Its description, a clause."""
    of_state: ClassVar[bool] = True
    """Whether it belongs to a state, so that ``at`` is required."""

    at: JudgedLoad | float | None = None

    def __post_init__(self) -> None:
        if self.at is not None:
            object.__setattr__(self, "at", JudgedLoad.of(self.at))

    @property
    def load(self) -> JudgedLoad | None:
        """The state at which it is evaluated."""
        return None if self.at is None else JudgedLoad.of(self.at)

    @property
    def title(self) -> str:
        """Its title without its load, as in ``rise of tip``."""
        return self.name.replace("_", " ")

    @property
    def key(self) -> str:
        """Unique text, as in ``rise of tip at 16.84 kPa``."""
        return self.title if self.at is None else f"{self.title} at {self.load}"

    @abc.abstractmethod
    def measure(self, design: DesignedBody) -> Measure:
        """Prepare it on a meshed device; raise ValueError with a message if the device does not have it."""


def length(what: str, value: float | str) -> float:
    """Return a length in m that is not negative, from a number or a text with a unit.

    Raises:
        ValueError: It is something else.
    """
    found = read_quantity(value, "m") if isinstance(value, str) else float(value)
    if not (np.isfinite(found) and found >= 0.0):
        raise ValueError(f"{what} is {value!r}; it must be a length above zero, or 0 for none")
    return found


# ----------------------------------------------------------------------------------------------------------------------
# Quantities that are functions of integrals over the body, with values and derivatives from UFL forms.


Combine = Callable[[Array], tuple[float, Array]]
"""Value of a function of integrals, and its slopes by them."""


class FormMeasure(Measure):
    """A function of integrals.

    Args:
        design: The meshed device.
        forms: UFL forms without arguments; those of the state are functions of `System.w`.
        combine: The function, and its slopes.
        counted_in_stress: Whether the function is in shear moduli.
        by_pressure: Derivatives of the last forms' sum by the pressures of the cavities, dimensionless.
    """

    def __init__(
        self, design: DesignedBody, forms: Sequence[ufl.Form], combine: Combine, *,
        counted_in_stress: bool = False, by_pressure: Sequence[ufl.Form] = (),
    ):  # fmt: skip
        import ufl

        self.design, self.combine, self.counted_in_stress = design, combine, counted_in_stress
        system, form = design.system, design.system.form
        self._forms = [form(one) for one in forms]
        test = ufl.TestFunction(system.space)
        self._slopes = [
            form(ufl.derivative(one, system.w, test)) if system.w in one.coefficients() else None for one in forms
        ]
        self._by_pressure = [form(one) for one in by_pressure]
        self._covectors = [design.motion.compiled(one) for one in forms]

    def _combined(self) -> tuple[float, Array]:
        """Return the value in SI units and its slopes by the integrals."""
        system = self.design.system
        unit = system.stress_unit if self.counted_in_stress else 1.0
        value, rates = self.combine(np.array([system.integral(form) for form in self._forms]))
        return unit * value, unit * rates

    def value(self, state: State | None) -> float:
        return self._combined()[0]

    def slopes(self, state: State | None) -> Slopes:
        system = self.design.system
        value, rates = self._combined()
        by_w: Array | None = None
        by_X = np.zeros(self.design.motion.entries)
        for rate, slope, covector in zip(rates, self._slopes, self._covectors, strict=True):
            if slope is not None:
                part = rate * system.assemble([slope])
                by_w = part if by_w is None else by_w + part
            by_X += rate * self.design.motion.assembled(covector)
        by_P = sum(
            (
                share * system.integral(form)
                for share, form in zip(system.coupling.shares, self._by_pressure, strict=False)
            ),
            0.0,
        )
        return Slopes(value, by_w, float(rates[-1] * by_P), by_X, self.note(value))

    def note(self, value: float) -> str:
        """Return a warning on the value, or ""."""
        return ""


def scaled(factor: float) -> Combine:
    """Return the sum of the integrals times a factor."""
    return lambda values: (factor * float(values.sum()), np.full(len(values), factor))


QUANTITIES: Registry[type[DesignQuantity]] = Registry("quantity", lambda quantity: quantity.name)
"""Every known quantity by its name in problem files."""
register_quantity = QUANTITIES.register
