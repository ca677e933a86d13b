"""The recall view counts what a run did not localise, and draws its curves at the thresholds."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import s2rstore
from s2rstore.index.transaction import edit
from s2rtui.canvas import DEFAULT_OPTIONS
from s2rtui.charts.recall import VIEW
from s2rtui.charts.scene import LoadedData, LoadedModel, Scene, model_source
from s2rtui.cli import main
from s2rtui.session.session import Session

POSE = ("x", "y", "heading", "error", "heading_error", "loss", "accuracy", "rank")


@pytest.fixture
def lost(store_copy):
    """A store in which `vanilla` did not localise the real images 3, 4 and 5."""
    with edit(store_copy) as draft:
        for iid in (3, 4, 5):
            key = {"run": "vanilla", "side": "real", "iid": iid}
            draft.update("prediction", key, dict.fromkeys(POSE))
    return store_copy


def scene_of(path, expression):
    session = Session(path, "vanilla")
    session.select(expression)
    return session, Scene(session.store, session.state, LoadedData())


def test_the_table_has_the_shares_of_all_attempted_instances(lost, capsys):
    assert main(["show", str(lost), "recall", "--run", "vanilla", "--format", "json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    with s2rstore.open(lost) as store:
        part = store.run_columns("vanilla").real
        held = (part.error <= 2) & (np.degrees(part.heading_error) <= 20)
    by_name = {(r["figure"], r["of"]): r for r in rows if r["side"] == "real"}
    row = by_name["recall", "2 m, 20 deg"]
    assert (row["value"], row["n"], row["unit"]) == (100 * held.sum() / 40, 40, "%")
    assert by_name["not localised", None]["value"] == 3
    assert row["low"] < row["value"] < row["high"]


def test_the_drawing_says_what_is_not_localised_in_all_and_in_a_selection(lost):
    for expression, text in (("all", "n 40 (sim 0, real 3 not localised)"),
                             ("room:right", "; 3 not localised left out")):  # fmt: skip
        session, scene = scene_of(lost, expression)
        model = VIEW.input(scene)
        assert text in model.counted
        lines = VIEW.draw(scene, (80, 21), DEFAULT_OPTIONS).lines()
        assert any(text in line for line in lines)
        assert "◇ real" in lines[0]
        assert lines[1].startswith("100 %")
        assert sum(line.count("◇") for line in lines[1:12]) == 4  # a mark for each threshold
        session.close()
    assert VIEW.summary(scene).count("not localised") == 1


def test_the_figures_of_the_selection_before_are_shown_until_new_ones_are_computed(tiny_store):
    session, scene = scene_of(tiny_store, "all")
    waiting = replace(scene, loaded=LoadedData(models={}))
    assert "figures are being computed" in VIEW.draw(waiting, (80, 21), DEFAULT_OPTIONS).lines()[0]
    loaded = LoadedModel(model_source(session.state), VIEW.model(session.store, session.state))
    shown = replace(scene, loaded=LoadedData(models={"recall": loaded}))
    assert (VIEW.input(shown), VIEW.loading(shown)) == (loaded.model, "")
    session.select("room:right")
    older = replace(shown, state=session.state)
    assert (VIEW.input(older), VIEW.loading(older)) == (loaded.model, "figures of the selection")
    other = replace(shown, state=replace(session.state, run="dataaug"))
    assert VIEW.input(other) is None
    session.close()
