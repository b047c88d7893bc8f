"""A quantity of one's own, in one file: the mean of the silicone's squared stretch, limited in a problem by its name."""

from __future__ import annotations

import numpy as np
import pytest

from softmodels.case.case import Case
from softmodels.case.load import steps_of
from softmodels.design.problem import DesignProblem
from softmodels.design.quantities import QUANTITIES, DesignQuantity, FormMeasure
from softmodels.materials.laws import NeoHookean


class MeanSquareStretch(DesignQuantity, name="mean_square_stretch", unit="1"):
    """Mean of a third of the first invariant, 1 where nothing is stretched."""

    def measure(self, design):
        from dolfinx import fem

        body = design.system.body
        weights = (design.strain.I1 / 3, fem.Constant(body.mesh, 1.0))
        forms = [weight * body.hoop * body.measures()[0] for weight in weights]

        def mean(values):
            return values[0] / values[1], np.array([1.0, -values[0] / values[1]]) / values[1]

        return FormMeasure(design, forms, mean)


@pytest.fixture(autouse=True, scope="module")
def forgotten():
    yield
    del QUANTITIES[MeanSquareStretch.name]


def test_its_gradient_is_exact(designed, thin_disk, comm, taylor):
    model = designed(thin_disk, ("membrane",), (MeanSquareStretch(at=2000.0),), comm)
    value = model.evaluate(model.start).values["mean square stretch at 2 kPa"]
    assert 1.005 < value < 1.1
    ((order, _),) = taylor(model, "membrane").values()
    assert order == pytest.approx(2.0, abs=0.2)


def test_a_problem_knows_it(thin_disk):
    case = Case(name="mine", actuator=thin_disk, material=NeoHookean(20e3, 0.49), steps=steps_of(pressure_cm=(20.0,)))
    problem = DesignProblem(
        case, {"membrane": ("1.8 mm", "2.4 mm")}, maximise={"quantity": "rise", "at": "20 cm"},
        keep=[{"quantity": "mean_square_stretch", "at": "20 cm", "at_most": 1.2}],
    )  # fmt: skip
    assert [type(keep.quantity) for keep in problem.limits] == [MeanSquareStretch]
