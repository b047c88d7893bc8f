"""Meshes that are kept: taken for the same device alone, and no failure where they cannot be."""

from __future__ import annotations

import dataclasses
import time

import pytest

from geometries import HollowDisk, meshing

SECTION = HollowDisk(section="axisymmetric", cell_size=0.006, refinement=1.0)


@pytest.fixture
def made(monkeypatch, tmp_path):
    """An empty cache, and what was meshed."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    found, make = [], meshing._make

    def counted(actuator, path):
        found.append(actuator)
        make(actuator, path)

    monkeypatch.setattr(meshing, "_make", counted)
    return found


def test_a_device_is_meshed_once(made, tmp_path):
    first = SECTION.write(tmp_path / "one.msh").read_bytes()
    assert SECTION.write(tmp_path / "two.msh").read_bytes() == first
    assert dataclasses.replace(SECTION).write(tmp_path / "two.msh").read_bytes() == first and made == [SECTION]


@pytest.mark.parametrize("change", [{"cell_size": 0.0061}, {"membrane": 0.0071}, {"support": "base"}])
def test_another_device_is_meshed(change, made, tmp_path):
    other = dataclasses.replace(SECTION, **change)
    SECTION.write(tmp_path / "one.msh")
    other.write(tmp_path / "two.msh")
    assert made == [SECTION, other]


def test_what_another_mesher_made_is_not_taken(made, monkeypatch, tmp_path):
    SECTION.write(tmp_path / "one.msh")
    monkeypatch.setattr(meshing, "_mesher", lambda: "another version")
    SECTION.write(tmp_path / "one.msh")
    assert len(made) == 2


def test_a_class_from_elsewhere_is_not_kept(made, tmp_path):
    @dataclasses.dataclass(frozen=True)
    class Own(HollowDisk):
        pass

    own = Own(section="axisymmetric", cell_size=0.006, refinement=1.0)
    for _ in range(2):
        own.write(tmp_path / "own.msh")
    assert len(made) == 2 and not meshing.folder().exists()


def test_a_kept_mesh_that_ends_early_is_made_anew(made, tmp_path):
    whole = SECTION.write(tmp_path / "one.msh").read_bytes()
    (kept,) = meshing.folder().glob("*.msh")
    kept.write_bytes(whole[:5000])
    assert SECTION.write(tmp_path / "two.msh").read_bytes() == whole == kept.read_bytes() and len(made) == 2


def test_a_cache_that_cannot_be_written_is_no_failure(made, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", "/proc/none")
    for _ in range(2):
        SECTION.write(tmp_path / "one.msh")
    assert len(made) == 2


def test_what_is_unused_for_longest_goes_first(made, monkeypatch, tmp_path):
    others = [dataclasses.replace(SECTION, membrane=0.001 * k) for k in (6, 7, 8)]
    size = others[0].write(tmp_path / "one.msh").stat().st_size
    monkeypatch.setattr(meshing, "MOST_KEPT", int(2.5 * size))
    time.sleep(0.02)
    others[1].write(tmp_path / "one.msh")
    time.sleep(0.02)
    others[0].write(tmp_path / "one.msh")  # used again
    time.sleep(0.02)
    others[2].write(tmp_path / "one.msh")
    made.clear()
    others[0].write(tmp_path / "one.msh")
    assert made == []
    others[1].write(tmp_path / "one.msh")
    assert made == [others[1]]
