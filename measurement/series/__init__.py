"""All photographs of a run.

Begin with `measuring`, which measures a list of photographs; `photo` does one of them. Both draw what they measure.

- `checks`: every check of photographs.
- `photo_list`: ``photos.csv`` and the readings of the water column; the same photograph twice.
- `witness`: each photograph against the others: heights over pressures.
"""
