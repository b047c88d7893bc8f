"""The mould of a device: bodies to print or mill, and what the bench needs to cast with them.

Begin with `make`.

- `settings`: what a workshop sets. `bodies`: the parts of the mould in the CAD kernel. `grooves`: for threads around a tube.
- `facets`: their surfaces, measured, and on the printer's plates. `pictures`: views, steps of the work, drawing.
- `files`: STEP, STL, the sheet for the bench, and the call `sm.mould`.
"""
