"""From what a device should do to its shape.

Begin with `problem` (what is asked) and `optimise` (the call).

- `loads`: states at which a design is judged. `quantities`: what it is judged by, one idea a file.
- `formulation`, `search`, `trials`: the problem in numbers of size one, the search, its trials.
- `model`, `body`, `states`, `gradients`: the device as the optimiser sees it: meshed, solved, differentiated.
- `result`, `folder`: what was found, and where it is kept.
"""
