"""Columns of short runs in which some rank has no cell, facet or edge of a component: it acts on one end of a beam or tube."""

from __future__ import annotations

import itertools
import sys
from pathlib import Path

from tests.support import stl_files

STATES = 3
"""States of each case: the first ones of its path."""
END = "within x > 50 mm"
"""A piece of the beam that one rank of three has, and one of two."""
BEAM = """
material = {law = "neo-hookean", shear_modulus = "30 kPa", poisson = 0.49}
[geometry]
device = "Beam"
cell_size = "5 mm"
"""
TUBE = """
material = {law = "neo-hookean", shear_modulus = "30 kPa", poisson = 0.49}
[geometry]
device = "Cylinder"
length = "40 mm"
cell_size = "4 mm"
"""
CUP = """
material = {law = "neo-hookean", shear_modulus = "200 kPa", poisson = 0.49}
[geometry]
device = "SuctionCup"
"""
BLOCK = """
material = {law = "neo-hookean", shear_modulus = "30 kPa", poisson = 0.49}
[geometry]
device = "ImportedActuator"
file = "block.step"
cavities = ["at 10, 0, 0 mm", "at 50, 0, 0 mm"]
support = "x = 0 mm"
cell_size = "5 mm"
"""
BODIES = """
material = {law = "neo-hookean", shear_modulus = "30 kPa", poisson = 0.45}
[geometry]
device = "ImportedActuator"
file = "bodies.step"
cavities = ["none"]
support = "z = 0 mm"
surfaces = ["lid = z = 12 mm"]
cell_size = "5 mm"
loose = ["solid_2"]
"""
DEVICES = {"cavity": TUBE, "seal": CUP, "two cavities": BLOCK, "bodies": BODIES}
"""By the beginning of a case's name; all others are of a beam."""
MISSING = {"seal": "lip", "two cavities": "cavity2", "bodies": "lid"}
"""Faces that some rank has nothing of, by the same; of a beam it is the end."""
PUSH = """
[force.push]
face = "tip"
direction = "-z"
[load]
force.push.force_N = [0.004]
"""
INFLATED = """
[load]
pressure_cm = [5.0]
"""
STIFF = """
[region.stiff]
within = "x > 50 mm"
law = "neo-hookean"
shear_modulus = "90 kPa"
poisson = 0.49
"""
BALL = """
[contact.ball]
shape = "sphere"
faces = "top"
at = ["55 mm", "0 mm", "7.6 mm"]
radius = "5 mm"
"""
UP, ON_TOP = PUSH.replace('"-z"', '"z"'), PUSH.replace('"tip"', '"top"')
TRIANGLES = BALL.replace('"sphere"', '"stl"').replace('radius = "5 mm"', 'file = "ball.stl"')
GUIDED = 'guide = "z"\nspring = "5 N/m"\n'
CASES = {
    "region": STIFF + PUSH,
    "region, displacements": '[solver]\nformulation = "displacement"\n' + STIFF + PUSH,
    "region, iterative": '[solver]\nmethod = "iterative"\n' + STIFF + PUSH,
    "region with a memory": STIFF + PUSH.replace("[load]", "[load]\ntime_s = [2.0]") + """
[region.stiff.memory]
branches = [[0.2, 1.0]]
""",
    "cavity, region that is rigid": '[rigid.block]\nregion = "cap"\n' + INFLATED,
    "cavity, region that is held": '[hold.grip]\nface = "cap"\nslip = "z"\n' + INFLATED,
    "rigid parts": f"""
[rigid.plate]
face = "top {END}"
mass = "0.2 g"
[gravity]
direction = "-z"
""" + PUSH,
    "guided rigid part": f"""
[rigid.plate]
face = "top {END}"
kind = "guided"
direction = [0, 0, 1]
""" + ON_TOP,
    "held rigid part": '[rigid.plate]\nface = "tip"\nkind = "held"\n' + ON_TOP,
    "clamps": f"""
[hold.grip]
face = "bottom {END}"
along = "z"
[hold.edge]
face = "edge of tip and bottom"
""" + ON_TOP,
    "hinge": """
[hold.pin]
face = "edge of support and bottom"
[hold.roller]
face = "edge of tip and bottom"
along = "z"
""" + ON_TOP,
    "springs": f"""
[spring.foot]
on = "bottom {END}"
stiffness = "2 N/m"
""" + ON_TOP,
    "loads": f"""
[gravity]
direction = "-z"
[mass.lump]
face = "top {END}"
amount = "0.1 g"
[force.edge]
face = "edge of tip and top"
direction = "-z"
amount = "0.5 mN"
[moment.turn]
face = "bottom {END}"
axis = "-y"
amount = "0.01 N*mm"
""" + PUSH,
    "sheet": f'[sheet]\nface = "top {END}"\nstiffness = "50 N/m"\n' + PUSH,
    "fabric": f'[fabric.cloth]\non = "top {END}"\nalong = "100 N/m"\nacross = "50 N/m"\naxis = [1, 0, 0]\n' + PUSH,
    "fibres on a face": f"""
[fibres.thread]
on = "top {END}"
axis = [1, 0, 0]
angle = "0 deg"
helices = 1
stiffness = "100 N/m"
""" + PUSH,
    "cavity, fibres in a region": '[fibres.thread]\non = "cap"\nangle = "0 deg"\nhelices = 1\nmodulus = "50 kPa"\n' + INFLATED,
    "sphere": BALL + UP,
    "sphere with friction": BALL + "friction = 0.4\n" + UP,
    "sphere with a guide": BALL + GUIDED + """
mass = "0.1 g"
[gravity]
direction = "-z"
density = "0 kg/m^3"
""" + UP,
    "triangles": TRIANGLES + UP,
    "triangles with a guide": TRIANGLES + GUIDED + UP,
    "plane": f'[contact]\nfaces = "top {END}"\nplane = "z = 3 mm"\n' + UP,
    "walls": f'[walls]\nfaces = "top {END}, bottom {END}"\n' + PUSH,
    "gauges": """
[points]
corner = "60, 0, 2.5 mm"
[angles]
end = "face x = 60 mm"
""" + PUSH,
    "inertia": STIFF + PUSH.replace("[load]", "[load]\ninertia = true\ntime_s = [0.02]"),
    "cavity, sheet around its end": """
[sheet]
face = "outer within z > 35 mm"
stiffness = "50 N/m"
""" + INFLATED,
    "cavity, walls within it": """
[walls]
faces = "cavity within z > 35 mm, cavity within z < 5 mm"
""" + INFLATED,
    "seal": """
[contact.plane]
shape = "plane"
faces = "lip"
at = ["0 mm", "0 mm", "0 mm"]
along = [0, 0, 1]
seal = true
[force.pull]
face = "top"
direction = "z"
[load]
travel_mm = [0.0, 1.0]
at_pressure_cm = -30
""",
    "two cavities": """
[load]
cavity1.pressure_cm = [0, 5, 5]
cavity2.volume_ml = [0, 0, 0.05]
""",
    "bodies": """
[contact.joint]
between = ["solid_1", "solid_2"]
friction = 0.3
[spring.weak]
on = "solid_2"
stiffness = "0.1 N/m"
[force.push]
face = "lid"
direction = "-z"
[load]
force.push.force_N = [0.2]
""",
    "no such piece": PUSH.replace('"tip"', '"tip within x < 5 mm"'),
}  # fmt: skip
"""Tables beside those of the device."""
UNLIKE = "control", "newton_iterations"
"""Columns of no numbers, or of such as depend on where K was factorised."""


