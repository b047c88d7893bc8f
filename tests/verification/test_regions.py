"""Two materials bonded in one body: closed forms, one material cut in two, derivatives, and ranks.

Two layers in plane strain of one Poisson's ratio bend under an even push as a composite beam does, exactly: with
E' = E / (1 - nu^2), the strain along them is e + k (y - y0), y0 the place of the mean of E', and with the push p on the
thickness h at its middle, k = p h (y0 - h/2) / sum of E' I.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.integrate import quad

import softmodels as sm
from softmodels.case.load import steps_of
from softmodels.case.materials import Region
from softmodels.materials.laws import NeoHookean, Yeoh
from softmodels.mechanics.body import Body
from softmodels.mechanics.component import ComponentError
from softmodels.mechanics.controls import pressure_control, volume_control
from softmodels.mechanics.sensitivity import Sensitivity
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from softmodels.runs.fields import Fields
from tests.support import bodies
from tests.support.campaigns import sampled
from tests.support.cavities import PushedBody, TubeBody
from tests.support.closed_forms import work_of_stress

SOFT, HARD = NeoHookean(30e3, 0.5), Yeoh(60e3, 2e3, 100.0, 0.5)
SPHERE = "closed integrals of a sphere of two layers, radii 10, 12 and 15 mm, inner stretch to 1.8"
TUBE = "closed integrals of a tube of two layers, radii 10, 12 and 15 mm, inner stretch to 1.8"
SAME = "one region, cut in two of one material"
BENT = "composite beam in plane strain, moduli 1 to 10, pushed at one end"
RATES = "central differences of a sphere of two layers"
STRETCHES = np.array([1.1, 1.4, 1.8])


@pytest.fixture(scope="module")
def layered():
    """Sphere and tube of two layers: the main one inside, ``shell`` around it."""
    return {"sphere": bodies.LayeredSphere(through=3, along=12), "tube": bodies.LayeredTube(through=3)}


def slope(law, stretch, mode):
    """W' of equibiaxial (3) or planar (2) tension, of a law in I1."""
    if mode == 3:
        I1, by_stretch = 2 * stretch**2 + stretch**-4, 4 * stretch - 4 * stretch**-5
    else:
        I1, by_stretch = stretch**2 + stretch**-2 + 1, 2 * stretch - 2 * stretch**-3
    if isinstance(law, NeoHookean):
        return law.shear_modulus / 2 * by_stretch
    return (law.c1 + 2 * law.c2 * (I1 - 3) + 3 * law.c3 * (I1 - 3) ** 2) * by_stretch


def exact(device, laws, stretch, mode):
    """Pressure of incompressible layers: int W'/(l^m - 1) dl over each of them."""

    def at(radius):
        return (1 + (stretch**mode - 1) * (device.inner / radius) ** mode) ** (1 / mode)

    walls = [at(radius) for radius in (device.inner, device.between, device.outer)]
    return sum(
        quad(lambda x, law=law: slope(law, x, mode) / (x**mode - 1), walls[i + 1], walls[i], epsrel=1e-11)[0]
        for i, law in enumerate(laws)
    )


@pytest.mark.parametrize(("name", "mode", "against"), sampled([("sphere", 3, SPHERE), ("tube", 2, TUBE)]))
def test_two_layers(name, mode, against, layered, body_of, solved, figure):
    device = layered[name]
    body = body_of(device, TubeBody if name == "tube" else Body)
    for laws in ((SOFT, HARD), (HARD, SOFT)):
        equations = Solver(System(body, laws[0], components=[Region(laws[1], name="shell")]))
        rest = equations.system.rest().V
        _, points, end = solved(equations, [(s**mode - 1) * rest for s in STRETCHES], "volume", "volume")
        assert end is None
        found = [point.state.P * equations.system.stress_unit for point in points if point.requested]
        known = [exact(device, laws, stretch, mode) for stretch in STRETCHES]
        figure(against, "pressure on the section, soft inside and outside", np.array(found) / known - 1, 1e-4)
    assert all(point.signature.negative_eigenvalues == 0 for point in points[:2])
    check_values(equations, points[-1].state, laws, figure, against)


