"""A case: everything that decides the numbers of a run, as a value and as a TOML file.

Begin with `case`. A field of `Case` names its entry in `entries`, from which come table, option and message.

- `case`: the case, from a file, from options, and from the arguments of a call; the numbers that designs vary.
- `entries`: fields as text; named points and angles.
- `load`: load steps from files, options and calls. `materials`: materials as text, their errors, regions; tables of what is
  added; the user's own Python files.
- `tolerances`: how well lengths as made and readings at the bench are known.
- `abaqus`: the case of a deck of Abaqus or CalculiX.
"""
