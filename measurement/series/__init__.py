"""All photographs of a run.

Begin with `measuring`, which measures one photograph, and a list of them.

- `checks`: every check of photographs.
- `drawing`: pictures of photographs and of a run, and its page.
- `markers`: markers on a device in every photograph of a list: which is which, places and turns.
- `photo_list`: ``photos.csv`` and the readings of the water column; the same photograph twice.
- `revolved`: outlines of bodies of revolution seen from the side, which may overhang.
- `space`: the tip in space, from two side views.
- `views`: side views: tip, angle and centre line in every photograph of a list.
- `witness`: each photograph against the others: heights over pressures.
"""
