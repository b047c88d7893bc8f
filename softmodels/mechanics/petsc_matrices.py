"""PETSc matrices of compiled bilinear forms.

By the compiled functions that ``dolfinx.fem.petsc`` calls too. That module prepares PETSc's functions for Numba when it is
imported, and reads their declarations with a parser of C, which is a fiftieth of a short command's time.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from dolfinx import fem
    from petsc4py import PETSc


def held_dofs(bcs: Sequence[fem.DirichletBC]) -> npt.NDArray[np.int32]:
    """Owned dofs that conditions hold, local numbers."""
    own = [dofs[:owned] for dofs, owned in (bc.dof_indices() for bc in bcs)]
    return np.concatenate([np.empty(0, dtype=np.int32), *own])


def create_matrix(form: fem.Form) -> PETSc.Mat:
    """An empty matrix with a form's pattern."""
    from dolfinx import cpp

    return cpp.fem.petsc.create_matrix(form._cpp_object, None)  # type: ignore[no-any-return]


def assemble_into(
    matrix: PETSc.Mat, form: fem.Form, bcs: Sequence[fem.DirichletBC] = (), diagonal: float = 1.0
) -> None:
    """Add a form up in a matrix, which is not brought to its end.

    Args:
        matrix: With the form's pattern.
        form: The form; of one space for both its arguments.
        bcs: Rows and columns of their dofs stay empty.
        diagonal: What stands on their diagonal.
    """
    from dolfinx import cpp, fem

    held = [bc._cpp_object for bc in bcs]
    constants, coefficients = fem.pack_constants(form), fem.pack_coefficients(form)
    cpp.fem.petsc.assemble_matrix(matrix, form._cpp_object, constants, coefficients, held)
    matrix.assemble(matrix.AssemblyType.FLUSH)
    put_diagonal(matrix, form.function_spaces[0], bcs, diagonal)


def put_diagonal(
    matrix: PETSc.Mat, space: fem.FunctionSpace, bcs: Sequence[fem.DirichletBC], diagonal: float = 1.0
) -> None:
    """Put a number on the diagonal of held dofs; between what is added up and this, the matrix is flushed."""
    from dolfinx import cpp

    of = getattr(space, "_cpp_object", space)
    cpp.fem.petsc.insert_diagonal(matrix, of, [bc._cpp_object for bc in bcs], diagonal)


def assembled_matrix(form: fem.Form, bcs: Sequence[fem.DirichletBC] = (), diagonal: float = 1.0) -> PETSc.Mat:
    """A form's matrix; see `assemble_into`."""
    matrix = create_matrix(form)
    assemble_into(matrix, form, bcs, diagonal)
    matrix.assemble()
    return matrix


def sparse_matrix(form: fem.Form, bcs: Sequence[fem.DirichletBC] = (), diagonal: float = 1.0) -> PETSc.Mat:
    """A form's matrix with no places for zeros, which would take several times the memory; see `assemble_into`."""
    from petsc4py import PETSc

    dofmap, comm = form.function_spaces[0].dofmap, form.mesh.comm
    numbers, block = dofmap.index_map, dofmap.index_map_bs
    size = (numbers.size_local * block, PETSc.DETERMINE)
    made = PETSc.Mat().createAIJ((size, size), bsize=block, comm=comm)
    places = numbers.local_to_global(np.arange(numbers.size_local + numbers.num_ghosts, dtype=np.int32))
    local = PETSc.LGMap().create(places.astype(np.int32), block, comm)  # type: ignore[arg-type]
    made.setLGMap(local, local)
    made.setOption(PETSc.Mat.Option.IGNORE_ZERO_ENTRIES, True)  # type: ignore[arg-type]
    assemble_into(made, form, bcs, diagonal)
    made.assemble()
    local.destroy()
    return made


def length(x: PETSc.Vec) -> float:
    """Euclidean length of a vector."""
    return float(x.dot(x)) ** 0.5
