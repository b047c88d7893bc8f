"""From a case to a run: solved state by state, kept in memory or in a folder.

Begin with `simulation`, which yields states; `recording` writes them, and resumes an interrupted run.

- `simulation`: also `sm.Model`: equilibria, paths and modes without files. `analyses`: limit pressures, natural frequencies.
  `grasp`: an object between fingers.
- `fields`: fields and figures of a state, and its row. `state_values`: what they are made of, and the grid they live
  on; gaps between walls. `grid`: surfaces and curves of it.
- `columns`: what stands in ``path.csv``, and the 95 % bands there. `notes`: warnings and explanations.
- `store`: the results folder, written and read. `formats`: what its files hold. `states`: the states of a run, and values along
  a line through the body, such as the stress through a wall.
- `outcomes`: exit statuses, and the bar while a run works.
"""
