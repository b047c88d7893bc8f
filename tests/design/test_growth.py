"""Networks that grow: what a thin channel more does, against exact slopes; the stages of a search; bad input."""

import csv
import dataclasses
import io
import types

import numpy as np
import pytest

from geometries import ChannelPlate, GeometryError
from softmodels.design import grow, optimise
from softmodels.design.model import DesignModel
from softmodels.design.problem import DesignProblem
from softmodels.design.trials import DesignError
from tests.support.campaigns import sampled

PLATE = """
name = "strip"

[case]
name = "strip"

[case.geometry]
device = "ChannelPlate"
outline = "rectangle 20 x 12 mm"
channels = ["4, -3.5 to 4, 3.5 mm radius 1.2 mm"]
thickness = "5 mm"
around = 8
cell_size = "1.6 mm"
symmetry = "none"

[case.material]
law = "neo-hookean"
shear_modulus = "20 kPa"

[case.load]
pressure = "0:4 kPa"

[parameters]
start_radii = { from = "0.6 mm", to = "1.3 mm" }

[maximise]
quantity = "rise"
at = "4 kPa"

[grow]
candidates = "3 x 2"
radius = "0.8 mm"
most_channels = 2
"""


def problem(**changes):
    """The problem with other lines by their first words."""
    lines = [next((text for key, text in changes.items() if line.startswith(f"{key} =")), line) for line in PLATE.splitlines()]
    return DesignProblem.from_toml("\n".join(lines))


def test_the_energy_of_a_channel_is_that_of_a_bore_in_a_large_block():
    """By its own pressure the section grows as that of a thick tube; a small stress opens it as a hole in a linear solid."""
    along, C = np.array([[0.6, 0.8, 0.0]]), np.eye(3)[None]
    pressure, step = 0.4, 1e-20
    rate = grow.channel_energy((pressure + 1j * step) * C, C.astype(complex), along).imag / step
    L = 1.0 - rate[0]
    assert 0.5 * (np.log(L) + 1.0 - 1.0 / L) == pytest.approx(pressure, rel=1e-9)
    stretched = np.einsum("i,j->ij", (0.8, -0.6, 0.0), (0.8, -0.6, 0.0))[None]  # across: plane strain, (3 s1^2) / 8 in all
    s = 1e-4
    held = grow.channel_energy(s * (stretched + 0.5 * np.einsum("mi,mj->mij", along, along)), C, along)[0]
    assert held == pytest.approx(-0.375 * s**2, rel=1e-3)


def test_the_energy_does_not_change_where_all_turns():
    rng = np.random.default_rng(2)
    A, F = rng.normal(size=(3, 3)), np.eye(3) + 0.2 * rng.normal(size=(3, 3))
    Q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    Q *= np.linalg.det(Q)
    A, C, along = 0.3 * (A + A.T), F.T @ F, np.array([0.0, 0.0, 1.0])
    turned = np.array([Q @ A @ Q.T]), np.array([Q @ C @ Q.T]), (Q @ (1.0, 0.0, 0.0))[None]
    assert along @ turned[2][0] != 0.0
    assert grow.channel_energy(*turned)[0] == pytest.approx(grow.channel_energy(A[None], C[None], np.array([[1.0, 0, 0]]))[0])


LINES = {"10, -3 to 10, 3": 0.10, "9, -3 to 14, 3": 0.15}
"""Thin channels, and how far their gain may be from the exact slope of one with a radius of 0.4 mm, whose ends count too."""


@pytest.mark.parametrize("line", sampled(list(LINES)))
def test_the_gain_of_a_thin_channel_is_its_exact_slope(comm, line):
    """At a fifth of the shear modulus; the exact slope is by the radius of a channel that is there."""
    base = problem()
    first, last = np.array([[float(x) for x in place.split(",")] for place in line.split("to")]) * 1e-3
    shares = (np.arange(40) + 0.5)[:, None] / 40
    points = np.concatenate([first + shares * (last - first), np.full((40, 1), -0.5e-3)], axis=1)[None]
    silicone, cavity = np.ones((1, 40), dtype=bool), np.zeros(1, dtype=np.int64)
    ((gain, _),) = grow.ThinChannels(base, base.case, comm).gains(points, silicone, cavity, 1.0)
    plate = base.case.actuator
    both = plate.replaced(channels=(*plate.channels, f"{line} mm radius 0.4 mm in thin"))
    case = dataclasses.replace(base.case, actuator=both)
    model = DesignModel(case, ("start_radii[2]", "end_radii[2]"), [base.terms[0].quantity], comm)
    (slopes,) = model.evaluate(model.start).gradients.values()
    model.release()
    assert gain == pytest.approx(slopes.sum() / (2.0 * 0.4e-3), rel=LINES[line])


