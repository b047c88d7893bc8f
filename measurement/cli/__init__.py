"""The commands of ``python -m measurement``.

- `calibrate`, `setup`, `photos`, `demo`: one file for each command.
- `shared`: exit statuses, texts of options as numbers, the progress bar.
"""
