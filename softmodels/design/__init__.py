"""From what a device should do to its shape.

Begin with `problem` (what is asked) and `optimise` (the call, the search, and whole numbers one by one).

- `trials`: loads at which a design is judged, and evaluated designs.
- `quantities`: what it is judged by, and the meshed device that this is evaluated on. `extremes`, `targets`: more of them.
- `problem`: also in numbers of size one. `model`: the device as the optimiser sees it, and the folder of its trials.
- `states`: its states and their gradients. `result`: what was found.
- `surfaces`: distance of a face from a target surface.
- `grow`: channels added to a network, each where it promises most.
- `study`: samples of a case instead of a search: a dataset, surrogates, Sobol indices.
"""