def test_the_gain_of_a_pose_is_that_of_its_place(comm):
    """A target above: what raises the face brings it nearer, by as much in tolerances; and so do two pressures in the mean."""
    coarse = problem(around="around = 6", cell_size='cell_size = "3 mm"')
    place = {"quantity": "face_place", "of": "top", "at": "4 kPa"}
    pose = {"quantity": "pose", "of": "top", "position": {"z": "5 mm"}, "tolerance": "0.5 mm", "at": "4 kPa"}
    flat = {"quantity": "surface", "height": "5 mm", "at": "4 kPa"}  # all of it is far below
    made = {}
    for name, goal in (
        ("surface", {"maximise": None, "follow": flat}),
        ("place", {"maximise": place}),
        ("mean", {"maximise": {**place, "at": ["2 kPa", "4 kPa"], "weights": [0, 1]}}),
        ("pose", {"maximise": None, "follow": pose}),
    ):
        asked = dataclasses.replace(coarse, **goal)
        made[name] = np.array([each.gain for each in grow.candidates(asked, asked.case, asked.growth, comm)])
    assert np.ptp(made["place"]) > 0.0
    assert made["mean"] == pytest.approx(made["place"], rel=1e-6)
    assert made["pose"] == pytest.approx(made["place"] / 0.5e-3, rel=1e-6)
    assert made["surface"] == pytest.approx(made["place"], rel=0.05, abs=0.02 * np.abs(made["place"]).max())


def ends(*places):
    return frozenset((round(1e6 * x), round(1e6 * y)) for x, y in places)


def test_half_a_plate_predicts_what_the_whole_does(comm):
    whole, half = problem(), problem(symmetry='symmetry = "auto"', start_radii='thickness = { from = "4.5 mm", to = "5.5 mm" }')
    assert half.case.actuator.copies == 2
    across = grow.candidates(half, half.case, half.growth, comm)
    same = {ends(each.start, each.end): each.gain for each in grow.candidates(whole, whole.case, whole.growth, comm)}
    assert {len(each.channels) for each in across} == {1, 2} and len(across) < len(same)
    best = max(same.values())
    for each in across:
        mirror = ends(*((x, -y) for x, y in (each.start, each.end)))
        expected = sum(same[line] for line in {ends(each.start, each.end), mirror})
        assert each.gain == pytest.approx(expected, rel=0.1, abs=0.05 * best)


def test_a_strip_grows_by_the_best_channel_and_is_resumed(tmp_path, comm):
    coarse = problem(around="around = 6", cell_size='cell_size = "3 mm"')
    how = {"evaluations": 2, "folder": tmp_path / "grown"}
    result = optimise.optimise(coarse, **how)
    assert len(result.device.drawn.channels) == 2 and len(result.variants) == 3
    assert {"1-channel", "2-channels", "2-channels-try-2", "more-than-1.csv", "more-than-2.svg", "design.toml"} <= {
        each.name for each in (tmp_path / "grown").iterdir()
    }
    reached = [float(sentence.split(" mm,")[0].rsplit(" ", 1)[1]) for sentence in result.variants]
    assert reached == sorted(reached)  # with a second channel, then with another one in place of the first
    rows = list(csv.DictReader(io.StringIO((tmp_path / "grown/more-than-1.csv").read_text())))
    gained = [float(row["predicted gain (mm)"]) for row in rows]
    assert gained == sorted(gained, reverse=True)
    rises = [
        list(csv.reader(io.StringIO((tmp_path / f"grown/{n}/iterates.csv").read_text()))) for n in ("1-channel", "2-channels")
    ]
    column = next(k for k, head in enumerate(rises[0][0]) if head.startswith("rise"))
    alone = float(rises[0][-1][column])
    column = next(k for k, head in enumerate(rises[1][0]) if head.startswith("rise"))
    assert float(rises[1][1][column]) - alone == pytest.approx(gained[0], rel=0.4)  # with 0.8 mm it is no longer thin
    told = []
    again = optimise.optimise(coarse, **how, resume=True, progress=told.append)
    assert again.end.objective == pytest.approx(result.end.objective, rel=1e-9)
    assert not [text for text in told if text.startswith("design ")]


