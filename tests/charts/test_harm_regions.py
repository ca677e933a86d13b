"""The metres of changed regions, which the instance view lists for heat of kind harm."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from scipy import ndimage

import s2rstore
from s2rstore.metrics.heatmap_scores import trust_line
from s2rtui.analysis.connected_regions import connected_regions, place_in_image
from s2rtui.charts.instance.model import _harm_note
from s2rtui.session.state import HeatChoice


@given(arrays(np.bool_, array_shapes(min_dims=2, max_dims=2, max_side=12), elements=st.booleans()))
def test_regions_are_those_of_scipy(mask: np.ndarray) -> None:
    labels, count = ndimage.label(mask, structure=np.ones((3, 3)))
    expected = {(labels == number).tobytes() for number in range(1, count + 1)}
    assert {region.tobytes() for region in connected_regions(mask)} == expected


@pytest.mark.parametrize(
    ("rows", "columns", "place"),
    [(slice(0, 3), slice(0, 3), "top left"), (slice(4, 8), slice(9, 12), "right"),
     (slice(4, 8), slice(4, 8), "middle"), (slice(10, 12), slice(5, 7), "bottom")],
)  # fmt: skip
def test_places_are_named_by_thirds(rows: slice, columns: slice, place: str) -> None:
    region = np.zeros((12, 12), dtype=np.bool_)
    region[rows, columns] = True
    assert place_in_image(region) == place


def test_the_metres_of_each_place_are_listed_largest_first() -> None:
    heat = np.zeros((12, 12), dtype=np.float32)
    heat[0:2, 0:2] = 0.42 / 4
    heat[9:12, 9:12] = -0.9 / 9
    ((name, text),) = _harm_note(HeatChoice("harm", "position"), heat)
    assert name == "harm"
    assert text == "changes cost -0.48 m: -0.90 m bottom right, +0.42 m top left"
    for corner in (0, 5, 11):
        heat[5, corner] += 0.1
    assert _harm_note(HeatChoice("harm", "position"), heat)[0][1].endswith(", 1 more")


def test_fine_heat_is_summed_and_other_kinds_have_no_metres() -> None:
    heat = np.array([[0.5, -0.2], [0.1, np.nan]], dtype=np.float32)
    text = "changes cost +0.40 m"
    assert _harm_note(HeatChoice("harm_fine", None), heat) == [("harm", text)]
    assert _harm_note(HeatChoice("harm", "position"), np.zeros((4, 4))) == [
        ("harm", "no changed part")
    ]
    assert _harm_note(HeatChoice("occlusion", "rgb"), heat) == []
    assert _harm_note(HeatChoice("harm", "position"), None) == []
    assert _harm_note(None, heat) == []


@pytest.mark.parametrize("mode", ["heading", "loss"])
def test_heat_in_radians_and_loss_has_no_metres(mode: str) -> None:
    assert _harm_note(HeatChoice("harm", mode), np.ones((12, 12), dtype=np.float32)) == []


def test_only_heat_in_metres_is_said_to_sum_to_metres(tiny_store: Path) -> None:
    with s2rstore.open(tiny_store) as store:
        for mode, expected in (
            ("position", True),
            (None, True),
            ("heading", False),
            ("loss", False),
        ):
            line = trust_line(store, "vanilla", "harm", mode)
            assert line.startswith("what each changed segment costs")
            assert ("sums to metres" in line) == expected
