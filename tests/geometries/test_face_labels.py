"""Faces picked by their names and colours, as they stand in STEP files; the files' texts are changed here by hand."""

from __future__ import annotations

import random
import re
from pathlib import Path

import gmsh
import numpy as np
import pytest

from geometries import GeometryError, ImportedActuator
from geometries.meshing import private_model
from tests.support.campaigns import sampled

RED, ORANGE = (1.0, 0.0, 0.0), (1.0, 0.5, 0.0)
CHOICES = {"cavities": ("at 12, 0, 5 mm",), "support": "x = 0 mm", "planes": ("y = 0 mm",), "cell_size": 0.006}


@pytest.fixture(scope="module")
def text(step_file, tmp_path_factory):
    """Half a block of 24 x 12 x 10 mm at y > 0 with a cavity of 12 x 6 x 4 mm, both cut by y = 0, as the text of its file."""

    def draw(occ):
        occ.cut([(3, occ.addBox(0, 0, 0, 24, 12, 10))], [(3, occ.addBox(6, -6, 3, 12, 12, 4))])

    file = step_file(tmp_path_factory.mktemp("plain") / "part.step", draw)
    return Path(file).read_text().replace("\n", "")


def face_at(text, axis, place):
    """Number of the face in a plane, from what its instances say."""
    for face, plane in re.findall(r"#(\d+) = ADVANCED_FACE\('',\([^)]*\),#(\d+),", text):
        frame = re.search(rf"#{plane} = PLANE\('',#(\d+)\)", text)[1]
        origin, normal = re.search(rf"#{frame} = AXIS2_PLACEMENT_3D\('',#(\d+),#(\d+)", text).groups()
        at, along = (
            [float(value) for value in re.search(rf"#{one} = \w+\('',\(([^)]*)\)", text)[1].split(",")]
            for one in (origin, normal)
        )
        if abs(along[axis]) == 1.0 and at[axis] == place:
            return face
    raise AssertionError("no such face")


def named(text, names):
    """The text with names on faces, by axis and place."""
    for (axis, place), name in names.items():
        start = f"#{face_at(text, axis, place)} = ADVANCED_FACE('"
        text = text.replace(f";{start}", f";{start}{name}")
    return text


def coloured(text, colours):
    """The text with colours on faces, by axis and place."""
    added, styles = [], []
    for k, ((axis, place), shades) in enumerate(colours.items()):
        n = 100000 + 10 * k
        added.append(
            f"#{n}=COLOUR_RGB('',{','.join(map(str, shades))});#{n + 1}=FILL_AREA_STYLE_COLOUR('',#{n});"
            f"#{n + 2}=FILL_AREA_STYLE('',(#{n + 1}));#{n + 3}=SURFACE_STYLE_FILL_AREA(#{n + 2});"
            f"#{n + 4}=SURFACE_SIDE_STYLE('',(#{n + 3}));#{n + 5}=SURFACE_STYLE_USAGE(.BOTH.,#{n + 4});"
            f"#{n + 6}=PRESENTATION_STYLE_ASSIGNMENT((#{n + 5}));"
            f"#{n + 7}=STYLED_ITEM('',(#{n + 6}),#{face_at(text, axis, place)});"
        )
        styles.append(f"#{n + 7}")
    context = re.search(r"#(\d+) = \( GEOMETRIC_REPRESENTATION_CONTEXT", text)[1]
    group = f"#99999=MECHANICAL_DESIGN_GEOMETRIC_PRESENTATION_REPRESENTATION('',({','.join(styles)}),#{context});"
    head, _, tail = text.rpartition("ENDSEC;")
    return head + "".join(added) + group + "ENDSEC;" + tail


@pytest.fixture
def part(tmp_path):
    """Return a function that gives the part of a text."""

    def make(text, **changes):
        file = tmp_path / f"part{len(list(tmp_path.iterdir()))}.step"
        file.write_bytes(text if isinstance(text, bytes) else text.encode())
        return ImportedActuator(file=str(file), **{**CHOICES, **changes})

    return make