LIMITED = """
[[keep]]
quantity = "limit_margin"
at_least = 1.1
[[keep]]
quantity = "peak_stretch"
at = "4 kPa"
at_most = 1.3
"""


def test_what_a_channel_is_worth_is_what_it_takes_away(comm):
    """Of a channel that may go, and of what limits lose by it, against solves without it: a first-order prediction."""
    text = PLATE.replace('radius 1.2 mm"]', 'radius 1.2 mm", "4, 1 to 12, 1 mm radius 0.6 mm offset -0.8 mm"]')
    text = text.replace("most_channels = 2", "most_channels = 3").replace("around = 8", "around = 6")
    text = text.replace('start_radii = { from = "0.6 mm", to = "1.3 mm" }', 'thickness = ["5 mm", "6 mm"]')
    asked = DesignProblem.from_toml(text.replace('"1.6 mm"', '"3 mm"') + LIMITED)
    limits = [(keep.quantity, weight) for keep, weight in zip(asked.limits, (-1.0, 10.0), strict=True)]
    thin = grow.ThinChannels(asked, asked.case, comm, limits)
    plates = {(): asked.case.actuator, (2,): asked.case.actuator.without_channels([2])}
    assert set(thin.without) == {(1,), (2,)}
    worth = []
    for plate in plates.values():
        model = DesignModel(dataclasses.replace(asked.case, actuator=plate), (), asked.quantities, comm, highest=asked.highest)
        values = model.evaluate(np.zeros(0)).values
        model.release()
        worth.append([values[asked.terms[0].quantity.key], sum(w * values[quantity.key] for quantity, w in limits)])
    assert thin.without[2,] == pytest.approx(np.diff(worth, axis=0)[0], rel=0.35)


def test_a_plate_without_channels_keeps_the_nodes_and_cavities_of_the_others():
    lines = ("5, 0 to 35, 0 mm", "10, 0 to 10, 5 mm", "10, 5 to 20, 5 mm", "20, -5 to 30, -5 mm in b")
    plate = ChannelPlate(channels=lines)
    assert grow.removable(plate) == [(1,), (3,)]  # without 2 the third is alone, without 4 its cavity gone
    moved = plate.replaced(node_x=tuple(x + 1e-4 for x in plate.entries("node_x")), start_radii=(1.1e-3, 1.2e-3, 1.0e-3, 9e-4))
    less = moved.without_channels([3])
    for old, new in zip([moved.drawn.channels[k] for k in (0, 1, 3)], less.drawn.channels, strict=True):
        assert np.array_equal(old.points, new.points) and old.radii == new.radii and old.cavity == new.cavity
    with pytest.raises(GeometryError, match="fall apart"):
        plate.without_channels([2])
    with pytest.raises(GeometryError, match="only written channels can be removed, numbers 4 to 4"):
        ChannelPlate(network="parallel:2", channels=("10, -4 to 30, -4 mm",)).without_channels([1])


def test_channels_are_tried_at_the_heights_that_have_one(comm):
    low, high = (f"4, -3.5 to 4, 3.5 mm radius 0.6 mm offset {z} mm in {name}" for z, name in ((-1, "low"), (1, "high")))
    some = {"channels": f'channels = ["{low}", "{high}"]', "start_radii": 'thickness = ["5 mm", "6 mm"]'}
    coarse = problem(around="around = 6", cell_size='cell_size = "3 mm"', most_channels="most_channels = 3", **some)
    grows = {**coarse.grow, "radius": "0.6 mm", "heights": ["-1 mm", "1 mm"]}
    two = dataclasses.replace(coarse, grow=grows)
    table = [each for each in grow.candidates(two, two.case, two.growth, comm) if each.channels]
    assert {(each.offset, each.cavity) for each in table} == {(-1e-3, "low"), (1e-3, "high")}
    assert max(each.gain for each in table if each.offset > 0.0) < 0.05 * table[0].gain  # below the middle it bends upwards
    assert " offset -1 mm" in table[0].channels[0] and "mm at -1 mm is predicted" in table[0].sentence(two)
    with pytest.raises(DesignError, match=r"no channel lies at the height 0\.3 mm that others could join"):
        dataclasses.replace(coarse, grow={**grows, "heights": ["0.3 mm"]})


