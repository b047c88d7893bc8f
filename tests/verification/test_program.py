"""Several cavities, each under its own pressure or volume, step by step."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from geometries import ImportedActuator
from softmodels.case.load import steps_of
from softmodels.common.units import Column
from softmodels.materials.laws import NeoHookean
from softmodels.path import schedule
from tests.support import bodies

ALONE = "two balloons by themselves, in one program"
WAYS = "pressures that lead to volumes, by those volumes in five orders of steps"
RUBBER = NeoHookean(100e3, 0.499)
CM = 95.1235  # Pa
RADII = {"inner": (9.5, 10.0), "outer": (19.5, 21.0)}  # mm
ML = 1e6


@pytest.fixture(scope="module")
def balloons():
    """Two half balloons, one inside the other and apart: what one does says nothing of the other."""
    from softmodels.common.schema import number_field

    @dataclasses.dataclass(frozen=True, kw_only=True)
    class Balloons(bodies.Sphere):
        through: float = number_field(1, "cells through the wall")
        along: float = number_field(16, "cells from the equator to the pole")

        @property
        def ratios(self):
            return (1.0, 1.0)

        @property
        def cavity_volume(self):
            return sum(2 / 3 * math.pi * (inner * 1e-3) ** 3 for inner, _ in RADII.values())

        def build(self):
            import gmsh

            roles = {}
            for (inner, outer), cavity in zip(RADII.values(), ("cavity", "cavity2"), strict=True):
                self._ring(inner * 1e-3, outer * 1e-3, cavity, roles)
            gmsh.model.geo.synchronize()
            for name, (dimension, tags) in roles.items():
                gmsh.model.addPhysicalGroup(dimension, tags, name=name)

        def _ring(self, inner, outer, cavity, roles):
            import gmsh

            geo, mesh = gmsh.model.geo, gmsh.model.geo.mesh
            centre = geo.addPoint(0, 0, 0)
            a, b, c, d = (geo.addPoint(*p, 0) for p in ((inner, 0), (outer, 0), (0, outer), (0, inner)))
            curves = [
                geo.addLine(a, b),
                geo.addCircleArc(b, centre, c),
                geo.addLine(c, d),
                geo.addCircleArc(d, centre, a),
            ]
            face = geo.addPlaneSurface([geo.addCurveLoop(curves)])
            for curve, cells in zip(curves, (self.through, self.along) * 2, strict=True):
                mesh.setTransfiniteCurve(curve, round(cells) + 1)
            mesh.setTransfiniteSurface(face)
            for name, dimension, tag in (
                ("solid", 2, face), ("equator", 1, curves[0]), ("axis", 1, curves[2]), (cavity, 1, curves[3]),
                ("outer", 1, curves[1]),
            ):  # fmt: skip
                roles.setdefault(name, (dimension, []))[1].append(tag)

    return Balloons()


@pytest.fixture(scope="module")
def alone(equilibrium):
    """Return a function that gives the equations of one of the balloons by itself."""

    def make(name):
        inner, outer = (radius * 1e-3 for radius in RADII[name])
        return equilibrium(bodies.Sphere(inner=inner, outer=outer, through=1, along=16), RUBBER)

    return make


@pytest.fixture(scope="module")
def run(balloons, body_of):
    """Return a function that takes both balloons through a program: points with how far they have come, and the end."""
    from softmodels.mechanics.solver import Solver
    from softmodels.mechanics.system import System
    from softmodels.path.stability import PathEnd
    from softmodels.runs.fields import Fields

    def through(*series, device=balloons):
        eq = Solver(System(body_of(device), RUBBER))
        fields, points = Fields(eq), []
        try:
            cavities = {f"cavity{i}": one for i, one in enumerate(series, 1)}
            for come, point in schedule.follow(eq, steps_of(water_density=CM / Column(1.0).pascal, **cavities)):
                points.append((come, point, fields.figures(point.state)))
        except PathEnd as end:
            return points, end
        finally:
            eq.release()
        return points, None

    return through


def asked(points):
    """Figures at the steps of a program."""
    return [figures for _, point, figures in points if point.requested]


@pytest.fixture(scope="module")
def limits(alone, solved):
    """Limit pressure in Pa and added volume there in m3 of each balloon by itself."""
    found = {}
    for name in RADII:
        eq = alone(name)
        _, _, end = solved(eq, [5.0])
        state = end.limit.state
        found[name] = state.P * eq.system.stress_unit, (state.V - eq.system.rest().V) * eq.system.volume_unit
    return found


@pytest.mark.campaign
def test_each_does_what_it_does_alone(run, alone, solved, limits, figure):
    """One is blown past its limit by volume, then the other's pressure is raised: it finds its own limit, at its pressure."""
    added = 2.0 * limits["inner"][1]
    above = 1.05 * limits["outer"][0] / CM
    points, end = run({"volume_ml": (added * ML, added * ML)}, {"pressure_cm": (0.0, above)})
    assert end is not None and end.limit is not None
    eq = alone("inner")
    _, single, _ = solved(eq, [added / eq.system.volume_unit], "auto", "volume")
    held = single[-1].state.P * eq.system.stress_unit
    assert held < 0.95 * limits["inner"][0]  # well past its limit

    at = next(figures for _, point, figures in points if point.limit and figures.cavity_volumes[1] > 0.0)
    wanted = np.array([held, limits["outer"][0]])
    figure(ALONE, "pressures at the other's limit", np.divide(at.cavity_pressures, wanted) - 1, 6.5e-11)
    figure(ALONE, "volume held", at.cavity_volumes[0] / added - 1, 1e-12)
    # The second step holds the first one's volume: nothing falls before the second balloon's own limit.
    second = [point for come, point, _ in points if come > 1]
    turned = next(k for k, point in enumerate(second) if point.limit)
    assert turned > 2 and all(point.stable_under_pressure for point in second[:turned])
    assert not any(point.stable_under_pressure for point in second[turned + 1 :]) and len(second) > turned + 1


