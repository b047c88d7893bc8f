"""A case from a deck of Abaqus or CalculiX: its mesh as an `ImportedMesh`, its laws, supports, pressures and gravity.

Such decks have no units: lengths are in one unit, stresses in another, and densities and accelerations follow from both with
seconds. What is not read is listed with its line, so that nothing is lost in silence.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from geometries import abaqus, faces, imported, mesh_arrays
from geometries.abaqus import Card, Deck
from softmodels.case import materials
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.common import files, units
from softmodels.common.arrays import Array
from softmodels.common.errors import reason
from softmodels.materials import laws
from softmodels.materials.laws import Material
from softmodels.materials.memory import Branch, Memory, Softening

STRESS_UNITS = {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "psi": 6894.757293168}
"""In Pa."""
USUAL_STRESS = {"mm": "MPa", "cm": "MPa", "m": "Pa", "inch": "psi"}
PROGRAMS = ("abaqus", "calculix")
CALCULIX_POISSON = 0.475
"""Poisson's ratio that CalculiX takes for a law without D; Abaqus takes it as incompressible."""
PLANE_SHARE = 1e-6
"""How far nodes of a symmetry plane may lie off it, over the model's extent."""


@dataclasses.dataclass(frozen=True)
class Imported:
    """What a deck becomes: text of the case file, the case, remarks on how it was read, and what was not read, with lines."""

    text: str
    case: Case
    remarks: tuple[str, ...]
    unread: tuple[str, ...]


def import_model(file: Path, folder: Path, unit: str = "mm", stress: str = "", program: str = "") -> Imported:
    """Return the case of a deck.

    Args:
        file: The deck, ``.inp``.
        folder: Where the case file will be, from which it names the deck.
        unit: Unit of its lengths, one of `geometries.faces.UNITS`.
        stress: Unit of its stresses, one of `STRESS_UNITS`; usual with that unit if empty.
        program: Whose dialect it is, one of `PROGRAMS`; by its keywords if empty.

    Raises:
        CaseError: A law that is not read, or nothing that holds the part or presses on it.
        GeometryError: A mesh or surface that cannot be used.
    """
    if file.suffix.lower() != ".inp":
        raise CaseError(
            f"file {file} is no deck (.inp); other meshes and drawings need no import: softmodels run --device ImportedMesh, "
            "or ImportedActuator for STEP"
        )
    try:
        text = files.read_file(file, files.MAX_GEOMETRY_BYTES).decode("utf-8", errors="replace")
    except OSError as error:
        raise CaseError(f"file {file} cannot be read ({reason(error)})") from None
    return _Model(file, Deck(str(file), text), unit, stress or USUAL_STRESS[unit], program).imported(folder)


