"""Gradients by a network's nodes, heights, radii and outline: Taylor's remainder on random networks."""

import numpy as np
import pytest

from geometries import ChannelPlate
from softmodels.common.errors import GeometryError
from softmodels.design.quantities import AddedVolume, Mass, Rise, StoredEnergy
from tests.support.campaigns import sampled

TAYLOR = "Taylor's remainder of every quantity by every length, before and past a limit point"
WORKING = 3000.0
QUANTITIES = (Rise(at=WORKING), AddedVolume(at=WORKING), StoredEnergy(at=WORKING), Mass())
NAMES = (
    "node_x[1]", "node_y[2]", "node_offsets[3]", "start_radii[1]", "end_radii[2]", "thickness", "scale_x", "fillet",
    "outline_y[3]",
)  # fmt: skip


STEPS = {"fillet": 0.05}
"""Shares of a length by which it is changed, where a hundredth moves the plate by less than its states are solved to."""


def random_network(seed: int) -> ChannelPlate:
    """Two or three channels from a node, straight or bent, at heights and of radii of their own, in a rectangle or a kite."""
    rng = np.random.default_rng(seed)
    while True:
        (x, y), ends = rng.uniform((8, -2), (20, 2)), rng.uniform((4, -5), (26, 5), (int(rng.integers(2, 4)), 2))
        lines = [f"{x:.3f}, {y:.3f} to {a:.3f}, {b:.3f} mm" for a, b in ends]
        if rng.integers(2):
            middle = 0.5 * (np.array([x, y]) + ends[0]) + rng.uniform(-2, 2, 2)
            lines[0] = f"{x:.3f}, {y:.3f} to {middle[0]:.3f}, {middle[1]:.3f} to {ends[0][0]:.3f}, {ends[0][1]:.3f} mm"
        radii = rng.uniform(0.9, 1.2, (len(lines), 2))
        texts = tuple(f"{line} radius {p:.3f} to {q:.3f} mm" for line, (p, q) in zip(lines, radii, strict=True))
        outline = ("rectangle 30 x 16 mm", "0, -8, 32, -6, 36, 1, 28, 8, 0, 8 mm")[int(rng.integers(2))]
        try:
            plate = ChannelPlate(channels=texts, outline=outline, around=6.0, cell_size=4e-3, fillet=4e-4)
            heights = rng.uniform(-0.8e-3, 0.5e-3, len(plate.nodes.places))
            return plate.replaced(node_offsets=tuple(heights.tolist()))
        except GeometryError:
            continue


@pytest.mark.parametrize("name", sampled(["node_offsets[3]", "node_x[1]", "fillet", "outline_y[3]"]))
def test_a_random_network(designed, second_order, comm, name):
    second_order(designed(random_network(1), NAMES, QUANTITIES, comm), name, TAYLOR, "network", STEPS.get(name, 0.01))


@pytest.mark.campaign
def test_every_length_of_a_random_network(designed, second_order, comm):
    model = designed(random_network(7), NAMES, QUANTITIES, comm)
    for name in NAMES:
        second_order(model, name, TAYLOR, "network", STEPS.get(name, 0.01))


COARSE = {"around": 6.0, "cell_size": 4e-3}
SLICES = {
    "half": ChannelPlate(
        outline="rectangle 30 x 16 mm", channels=("6, 0 to 24, 0 mm radius 1.2 to 1 mm", "12, -5 to 12, 5 mm"), **COARSE
    ),
    "wedge": ChannelPlate(
        outline="circle 24 mm", support="edge", channels=("-8, 0 to 8, 0 mm", "0, -8 to 0, 8 mm"), fillet=4e-4, **COARSE
    ),
}  # fmt: skip
FOLLOWED = {
    "half": ("node_x[2]", "node_offsets[2]", "end_radii[1]", "scale_y", "thickness"),
    "wedge": ("radius", "offset", "thickness", "fillet"),
}


@pytest.mark.parametrize(
    ("slice_name", "name"),
    sampled([(key, name) for key, names in FOLLOWED.items() for name in names], (("half", "node_x[2]"), ("wedge", "radius"))),
)
def test_a_half_and_a_wedge(designed, second_order, comm, slice_name, name):
    """By what keeps their mirrors."""
    device = SLICES[slice_name]
    assert {*FOLLOWED[slice_name]} <= {*device.movable} and device.copies == {"half": 2, "wedge": 8}[slice_name]
    second_order(designed(device, FOLLOWED[slice_name], QUANTITIES, comm), name, TAYLOR, "network", STEPS.get(name, 0.004))
