"""All photographs of a run.

Begin with `measuring`, which measures a list of photographs; `photo` does one of them. `checks`: every check of photographs.

- `photo_list`: ``photos.csv`` and the readings of the water column.
- `witness`: each photograph against the others: heights over pressures. `copies`: the same photograph twice.
- `pictures`, `overview`: what is drawn of one photograph, and of the whole run.
"""
