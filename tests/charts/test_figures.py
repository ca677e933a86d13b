"""Figures have exactly the requested size, deterministic bytes and labelled colour bars."""

from io import BytesIO

import matplotlib
import numpy as np
import pytest
from PIL import Image

from s2rstore.errors import RequestError
from s2rtui.canvas import LIGHT
from s2rtui.charts.map import map_drawing
from s2rtui.charts.suggestions import paper_drawing
from s2rtui.drawing.page import colour_bar_ticks
from s2rtui.drawing.paper import draw_paper
from tests.charts.examples import (
    DRAWINGS,
    errors_drawing,
    map_input,
    orientation_drawing,
    overview_drawing,
    scatter_of,
    umap_drawing,
)
from tests.support.suggestions import suggestions_input

FIGURES = DRAWINGS | {"suggestions": paper_drawing(suggestions_input().directions)}
TEXTS = {"map": ("vanilla", "worst15"), "instance": ("vanilla",), "groups": ("vanilla",)}
"""Title and subtitle of some figures."""
USER = {
    "text.parse_math": True, "font.size": 31.0, "axes.linewidth": 7.0, "lines.linewidth": 9.0,
    "axes.facecolor": "red", "savefig.dpi": 33, "xtick.direction": "in", "image.cmap": "gray",
    "font.family": ["serif"], "legend.fontsize": 25.0, "axes.titlepad": 40.0,
}  # fmt: skip
"""Settings of matplotlib that figures neither use nor change."""


def decode(data: bytes) -> Image.Image:
    return Image.open(BytesIO(data))


def test_empty_selections_and_missing_values_can_be_drawn():
    nobody, no_points = np.zeros(60, dtype=np.bool_), np.full((60, 2), np.nan)
    bare_map = map_input(selected=nobody, cursor=None, heat=None, plan=None, rooms=())
    size = (300, 200)
    for figure in (
        draw_paper(map_drawing(bare_map), size, LIGHT),
        draw_paper(umap_drawing(selected=nobody), size, LIGHT),
        draw_paper(umap_drawing({"sim": no_points, "real": no_points}, 1), size, LIGHT),
        draw_paper(orientation_drawing(selected=nobody, valid=nobody), size, LIGHT),
        draw_paper(errors_drawing(selected=nobody, valid=nobody), size, LIGHT),
    ):
        assert decode(figure).size == size


@pytest.mark.parametrize("name", FIGURES)
def test_figures_have_their_size_no_metadata_and_no_use_of_the_user_s_settings(name):
    def draw(size: tuple[int, int]) -> bytes:
        return draw_paper(FIGURES[name], size, LIGHT, *TEXTS.get(name, ()))

    plain = draw((240, 180))
    with matplotlib.rc_context(USER):
        before = dict(matplotlib.rcParams)
        assert draw((240, 180)) == plain
        assert dict(matplotlib.rcParams) == before
    for size, data in (((240, 180), plain), ((65, 48), draw((65, 48)))):
        image = decode(data)
        assert image.size == size
        assert set(image.info) <= {"dpi"}


def test_an_invalid_size_is_rejected():
    with pytest.raises(RequestError, match="--size"):
        draw_paper(overview_drawing(), (0, 100), LIGHT)


def test_many_points_are_drawn_as_cells(monkeypatch):
    drawings = umap_drawing(cursor=None), scatter_of()
    few = [draw_paper(drawing, (600, 300), LIGHT) for drawing in drawings]
    monkeypatch.setattr("s2rtui.drawing.plane_paper.POINTS_UP_TO", 10)
    for drawing, before in zip(drawings, few, strict=True):
        many = draw_paper(drawing, (600, 300), LIGHT)
        assert before != many
        assert decode(many).size == (600, 300)


@pytest.mark.parametrize(
    "scale", [(0.13, 7.83), (-4.2, 4.2), (0.0, 0.0031), (12345.0, 67890.0), (2.0, 2.002)]
)
@pytest.mark.parametrize("height", [0.1, 0.5, 1.3, 2.1])
def test_a_colour_bar_has_labels_at_both_ends(scale, height):
    places, labels = colour_bar_ticks(scale, height)
    assert (places[0], places[-1]) == scale
    assert places == sorted(set(places))
    assert len(labels) == len(places)
    low, high = (float(labels[end].replace("−", "-")) for end in (0, -1))
    assert (low, high) == pytest.approx(scale, rel=0.006)
    apart = np.diff(places) / (scale[1] - scale[0]) * height
    assert len(places) == 2 or (apart >= 0.15).all()