def roles(part, folder):
    """Corners of each role's box in mm, rounded."""
    mesh = part.write(folder / "part.msh")
    with private_model():
        gmsh.merge(str(mesh))
        groups = gmsh.model.getPhysicalGroups(2)
        places = {gmsh.model.getPhysicalName(*group): gmsh.model.mesh.getNodesForPhysicalGroup(*group)[1] for group in groups}
    return {
        name: np.round([f(at.reshape(-1, 3), axis=0) * 1e3 for f in (np.min, np.max)], 6).tolist()
        for name, at in places.items()
    }


@pytest.mark.campaign
def test_every_role_by_name_or_colour(part, text, tmp_path):
    labelled = coloured(named(text, {(0, 0): "flange", (2, 3): "air", (1, 0): "cut"}), {(2, 10): ORANGE, (2, 0): RED})
    labels = {
        "support": "named flange",
        "cavities": ("named air",),
        "planes": ("named cut",),
        "surfaces": ("pad = coloured #ff8000",),
    }
    by_label = part(labelled, **labels)
    assert by_label.faces == ("pad",) and part(text).faces == ()
    found = roles(by_label, tmp_path)
    assert found == roles(part(text, surfaces=("pad = z = 10 mm",)), tmp_path)
    assert found["support"] == [[0, 0, 0], [0, 12, 10]] and found["pad"] == [[0, 0, 10], [24, 12, 10]]
    assert part(labelled, support="coloured red").reading == part(text, support="z = 0 mm").reading


def test_one_name_on_several_faces(part, text, tmp_path):
    names = {(0, 0): "held", (2, 0): "held"}
    assert roles(part(named(text, names), support="named held"), tmp_path)["support"] == [[0, 0, 0], [24, 12, 10]]


@pytest.mark.parametrize("seed", sampled(range(3)))
def test_the_order_of_faces_in_the_file_does_not_matter(seed, part, text, tmp_path):
    shell, listed = re.search(r"CLOSED_SHELL\('',\(([^)]*)\)\)", text).group(0, 1)
    order = listed.split(",")
    random.Random(seed).shuffle(order)
    shuffled = named(text.replace(shell, f"CLOSED_SHELL('',({','.join(order)}))"), {(0, 24): "end"})
    assert roles(part(shuffled, support="named end"), tmp_path)["support"] == [[24, 0, 0], [24, 12, 10]]


@pytest.mark.parametrize(
    ("written", "name"),
    sampled([
        (b"l''air", "l'air"),
        (b"two words; and more", "two words; and more"),
        (b"back\\\\slash", "back\\slash"),
        ("über".encode(), "über"),
        ("über".encode("latin-1"), "über"),
        ("über".encode().decode("latin-1").encode(), "über"),  # as Open CASCADE writes it
        (rb"\X\FCber", "über"),
        (rb"\S\|ber", "über"),
        (rb"\X2\00FC\X0\ber", "über"),
        (rb"\X4\0001F388\X0\ ", "\N{BALLOON}"),
    ], 3),
)  # fmt: skip
def test_names_as_files_write_them(written, name, part, text):
    data = named(text, {(0, 24): "LABEL"}).encode().replace(b"LABEL", written)
    assert part(data, support=f"named {name}").reading == part(text, support="x = 24 mm").reading


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"support": "named lid"}, "names of faces in the file are air, flange"),
        ({"support": "coloured blue"}, "colours of faces in the file are #ff0000, #ff8000"),
        ({"support": "coloured mauve"}, "#rrggbb or one of black"),
        ({"support": "named air"}, "already belongs to a cut plane or a cavity"),
        ({"cavities": ("named flange",)}, "outside the part"),
        ({"cavities": ("at 12, 0, 5 mm", "named air")}, "already belongs to"),
        (
            {"planes": ("named flange", "y = 0 mm"), "support": "x = 24 mm", "cavities": ("coloured red",)},
            "outside the part",
        ),
        ({"planes": ("named air",)}, "move the part by 0, 0, -3 mm"),
    ],
)
def test_labels_that_do_not_fit_are_refused(changes, words, part, text):
    labelled = coloured(named(text, {(0, 0): "flange", (2, 3): "air"}), {(2, 10): ORANGE, (2, 0): RED})
    with pytest.raises(GeometryError, match=re.escape(words)):
        part(labelled, **changes)


def test_a_file_without_labels_says_so(part, text):
    for choice, words in (("named lid", "no face in the file has a name"), ("coloured red", "has a colour")):
        with pytest.raises(GeometryError, match=words):
            part(text, support=choice)
