"""All photographs of a run.

Begin with `measuring`, which measures a list of photographs; `photo` does one of them.

- `photo_list`: ``photos.csv`` and the readings of the water column.
- `witness`: each photograph against the others: heights over pressures.
- `pictures`, `overview`: what is drawn of one photograph, and of the whole run.
"""
