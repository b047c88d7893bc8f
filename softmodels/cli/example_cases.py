"""The case files of ``softmodels examples``, one of each kind; each runs in seconds."""

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
    "disk.toml": f"""# the disk of the photographs; what it is made of is for the fit to find
name = "disk"

{_DISK}
[load]
pressure_cm = "0:177"
""",
    "volume.toml": f"""# past the limit point, by the cavity's volume
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
    "cycle.toml": f"""# a pressure raised and lowered again: the disk jumps out and back
name = "cycle"

{_THIN}{_YEOH}
[load]
pressure_cm = [0, 20, 36]
cycle = true
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
    "ball.toml": f"""# pressed on a rigid ball that stands half a millimetre above the disk
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
    "balloon.toml": """# a balloon on its neck, past its limit point
name = "balloon"

[geometry]
device = "Balloon"

[load]
volume_ml = "0:40:10"
""",
    "mypart.toml": """# a finger from a STEP file; its only closed inner shell is the cavity, and it bends up
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
    "program.toml": """# a part with two cavities, a series for each: one inflated, the other filled with water and shut
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
"""Text by name of the file."""

PROBLEMS = {
    "problems/higher.toml": """# softmodels design: where to put the silicone of a membrane so that its top is highest
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

[parameters]                            # each entry of the profile: thickness over the mean one, from the middle outwards
profile = { from = 0.6, to = 1.7 }

[maximise]
quantity = "height"                     # of the top under pressure; "rise" is how far it moves, and begins lower
of = "apex"
at = "177 cm"

[[keep]]
quantity = "mass"
at_most = "20.5 g"

[[keep]]
quantity = "limit_margin"               # limit pressure over the highest pressure asked at
at_least = 1.25

[tolerances]                            # one standard deviation; with it all limits hold with 95 %
base = "0.1 mm"
""",
}
"""Design problems, likewise."""
