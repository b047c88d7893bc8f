"""Pictures, films and pages.

Begin with `draw`, which draws a folder of results; `draw_design` draws a design.

- `solid`, `section`, `curves`, `film`: what is drawn of a run. `report`: one page with all of it.
- `offscreen`, `style`: rendering; colours and titles. `fits`, `limits`, `modes`: fits, scatter, natural modes.
  `design_files`: names of files.
"""
