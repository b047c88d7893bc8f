"""Entries of a case that fill tables of their own: its name, device, material, programs and gauges."""

from __future__ import annotations

from typing import Any

from geometries import Actuator
from geometries import table as geometry_table
from geometries.kinds import Text
from softmodels.case import gauges as gauge_tables
from softmodels.case import material_table
from softmodels.case.entries import MISSING, Entry, Tables
from softmodels.case.gauges import Gauges
from softmodels.materials.laws import Material
from softmodels.path import schedule as programs
from softmodels.path.schedule import Program


class NameEntry(Entry):
    """The case's name, which stands outside of all tables."""

    def read(self, tables: Tables) -> Any:
        return tables.get("name", MISSING)

    def write(self, value: str, text: Text) -> dict[str, dict[str, Any]]:
        return {}


class DeviceEntry(Entry):
    """The device."""

    tables = ("geometry",)

    def read(self, tables: Tables) -> Actuator:
        return geometry_table.from_table(tables["geometry"])

    def write(self, value: Actuator, text: Text) -> dict[str, dict[str, Any]]:
        return {"geometry": geometry_table.to_table(value, text)}


class MaterialEntry(Entry):
    """The silicone."""

    tables = ("material",)

    def read(self, tables: Tables) -> Any:
        return material_table.from_table(tables["material"]) if "material" in tables else MISSING

    def write(self, value: Material, text: Text) -> dict[str, dict[str, Any]]:
        return {"material": material_table.to_table(value, text)}


class ProgramEntry(Entry):
    """A series for each cavity: tables ``cavity1`` and so on within the load."""

    tables = ("load",)

    def known(self, key: str) -> bool:
        return key.startswith("cavity")

    def read(self, tables: Tables) -> Any:
        series = {key: value for key, value in tables.get("load", {}).items() if self.known(key)}
        return programs.from_tables(series) if series else MISSING

    def write(self, value: Program, text: Text) -> dict[str, dict[str, Any]]:
        return {"load": programs.to_tables(value)} if value else {}


class GaugesEntry(Entry):
    """Named points, angles and the profile's plane."""

    tables = ("points", "angles", "profile")

    def read(self, tables: Tables) -> Gauges:
        return gauge_tables.from_tables(tables)

    def write(self, value: Gauges, text: Text) -> dict[str, dict[str, Any]]:
        return gauge_tables.to_tables(value)
