"""Labels of heat name kind, mode and unit; the metres of changed regions are listed."""

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.heatmap_kinds import heatmap_facts
from s2rstore.metrics.heatmap_scores import trust_line
from s2rstore.reader import Store
from s2rstore.records import ArrayRecord
from s2rtools.heatmaps import HEATMAP_KINDS
from s2rtui.canvas import LIGHT
from s2rtui.charts.map import heat_facts, map_drawing
from s2rtui.charts.shared.instance import heat_fields, instance_drawing
from s2rtui.charts.shared.instance_input import _harm_note, place_in_image
from s2rtui.drawing import paper
from s2rtui.drawing.cells import draw_cells
from s2rtui.session.heatmaps import heatmap_choices
from s2rtui.session.session import Session
from s2rtui.session.state import HeatChoice, State
from tests.charts.examples import draw_map, instance_input, map_input
from tests.support import networks

RUN = "vanilla"
UNITS = {"m", "rad", "loss", "standard deviations", "arb. units", ""}


@pytest.fixture(scope="module")
def records() -> list[ArrayRecord]:
    """The arrays of all heatmap kinds of a small model."""
    model = networks.small_model(*networks.local_trunks()["residual"], (36, 36))
    return [
        ArrayRecord(
            RUN, name, output.side, output.mode, f"{name}/{output.side}/{output.mode}", "float16",
            (40, *output.shape), ("iid", *output.axes), 1.0, 0.0, output.unit, "0" * 64,
        )
        for name, kind in HEATMAP_KINDS.items()
        for output in kind.outputs(model)
    ]  # fmt: skip


@pytest.fixture
def store(
    tiny_store: Path, records: list[ArrayRecord], monkeypatch: pytest.MonkeyPatch
) -> Iterator[Store]:
    monkeypatch.setattr(Store, "array_kinds", lambda self, run: records)
    with s2rstore.open(tiny_store) as opened:
        yield opened


@pytest.fixture
def state(tiny_store: Path) -> State:
    return replace(Session(tiny_store).state, overlay="instance")


def drawn_labels(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The labels of the colour bars that a figure draws, without line breaks."""
    labels: list[str] = []

    def record(page, box, bar, label) -> None:
        labels.append(label.replace("\n", " "))

    monkeypatch.setattr(paper, "draw_colour_bar", record)
    return labels


def test_every_label_names_kind_mode_and_unit(store, state, monkeypatch):
    kinds = {kind.replace("_", " ") for kind in HEATMAP_KINDS}
    choices = heatmap_choices(store, RUN)
    assert {kind for kind, _ in choices} == set(HEATMAP_KINDS)
    labels = drawn_labels(monkeypatch)
    for kind, mode in choices:
        heat = HeatChoice(kind, mode, "real")
        name = kind.replace("_", " ")
        label, unit, is_signed = heat_facts(store, replace(state, heat=heat))
        assert unit in UNITS
        assert unit not in kinds
        assert is_signed == heatmap_facts(kind).is_signed
        view = map_input(
            heat=np.ones((4, 4)), heat_is_signed=is_signed, heat_label=label, heat_unit=unit
        )
        paper.draw_paper(map_drawing(view), (800, 600), LIGHT)
        on_map = labels[-1]
        images = instance_drawing(instance_input(**heat_fields(store, RUN, heat)))
        paper.draw_paper(images, (800, 600), LIGHT)
        on_map_terminal = " ".join(draw_map(view, (150, 40)).lines()[-3:])
        on_instance_terminal = " ".join(draw_cells(images, (150, 40)).lines())
        for label in (on_map, labels[-2], on_map_terminal, on_instance_terminal):
            assert name in label
            assert not mode or mode in label
            assert unit in label
            assert not [other for other in kinds - {name} if other in label.replace(name, "")]


def test_modes_of_a_kind_have_units_of_their_own(store):
    units = {
        mode: heat_fields(store, RUN, HeatChoice("pixel_difference", mode))["unit"]
        for mode in ("rgb", "depth")
    }
    assert units == {"rgb": "standard deviations", "depth": "m"}


def test_numbers_of_pixels_have_no_sign(store, state):
    counted = replace(state, heat=HeatChoice("harm", "position"), overlay="run", aggregate="count")
    assert heat_facts(store, counted)[1:] == ("pixels", False)


@pytest.mark.parametrize(
    ("rows", "columns", "place"),
    [(slice(0, 3), slice(0, 3), "top left"), (slice(4, 8), slice(9, 12), "right"),
     (slice(4, 8), slice(4, 8), "middle"), (slice(10, 12), slice(5, 7), "bottom")],
)  # fmt: skip
def test_places_are_named_by_thirds(rows, columns, place):
    region = np.zeros((12, 12), dtype=np.bool_)
    region[rows, columns] = True
    assert place_in_image(region) == place


def test_the_metres_of_each_place_are_listed_largest_first():
    heat = np.zeros((12, 12), dtype=np.float32)
    heat[0:2, 0:2] = 0.42 / 4
    heat[9:12, 9:12] = -0.9 / 9
    ((name, text),) = _harm_note(HeatChoice("harm", "position"), heat, 3.0)
    assert name == "harm"
    total = "changes cost -0.48 m, without these 3.00 -> 3.48 m"
    assert text == f"{total}: -0.90 m bottom right, +0.42 m top left"
    for corner in (0, 5, 11):
        heat[5, corner] += 0.1
    assert _harm_note(HeatChoice("harm", "position"), heat, math.nan)[0][1].endswith(", 1 more")


def test_fine_heat_is_summed_and_other_kinds_and_modes_have_no_metres():
    heat, none = np.array([[0.5, -0.2], [0.1, np.nan]], dtype=np.float32), np.zeros((4, 4))
    position = HeatChoice("harm", "position")
    note = ("harm", "changes cost +0.40 m, without these 0.30 -> 0.00 m")
    assert _harm_note(HeatChoice("harm_fine", None), heat, 0.3) == [note]
    assert _harm_note(position, none, 1.0) == [("harm", "no changed part")]
    assert _harm_note(position, None, 1.0) == _harm_note(None, heat, 1.0) == []
    for choice in (("occlusion", "rgb"), ("harm", "heading"), ("harm", "loss")):
        assert _harm_note(HeatChoice(*choice), heat, 1.0) == []


def test_only_heat_in_metres_is_said_to_sum_to_metres(tiny_store):
    with s2rstore.open(tiny_store) as store:
        for mode, expected in (("position", True), (None, True), ("heading", False)):
            line = trust_line(store, "vanilla", "harm", mode)
            assert line.startswith("what each changed segment costs")
            assert ("sums to metres" in line) == expected
