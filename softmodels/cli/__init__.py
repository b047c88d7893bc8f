"""The commands: options read, runs started, one sentence and an exit status.

- `options`: options shared by all devices, the choice of ranks, and how a command begins and ends.
- `app_command`: the bench on a page. `run_command`: the options of a run. `run`: what it prints, and the process that draws.
- `analyses`: limit pressure and natural frequencies. `grasp_command`: an object between fingers. `fit_command`: fits.
  `design`: the search for a device. `study_command`: samples of a case.
- `material_commands`: a material's curves and scores. `silicone_command`: named silicones.
- `results`: opening and comparing results. `exports`: moulds, and cases for other programs. `doctor`: the installation.
- `examples`: small files to try everything with, and the demonstration of the whole workflow.
"""
