"""What every room shares: units, errors, schemas, files, folders, commands and processes.

Begin with `units` (text with a unit in, SI out) and `schema` (fields that know their unit, from which come checks, tables of
TOML files and command-line options).

- `units`: quantities read and written. `tables`: TOML files and tables of users, read with limits. `columns`: what the columns
  of such a table hold, and in which unit. `arrays`: types of arrays.
- `schema`: fields, kinds of values, and the codec between dataclasses and tables.
- `names`: arguments checked by name; classes by name, the user's own among them; public names loaded when used.
- `errors`: errors whose message is a sentence, and how options are spelt in it.
- `lazy`: the solver's libraries, imported when they are used.
- `cards`: how results show themselves: a line on a terminal, a card in a notebook.
- `files`: opening, writing beside and renaming. `folders`: results folders: claimed, locked, recorded, cleared, and those of a
  single command. `pages`: reports, and where their numbers come from.
- `commands`: how commands start and end. `processes`: cores, signal handlers, one thread at a time, the terminal.
  Processes that answer calls.
"""
