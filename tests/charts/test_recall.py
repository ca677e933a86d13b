"""The recall view counts what a run did not localise, and draws its curves at the thresholds."""

from __future__ import annotations

import json

import numpy as np
import pytest

import s2rstore
from s2rstore.index.transaction import edit
from s2rtui.charts.recall.terminal import draw_recall
from s2rtui.charts.recall.view import VIEW
from s2rtui.charts.scene import Resources, Scene
from s2rtui.cli import main
from s2rtui.session import Session

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
    return session, Scene(session.store, session.state, Resources())


def test_the_table_has_the_shares_of_all_attempted_instances(lost, capsys):
    assert main(["show", str(lost), "recall", "--run", "vanilla", "--format", "json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    with s2rstore.open(lost) as store:
        part = store.run_columns("vanilla").real
        held = (part.error <= 2) & (np.degrees(part.heading_error) <= 20)
    (row,) = [r for r in rows if (r["side"], r["metres_m"]) == ("real", 2)]
    assert (row["value"], row["n"], row["not_localised"]) == (held.sum() / 40, 40, 3)
    assert row["low"] < row["value"] < row["high"]


def test_the_drawing_says_what_is_not_localised_in_all_and_in_a_selection(lost):
    for expression, text in (("all", "n 40 (sim 0, real 3 not localised)"),
                             ("room:right", "; 3 not localised left out")):  # fmt: skip
        session, scene = scene_of(lost, expression)
        model = VIEW.input(scene)
        assert text in model.counted
        lines = draw_recall(model, (80, 21)).lines()
        assert any(text in line for line in lines)
        assert lines[0].startswith("100 %")
        assert sum(line.count("◇") for line in lines[:10]) == 4  # a mark for each threshold
        session.close()
    assert VIEW.summary(scene).count("not localised") == 1
