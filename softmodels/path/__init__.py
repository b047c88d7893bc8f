"""Following a device along its load path.

Begin with `continuation`: `trace` yields one `Point` after another, limit points and bifurcations among them; `follow` takes
the branch that leaves one.

- `stability`: points, their eigenvalues and modes, ends, and the quantities a path is asked for.
- `supply`: syringes and gas; tubes, valves and leaks in time.
- `steps`, `schedule`: load steps, preload, loading and unloading with snap-through; silicone that
  creeps.
"""
