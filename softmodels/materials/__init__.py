"""Laws of silicones: energies, test specimens, stability, and the library of named products."""

from softmodels.materials import laws as laws