def test_a_channel_that_cannot_be_searched_is_skipped_by_name(comm):
    """A bound of a parameter at which the plate with it is invalid, as the parts of a joint part there."""
    base, told, holds = problem(), [], types.SimpleNamespace(holders=())
    ended = [types.SimpleNamespace(result=types.SimpleNamespace(case=base.case, holding=holds))]
    line = "4, 0 to 16, 0 mm radius 1.4 mm"  # valid as it is, and above the bounds
    table = [grow.Candidate((4e-3, 0.0), (16e-3, 0.0), "", (line,), 1e-4)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(grow, "make_map", lambda *_: table)
        stages = grow.stages(base, ended, None, comm, False, told.append)
        next(stages)
        assert list(stages) == []
    assert "but is not tried: start_radii[2] starts at 1.4 mm, outside 0.6 mm to 1.3 mm" in told[0]
    assert told[-1] == "no channel more or less gains; the network stays at 1 channel"


def test_the_map_alone_is_written_and_told_in_sentences(tmp_path, comm):
    asked = problem(around="around = 6", cell_size='cell_size = "3 mm"')
    folder = optimise.open_folder(asked, tmp_path / "map", comm, {})
    told = grow.map_alone(asked, folder, comm)
    folder.leave()
    assert told[0].startswith("a channel from (") and "is predicted to improve rise at 4 kPa by 0.0" in told[0]
    assert "is predicted to worsen rise at 4 kPa by" in told[-1]
    drawing = (tmp_path / "map/map.svg").read_text()
    assert drawing.count("<polyline") == 1 and drawing.count("<line") > len(told)
    with pytest.raises(DesignError, match=r"add \[grow\] with candidates, radius, most_channels, heights to the problem"):
        grow.map_alone(dataclasses.replace(asked, grow=None), None, comm)


def test_gains_beyond_first_order_are_doubted():
    asked = problem(around="around = 6", cell_size='cell_size = "3 mm"')
    plate = asked.case.actuator
    small, large = (grow.Candidate((0.0, 0.0), (0.01, 0.0), "", ("",), gain) for gain in (1e-4, 1.1 * plate.thickness))
    assert grow.doubts(asked, plate, [small]) == [] and grow.doubts(asked, plate, []) == []
    (told,) = grow.doubts(asked, plate, [large, small])
    assert "beyond first order" in told and "at a lower pressure" in told


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"most_channels": "most_channels = 1"}, "the plate has 1 already, so give a whole number from 2"),
        ({"candidates": 'candidates = "many"'}, "write the places along x and y"),
        ({"radius": 'radius = "3 mm"'}, "below half the thickness"),
        ({"radius": 'radius = "0.5 mm"'}, "outside the bounds of start_radii.1., 0.6 mm to 1.3 mm; give grow a radius"),
        ({"radius": "most = 3"}, "unknown entry 'most'"),
        ({"quantity": 'quantity = "added_volume"'}, "grow needs an objective that is a motion at a pressure"),
    ],
)
def test_bad_input_is_rejected_in_a_sentence(changes, message):
    with pytest.raises(DesignError, match=message):
        problem(**changes)


def test_only_plates_with_channels_grow():
    text = PLATE.replace('device = "ChannelPlate"', 'device = "HollowDisk"')
    text = "\n".join(
        line for line in text.splitlines() if not line.startswith(("outline", "channels", "thickness", "around", "symm"))
    ).replace("start_radii", "membrane").replace('"0.6 mm", to = "1.3 mm"', '"5 mm", to = "8 mm"')  # fmt: skip
    with pytest.raises(DesignError, match="grow adds channels to a ChannelPlate, and the device is a HollowDisk"):
        DesignProblem.from_toml(text)


def test_a_plate_with_more_channels_keeps_the_nodes_that_have_moved():
    plate = ChannelPlate(network="parallel:2")
    moved = plate.replaced(node_x=tuple(x + 1e-4 for x in plate.entries("node_x")), start_radii=(1.1e-3, 1.2e-3, 1.0e-3))
    more = moved.with_channels(["10, -4 to 30, -4 mm radius 0.6 mm"])
    assert len(more.drawn.channels) == 4 and more.start_radii == (1.1e-3, 1.2e-3, 1.0e-3, 0.6e-3)
    for old, new in zip(moved.drawn.channels, more.drawn.channels, strict=False):
        assert np.array_equal(old.points, new.points) and old.radii == new.radii