class _Model:
    """A deck being read."""

    def __init__(self, file: Path, deck: Deck, unit: str, stress: str, program: str):
        self.file, self.deck, self.unit = file, deck, unit
        self.metre, self.pascal = faces.UNITS[unit], STRESS_UNITS[stress]
        native = any(card.keyword in ("NODE FILE", "EL FILE", "CONTACT FILE") for card in deck.cards) and not deck.instances
        self.program = program or PROGRAMS[native]
        self.remarks = [
            f"read as a deck of {self.program.capitalize().replace('x', 'X')}: lengths in {unit}, stresses in {stress}"
        ]
        self.unread = Counter[str]()
        self.faces: dict[str, str] = {}
        for kind, count in deck.unread_elements.items():
            self.unread[f"{count} elements of type {kind}"] = 1
        self.mesh = imported.mesh_of(str(file), deck.mesh(), self.metre)

    def imported(self, folder: Path) -> Imported:
        """Read everything but the mesh."""
        silicones, densities = self._materials()
        tables: dict[str, dict[str, object]] = {"geometry": self._geometry(folder)}
        tables |= self._sections(silicones, densities)
        tables |= self._supports(tables["geometry"])
        tables |= self._loads(tables["geometry"], densities)
        if self.faces:
            tables["geometry"]["surfaces"] = [f"{name} = named {text}" for name, text in self.faces.items()]
        import tomli_w

        text = tomli_w.dumps({"name": imported.region_name(self.file.stem), **tables})
        for i, card in enumerate(self.deck.cards):
            if card.options.get("OP", "").upper() == "NEW" and card.keyword in [other.keyword for other in self.deck.cards[:i]]:
                self.unread[f"*{card.keyword.capitalize()} (line {card.number}): OP=NEW, that earlier ones end"] += 1
            if card.keyword not in READ:
                self.unread[f"*{card.keyword.capitalize()} (line {card.number})"] += 1
        return Imported(text, Case.from_toml(text, folder), tuple(self.remarks), tuple(self.unread))

    def _geometry(self, folder: Path) -> dict[str, object]:
        place = self.file.resolve()
        place = place.relative_to(folder.resolve()) if place.is_relative_to(folder.resolve()) else place
        return {"device": "ImportedMesh", "file": str(place), "unit": self.unit}

    # ------------------------------------------------------------------------------------------------------------------
    # Laws.

    def _materials(self) -> tuple[dict[str, Material], dict[str, float]]:
        """Return the laws and the densities (kg/m3) by the materials' names in capitals."""
        cards = defaultdict[str, list[Card]](list)
        name, named = "", True
        for card in self.deck.cards:
            if card.keyword == "MATERIAL":
                name, named = card.options["NAME"].upper(), True
            elif card.keyword in OF_MATERIAL and named:
                cards[name].append(card)
            else:
                named = False
        silicones, densities = dict[str, Material](), dict[str, float]()
        for name in {key.upper() for key in self.deck.material_sets}:
            silicones[name] = self._law(name, cards[name])
            for card in cards[name]:
                if card.keyword == "DENSITY":
                    densities[name] = _numbers(card)[0] * self.pascal / self.metre**2
        return silicones, densities

    def _law(self, name: str, cards: Sequence[Card]) -> Material:
        law, softening = None, None
        branches = [branch for card in cards if card.keyword == "VISCOELASTIC" for branch in self._branches(name, card)]
        share = sum(branch.share for branch in branches)
        if not 0.0 <= share < 1.0:
            raise CaseError(
                f"file {self.file}: material {name} loses {share:g} of its modulus by *Viscoelastic; it must be below 1"
            )
        for card in cards:
            where = f"material {name}, *{card.keyword.capitalize()} (line {card.number})"
            # Abaqus' shares are of the instantaneous modulus, ours of that after a long time.
            pascal = self.pascal * (1.0 - share if card.options.get("MODULI", "").upper() == "INSTANTANEOUS" else 1.0)
            if card.keyword == "HYPERELASTIC":
                law = self._hyperelastic(where, card, pascal)
            elif card.keyword == "ELASTIC":
                young, poisson = (*_numbers(card), 0.0)[:2]
                law = laws.NeoHookean.from_young(young * pascal, poisson)
                self.remarks.append(f"{where} is read as neo-Hookean, the same at small strain")
            elif card.keyword == "MULLINS EFFECT":
                r, m, beta = _numbers(card)[:3]
                softening = Softening(r, m * self.pascal, beta)
            elif card.keyword not in ("DENSITY", "VISCOELASTIC"):
                self.unread[f"*{card.keyword.capitalize()} (line {card.number})"] += 1
        if law is None:
            raise CaseError(
                f"file {self.file}: material {name} has no law that is read; give it *Elastic, or *Hyperelastic: {LAWS}"
            )
        if branches:
            self.remarks.append(
                f"material {name}: its branches are neo-Hookean springs here; the other program scales the whole law, which "
                "is the same at moderate strain"
            )
        branches = [dataclasses.replace(branch, share=branch.share / (1.0 - share)) for branch in branches]
        memory = Memory(tuple(branches), softening) if branches or softening else None
        return dataclasses.replace(law, memory=memory)

    def _hyperelastic(self, where: str, card: Card, pascal: float) -> Material:
        """Return the law of a card whose stresses are in a unit (Pa); `CaseError` for one that is not read."""
        kind = ", ".join(key for key in card.options if key not in ("N", "MODULI", "PROPERTIES")).replace("-", " ")
        n, values = int(card.options.get("N", 1)), _numbers(card)
        most = {"NEO HOOKE": 1, "MOONEY RIVLIN": 1, "YEOH": 1, "REDUCED POLYNOMIAL": 3, "OGDEN": 4, "POLYNOMIAL": 2}
        if n > most.get(kind, 0):
            terms = f" with N={n}" if n > 1 else ""
            raise CaseError(f"file {self.file}: {where} is {kind.lower() or 'empty'}{terms}, which is not read; {LAWS} are")
        polynomial = (5, 2) if n == 2 else (2, 1)
        counts = {"MOONEY RIVLIN": (2, 1), "POLYNOMIAL": polynomial, "YEOH": (3, 3), "OGDEN": (2 * n, n)}
        count, compressive = counts.get(kind, (n, n))
        values += [0.0] * (count + compressive - len(values))
        own, compress = values[:count], values[count : count + compressive]
        if any(compress[1:]):
            self.unread[f"{where}: D2 and on, energies of higher powers of J - 1"] = 1
        if kind == "OGDEN":
            mu, alpha = tuple(pascal * value for value in own[::2]), tuple(own[1::2])
            return laws.Ogden.from_two_mu(mu, alpha, self._poisson(sum(mu), compress[0]))
        own = [pascal * value for value in own]
        if kind in ("MOONEY RIVLIN", "POLYNOMIAL"):
            c10, c01, c20, c11, c02 = (*own, 0.0, 0.0, 0.0)[:5]
            poisson = self._poisson(2 * (c10 + c01), compress[0])
            return laws.MooneyRivlin(c10, c01, poisson=poisson) if n == 1 else laws.Polynomial(c10, c01, c20, c11, c02, poisson)
        c1, c2, c3 = (*own, 0.0, 0.0)[:3]
        return laws.Yeoh(c1, c2, c3, poisson=self._poisson(2 * c1, compress[0]))

    def _poisson(self, mu: float, compressibility: float) -> float:
        """Return Poisson's ratio of a shear modulus (Pa) and the D of an energy (J - 1)^2/D in the deck's unit."""
        if not compressibility:
            return 0.5 if self.program == "abaqus" else CALCULIX_POISSON
        bulk = 2.0 * self.pascal / compressibility
        return (3 * bulk - 2 * mu) / (6 * bulk + 2 * mu)

    def _branches(self, name: str, card: Card) -> list[Branch]:
        """Return the branches of a material, with Abaqus' shares."""
        where = f"material {name}, *Viscoelastic (line {card.number})"
        if card.options.get("TIME", "").upper() != "PRONY":
            self.unread[f"{where}: {', '.join(f'{key}={value}' for key, value in card.options.items())}"] = 1
            return []
        branches = []
        for _, words in card.lines:
            shear, bulk, time = (*(_number(word) for word in words), 0.0, 0.0)[:3]
            if bulk:
                self.unread[f"{where}: relaxation of the bulk modulus"] = 1
            if shear:
                branches.append(Branch(shear, time))
        return branches

    def _sections(self, silicones: Mapping[str, Material], densities: Mapping[str, float]) -> dict[str, dict[str, object]]:
        """Return the tables of the material of most cells, and of the others' regions."""
        sets = {key.upper(): imported.region_name(name) for key, name in self.deck.material_sets.items()}
        cells = {imported.region_name(name): len(own) for name, own in self.mesh.regions.items()}
        if not silicones:
            raise CaseError(f"file {self.file} has no *Solid section with a material; it gives elements their law")
        main, *others = sorted(silicones, key=lambda name: -cells[sets[name]])
        if bare := len(self.mesh.cells) - sum(cells[sets[name]] for name in silicones):
            self.remarks.append(f"{bare} cells have no *Solid section; they take the material {main}")
        self.main = main
        tables: dict[str, dict[str, object]] = {"material": materials.to_table(silicones[main])}
        for name in others:
            table = materials.to_table(silicones[name])
            if name in densities:
                table["density"] = units.exact_text(densities[name], "kg/m^3")
            tables.setdefault("region", {})[sets[name]] = table
        return tables

    # ------------------------------------------------------------------------------------------------------------------
    # Supports and loads.

    def _supports(self, geometry: dict[str, object]) -> dict[str, dict[str, object]]:
        """Add the support and the cut planes to the geometry, and return the tables of further clamps."""
        held = defaultdict[str, set[int]](set)
        for card in self.deck.cards:
            for number, (target, *rest) in card.lines if card.keyword == "BOUNDARY" else ():
                if target.upper() in self._cavities():
                    continue
                where = f"*Boundary (line {number}) of {target}"
                free, value = _components(rest)
                if value:
                    self.unread[f"{where}: a prescribed displacement of {value:g}"] = 1
                elif free is None:
                    self.unread[f"{where}: {', '.join(rest)}"] = 1
                else:
                    held[target] |= free
        holds: dict[str, object] = {}
        planes = list[str]()
        for target, components in held.items():
            name = self._face(target)
            if not components:
                continue
            if name is None or not len(triangles := self.mesh.named(name)):
                self.unread[f"*Boundary of {target}: these nodes make up no face of the part"] = 1
            elif len(components) == 3 and "support" not in geometry:
                geometry["support"] = f"named {name}"
            elif len(components) == 1 and self._is_cut(triangles, axis := min(components)):
                planes.append(f"{'xyz'[axis]} = 0 mm")
            else:
                label = self._label(name)
                across = "xyz"[min({0, 1, 2} - components)] if len(components) == 2 else ""
                along = "xyz"[min(components)] if len(components) == 1 else ""
                holds[label] = {"face": label} | ({"along": along} if along else {}) | ({"slip": across} if across else {})
        if planes:
            geometry["planes"] = list(dict.fromkeys(planes))
        if "support" not in geometry and len(planes) < 3:
            raise CaseError(f"file {self.file}: no *Boundary holds a face of the part in all three directions; give one")
        return {"hold": holds} if holds else {}

    def _is_cut(self, triangles: mesh_arrays.Ints, axis: int) -> bool:
        """Return whether faces lie in a symmetry plane through the origin that bounds the part and has no other faces."""
        near = PLANE_SHARE * self.mesh.extent
        flat = np.abs(self.mesh.corners[..., axis]).max(axis=1) < near
        side = self.mesh.points[:, axis]
        return bool(flat[triangles].all() and flat.sum() == len(triangles) and min(side.max(), -side.min()) < near)

    def _face(self, target: str) -> str | None:
        """Return the file's name of a set of nodes or a surface, as the mesh has it."""
        known = {name.upper(): name for name in self.mesh.faces}
        return known.get(target.upper()) or known.get(target.upper().rpartition(".")[2])  # of the only instance

    def _label(self, name: str) -> str:
        """Return the case's name of a face."""
        label = imported.region_name(name)
        label = f"face_{label}" if label in ("support", "outer", "axis", "solid") or label.startswith("cavity") else label
        self.faces[label] = name
        return label

    def _cavities(self) -> dict[str, str]:
        """Return the surfaces of fluid cavities by their reference nodes or sets, in capitals."""
        return {
            card.options["REF NODE"].upper(): card.options["SURFACE"]
            for card in self.deck.cards
            if card.keyword == "FLUID CAVITY" and {"REF NODE", "SURFACE"} <= card.options.keys()
        }

    def _loads(self, geometry: dict[str, object], densities: Mapping[str, float]) -> dict[str, dict[str, object]]:
        """Add the cavities to the geometry, and return the tables of their pressures and of gravity."""
        tables: dict[str, dict[str, object]] = {}
        steps = list[dict[str, float]]()
        for card in self.deck.cards:
            if card.keyword == "STEP":
                steps.append(dict(steps[-1]) if steps else {})
            for surface, pressure in self._pressures(card):
                if not steps:
                    steps.append({})
                steps[-1][surface] = pressure
            for number, words in card.lines if card.keyword == "DLOAD" else ():
                if len(words) > 1 and words[1].upper() == "GRAV":
                    acceleration, *way = (_number(word) for word in words[2:6])
                    tables["gravity"] = {
                        "direction": ", ".join(f"{x:.12g}" for x in way),
                        "magnitude": units.exact_text(acceleration * self.metre, "m/s^2"),
                    }
                    self.remarks.append("gravity acts from the beginning, whatever its step")
                    if self.main in densities:
                        tables["gravity"]["density"] = units.exact_text(densities[self.main], "kg/m^3")
                elif len(words) > 1 and not words[1].upper().startswith("P"):
                    self.unread[f"*Dload (line {number}): {words[1]}"] = 1
        pressed = list(dict.fromkeys(surface for step in steps for surface in step))
        if not pressed:
            raise CaseError(f"file {self.file} has no pressure (*Dsload, *Dload, *Fluid cavity) that could be that of a cavity")
        geometry["cavities"] = [f"named {surface}" for surface in pressed]
        history = np.array([[step.get(surface, 0.0) for surface in pressed] for step in steps]) * self.pascal
        return tables | {"load": self._history(geometry, history)}

    def _history(self, geometry: dict[str, object], history: Array) -> dict[str, object]:
        """Return the table of pressures (steps, cavities) in Pa, and give the geometry their ratios."""
        largest = history[np.abs(history).max(axis=1).argmax()]
        top = float(largest[np.abs(largest).argmax()])
        if not top:
            raise CaseError(f"file {self.file}: its pressures are 0")
        ratios = largest / top
        shares = history @ ratios / (ratios @ ratios)
        if not np.allclose(history, np.outer(shares, ratios), rtol=0, atol=1e-9 * abs(top)):
            return {
                f"cavity{i}": {"pressure": ["0 Pa", *(units.exact_text(value, "Pa") for value in series)]}
                for i, series in enumerate(history.T.tolist(), 1)
            }
        if len(ratios) > 1:
            geometry["pressure_ratios"] = ratios.tolist()
        values = [value for value, _ in itertools.groupby([0.0, *shares.tolist()])][1:]  # a step may change something else
        if len(values) == 1:
            return {"pressure": f"0:{units.exact_text(values[0], 'Pa')}"}  # in as many steps as it takes
        return {"pressure": ["0 Pa", *(units.exact_text(value, "Pa") for value in values)]}

    def _pressures(self, card: Card) -> Iterator[tuple[str, float]]:
        """Yield the surfaces of the mesh and the pressures, in the deck's unit, at the end of its step."""
        for number, words in card.lines:
            if card.keyword == "DSLOAD" and len(words) > 2 and words[1].upper() == "P":
                target, value = words[0], _number(words[2])
            elif card.keyword == "DLOAD" and len(words) > 2 and words[1].upper()[:1] == "P" and words[1][1:].isdigit():
                target, value = abaqus.dload_surface(words[2]), _number(words[2])
            elif card.keyword == "BOUNDARY" and words[0].upper() in self._cavities() and words[1:2] == ["8"]:
                target, value = self._cavities()[words[0].upper()], _number(words[3])
            else:
                if card.keyword == "DSLOAD":
                    self.unread[f"*Dsload (line {number}): {', '.join(words[1:2])}"] = 1
                continue
            surface = self._face(target)
            if surface is None:
                raise CaseError(f"file {self.file}, line {number}: there is no surface {target}")
            yield surface, value * self._amplitude(card)

    def _amplitude(self, card: Card) -> float:
        """Return the last value of a load's amplitude; 1 without one."""
        name = card.options.get("AMPLITUDE", "").upper()
        for other in self.deck.cards:
            if name and other.keyword == "AMPLITUDE" and other.options.get("NAME", "").upper() == name:
                return _numbers(other)[-1]
        return 1.0


