"""The rows of a matrix of PETSc that are on this rank, as C code reads them: where they are, and nothing copied."""

from __future__ import annotations

import ctypes
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from petsc4py import PETSc

Ints = npt.NDArray[np.int32]


class MatrixParts:
    """The columns of this rank, and those of others.

    Args:
        matrix: Assembled, with as many columns on each rank as rows.
        c: The C code (`softmodels.mechanics.c_library`).

    Attributes:
        others: Numbers of the columns of others, rising.
    """

    def __init__(self, matrix: PETSc.Mat, c: ModuleType):
        from petsc4py import PETSc

        self._petsc, self._c, self._matrix = ctypes.CDLL(PETSc.__file__), c, matrix
        self.others, handles = np.empty(0, dtype=np.int32), [ctypes.c_void_p(matrix.handle)]
        if matrix.comm.size > 1:
            here, beyond, columns = ctypes.c_void_p(), ctypes.c_void_p(), ctypes.POINTER(ctypes.c_int32)()
            pointers = [ctypes.byref(found) for found in (here, beyond, columns)]
            self._call("MatMPIAIJGetSeqAIJ", handles[0], *pointers)
            handles, count = [here, beyond], ctypes.c_int32()
            self._call("MatGetLocalSize", beyond, None, ctypes.byref(count))
            self.others = np.array(columns[: count.value], dtype=np.int32)
        self._handles = handles

    def read(self, places: tuple[Ints, Ints]) -> object:
        """The rows with their values as they are now, for the C code.

        Args:
            places: What stands for each column of this rank, and for each of `others`; they have to outlive what is returned.
        """
        ffi = self._c.ffi
        parts = ffi.new("part[2]")
        for part, handle, place in zip(parts, self._handles, places, strict=False):
            count, done = ctypes.c_int32(), ctypes.c_int()
            starts, columns, values = (ctypes.c_void_p() for _ in range(3))
            rows = [ctypes.byref(found) for found in (count, starts, columns, done)]
            self._call("MatGetRowIJ", handle, 0, 0, 0, *rows)
            self._call("MatSeqAIJGetArrayRead", handle, ctypes.byref(values))
            part.starts, part.columns = (ffi.cast("int32_t *", found.value or 0) for found in (starts, columns))
            part.values = ffi.cast("double *", values.value or 0)
            part.places = ffi.from_buffer("int32_t[]", place)
        if len(self._handles) == 1:
            self._none = np.zeros(self._matrix.getLocalSize()[0] + 1, dtype=np.int32)
            parts[1].starts = ffi.from_buffer("int32_t[]", self._none)
        return parts

    def _call(self, function: str, *given: object) -> None:
        from petsc4py import PETSc

        error = getattr(self._petsc, function)(*given)
        if error:
            raise PETSc.Error(error)
