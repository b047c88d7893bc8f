"""Write a deck for CalculiX, which Abaqus also reads except for solver keywords. Lengths in mm, pressures in Pa, forces in uN.

In metres the nodal forces are so small that CalculiX treats a residual as zero. C3D10 has displacements only: compare with
``formulation = "displacement"``.
"""

from __future__ import annotations

import io
from collections.abc import Iterable
from typing import TextIO

import numpy as np
import numpy.typing as npt

from softmodels.case.entries import CaseError
from softmodels.decks.deck import WRITTEN, Deck, DeckSilicone

NO_TERM = 1e10
"""D of a volumetric term without effect: for 0 CalculiX uses its own default."""
PATIENT = "*CONTROLS, PARAMETERS=TIME INCREMENTATION\n30, 40, 9, 60, 10, 4, , 10\n"
CLOSE = "*CONTROLS, PARAMETERS=FIELD\n1e-5, 1e-3, , , 1e-5, 1e-5, 1e-8, 1e-8\n"
"""Tolerances of residual and correction, instead of the default 0.5 % and 1 %."""

NOTHING = 1e-12
"""Fraction of the largest nodal force below which a force is rounding error."""


def calculix(deck: Deck) -> str:
    """Return the deck's text: a step for the dead loads, if there are any, and one for each requested pressure."""
    out = io.StringIO()
    for text in (WRITTEN, *deck.remarks):
        out.write(f"** {text}\n")
    _write_mesh(deck, out)
    for tie in deck.tied:
        terms = [(tie.node, tie.component, -1.0), *((*at, factor) for at, factor in tie.terms.items())]
        entries = [f"{node + 1}, {i + 1}, {factor:.12e}" for node, i, factor in terms]
        lines = [", ".join(entries[at : at + 4]) for at in range(0, len(entries), 4)]
        out.write(f"*EQUATION\n{len(terms)}\n" + "\n".join(lines) + "\n")
    for one in deck.supports.rigged:
        if one.turn is not None:
            name = f"RIGID_{one.name}".upper()
            out.write(_cards(f"*NSET, NSET={name}", one.nodes))
            out.write(f"*RIGID BODY, NSET={name}, REF NODE={one.place + 1}, ROT NODE={one.turn + 1}\n")
    for component, nodes in deck.held.items():
        out.write(_cards(f"*NSET, NSET=HELD{component + 1}", nodes))
    out.write("*BOUNDARY\n")
    for component in deck.held:
        out.write(f"HELD{component + 1}, {component + 1}, {component + 1}\n")
    for silicone in deck.silicones:
        out.write(f"*MATERIAL, NAME={silicone.name.upper()}\n{_law(silicone)}")
        sets = ["SOLID"] if len(deck.silicones) == 1 else [region.upper() for region in silicone.regions]
        out.writelines(f"*SOLID SECTION, ELSET={name}, MATERIAL={silicone.name.upper()}\n" for name in sets)
    _write_springs(deck, out)
    if deck.forces is not None:
        _write_step(out, "*CLOAD\n" + _forces(deck.forces))
    for pressures in deck.pressures:
        loads = [f"{role.upper()}, P, {p:.12e}\n" for role, p in zip(deck.walls, pressures, strict=True)]
        _write_step(out, "*DSLOAD\n" + "".join(loads))
    return out.getvalue()


def _write_step(out: TextIO, load: str) -> None:
    """Write a step that applies a load; loads of earlier steps stay."""
    out.write("*STEP, NLGEOM, INC=400\n*STATIC\n0.1, 1., 1e-4, 0.2\n" + PATIENT + CLOSE)
    out.write(f"{load}*NODE FILE\nU\n")
    out.write("*NODE PRINT, NSET=PROBES, FREQUENCY=10000\nU\n*END STEP\n")


def _forces(forces: npt.NDArray[np.float64]) -> str:
    """Return the lines with the forces on nodes, from N."""
    lines = []
    for node, component in np.argwhere(np.abs(forces) > NOTHING * np.abs(forces).max()):
        lines.append(f"{node + 1}, {component + 1}, {1e6 * forces[node, component]:.12e}\n")
    return "".join(lines)


