"""From a case to a run: solved state by state, kept in memory or in a folder.

Begin with `simulation`, which yields states; `recording` writes them.

- `fields`, `state_values`, `self_contact`, `grid`: fields and figures of a state, and where they live.
- `columns`, `row`: what stands in ``path.csv``. `notes`: warnings and explanations. `outcomes`: exit statuses.
- `store`, `formats`, `stored`, `resume`: the results folder: written, in which formats, read, continued. `progress`: the bar.
- `model`: `sm.Model`: equilibria, paths and modes without files.
- `frequencies`: natural frequencies along a path. `limits`: limit pressure and its scatter.
- `band`: 95 % bands and the sources of a silicone.
"""
