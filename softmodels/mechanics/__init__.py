"""A body, its potential, and the solver of its equilibrium.

One Newton step is read in `potential` (energy, residual, tangent in UFL), `system` (assembled), `newton` (SNES, bordered
equations, acceptance) and `solver` (which calls it), with the linear solve in `iterative`: a factorisation, or multigrid.

- `body`: mesh and roles, dimensionless, with slip planes. `pieces`: parts of faces, and edges, by short texts.
- `regions`: several materials, and what holds a body. `component`: what can be added to a device.
- `dead_loads`: loads as drivers. `rigid`: unknowns of rigid parts.
- `controls`: lines in the pressure-volume plane; coupled cavities. `assembly`: matrices, terms that UFL does not have.
- `memory`: what silicone remembers at the integration points, and its energy over one step in time. `inertia`: mass and motion.
- `products`: tangent times vector from second derivatives at quadrature points.
- `sensitivity`: derivatives of states by parameters, and the mesh moved to other lengths of its device.
- `compiling`: the cache of compiled forms and of C code. `mpi`: ranks.
"""
