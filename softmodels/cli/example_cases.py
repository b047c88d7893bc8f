"""Case files of ``softmodels examples``, one of each kind; each runs in seconds."""

from __future__ import annotations

_DISK = """[geometry]
device = "HollowDisk"
section = "axisymmetric"
"""
_THIN = f"""{_DISK}variant = "shadow"
"""
_YEOH = """
[material]
law = "yeoh"
c1 = "10 kPa"
c2 = "20 Pa"
c3 = "3 Pa"
poisson = 0.495
"""

CASES = {
    "disk.toml": f"""# the disk of the photographs; its material is to be fitted
name = "disk"

{_DISK}
[load]
pressure_cm = "0:177"
""",
    "volume.toml": f"""# past the limit point, under volume control
name = "volume"

{_THIN}
[load]
volume_ml = "0:60:10"
""",
    "syringe.toml": f"""# driven by a syringe on a T-junction with 5 ml of tubes
name = "syringe"

{_THIN}
[load]
stroke_ml = "0:20"

[supply]
kind = "syringe"
dead_volume = "5 ml"
""",
    "cycle.toml": f"""# loading and unloading under pressure control: the disk snaps through and back
name = "cycle"

{_THIN}{_YEOH}
[load]
pressure_cm = [0, 20, 36]
load_unload = true
""",
    "creep.toml": f"""# silicone with a memory: raised, held for a minute and let down, three times
name = "creep"

{_THIN}{_YEOH}
[material.memory]
branches = [[0.1, "1 s"], [0.1, "10 s"], [0.1, "100 s"]]   # share of the modulus, relaxation time
softening = [1.6, "2 kPa", 0.1]                             # Mullins: r, m, beta

[load]
pressure_cm = "0:20"
rate = "2 cm/s"
hold = "60 s"
cycles = 3
""",
    "contact.toml": f"""# below a rigid plate 1 mm above the disk
name = "contact"

{_DISK}support = "base"

[load]
pressure_cm = "0:177"

[contact]
faces = "top"
plane = "z = 17 mm"
""",
    "ball.toml": f"""# pressed against a rigid ball half a millimetre above the disk
name = "ball"

{_DISK}
[load]
pressure_cm = "0:120"

[contact.ball]
shape = "sphere"
faces = "top"
at = ["0 mm", "0 mm", "26.5 mm"]
radius = "10 mm"
""",
    "sheet.toml": """# the seminar actuator, coarse, with a thin sheet on its underside
name = "sheet"

[geometry]
device = "SeminarActuator"
around = 6
cell_size = "8 mm"

[material]
silicone = "ecoflex-00-30"

[load]
pressure_cm = "0:40"

[sheet]
face = "bottom"
stiffness = "100 N/m"
""",
    "balloon.toml": """# a balloon with a neck, past its limit point
name = "balloon"

[geometry]
device = "Balloon"

[load]
volume_ml = "0:40:10"
""",
    "mypart.toml": """# a finger from a STEP file; its only closed inner shell is the cavity; it bends upwards
name = "mypart"

[geometry]
device = "ImportedActuator"
file = "mypart.step"
support = "x = 0 mm"
gauge_point = "at 80, 6, -6 mm" # a corner of its tip, whose rise along z is reported
cell_size = "4 mm"
curvature = 6

[angles]
bend = "face x = 80 mm"         # mean rotation of the face of its tip

[material]
silicone = "ecoflex-00-30"

[load]
pressure_cm = "0:65"
""",
    "program.toml": """# a part with two cavities, a load series for each: one inflated, the other filled with water and closed
name = "program"

[geometry]
device = "ImportedActuator"
file = "twopart.step"
cavities = ["at 11, 0, 2 mm", "at 11, 0, -2 mm"]
support = "x = 0 mm"
cell_size = "3 mm"

[material]
silicone = "ecoflex-00-30"

[load]
cavity1.pressure_cm = [10, 20, 20]
cavity2.volume_ml = [0, 0, 0.02]
""",
}
"""File texts by file name."""

PROBLEMS = {
    "problems/higher.toml": """# softmodels design: distribute the silicone of a membrane so that its top rises highest
name = "higher"

[case.geometry]
device = "HollowDisk"
section = "axisymmetric"
profile = [1.0, 1.0, 1.0, 1.0]

[case.material]
law = "neo-hookean"
shear_modulus = "30 kPa"

[case.load]
pressure_cm = "0:177"

[parameters]                            # each entry of the profile: thickness relative to the mean, from the middle outwards
profile = { from = 0.6, to = 1.7 }

[maximise]
quantity = "height"                     # of the top under pressure; "rise" is its displacement
of = "apex"
at = "177 cm"

[[keep]]
quantity = "mass"
at_most = "20.5 g"

[[keep]]
quantity = "limit_margin"               # limit pressure over the highest pressure of the problem
at_least = 1.25

[tolerances]                            # one standard deviation; all limits then hold with 95 % probability
base = "0.1 mm"
""",
}
"""Design problems by file name."""


