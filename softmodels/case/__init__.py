"""A case: everything that decides the numbers of a run, as a value and as a TOML file.

Begin with `case`. A field of `Case` names its entry in `entries`, from which come table, option and messages.

- `load`: requested pressures, volumes, strokes, loads. `materials`: materials as text, their errors, regions.
- `from_python`: a case from the arguments of a call.
- `components`: tables of what is added. `requests`: named points and angles. `own_modules`: the user's own Python files.
"""
