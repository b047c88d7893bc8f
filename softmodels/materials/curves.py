"""A material's curves in all test specimens, and as a balloon."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from softmodels.materials.material import Material
from softmodels.materials.specimens import MODE_NAMES, Response, respond, strain_of
from softmodels.materials.stability import Verdict, judge

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True, eq=False)
class MaterialCurves:
    """A material's curves.

    Attributes:
        name: As asked for.
        material: The law.
        stretch: Shape (n,).
        responses: By mode.
        verdict: Its stability over the stretches.
    """

    name: str
    material: Material
    stretch: Array
    responses: dict[str, Response]
    verdict: Verdict

    @classmethod
    def of(cls, name: str, material: Material, stretch: Array) -> MaterialCurves:
        responses = {mode: respond(material, stretch, mode) for mode in MODE_NAMES}
        ends = np.array([stretch[0], stretch[-1]])
        return cls(name, material, stretch, responses, judge(material, float(strain_of("uniaxial", ends).max())))

    def true_stress(self, mode: str) -> Array:
        """Force per deformed area in Pa, shape (n,)."""
        response = self.responses[mode]
        across = {"uniaxial": response.side**2, "planar": response.side, "equibiaxial": response.side * self.stretch}
        return response.stress / across[mode]

    def balloon(self, thickness_over_radius: float) -> Array:
        """Pressure in Pa in a thin spherical balloon, shape (n,): P = 2 (t/R) S / stretch^2, S of equibiaxial tension."""
        return 2 * thickness_over_radius * self.responses["equibiaxial"].stress / self.stretch**2
