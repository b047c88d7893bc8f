"""Target surfaces: distances and gradients of a plate's face, what a slice shows, formulas that are none."""

import numpy as np
import pytest

from geometries import ChannelPlate
from softmodels.design.quantities import QUANTITIES
from softmodels.design.surfaces import Formula, Surface

DOME = "0.5 mm * (1 - (x^2 + y^2) / (1.2 cm)^2)"
PRESSURE = 3000.0
PLATE = ChannelPlate(
    outline="-12, -10, 12, -10, 12, 10, -12, 10 mm", channels=("-7, 0 to 7, 0 mm", "0, -5 to 0, 5 mm"), support="free",
    thickness=4e-3, radius=0.8e-3, offset=0.4e-3, around=6.0, cell_size=4e-3,
)  # fmt: skip


def test_the_distance_and_those_of_points_have_exact_slopes(designed, comm):
    asked = Surface(at=PRESSURE, height=DOME, tilted=True)
    model = designed(PLATE, ("offset", "scale_x"), [asked], comm)
    here = model.evaluate(model.start)
    value, squares = here.values[asked.key], here.squares[asked.key]
    residuals = squares.residuals
    assert np.sqrt(residuals @ residuals / squares.count) == pytest.approx(value, rel=1e-6)
    for number, step in enumerate((5e-6, 1e-3)):
        shift = step * np.eye(2)[number]
        high, low = (model.evaluate(model.start + sign * shift).values[asked.key] for sign in (1.0, -1.0))
        assert here.gradients[asked.key][number] == pytest.approx((high - low) / (2.0 * step), rel=5e-3)
    (by_offset, _) = squares.jacobian.T @ residuals / (squares.count * value)
    assert by_offset == pytest.approx(here.gradients[asked.key][0], rel=1e-2)


def test_a_slice_shows_what_the_whole_plate_does_and_tilt_does_not_count(designed, comm):
    tilt = f"{DOME} + 0.2 mm + 0.1 * x"
    quarter, whole = PLATE, PLATE.replaced(symmetry="none")
    assert quarter.copies == 4
    values = {}
    for name, plate, height in (("quarter", quarter, DOME), ("whole", whole, DOME), ("tilted", whole, tilt)):
        asked = Surface(at=PRESSURE, height=height, tilted=True)
        model = designed(plate, (), [asked], comm)
        values[name] = model.evaluate(model.start).values[asked.key]
    assert values["quarter"] == pytest.approx(values["whole"], rel=2e-2)  # coarse meshes
    assert values["tilted"] == pytest.approx(values["whole"], rel=2e-2)  # distances are along the tilted normal
    with pytest.raises(ValueError, match="not its own mirror image, but only 1/4 of the device is meshed; use --symmetry none"):
        designed(quarter, (), [Surface(at=PRESSURE, height=tilt)], comm).evaluate(np.zeros(0))


def test_a_formula_is_a_length():
    x, y = np.array([0.0, 3e-3]), np.array([2e-3, 4e-3])
    assert Formula("2 mm - (x^2 + y^2) / 1cm").text
    assert Formula("2 mm - (x^2 + y^2) / 1cm")(x, y, np) == pytest.approx(2e-3 - (x**2 + y**2) / 1e-2)
    assert Formula("y * tan(60 deg * x / (5e1 mm))")(x, y, np) == pytest.approx(y * np.tan(np.pi / 3 * x / 0.05))
    assert Formula("-x * sqrt(pi)")(x, y, np) == pytest.approx(-x * np.sqrt(np.pi))
    assert QUANTITIES["surface"] is Surface


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x^2", "its value is no length"), ("3", "its value is no length"), ("", "it cannot be read"),
        ("2 mm *", "it cannot be read"), ("2 kg", "kg"), ("z + 1 mm", "'z' is not known"),
        ("open(1 mm)", "'open' is not known"), ("x.real", "numbers with units"), ("x if y else x", "numbers with units"),
        ("sqrt(x, y)", "'sqrt' is not known"), ("1 mm / 0", "it cannot be evaluated"), ("x * 0 / 0", "it has no value"),
        ("(" * 900 + "x" + ")" * 900, "it cannot be read"), ("sqrt(-x^2)", "it has no value"),
    ],
)  # fmt: skip
def test_what_is_no_formula_is_rejected_in_a_sentence(text, message):
    with pytest.raises(ValueError, match=message) as told:
        Surface(at=PRESSURE, height=text)
    assert "write a height such as" in str(told.value) and "\n" not in str(told.value)