def test_a_pressure_held_past_its_limit_is_unstable(run, alone, solved, limits):
    """The first step is under volume and stable; that the pressure of the same state would not hold it shows in the falling
    directions of the balloon by itself."""
    added = 2.0 * limits["inner"][1]
    points, _ = run({"volume_ml": (added * ML,)}, {"pressure_cm": (0.0,)})
    assert all(point.stable_under_volume for _, point, _ in points)
    assert points[-1][1].signature.negative_eigenvalues == 1 and [point.limit for _, point, _ in points].count(True) == 1
    eq = alone("inner")
    _, single, _ = solved(eq, [added / eq.system.volume_unit], "auto", "volume")
    assert single[-1].signature.negative_eigenvalues == 1


@pytest.fixture(scope="module")
def part(two_cavities):
    return ImportedActuator(
        file=str(two_cavities), cavities=("at 11, 0, 2 mm", "at 11, 0, -2 mm"), support="x = 0 mm", cell_size=0.006
    )


@pytest.mark.campaign
def test_pressures_and_volumes_are_two_ways_to_one_state(part, run, figure):
    """Volumes that a program of pressures leads to lead, given by themselves, to those pressures; in any order of steps."""
    pressures = ((60.0, 60.0, 30.0), (0.0, 45.0, 45.0))
    points, end = run(*({"pressure_cm": row} for row in pressures), device=part)
    assert end is None
    wanted = asked(points)[-1]
    # Each presses the other's wall: with 45 cm beside it one takes less than with none.
    assert asked(points)[1].cavity_volumes[0] < 0.995 * asked(points)[0].cavity_volumes[0]
    one, other = (volume * ML for volume in wanted.cavity_volumes)
    ways = (
        ({"volume_ml": (one, one)}, {"volume_ml": (0.0, other)}),
        ({"volume_ml": (0.0, one)}, {"volume_ml": (2 * other, other)}),
        ({"volume_ml": (one,)}, {"volume_ml": (other,)}),  # both at once
        ({"volume_ml": (0.5 * one, 0.5 * one, one)}, {"pressure_cm": (0.0, 45.0, 45.0)}),
        ({"pressure_cm": (0.0, 30.0)}, {"volume_ml": (other, other)}),
    )
    for way in ways:
        points, end = run(*way, device=part)
        assert end is None
        found = asked(points)[-1]
        figure(WAYS, "pressures", np.divide(found.cavity_pressures, (30 * CM, 45 * CM)) - 1, 1e-9)
        figure(WAYS, "volumes", np.divide(found.cavity_volumes, wanted.cavity_volumes) - 1, 1.5e-9)
        figure(WAYS, "tip's rise", found.rises["tip"] / wanted.rises["tip"] - 1, 7.5e-9)
        figure(WAYS, "stored energy", found.stored_energy / wanted.stored_energy - 1, 6e-10)


def test_work_of_all_cavities_is_what_is_stored(part, run, figure):
    """Trapezia of the pressures over the volumes, through steps of both kinds and back down; their error is of second order."""
    points, _ = run(
        {"pressure_cm": (60.0, 60.0, 20.0)}, {"volume_ml": (0.0, 0.03, 0.03)}, device=part
    )  # fmt: skip
    p, V = (np.array([getattr(figures, name) for _, _, figures in points])
            for name in ("cavity_pressures", "cavity_volumes"))  # fmt: skip
    fine, coarse = (np.sum((q[1:] + q[:-1]) / 2 * np.diff(W, axis=0)) for q, W in ((p, V), (p[::2], V[::2])))
    stored = points[-1][2].stored_energy
    assert len(points) % 2 == 1
    against = "energy stored after pressures and volumes of two cavities"
    figure(against, "work, by trapezia", fine / stored - 1, 6.5e-5)
    figure(against, "work, extrapolated", (4 * fine - coarse) / 3 / stored - 1, 4.5e-6)  # Richardson's


@pytest.mark.campaign
def test_back_to_nothing(part, run):
    """Whatever order the cavities are filled in, emptied they leave the part as it was."""
    points, _ = run({"pressure_cm": (40.0, 40.0, 0.0, 0.0)}, {"volume_ml": (0.0, 0.03, 0.03, 0.0)}, device=part)
    last = points[-1][2]
    assert last.stored_energy < 1e-9 * max(figures.stored_energy for *_, figures in points)
    assert max(map(abs, last.cavity_pressures)) < 1e-5 * 40 * CM