def text_of(name: str, tables: str) -> str:
    """The text of a case; what stands above the first table goes before all tables."""
    above, bracket, rest = tables.lstrip().partition("[")
    device = next((DEVICES[key] for key in DEVICES if name.startswith(key)), BEAM)
    return f"{above}{device}{bracket}{rest}"


def write_block(file: Path) -> None:
    """Write a block of 60 x 10 x 10 mm with a cavity at either end as a STEP file."""
    import gmsh

    from geometries.meshing import private_model

    with private_model():
        occ = gmsh.model.occ
        block = occ.addBox(0, -5, -5, 60, 10, 10)
        occ.cut([(3, block)], [(3, occ.addBox(x, -3, -3, 10, 6, 6)) for x in (5, 45)])
        occ.synchronize()
        gmsh.write(str(file))


def write_bodies(file: Path) -> None:
    """Write a block of 60 x 10 x 8 mm, and one of 8 x 8 x 4 mm that stands on its end, as a STEP file."""
    import gmsh

    from geometries.meshing import private_model

    with private_model():
        for corner, edges in (((0, -5, 0), (60, 10, 8)), ((51, -4, 8), (8, 8, 4))):
            gmsh.model.occ.addBox(*corner, *edges)
        gmsh.model.occ.synchronize()
        gmsh.write(str(file))


def is_missing(comm, body, name) -> bool:
    """Whether some rank has nothing of a case's face, or no cell of the beam's end."""
    from softmodels.mechanics.mpi import any_rank, largest

    if name in MISSING:
        return any_rank(comm, not len(body.entities[MISSING[name]][1]))
    mesh = body.mesh
    cells = mesh.geometry.dofmaps[0][: mesh.topology.index_map(3).size_local]
    along = mesh.geometry.x[cells, 0].mean(axis=1)
    return any_rank(comm, not (along > 5 / 6 * largest(comm, along.max())).any())


def figures(comm, folder: Path, names: str = ";".join(CASES)) -> dict[str, dict[str, list[float]] | str]:
    """The columns of these cases' states, or the sentence with which each ends."""
    from softmodels.case.case import Case
    from softmodels.common.errors import ComponentError
    from softmodels.mechanics.mpi import is_root, on_root
    from softmodels.runs.simulation import Simulation

    on_root(comm, lambda: stl_files.write_stl(folder / "ball.stl", *stl_files.ball(0.005)))
    on_root(comm, lambda: write_block(folder / "block.step"))
    on_root(comm, lambda: write_bodies(folder / "bodies.step"))
    found: dict[str, dict[str, list[float]] | str] = {}
    for name in names.split(";"):
        file = folder / f"{comm.size}.toml"
        on_root(comm, lambda name=name, file=file: file.write_text(text_of(name, CASES[name])))
        if is_root(comm):
            print(name, file=sys.stderr, flush=True)  # which one hangs
        simulation = Simulation(Case.from_file(file), comm)
        try:
            simulation.write_mesh(folder / f"{comm.size}.msh")
            simulation.prepare(folder / f"{comm.size}.msh")
            assert comm.size == 1 or name.startswith("cavity") or is_missing(comm, simulation.body, name), name
            rows = [step.row for step in itertools.islice(simulation.steps(), STATES)]
        except ComponentError as error:
            found[name] = str(error)
            continue
        finally:
            simulation.release()
        found[name] = {column: [row.cell(column) for row in rows] for column in rows[-1].cells if column not in UNLIKE}
    return found
