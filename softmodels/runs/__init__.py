"""From a case to a run: solved state by state, kept in memory or in a folder.

Begin with `simulation`, which yields states; `recording` writes them, and resumes an interrupted run.

- `simulation`: also `sm.Model`: equilibria, paths and modes without files. `analyses`: limit pressures, natural frequencies.
  `grasp`: an object between fingers.
- `fields`: fields and figures of a state. `state_values`: what they are made of, and the grid they live
  on; gaps between walls. `grid`: surfaces and curves of it.
- `table`: a run as arrays in SI by name, and the columns of ``path.csv``. `columns`: how each variable is computed. `budget`:
  95 % intervals and what they are made of. `mesh_error`: the same path with smaller cells. `labels`: a state and its load in
  words. `notes`: warnings and explanations.
- `store`: the results folder, written and read. `formats`: what its files hold. `states`: the states of a run, and values along
  a line through the body, such as the stress through a wall.
- `outcomes`: exit statuses, and the bar while a run works.
"""
