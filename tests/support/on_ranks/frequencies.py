"""Natural frequencies of a wedge and a beam with a plate."""

from __future__ import annotations

import softmodels as sm

WEDGE = sm.HollowDisk(angle=30.0, cell_size=0.006, fillet=0.0015)
BEAM = sm.Beam(length=0.020, width=0.004, thickness=0.004, part="full", cell_size=0.004)
LAW = sm.NeoHookean(30e3, 0.49)


def figures(comm, folder) -> dict[str, list[float]]:
    """Frequencies in Hz by device."""
    wedge, beam = sm.Model(WEDGE, LAW), sm.Model(BEAM, LAW, (sm.Gravity("-z"), sm.Rigid("tip", mass=1e-4)))
    state = wedge.solve(pressure=1e3)
    found = {"wedge": wedge.modes(state), "sealed wedge": wedge.modes(state, sealed=True), "beam": beam.modes()}
    return {name: [mode.frequency for mode in modes] for name, modes in found.items()}
