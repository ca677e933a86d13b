"""The label of heat names the kind, the mode and the unit that is drawn, in every view."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.reader import Store
from s2rstore.records import ArrayRecord
from s2rtools.heatmaps import HEATMAP_KINDS
from s2rtui.charts.instance import paper as instance_paper
from s2rtui.charts.map import paper as map_paper
from s2rtui.charts.map.terminal import draw_map
from s2rtui.charts.shared.base_map_model import map_input
from s2rtui.charts.shared.image_pair_model import heat_fields
from s2rtui.charts.shared.image_pair_terminal import draw_instance
from s2rtui.session import Session
from s2rtui.session.heatmaps import heatmap_choices
from s2rtui.session.state import HeatChoice, State
from tests.charts.examples import instance_input
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
            (40, *output.shape), ("iid", *output.axes), 1.0, 0.0, output.unit,
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


def drawn_labels(monkeypatch: pytest.MonkeyPatch, module: object) -> list[str]:
    """The labels of the colour bars that a figure draws, without line breaks."""
    labels: list[str] = []

    def record(page, left, bottom, height, scale, label, *others, **options) -> None:
        labels.append(label.replace("\n", " "))

    monkeypatch.setattr(module, "draw_colour_bar", record)
    return labels


def test_every_label_names_kind_mode_and_unit(
    store: Store, state: State, monkeypatch: pytest.MonkeyPatch
) -> None:
    kinds = {kind.replace("_", " ") for kind in HEATMAP_KINDS}
    choices = heatmap_choices(store, RUN)
    assert {kind for kind, _ in choices} == set(HEATMAP_KINDS)
    on_map, on_images = (
        drawn_labels(monkeypatch, module) for module in (map_paper, instance_paper)
    )
    for kind, mode in choices:
        heat = HeatChoice(kind, mode, "real")
        name = kind.replace("_", " ")
        view = map_input(store, replace(state, heat=heat), heat=np.ones((4, 4)))
        unit = view.heat_unit
        assert unit in UNITS
        assert unit not in kinds
        map_paper.map_figure(view, (800, 600))
        images = instance_input(**heat_fields(store, RUN, heat))
        instance_paper.instance_figure(images, (800, 600))
        on_map_terminal = " ".join(draw_map(view, (150, 40)).lines()[-3:])
        on_instance_terminal = " ".join(draw_instance(images, (150, 40)).lines())
        for label in (on_map[-1], on_images[-2], on_map_terminal, on_instance_terminal):
            assert name in label
            assert not mode or mode in label
            assert unit in label
            assert not [other for other in kinds - {name} if other in label.replace(name, "")]


def test_modes_of_a_kind_have_units_of_their_own(store: Store) -> None:
    units = {
        mode: heat_fields(store, RUN, HeatChoice("pixel_difference", mode))["unit"]
        for mode in ("rgb", "depth")
    }
    assert units == {"rgb": "standard deviations", "depth": "m"}
