"""Outlines of a membrane, a balloon and a bellows, from other models than the fitted one, give their modulus back."""

from __future__ import annotations

import functools

import numpy as np
import pytest

import softmodels as sm
from geometries import Balloon, Bellows, Membrane
from measurement.outline.outline import Outline
from softmodels.fitting.outlines.shapes import half_outline, shadow_of
from softmodels.pictures.curves import profile
from softmodels.runs.grid import QuadraticCurve
from tests.support import membrane_shooting as shooting
from tests.support.campaigns import sampled

MODULUS = 20e3
ERROR = 30e-6
"""Standard error of a point in m."""
SPACING = 200e-6
"""Distance of neighbouring points in m."""
BENCH = ("centre", "pressure_offset", "zero")
"""A leak or a unit of length would take up what the models differ by."""
MEMBRANE = Membrane(radius=0.02, thickness=0.3e-3, cell_size=0.002, section="axisymmetric", through=1)
WALL = 0.3e-3
BALLOON = Balloon(radius=0.02 - WALL / 2, wall=WALL, neck_radius=0.0, cell_size=0.004, section="axisymmetric", through=1)
BELLOWS = Bellows(section="axisymmetric", cell_size=0.0015, through=1)


def outline(half, pressure, name):
    """An outline through both sides of the places of one, shape (n, 2) in m from the axis outwards."""
    length = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(half, axis=0), axis=1))]
    wanted = np.arange(0.0, length[-1], SPACING)
    half = np.column_stack([np.interp(wanted, length, column) for column in half.T])
    whole = np.vstack([half[:0:-1] * [-1.0, 1.0], half])
    x, z = whole[np.argsort(whole[:, 0], kind="stable")].T
    return Outline(x, z, np.full(len(x), ERROR), pressure, 5.0, name)


def of_the_membrane():
    """By shooting: the outside lies half the deformed thickness beyond the middle surface; the clamp is not seen."""
    thickness, found = MEMBRANE.thickness, []
    membrane = shooting.CircularMembrane(MEMBRANE.radius, thickness, shooting.Yeoh(MODULUS / 2))
    for state in membrane.path(np.linspace(2e-3, 14e-3, 7))[1::2]:
        along = np.gradient(state.places, axis=0)
        along /= np.linalg.norm(along, axis=1)[:, None]
        beyond = thickness / state.stretches.prod(axis=1)[:, None] / 2 * np.column_stack([-along[:, 1], along[:, 0]])
        outside = state.places + beyond - [0.0, thickness / 2]
        found.append(outline(outside[outside[:, 1] > 5e-4], state.pressure, f"{state.height * 1e3:.0f} mm"))
    return found


def of_the_balloon(below=0.0):
    """An incompressible neo-Hookean sphere in closed form, its lower pole held.

    Args:
        below: How far below the undeformed apex heights are counted from, in m.
    """
    inner, outer = BALLOON.radius, BALLOON.radius + WALL
    found = []
    for stretch in (1.06, 1.12, 1.2, 1.3):
        swollen = ((stretch * inner) ** 3 + outer**3 - inner**3) ** (1 / 3)
        at_outside, at_inside = (2 / k + 1 / (2 * k**4) for k in (swollen / outer, stretch))
        angle = np.linspace(0.0, np.pi / 2, 2000)
        places = swollen * np.column_stack([np.sin(angle), np.cos(angle)]) + [0.0, swollen - 2 * outer + below]
        found.append(outline(places[places[:, 1] > 1e-4], MODULUS * (at_outside - at_inside), f"stretch {stretch}"))
    return found


def of_the_bellows():
    """On a mesh of half the size."""
    fine = Bellows(section="axisymmetric", cell_size=0.0007, through=2)
    run = sm.inflate(fine, sm.NeoHookean(MODULUS), "0,6,12,18 cm")

    def outer_curve(state):
        line = profile(state.points, state.displacement, run.case.actuator)
        return np.stack([line[:-2:2], line[2::2], line[1:-1:2]], axis=1)

    top, found = outer_curve(run[0])[0, 0, 1], []
    for cm in (6, 12, 18):
        curve = QuadraticCurve(outer_curve(run.at(f"{cm} cm")) - [0.0, top])
        found.append(outline(half_outline(shadow_of(curve).curve, 50e-6)[0], cm * run.case.column.pascal, f"{cm} cm"))
    return found


fit = functools.partial(sm.fit, material="neo-hookean")


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("device", "measured", "how", "within"),
    sampled(
        [
            (MEMBRANE, of_the_membrane, {}, 0.004),
            (BALLOON, of_the_balloon, {"height_datum": "apex"}, 2e-5),
            (BELLOWS, of_the_bellows, {"height_datum": "apex"}, 0.02),
        ]
    ),
    ids=["membrane", "balloon", "bellows"],
)
def test_outlines_of_another_model_give_the_modulus_back(device, measured, how, within, figure):
    report = fit(device, measured(), options=sm.FitOptions(profiles=False, free=BENCH, **how))
    assert report.chosen.sound and report.chosen.fit.converged
    assert ("heights count from its apex" in " ".join(report.notes)) == (device is not MEMBRANE)
    off = report.chosen.fit.values["shear_modulus"] / MODULUS - 1
    figure(f"outlines of a {type(device).__name__.lower()} by another model", "the modulus fitted to them", off, within)


def test_a_balloon_s_outlines_state_what_they_count_from():
    """Without a word they are refused; and heights above the table it stands on are no heights above its apex."""
    with pytest.raises(sm.FitError, match=r"mm from flat, and heights of outlines count .* height_datum apex"):
        fit(BALLOON, of_the_balloon())
    options = sm.FitOptions(profiles=False, free=BENCH, height_datum="apex")
    with pytest.raises(sm.FitError, match="outlines belong to another device"):
        fit(BALLOON, of_the_balloon(below=2 * (BALLOON.radius + WALL)), options=options)
