"""Pictures, films and pages.

Begin with `draw`, which draws a folder of results; `draw_design` draws a design.

- `solid`, `curves`, `film`: what is drawn of a run, solids and half sections. `report`: one page with all of it.
- `offscreen`, `style`: rendering; colours and titles. `fits`: fits. `analyses`: scatter of limits, natural modes.
- `comparison`: results side by side. `study`: samples of a case.
"""
