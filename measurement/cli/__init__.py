"""The commands of ``python -m measurement``.

- `setup`: the commands ``calibrate`` and ``setup``. `photos`: the commands ``photos`` and ``demo``.
- `shared`: exit statuses, texts of options as numbers, the progress bar.
"""
