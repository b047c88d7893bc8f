"""The commands: options read, runs started, one sentence and an exit status.

- `options`: options shared by all devices, and the choice of ranks. `run`, `run_command`: running a case. `drawing`: the
  process that draws.
- `limit_command`, `modes_command`, `fit_command`, `score_command`, `curve_command`, `silicone_command`, `design`, `mould`,
  `export`, `demo`, `doctor`: one file for each command; `tensile_options`: options of those that read curves.
- `examples`, `example_cases`: small files to try everything with.
"""