# ----------------------------------------------------------------------------------------------------------------------
# Case files of ``softmodels examples`` for bench experiments, one of each kind.


_MATERIAL = """
[material]                      # or file = "results/fit/fitted.toml", of softmodels fit; --band takes its errors along
silicone = "dragon-skin-10-medium"
"""

_PLATE = """
[rigid.plate]
face = "plate"
mass = "20 g"

[gravity]
direction = "-z"
"""

BENCH = {
    "lifted.toml": f"""# a clamped membrane lifts a rigid plate of 20 g that is bonded to it
name = "lifted"

[geometry]
device = "Membrane"
radius = "20 mm"
thickness = "1 mm"
clamp_width = "5 mm"
plate_radius = "8 mm"
{_PLATE}
[material]                      # or file = "results/fit/fitted.toml", of softmodels fit; --band takes its errors along
silicone = "ecoflex-00-30"

[load]
volume_ml = "0:30:5"            # counted from the flat membrane; passes limit points, where pressure = "0:2 kPa" would end
""",
    "height.toml": f"""# the same plate held 8 mm high: blocked force on a load cell over the pressure, down to zero force
name = "height"

[geometry]
device = "Membrane"
clamp_width = "5 mm"
plate_radius = "8 mm"
{_PLATE}
[force.cell]
face = "plate"
direction = "z"
{_MATERIAL}
[load]
gravity = [0, 1, 1]             # its travel first, from the flat membrane on, then the weight, then the pressure
force.cell.travel_mm = [8, 8, 8]
cavity1.pressure_cm = [0, 0, 60]
""",
    "finger.toml": f"""# a short finger on a stiffer base with paper in it, under its weight; coarse
name = "finger"

[geometry]
device = "PneuNet"
chambers = 2
base = "3 mm"
paper = "0.2 mm"
cell_size = "5 mm"

[gravity]
direction = "-z"                # z: upside down; -x: it stands on its root; y needs part = "full"
{_MATERIAL}
[region.base]
silicone = "dragon-skin-30"

[region.paper]
law = "neo-hookean"
young = "1 GPa"
poisson = 0.3

[load]
pressure = "0:4 kPa"
""",
    "rod.toml": f"""# a spheroid on a neck, with a rod of the same silicone from the neck to the far pole
name = "rod"

[geometry]
device = "Balloon"
radius = "12 mm"
polar_radius = "20 mm"
wall = "1.5 mm"
rod_radius = "1.5 mm"
{_MATERIAL}
[load]
volume_ml = "0:20:5"
""",
    "sagging.toml": f"""# a strip clamped at one end, under its own weight
name = "sagging"

[geometry]
device = "Beam"
length = "80 mm"
width = "20 mm"
thickness = "5 mm"
cell_size = "5 mm"

[gravity]
direction = "-z"
{_MATERIAL}
[load]
share = "0:1"
""",
    "muscle.toml": f"""# a McKibben muscle that hangs by its fitting and lifts 200 g
name = "muscle"

[geometry]
device = "Cylinder"

[fibres.braid]
on = "outer"
angle = "30 deg"                # from the axis
stiffness = "10 kN/m"
slack = true

[gravity]
direction = "z"                 # the fitting is at z = 0, the load pulls away from it

[mass.load]
face = "end"
amount = "200 g"
{_MATERIAL}
[load]
pressure = "0:40 kPa"
""",
    "bent.toml": f"""# a short finger wound with thread, with a sheet along one side: it bends towards the sheet
name = "bent"

[geometry]
device = "Cylinder"
section = "half"
strip = "120 deg"
length = "20 mm"
cell_size = "3 mm"

[fibres.thread]
on = "outer, strip"
angle = "80 deg"
stiffness = "1 kN/m"

[sheet]
face = "strip"
stiffness = "2 kN/m"
{_MATERIAL}
[load]
pressure = "0:10 kPa"
""",
    "cell.toml": f"""# a bellows presses on a load cell 3 mm above it, which gives way by 1 mm at 5 N
name = "cell"

[geometry]
device = "Bellows"
{_MATERIAL}
[contact.cell]
shape = "sphere"
faces = "tip"
at = ["0 mm", "0 mm", "85 mm"]  # its lowest point 3 mm above the plate's top, at 32 mm
radius = "50 mm"
guide = "z"
spring = "5 N/mm"

[load]
pressure = "0:5 kPa"
""",
}
"""File texts by file name."""
