"""Which heatmap is offered first, and what is said about how far each can be trusted."""

import json
from pathlib import Path
from typing import Any

import pytest

import s2rstore
from s2rstore.findings import best_heatmap
from s2rstore.heatmap_kinds import HEATMAPS, NO_HEAT
from s2rstore.index.transaction import edit
from s2rstore.metrics import heatmap_scores
from s2rstore.reader import DEFAULT_MODES, NETWORK_KINDS
from s2rtools.heatmaps import HEATMAP_KINDS, IMAGE_KINDS
from s2rtui.session import view_settings
from s2rtui.session.session import Session

RUN = "vanilla"


def row(kind: str, mode: str | None, auroc: float | None, **fields: Any) -> dict[str, Any]:
    """A row of a score report, on the floor of both sides."""
    interval = {"auroc_low": 0.4, "auroc": auroc, "auroc_high": 0.99}
    rest = {"precision": 0.5, "base_rate": 0.08, "place": "floor", "side": "both"}
    return {"run": RUN, "kind": kind, "mode": mode, **interval, **rest, **fields}


def with_report(path: Path, rows: list[dict[str, Any]], key: str | None = None) -> Path:
    with s2rstore.open(path) as store:
        keys = {RUN: key or store.run(RUN).key}
    report = json.dumps({"runs": keys, "heatmaps": rows, "factors": []})
    with edit(path) as draft:
        draft.set_provenance("score", {"report": report})
    return path


def first(path: Path) -> tuple[str, str | None]:
    session = Session(path, RUN)
    try:
        heat = session.state.heat
        return heat.kind, heat.mode
    finally:
        session.close()


def test_every_kind_of_the_tools_is_registered_with_the_same_facts():
    assert set(HEATMAPS) == {*HEATMAP_KINDS, NO_HEAT}
    for name, kind in HEATMAP_KINDS.items():
        assert tuple(HEATMAPS[name].planes) == kind.planes
        assert HEATMAPS[name].needs_network == (name not in IMAGE_KINDS)
    assert DEFAULT_MODES == {
        "activation": "loss", "harm": "position", "harm_fine": "position", "occlusion": "rgbd",
        "pixel_difference": "rgb",
    }  # fmt: skip
    assert "harmonised_difference" not in NETWORK_KINDS


def test_the_best_score_of_the_store_comes_first(store_copy):
    rows = [
        row("feature_distance", None, 0.6),
        row("occlusion", "depth", 0.7),
        row("activation", "loss", None),
        row("activation", "loss", 0.9, place="image", side="real"),
        row("activation", "loss", 0.9, run="dataaug"),
    ]
    assert first(with_report(store_copy, rows)) == ("occlusion", "depth")


def test_scores_of_another_computation_do_not_count(store_copy):
    path = with_report(store_copy, [row("occlusion", "depth", 0.7)], key="0" * 16)
    assert first(path) == ("feature_distance", None)


@pytest.mark.parametrize(
    "text", [None, "{}", "[]", '{"runs": 3}', '{"runs": {}, "heatmaps": [{}]}']
)
def test_without_a_valid_report_the_shipped_ranking_decides(store_copy, text):
    if text is not None:
        with edit(store_copy) as draft:
            draft.set_provenance("score", {"report": text})
    assert first(store_copy) == ("feature_distance", None)


def test_a_kind_says_where_its_figure_comes_from(store_copy):
    with s2rstore.open(store_copy) as store:
        shipped = heatmap_scores.trust_line(store, RUN, "feature_distance", None)
        chance = heatmap_scores.trust_line(store, RUN, "activation", "loss")
        assert heatmap_scores.trust_line(store, RUN, "unknown", None) == ""
    assert shipped.endswith("AUROC 0.83 in 4 synthetic buildings")
    assert chance.endswith("AUROC about chance in 4 synthetic buildings")
    path = with_report(store_copy, [row("feature_distance", None, 0.6)])
    with s2rstore.open(path) as store:
        own = heatmap_scores.trust_line(store, RUN, "feature_distance", None)
    assert own.endswith("AUROC 0.60 (0.40 to 0.99) in this store")


def test_the_kind_none_stays_when_the_run_changes(tiny_store):
    session = Session(tiny_store)
    state = session.dispatch(view_settings.change_heat, -1)
    assert (state.heat.kind, state.shown_heat, state.message) == (NO_HEAT, None, "no heatmap")
    assert session.set_run("dataaug").shown_heat is None
    assert session.dispatch(view_settings.change_side).side == "sim"
    assert session.dispatch(view_settings.change_overlay).message == "no heatmap is chosen"
    after = session.dispatch(view_settings.change_heat, 1)
    assert after.shown_heat is not None
    assert after.side == "sim"
    assert "feature distance: where the last features differ" in after.message
    session.close()


def test_a_score_without_bounds_is_shown_without_an_interval(store_copy):
    unknown = row("occlusion", "depth", 0.7, auroc_low=None, auroc_high=None)
    path = with_report(store_copy, [unknown, row("feature_distance", None, 0.3)])
    with s2rstore.open(path) as store:
        assert heatmap_scores.own_scores(store, RUN)[0].text == "AUROC 0.70"
        found = best_heatmap.best_heatmap(store, RUN)
    assert not found.evident
