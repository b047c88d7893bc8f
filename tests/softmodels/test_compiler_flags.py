"""Words for the C compiler: accepted by the one at hand, and others for other processors."""

from __future__ import annotations

import shlex
import subprocess
import sys
import sysconfig

import cffi
import pytest

from softmodels.mechanics import compiling as asked, compiling as c_library
from softmodels.mechanics.compiling import CompilingError, compiler, compiler_flags, compiler_words, compiling

X86 = "processor\t: 0\nmodel name\t: Some\nflags\t\t: fpu sse2 avx2\nbugs\t: flags\n"
ARM = "processor\t: 0\nBogoMIPS\t: 50\nFeatures\t: fp asimd\n"


def test_other_instructions_are_another_word(tmp_path, monkeypatch):
    words = set()
    for number, text in enumerate((X86, X86.replace(" avx2", " avx2 avx512f"), ARM)):
        monkeypatch.setattr(asked.platform, "machine", lambda: "x86_64")
        file = tmp_path / f"cpuinfo{number}"
        file.write_text(text)
        flags = compiler_flags(file)
        assert "-march=native" in flags and flags == compiler_flags(file)
        words.add(flags[-1])
    assert len(words) == 3 and all(word.startswith("-DPROCESSOR=0x") for word in words)


def test_what_is_beside_the_instructions_does_not_count(tmp_path):
    file, other = tmp_path / "one", tmp_path / "other"
    file.write_text(X86)
    other.write_text(X86.replace("Some", "Another") + X86.replace("avx2", ""))
    assert compiler_flags(file) == compiler_flags(other)


@pytest.mark.parametrize("text", [None, "", "cpu\t: POWER9\n"])
def test_an_unknown_processor_has_code_for_any_of_its_kind(tmp_path, text):
    file = tmp_path / "cpuinfo"
    if text is not None:
        file.write_text(text)
    assert not [word for word in compiler_flags(file) if "march" in word or "PROCESSOR" in word]


def test_the_compiler_takes_them_and_keeps_what_is_no_number(tmp_path):
    source = tmp_path / "nan.c"
    source.write_text(
        "#include <math.h>\n#include <stdio.h>\nint main(int n, char **v) { double x = sqrt(-1.0 * n) + log(0.0 * n);\n"
        'printf("%d %d", isfinite(x), isnan(sqrt(-1.0 * n))); return 0; }\n'
    )
    subprocess.run([*compiler(), *compiler_flags(), source, "-o", tmp_path / "nan", "-lm"], check=True)
    assert subprocess.check_output([tmp_path / "nan"], text=True) == "0 1"


def test_without_a_compiler_that_of_a_package_is_taken(monkeypatch):
    """Only where none is found, and none is asked for."""
    monkeypatch.delenv("CC", raising=False)
    (own,) = compiler()
    assert own == shlex.split(sysconfig.get_config_var("LDSHARED"))[0]
    monkeypatch.setattr(asked.shutil, "which", lambda word: None)
    monkeypatch.setattr(asked.importlib.util, "find_spec", lambda name: name == "ziglang" or None)
    assert compiler() == [sys.executable, "-P", "-m", "ziglang", "cc"]
    assert compiler_words()[:5] == compiler() and "-shared" in compiler_words()
    monkeypatch.setenv("CC", "/no/compiler")
    with pytest.raises(cffi.VerificationError, match="/no/compiler"):
        compiler()
    monkeypatch.delenv("CC")
    monkeypatch.setattr(asked.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(cffi.VerificationError, match=own):
        compiler()


# -- The C code that multiplies with second derivatives, compiled on first use ---------------------------------------


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
