"""A body, its potential, and the solver of its equilibrium.

One Newton step is read in `potential` (energy, residual, tangent in UFL), `tangent` (its products), `system` (assembled),
`newton` (SNES, bordered equations, acceptance, factorisation) and `solver` (which calls it); `iterative` is multigrid for
large models.

- `body`: mesh and roles, dimensionless, with slip planes; parts of faces, and edges, by short texts.
- `regions`: several materials, rigid parts and their unknowns, and what holds a body. `component`: what can be added to a
  device.
- `controls`: lines in the pressure-volume plane; coupled cavities; loads as drivers.
- `assembly`: matrices, terms that UFL does not have, mass.
- `memory`: what silicone remembers at the integration points, and its energy over one step in time; inertia.
- `sensitivity`: derivatives of states by parameters, and the mesh moved to other lengths of its device.
- `compiling`: the cache of compiled forms and of C code. `mpi`: ranks.
"""
