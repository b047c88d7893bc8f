"""The C code that multiplies with second derivatives, compiled aside of the run that needs it."""

from __future__ import annotations

import pytest

from softmodels.mechanics import c_library
from softmodels.mechanics.compiling import CompilingError, compiling


@pytest.fixture
def empty(comm, tmp_path, monkeypatch):
    """An empty cache, and no process at work."""
    monkeypatch.setattr(c_library, "cache", lambda: tmp_path / "cache")
    monkeypatch.setattr(c_library, "cores", lambda: 2)
    monkeypatch.setattr(c_library, "_aside", {})
    return tmp_path / "cache"


def test_it_is_compiled_aside_and_once(comm, empty, monkeypatch):
    c_library.begin("moduli")
    c_library.begin("moduli")
    assert len(c_library._aside) == 1
    monkeypatch.setattr(c_library, "_compile", lambda *given: pytest.fail("it was compiled twice"))
    c = c_library.library(comm, "moduli")
    assert c_library._aside["moduli"].returncode == 0
    values, weights = c.ffi.new("double[]", [3.0] * 8), c.ffi.new("double[]", [0.5] * 8)
    moduli = c.ffi.new("double[]", 8)
    c.lib.moduli_take(8, 1, 1, values, weights, moduli)
    assert list(moduli) == [1.5] * 8
    assert [file.suffix for file in empty.iterdir()] == [".so"]


def test_on_one_core_the_run_compiles_by_itself(comm, empty, monkeypatch):
    monkeypatch.setattr(c_library, "cores", lambda: 1)
    c_library.begin("moduli")
    assert not c_library._aside
    assert c_library.library(comm, "moduli").lib


def test_what_goes_wrong_aside_is_reported_by_the_run(comm, empty, monkeypatch):
    empty.write_text("a file where the cache should be")
    c_library.begin("moduli")
    with pytest.raises(CompilingError, match="XDG_CACHE_HOME"), compiling():
        c_library.library(comm, "moduli")
    assert c_library._aside["moduli"].returncode != 0
