"""Entries of a case that fill tables of their own: its name, device, material, programs and gauges."""

from __future__ import annotations

from geometries import Actuator
from geometries import table as geometry_table
from geometries.kinds import Text
from softmodels.case import gauges as gauge_tables
from softmodels.case import material_table
from softmodels.case.entries import MISSING, Entry, Missing, Tables, Written, table_of
from softmodels.case.gauges import Gauges
from softmodels.materials.laws import Material
from softmodels.path import program as programs
from softmodels.path.program import LOAD_KEYS, Program


class NameEntry(Entry[object]):
    """The case's name, which stands outside of all tables; `Case` checks it."""

    def read(self, tables: Tables) -> object:
        return tables.get("name", MISSING)

    def write(self, value: object, text: Text) -> Written:
        return {}


class DeviceEntry(Entry[Actuator]):
    """The device."""

    tables = ("geometry",)

    def read(self, tables: Tables) -> Actuator:
        return geometry_table.from_table(table_of(tables, "geometry"))

    def write(self, value: Actuator, text: Text) -> Written:
        return {"geometry": geometry_table.to_table(value, text)}


class MaterialEntry(Entry[Material]):
    """The silicone."""

    tables = ("material",)

    def read(self, tables: Tables) -> Material | Missing:
        return material_table.from_table(table_of(tables, "material")) if "material" in tables else MISSING

    def write(self, value: Material, text: Text) -> Written:
        return {"material": material_table.to_table(value, text)}


class ProgramEntry(Entry[Program]):
    """A series for each cavity, and for dead loads: tables ``cavity1``, ``force`` and so on within the load."""

    tables = ("load",)

    def known(self, key: str) -> bool:
        return key.startswith("cavity") or key in LOAD_KEYS

    def read(self, tables: Tables) -> Program | Missing:
        series = {key: value for key, value in table_of(tables, "load").items() if self.known(key)}
        return programs.from_tables(series) if series else MISSING

    def write(self, value: Program, text: Text) -> Written:
        return {"load": programs.to_tables(value)} if value else {}


class GaugesEntry(Entry[Gauges]):
    """Named points, angles and the profile's plane."""

    tables = ("points", "angles", "profile")

    def read(self, tables: Tables) -> Gauges:
        return gauge_tables.from_tables({name: table_of(tables, name) for name in self.tables})

    def write(self, value: Gauges, text: Text) -> Written:
        return gauge_tables.to_tables(value)