def test_like_series_are_one_pressure(part, run, body_of, solved):
    from softmodels.mechanics.solver import Solver
    from softmodels.mechanics.system import System
    from softmodels.runs.fields import Fields

    points, _ = run({"pressure_cm": (50.0,)}, {"pressure_cm": (25.0,)}, device=part)
    eq = Solver(System(body_of(dataclasses.replace(part, pressure_ratios=(1.0, 0.5))), RUBBER))
    _, single, _ = solved(eq, [50 * CM / eq.system.stress_unit])
    one, other = points[-1][2], Fields(eq).figures(single[-1].state)
    assert one.rises["tip"] == pytest.approx(other.rises["tip"], rel=1e-7)
    assert one.cavity_volumes == pytest.approx(other.cavity_volumes, rel=1e-7)


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"cavity1": {"pressure_cm": [1, 2]}}, "1 cavities, but the device has 2"),
        ({"cavity1": {"pressure_cm": 1}, "cavity3": {"pressure_cm": 1}}, "name the cavities cavity1, cavity2"),
        ({"cavity1": {"pressure_cm": [1, 2]}, "cavity2": {"pressure_cm": [1, 2, 3]}}, "cavity1 has 2 values"),
        (
            {"cavity1": {"pressure_cm": [1, 1]}, "cavity2": {"pressure_cm": [1, 1]}},
            "step 2 of the program changes nothing",
        ),
        (
            {"cavity1": {"pressure_cm": [0, 2]}, "cavity2": {"volume_ml": [0, 1]}},
            "step 1 of the program changes pressures and",
        ),
        ({"cavity1": {"pressure_cm": 2}, "cavity2": {"volume_ml": [0, -1e3]}}, "empties a cavity of"),
        ({"cavity1": {"pressure_cm": "a,b"}, "cavity2": {"volume_ml": 0}}, "is not a list of numbers"),
        ({"cavity1": {"pressure_cm": True}, "cavity2": {"volume_ml": 0}}, "is not a list of numbers"),
        ({"cavity1": {"height": 1}, "cavity2": {"volume_ml": 0}}, "needs one of pressure_cm or volume_ml"),
        ({"cavity1": {"pressure_cm": 0}, "cavity2": {"volume_ml": 0}}, "only zeros"),
        ({"cavity1": {"pressure_cm": 1e6}, "cavity2": {"volume_ml": 0}}, "a pressure of 1e.06 cm .* is too much"),
        ({"cavity1": {"pressure_cm": 1}, "cavity2": {"volume_ml": [0, 1e4]}}, "10000 ml against a cavity"),
        ({"cavity1": {"pressure_cm": 1}, "cavity2": {"volume_ml": 0}, "load_unload": True}, "without load_unload"),
        ({"cavity1": {"pressure_cm": 1}, "cavity2": {"volume_ml": 0}, "pressure_cm": 1}, "one of these"),
    ],
)
def test_what_cannot_be_meant_is_said(part, tables, message):
    from softmodels.case.case import Case
    from softmodels.case.entries import CaseError

    with pytest.raises(CaseError, match=message):
        Case.from_toml(_toml(part, tables))


def _toml(part, tables):
    import tomli_w

    geometry = {
        "device": "ImportedActuator",
        "file": part.file,
        "cavities": list(part.cavities),
        "support": part.support,
    }
    return tomli_w.dumps({"name": "pair", "geometry": {**geometry, "cell_size": "6 mm"}, "load": tables})


@pytest.mark.parametrize(("table", "values"), [
    ({"pressure": "0:12:6 kPa"}, [0, 6e3, 12e3]), ({"pressure": "4, 3, 2 kPa"}, [4e3, 3e3, 2e3]),
    ({"pressure": "10:-10:10 kPa"}, [10e3, 0, -10e3]), ({"pressure_cm": "40, 0"}, [40 * CM, 0]),
    ({"pressure_cm": "0:20:10"}, [0, 10 * CM, 20 * CM]), ({"volume_ml": "2:1"}, [2e-6, 1e-6]),
])  # fmt: skip
def test_series_as_texts(table, values):
    steps = steps_of(cavity1=table, cavity2={"volume_ml": 0})
    assert [step.prescribed[0].values[0] for step in steps] == pytest.approx(values, rel=1e-4)


def test_case_file_keeps_the_program(part):
    from softmodels.case.case import Case

    case = Case.from_toml(_toml(part, {"cavity1": {"pressure_cm": "0,20,40"}, "cavity2": {"volume_ml": 0}}))
    wanted = {"cavity1": {"pressure_cm": [0, 20, 40]}, "cavity2": {"volume_ml": [0, 0, 0]}}
    assert case.program and case.steps == steps_of(**wanted)
    assert case.values == (0.0, 1.0, 2.0) and Case.from_toml(case.to_toml()) == case
