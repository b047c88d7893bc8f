"""The Python door: what a notebook calls.

- `calls`: `sm.inflate`, `sm.run`, `sm.load`, `sm.compare`, `sm.limit`, `sm.modes`, `sm.export`. `run`: `Run`, the states as
  arrays in SI units, for pandas and xarray too.
- `views`: pictures of results in a notebook, the device in space, the film.
"""