def check_values(equations, state, laws, figure, against):
    """Each region's stress is of its own law: von Mises' of a law in I1 has a closed form in the stretches."""
    fields = Fields(equations)
    values = fields.values(state)
    for region, law in zip(equations.system.potential.regions, laws, strict=True):
        stretches = values.stretches[region.cells]
        J = stretches.prod(axis=-1)
        b = stretches**2 if isinstance(law, NeoHookean) else stretches**2 / J[..., None] ** (2 / 3)
        I1 = b.sum(axis=-1)
        rubber = isinstance(law, NeoHookean)
        twice = law.shear_modulus if rubber else 2 * (law.c1 + 2 * law.c2 * (I1 - 3) + 3 * law.c3 * (I1 - 3) ** 2)
        known = twice / J * np.sqrt(((b - np.roll(b, 1, axis=-1)) ** 2).sum(axis=-1) / 2)
        off = values.von_mises[region.cells] / known - 1
        figure(against, "von Mises stress at the integration points of both layers", off, 1e-9)
    figure(
        against,
        "work of the Cauchy stress on a displacement, over the change of energy",
        work_of_stress(fields, state),
        1e-6,
    )
    assert np.isfinite(values.p).all() and fields.figures(state).stored_energy > 0


def test_one_material_cut_in_two_by_displacements_alone(layered, body_of, solved, figure):
    law, body = NeoHookean(30e3, 0.45), body_of(layered["sphere"])
    states = []
    for components in ([], [Region(law, name="shell")]):
        equations = Solver(System(body, law, "displacement", components=components))
        states.append(solved(equations, [0.3])[1][-1].state)
    whole, cut = states
    figure(SAME, "volume, displacements alone", cut.V / whole.V - 1, 1e-9)
    figure(SAME, "displacements, displacements alone", cut.w - whole.w, 1e-9)


@pytest.mark.quick
def test_patch(body_of, figure):
    """A block pressed from all sides is strained evenly: p is one, though it might jump across the slanted cut."""
    law, body = NeoHookean(30e3, 0.45), body_of(bodies.CutBlock(cells=3))
    found = []
    for components in ([], [Region(law, name="lid")], [Region(NeoHookean(3e8, 0.45), name="lid")]):
        equations = Solver(System(body, law, components=components))
        state = equations.solve(pressure_control(0.5), equations.system.rest().w, 0.0)
        found.append((state.V, Fields(equations).nodal(state)))
    (whole, fields), (cut, same), (stiff, _) = found
    figure(SAME, "volume of an evenly pressed block", cut / whole - 1, 1e-9)
    for name in ("displacement", "p", "J"):
        scale = np.abs(fields[name]).max()
        figure(SAME, f"{name} of an evenly pressed block", (same[name] - fields[name]) / scale, 1e-9)
    assert abs(stiff) > 1.01 * abs(whole)  # the world outside, counted from the block's own volume


def test_bilayer_bends(body_of, figure):
    plate = bodies.LayeredPlate()
    soft, stiff = NeoHookean(50e3, 0.45), NeoHookean(500e3, 0.45)
    solver = Solver(System(body_of(plate, PushedBody), soft, components=[Region(stiff, name="upper")]))
    solver.factorise(rest := solver.system.rest())
    along = solver.tangent(rest, pressure_control(0.0), 1e-10)
    fields = Fields(solver)
    u = fields.shape(along.w) / (along.P * solver.system.stress_unit)  # m per Pa
    h, moduli = plate.thickness, np.array([2 * law.shear_modulus * 1.45 / (1 - 0.45**2) for law in (soft, stiff)])
    middles = np.array([h / 4, 3 * h / 4])
    centre = moduli @ middles / moduli.sum()
    bending = moduli @ ((h / 2) ** 3 / 12 + h / 2 * (middles - centre) ** 2)
    curvature = h * (centre - h / 2) / bending
    x, y, _ = fields.grid.points.T
    inside = (x < 0.5 * plate.length) & (y < 1e-9)
    deflection = u[inside, 1] - u[np.argmin(x + y), 1]
    known = -curvature * x[inside] ** 2 / 2
    figure(BENT, "deflection up to half the length", (deflection - known) / np.abs(known).max(), 1e-3)


