"""The open inflation benchmark: devices that other laboratories measured, predicted with nothing fitted to them.

- `devices`: their cases and measured points, from the tables beside it. `__main__`: solves them and writes the page.
- `in_felupe`: the beam by FElupe, on the same mesh.
"""
