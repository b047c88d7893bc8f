"""What every room shares: units, errors, schemas, files, folders, commands and processes.

Begin with `units` (text with a unit in, SI out) and `schema` (fields that know their unit, from which come checks, tables of
TOML files and command-line options).

- `units`: quantities read and written. `toml_file`, `tables`: files of users, read with limits.
- `schema`: fields, kinds of values, and the codec between dataclasses and tables. `calls`: arguments checked by name;
  `lazy_names`: public names loaded when used.
- `registry`: classes by name, the user's own among them. `errors`: errors whose message is a sentence, and how options are
  spelt in it. `terminal`: sentences on a terminal.
- `files`: opening, writing beside and renaming. `folders`: results folders: claimed, locked, recorded, cleared; `output`:
  what a single command writes.
- `commands`: how commands start and end. `processes`: cores, signal handlers, one thread at a time.
- `page`: pages made from templates. `arrays`: types of arrays.
"""
