"""The commands: options read, runs started, one sentence and an exit status.

- `ending`: how a command begins and ends. `options`: options shared by all devices, ``softmodels run``, the choice of ranks.
- `run`: what a run prints, and the process that draws.
- `analyses`: limit pressure, natural frequencies, an object between fingers. `design`: the search for a device, studies.
- `material_commands`: fits, a material's curves and scores, named silicones.
- `results`: opening and comparing results. `exports`: moulds, cases from and for other programs.
- `doctor`: the installation, and the bench on a page.
- `completion`: the words of all commands, for shells.
- `examples`: small files to try everything with, and the demonstration of the whole workflow.
"""