@pytest.mark.parametrize("formulation", sampled(["mixed", "displacement"]))
def test_derivatives(formulation, layered, body_of, solved, figure):
    """By the main material's numbers, in whose moduli all is counted, and by a region's."""
    laws = {"": NeoHookean(30e3, 0.45), "shell": Yeoh(40e3, 2e3, 100.0, 0.45)}
    equations = Solver(
        System(body_of(layered["sphere"]), laws[""], formulation, components=[Region(laws["shell"], name="shell")])
    )
    eq = equations.system
    state = solved(equations, [0.5 * eq.rest().V], "volume", "volume")[1][-1].state
    names = ("shear_modulus", "poisson", "shell.c1", "shell.c2", "shell.poisson")
    _, rates = Sensitivity(equations).rates(state, volume_control(state.V), names)
    for name in names:
        where, _, number = name.rpartition(".")
        step, ends = 1e-4 * getattr(laws[where], number), []
        for sign in (1, -1):
            moved = laws | {where: dataclasses.replace(laws[where], **{number: getattr(laws[where], number) + sign * step})}
            eq.potential.regions[1].material = moved["shell"]
            eq.set_material(moved[""])
            ends.append((found := equations.solve(volume_control(state.V), state.w, state.P)).P * eq.stress_unit)
        eq.potential.regions[1].material = laws["shell"]
        eq.set_material(laws[""])
        apart = (ends[0] - ends[1]) / (2 * step) / rates[name].P - 1
        figure(RATES, "pressure at a given volume, by every number of both laws", apart, 1e-6)
        assert np.abs(found.w).max() > 0


@pytest.mark.campaign
def test_a_stiff_ring_is_a_rigid_one(figure):
    """A ring on a membrane, ten thousand times stiffer, against a rigid one bonded to the same face."""
    law, radii = Yeoh(14e3, 60.0), (0.008, 0.010)
    stiff = Region(NeoHookean(1e4 * law.shear_modulus_0, 0.45), name="ring1")
    soft = sm.inflate(sm.Membrane(rings=radii, ring_thickness=0.001), law, pressures="0,20 cm", components=[stiff])
    rigid = sm.inflate(sm.Membrane(rings=radii), law, pressures="0,20 cm", components=[sm.Rigid("ring1")])
    assert soft.limit is rigid.limit is None
    figure("rigid ring on a membrane at 20 cm", "ring 10,000 times stiffer: apex", soft.apex[-1] / rigid.apex[-1] - 1, 2e-3)
    volumes = soft.added_volume[-1] / rigid.added_volume[-1]
    figure("rigid ring on a membrane at 20 cm", "ring 10,000 times stiffer: added volume", volumes - 1, 2e-3)


def test_a_region_and_its_face_may_bear_one_name(body_of):
    """A plate on a membrane is a region of cells, and the face of them."""
    body = body_of(sm.Membrane(plate_radius=0.008, plate_thickness=0.001, cell_size=0.002))
    cells, faces = body.regions["plate"], body.entities["plate"]
    assert len(cells) > 0 and faces[0] == 1 and len(faces[1]) > 0


def test_what_is_no_region(layered, body_of):
    with pytest.raises(ComponentError, match=r"\[region.core\]: LayeredSphere has no region 'core'; its regions are shell"):
        Region(SOFT, name="core").check_on(layered["sphere"])
    with pytest.raises(ComponentError, match="no cells of this name; it has"):
        System(body_of(layered["sphere"]), SOFT, components=[Region(HARD, name="core")])
    with pytest.raises(ComponentError, match="cover the whole device"):
        System(body_of(layered["sphere"]), SOFT, components=[Region(HARD, name="shell"), Region(HARD, name="solid")])
    with pytest.raises(ComponentError, match="no name"):
        Region(SOFT)
    with pytest.raises(ComponentError, match="check the units"):
        Region(NeoHookean(30.0), name="shell")
    with pytest.raises(ComponentError, match=r"region.shell.*a density of 1.07e\+06 kg/m\^3 is out of range"):
        Region(SOFT, 1.07e6, name="shell")


def test_a_density_comes_back_from_a_case_file():
    components = (Region(HARD, 1250.0, name="cap"), Region(HARD, name="wall"))
    case = sm.Case("tube", sm.Cylinder(), SOFT, steps=steps_of(pressure_cm=(1.0,)), components=components)
    assert sm.Case.from_toml(case.to_toml()) == case and case.to_toml().count("\ndensity = ") == 1