def _write_mesh(deck: Deck, out: TextIO) -> None:
    mesh = deck.mesh
    out.write("*NODE, NSET=ALL\n")
    for number, (x, y, z) in enumerate(1e3 * deck.points, 1):
        out.write(f"{number}, {x:.12e}, {y:.12e}, {z:.12e}\n")
    for name, cells in mesh.regions.items():
        out.write(f"*ELEMENT, TYPE=C3D10, ELSET={name.upper()}\n")
        for cell in cells:
            out.write(f"{cell + 1}, " + ", ".join(str(node + 1) for node in mesh.cells[cell]) + "\n")
    if list(mesh.regions) != ["solid"]:
        others = [name.upper() for name in mesh.regions if name != "solid"]
        out.write("*ELSET, ELSET=SOLID\n" + "\n".join(others) + "\n")
    for role, faces in mesh.faces.items():
        out.write(f"*SURFACE, NAME={role.upper()}, TYPE=ELEMENT\n")
        out.writelines(f"{cell + 1}, S{side + 1}\n" for cell, side in faces)
    for role, nodes in mesh.nodes.items():
        out.write(_cards(f"*NSET, NSET=ON_{role.upper()}", nodes))
    out.write(_cards("*NSET, NSET=PROBES", deck.watched.values()))


def _write_springs(deck: Deck, out: TextIO) -> None:
    """Write each spring with its own table: elements, and forces in uN over elongations in mm."""
    number = len(deck.mesh.cells)
    for part, (one, first) in enumerate(deck.grounds, 1):
        for begin, end, stretches, forces in one.elements:
            name, number = f"SPRING{part}_{end}", number + 1
            out.write(f"*ELEMENT, TYPE=SPRINGA, ELSET={name}\n{number}, {first + begin + 1}, {first + end + 1}\n")
            # Blank lines are skipped: real numbers distinguish a table from the degrees of freedom of other springs.
            pairs = zip(1e6 * forces, 1e3 * stretches, strict=True)
            table = "".join(f"{force:.8e}, {stretch:.10e}\n" for force, stretch in pairs)
            out.write(f"*SPRING, ELSET={name}, NONLINEAR\n{table}")


def _law(silicone: DeckSilicone) -> str:
    """Return CalculiX's material cards of the silicone, with volumetric energy (1/D) (J - 1)^2."""
    terms, d1 = silicone.invariant_terms, 2 / silicone.bulk
    if stretches := silicone.material.stretch_terms:
        factors = [value for mu, alpha in stretches for value in (mu * alpha / 2, alpha)]
        values = [*factors, d1, *([NO_TERM] * (len(stretches) - 1))]
        return f"*HYPERELASTIC, OGDEN, N={len(stretches)}\n" + _lines(values)
    if set(terms) <= {(1, 0), (0, 1)}:
        return "*HYPERELASTIC, MOONEY-RIVLIN\n" + _lines([terms.get((1, 0), 0.0), terms.get((0, 1), 0.0), d1])
    if set(terms) <= {(1, 0), (2, 0), (3, 0)}:
        return "*HYPERELASTIC, YEOH\n" + _lines([*(terms.get((i, 0), 0.0) for i in (1, 2, 3)), d1, NO_TERM, NO_TERM])
    raise CaseError(f"{silicone.material.name} has terms without a CalculiX law; write a .feb for FEBio")


def _lines(values: list[float]) -> str:
    """At most eight numbers in a line."""
    return "".join(
        ", ".join(f"{value:.12e}" for value in values[at : at + 8]) + "\n" for at in range(0, len(values), 8)
    )


def _cards(keyword: str, nodes: Iterable[int]) -> str:
    """Return a set of nodes that count from 0; a line may hold at most 16."""
    values = [str(int(node) + 1) for node in nodes]
    return f"{keyword}\n" + "".join(", ".join(values[at : at + 12]) + "\n" for at in range(0, len(values), 12))