LAWS = "neo hooke, mooney-rivlin, yeoh, reduced polynomial up to N=3, polynomial up to N=2, and ogden up to N=4"
OF_MATERIAL = (
    "HYPERELASTIC", "VISCOELASTIC", "ELASTIC", "DENSITY", "MULLINS EFFECT", "DAMPING", "HYPERFOAM", "EXPANSION", "DEPVAR",
    "USER MATERIAL", "PLASTIC", "CREEP", "HYSTERESIS", "CONDUCTIVITY", "SPECIFIC HEAT",
)  # fmt: skip
OUTPUT = (
    "HEADING", "PREPRINT", "RESTART", "OUTPUT", "NODE OUTPUT", "ELEMENT OUTPUT", "ENERGY OUTPUT", "CONTACT OUTPUT", "NODE FILE",
    "EL FILE", "CONTACT FILE", "NODE PRINT", "EL PRINT", "ENERGY PRINT", "MONITOR", "FILE FORMAT", "PRINT", "TIME POINTS",
    "FILE OUTPUT", "END STEP", "END", "CONTROLS", "SECTION CONTROLS", "SYSTEM", "EOF", "PREDEFINED FIELD",
)  # fmt: skip
"""Keywords that do not change the solution, or end what began."""
READ = (
    *OF_MATERIAL, *OUTPUT, "MATERIAL", "BOUNDARY", "DSLOAD", "DLOAD", "STEP", "STATIC", "AMPLITUDE", "TIE", "FLUID CAVITY",
    "FLUID BEHAVIOR",
)  # fmt: skip

SYMMETRIES = {"XSYMM": {0}, "YSYMM": {1}, "ZSYMM": {2}, "ENCASTRE": {0, 1, 2}, "PINNED": {0, 1, 2}}


def _components(words: Sequence[str]) -> tuple[set[int] | None, float]:
    """Return the components, counted from 0, that a line of ``*BOUNDARY`` holds, and to what; None if it is not read."""
    if words and words[0].upper() in SYMMETRIES:
        return SYMMETRIES[words[0].upper()], 0.0
    try:
        first, last, value = (*(float(word) if word else math.nan for word in words), math.nan, math.nan)[:3]
    except ValueError:
        return None, 0.0
    if math.isnan(first):
        return None, 0.0
    last = first if math.isnan(last) else last
    return {i for i in range(3) if first <= i + 1 <= last}, 0.0 if math.isnan(value) else value


def _number(word: str) -> float:
    return float(word.lower().replace("d", "e")) if word else 0.0


def _numbers(card: Card) -> list[float]:
    """Return the numbers on the data lines of a card, of which only the last ones may be left out."""
    return [_number(word) for _, words in card.lines for word in words if word]
