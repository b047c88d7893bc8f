"""Silicones: laws, test specimens, stability, and the library of named products.

Begin with `laws`; a law added with `register_law` stands in one file.

- `laws`: measures of strain for UFL and for numpy, dual numbers; what a law is, and every law.
- `memory`: what a silicone remembers: relaxing branches and softening, as terms of one time step's energy.
- `specimens`: closed forms: tension, shear, balloons, thick walls; where a law stops being a material.
- `silicones`: named products with all their sources, and how they are mixed.
"""

from softmodels.materials import laws as laws
