"""The histogram counts what is valid and lights what is selected."""

from __future__ import annotations

import numpy as np

from s2rtui.canvas import DARK, ColourMode, Look
from s2rtui.plots import histogram, histogram_model
from tests.plots.examples import N, histogram_input


def test_counts_are_all_valid_and_the_selected_of_them() -> None:
    valid = np.arange(N) != 0
    model = histogram_model(histogram_input(valid=valid), 12)
    assert model.sim[0].sum() == N - 1
    assert model.real[1].sum() == 9
    assert (model.sim[1] <= model.sim[0]).all()
    assert model.edges[0] == 0


def test_beyond_the_edge_counts_into_the_last_bin_and_nan_nowhere() -> None:
    errors = np.array([0.5, 99.0, np.nan])
    ones = np.ones(3, dtype=np.bool_)
    view = histogram_input(sim=errors, real=errors, selected=ones, valid=ones, upper=1.0)
    assert histogram_model(view, 2).sim[0].tolist() == [0, 2]


def test_selected_bars_have_their_sides_colour_and_the_rest_is_grey() -> None:
    canvas = histogram(histogram_input(), (60, 12))
    inked = canvas.char[:, 9:] != " "
    colours = {tuple(colour) for colour in canvas.fg[:, 9:][inked]}
    assert {DARK.sim, DARK.real, DARK.unselected} <= colours


def test_selected_bars_differ_by_glyph_without_colours() -> None:
    for look, lit in ((Look(mode=ColourMode.NONE), "█"), (Look(ascii=True), "#")):
        assert any(lit in line for line in histogram(histogram_input(), (60, 12), look).lines())
