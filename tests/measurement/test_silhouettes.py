"""Real back-lit drops, measured with a scale alone: widths against those that were published with the photographs."""

from __future__ import annotations

import csv
import dataclasses

import numpy as np
import pytest
from click.testing import CliRunner

from measurement.__main__ import main
from measurement.outline.edge import coarse_contour, refine_edge
from measurement.outline.outline import Outline
from measurement.outline.profiles import Shading, find_shadow
from measurement.pictures import TONES, Unmeasurable, read_pixels
from measurement.screen.setup import Setup
from measurement.series import revolved
from measurement.series.measuring import trace_image
from measurement.series.photo_list import Photograph
from measurement.series.views import Scene

ROI = (147, 10, 677, 480)
"""Beside the drops the photographs show the rim of their vessel."""


@pytest.fixture(scope="module")
def drops(shared_data):
    found = shared_data("silhouettes")
    with (found / "drops.csv").open() as file:
        return [(found / row["sample_name"], row["scale"], float(row["de"])) for row in csv.DictReader(file)]


@pytest.fixture(scope="module")
def setups(drops, tmp_path_factory):
    """A setup for each drop, as a user makes it who knows the scale and nothing else."""
    made = []
    for path, scale, _ in drops:
        output = tmp_path_factory.mktemp("setups") / "setup.toml"
        done = CliRunner().invoke(
            main,
            ["setup", str(path), "--lens", "none", "--scale", f"{scale} px/m", "--roi", ",".join(map(str, ROI)),
             "-o", str(output)],
        )  # fmt: skip
        assert done.exit_code == 0, done.output
        assert "the picture does not verify it" in done.output
        made.append(Setup.from_file(output))
    return made


@pytest.mark.parametrize("tone", TONES)
def test_maximal_width(drops, setups, tone, figure):
    """Better as numbers proportional to light than with sRGB's curve."""
    assert len(drops) == 9
    x0, y0, x1, y1 = ROI
    for (path, _, width), setup in zip(drops, setups, strict=True):
        image = read_pixels(path)
        shadow = find_shadow(TONES[tone][image[y0:y1, x0:x1]], 0.0, None)
        contour = coarse_contour(shadow.mask, shadow.share, 1.0, (x0, y0))
        edge = refine_edge(Shading(image, shadow.colour, light=TONES[tone]), contour, 1.0)
        found = np.ptp(setup.to_metres(edge.px)[:, 0])
        figure("published widths of back-lit drops", f"width, tone {tone}", found / width - 1, 0.005)


def test_outlines_of_drops_about_their_axes(drops, setups, figure):
    """Their authors' widths are whole pixels, 0.34 % of them."""
    for (path, _, width), setup in zip(drops, setups, strict=True):
        scene = Scene(dataclasses.replace(setup, roi=ROI), (0.3, 0.01))
        (outline,) = revolved.outlines([Photograph(path, 0.0, 1.0)], scene).outcomes
        assert isinstance(outline, Outline) and outline.trusted, outline
        assert outline.x[0] > outline.x.min() + 1e-3  # it hangs from a needle
        figure("published widths of back-lit drops", "width of the outline", np.ptp(outline.x) / width - 1, 0.004)


def test_a_blank_screen_is_not_trusted(drops, setups):
    """Light that saturates beside an edge moves it, so that the whole way from photograph to outline refuses them."""
    for (path, _, _), setup in zip(drops, setups, strict=True):
        with pytest.raises(Unmeasurable, match="overexposed"):
            trace_image(read_pixels(path), setup)
