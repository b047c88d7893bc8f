"""Following a device along its load path.

Begin with `continuation`: `trace` yields one `Point` after another, limit points and bifurcations among them.

- `points`: points, ends, and the quantities a path is asked for. `stability`: eigenvalues and modes.
- `branching`: the branch that leaves a bifurcation. `supply`: syringes and gas. `air_flow`: tubes, valves and leaks.
- `program`, `schedule`: load programs, preload, loading and unloading with snap-through. `time_steps`: silicone that creeps.
"""
