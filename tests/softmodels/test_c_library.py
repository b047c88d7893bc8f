"""The C code that multiplies with second derivatives, compiled on first use."""

from __future__ import annotations

import pytest

from softmodels.mechanics import compiling as c_library
from softmodels.mechanics.compiling import CompilingError, compiling


@pytest.fixture
def empty(tmp_path, monkeypatch):
    """An empty cache."""
    monkeypatch.setattr(c_library, "cache", lambda: tmp_path / "cache")
    return tmp_path / "cache"


def test_it_is_compiled_once(comm, empty, monkeypatch):
    c = c_library.library(comm, "moduli")
    monkeypatch.setattr("cffi.FFI.cdef", lambda *given, **named: pytest.fail("it was compiled twice"))
    assert c_library.library(comm, "moduli") is c
    values, weights = c.ffi.new("double[]", [3.0] * 8), c.ffi.new("double[]", [0.5] * 8)
    moduli = c.ffi.new("double[]", 8)
    c.lib.moduli_take(8, 1, 1, values, weights, moduli)
    assert list(moduli) == [1.5] * 8
    assert [file.suffix for file in empty.iterdir()] == [".so"]


def test_a_cache_that_cannot_be_used_is_reported(comm, empty):
    empty.write_text("a file where the cache should be")
    with pytest.raises(CompilingError, match="XDG_CACHE_HOME"), compiling():
        c_library.library(comm, "moduli")
