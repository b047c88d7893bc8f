"""What the C compiler is asked for when it compiles equations.

Products with the tangent, its assembly and the forces are two fifths of a solid's path. On a slab of 88,570 unknowns the
instructions of this processor and sums in any order take a product from 42 to 29 ms and an assembly from 620 to 445 ms.
"""

from __future__ import annotations

import platform
import zlib
from pathlib import Path

PLAIN = ["-O2", "-g0"]
"""As Python's modules are compiled, but not for debuggers, which takes longer than all else."""
ARITHMETIC = ["-fno-math-errno", "-fno-trapping-math", "-fno-signed-zeros", "-fassociative-math"]
"""Sums in any order. What is no number or infinite stays so: Newton's method is held against it."""
PROCESSOR = Path("/proc/cpuinfo")
"""What Linux knows of the processors, one after the other; the first one's part is read."""
FEATURES = (b"flags", b"Features")
"""The line there that lists its instructions, on x86 and on ARM."""
READ = 1 << 14


def compiler_flags(processor: Path = PROCESSOR) -> list[str]:
    """Words for GCC or Clang.

    Modules for one processor may not run on another, and a home folder may be shared by several machines. DOLFINx names a
    module after what the compiler was asked for, so that a word that differs with the instructions keeps them apart.

    Args:
        processor: A file like Linux' ``/proc/cpuinfo``; where there is none, the code is for any processor of the kind.
    """
    instructions = _instructions(processor)
    if not instructions or platform.machine() not in ("x86_64", "aarch64"):
        return [*PLAIN, *ARITHMETIC]
    return [*PLAIN, *ARITHMETIC, "-march=native", f"-DPROCESSOR=0x{zlib.crc32(instructions):08x}"]


def _instructions(processor: Path) -> bytes:
    """The line of a processor's instructions; empty if it is not known."""
    try:
        with processor.open("rb") as file:
            start = file.read(READ)
    except OSError:
        return b""
    return next((line for line in start.splitlines() if line.startswith(FEATURES)), b"")
