"""No view, export, report or query counts an instance that the model was trained on, unmarked.

Two stores differ only in the trained instances of their runs: in one of them these have absurd
predictions. Whatever leaves trained instances out must be equal for both stores.
"""

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

import s2rstore
from s2rstore.index.transaction import edit
from s2rstore.language import evaluation
from s2rstore.metrics import run_metrics
from s2rtui.app.titled_view import TitledView
from s2rtui.canvas import DARK, LIGHT, RenderOptions
from s2rtui.charts.map import heat_facts
from s2rtui.charts.registry import BY_NAME, VIEWS
from s2rtui.cli import main
from s2rtui.export.load_scene import SceneOptions, open_scene
from s2rtui.export.report.build_report import render_report
from s2rtui.export.report.report_model import ReportRequest, RequestedSelection
from s2rtui.session import navigation, shared_selection
from s2rtui.session.session import Session
from s2rtui.user_data.notebook import Notebook
from tests.support import tiny
from tests.support.open_stores import kept_open
from tests.support.small_figures import draw_small_figures

N = 40
TRAINED = {"vanilla": "iid % 2 = 0", "dataaug": "iid % 4 = 1"}
"""The trained instances of each run, as SQL: half of them, and a quarter."""
COUNTING = [view for view in VIEWS if view.from_store and view.counts_instances]
EXPRESSIONS = (
    "all", "worst15", "best15", "worst(20%, sim.error)", "!worst15", "!room:right", "gap > 0",
    "real.error < 100", "new", "!trained", 'run("dataaug").worst15', "real.error > 50",
    "real.rank <= 5", 'run("dataaug").sim.rank < 4',
)  # fmt: skip


class Stores(NamedTuple):
    """The store with ordinary and the one with absurd predictions of trained instances."""

    ordinary: Path
    absurd: Path


@pytest.fixture(scope="module")
def stores(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stores]:
    folder = tmp_path_factory.mktemp("trained")
    made = Stores(*(tiny.build(folder / name / "tiny.s2r", N) for name in ("ordinary", "absurd")))
    for path in made:
        with edit(path) as draft:
            for run, condition in TRAINED.items():
                where = f"WHERE run = '{run}' AND {condition}"
                draft._connection.execute(
                    f"UPDATE prediction SET split = CASE WHEN iid % 3 = 0 THEN 'train' "
                    f"ELSE 'validation' END {where} AND side = 'sim'"
                )
                if path != made.absurd:
                    continue
                draft._connection.execute(
                    f"UPDATE prediction SET x = x + 900, y = y - 900, error = error + 1272, "
                    f"heading = -heading, heading_error = 3, loss = 1e6, accuracy = 0, "
                    f"rank = 41 - rank, outlier = 1e4 {where}"
                )
                draft._connection.execute(f"UPDATE projection SET u = u + 500, v = v - 500 {where}")
    with kept_open(made.ordinary), kept_open(made.absurd):
        yield made


def options(with_trained: bool = False, select: str = "all", **more: Any) -> SceneOptions:
    return SceneOptions(select, "vanilla", other="dataaug", with_trained=with_trained, **more)


@pytest.mark.parametrize("view", COUNTING, ids=lambda view: view.name)
def test_numbers_words_cells_and_figures_of_a_view_ignore_trained_instances(stores, view):
    shown = []
    for path in stores:
        with open_scene(path, options(), view) as scene:
            canvas = TitledView(view, scene).draw((110, 40), RenderOptions(DARK))
            cells = [getattr(canvas, part).tolist() for part in ("char", "fg", "bg")]
            rows = repr(view.numbers(scene))
            shown.append((rows, view.summary(scene), cells, view.figure(scene, (320, 240), LIGHT)))
            assert scene.state.count_text == "20 of 40 (20 trained on)"
            assert "20 of 40 (20 trained on) instances" in scene.caption
    for ordinary, absurd in zip(*shown, strict=True):
        assert ordinary == absurd


@pytest.mark.parametrize("view", COUNTING, ids=lambda view: view.name)
def test_views_mark_trained_instances_where_they_are_included(stores, view):
    with open_scene(stores.absurd, options(with_trained=True), view) as scene:
        assert scene.state.count_text == "40 of 40 (20 trained on, included)"
        title = TitledView(view, scene).draw((110, 40), RenderOptions(DARK)).lines()
        names, rows = view.numbers(scene)
        assert view.name != "errors" or "at most 12" in view.summary(scene)
    assert "20 trained on included" in title[0].replace("on, included", "on included")
    if view.name in ("map", "umap", "list"):
        splits = [row[list(names).index("split")] for row in rows]
        assert sum(split in ("train", "validation") for split in splits) == N // 2
    if view.name in ("map", "umap", "compare"):
        assert re.search("○.* trained on", "\n".join(title))
    if view.name == "overview":
        assert "pale" in title[0]


def test_queries_select_new_instances_only(stores, capsys):
    for expression in EXPRESSIONS:
        outputs = []
        for path in stores:
            for more in (["--count"], ["--format", "csv"]):
                assert main(["query", str(path), expression, *more]) == 0
            outputs.append(capsys.readouterr())
        assert outputs[0].out == outputs[1].out, expression
        assert outputs[0].err.count("20 trained on) instances of run vanilla") == 2, expression
        last = [output.err.splitlines()[-1] for output in outputs]
        assert last[0] == last[1], expression
        assert last[0].endswith("of 40 (20 trained on) instances of run vanilla")


def test_reports_say_whether_they_hold_trained_instances(stores, monkeypatch):
    draw_small_figures(monkeypatch)
    worst = ReportRequest(
        (RequestedSelection("worst(30%, real.error)"),), ("vanilla",), theme="light"
    )
    pages = [render_report(path, worst).decode() for path in stores]
    assert pages[0] == pages[1]
    assert "6 of 40 (20 trained on) instances" in pages[0]
    assert "new to the run: its model was not trained on them" in pages[0]
    whole = replace(worst, selections=(RequestedSelection("all"),), with_trained=True)
    page = render_report(stores.absurd, whole).decode()
    assert "40 of 40 (20 trained on, included) instances" in page
    assert "The model was trained on 20 of them" in page
    sides = re.search(r"Run vanilla on the selection.*?</table>", page, re.DOTALL)
    assert sides[0].count("<td>20</td>") == 2


def test_the_instance_view_ranks_among_new_instances_and_names_the_split(stores):
    view, notes = BY_NAME["instance"], {}
    for path in stores:
        for iid in (3, 6):
            with open_scene(path, options(iid=iid), view) as scene:
                rows = view.numbers(scene)[1]
                assert ("trained on it" in view.summary(scene)) == (iid == 6)
            notes[path, iid] = {row[0]: row[-1] for row in rows}
    assert notes[stores.ordinary, 3] == notes[stores.absurd, 3]
    assert notes[stores.absurd, 3]["ranks"].endswith("of 20 new instances by error")
    assert "split" not in notes[stores.absurd, 3]
    assert notes[stores.absurd, 6]["split"] == "train: the model was trained on it"
    assert notes[stores.absurd, 6]["ranks"].endswith("20 trained on included")


def test_the_stored_heat_of_a_run_names_its_trained_instances(stores):
    with open_scene(stores.absurd, options(heat="activation:loss", overlay="instance")) as scene:
        whole = replace(scene.state, overlay="run")
        shown, _, _ = heat_facts(scene.store, whole)
        of_one, _, _ = heat_facts(scene.store, scene.state)
        elsewhere = replace(whole, trained=np.zeros_like(whole.trained))  # none in view
        assert heat_facts(scene.store, elsewhere)[0] == shown
    assert shown.endswith("all instances, 20 trained on")
    assert "trained" not in of_one


def test_runs_and_the_headline_population_agree_with_the_screen(stores, s2r):
    outputs = [s2r("runs", path, "--format", "csv").printed for path in stores]
    assert outputs[0] == outputs[1]
    with s2rstore.open(stores.absurd) as store:
        for run, trained in (("vanilla", 20), ("dataaug", 10)):
            held_out = run_metrics.population(store, run)
            assert held_out.sum() == N - trained
            np.testing.assert_array_equal(evaluation.select(store, "all", run), held_out)
    with open_scene(stores.absurd, options()) as scene:
        np.testing.assert_array_equal(
            scene.state.base, run_metrics.population(scene.store, "vanilla")
        )


def test_runs_say_where_the_training_set_is_unknown(tmp_path, s2r):
    path = tiny.build(tmp_path / "s.s2r", N)
    with edit(path) as draft:
        draft._connection.execute("UPDATE prediction SET split = 'unseen'")
        draft.set_provenance("model:dataaug", {"split:sim": "[[3, 40]]"})
    notes = {row["run"]: row["note"] for row in s2r("runs", path, "--json").json}
    assert notes == {"vanilla": "training set unknown", "dataaug": ""}


def test_a_comparison_holds_the_instances_that_are_new_to_both_runs(stores):
    view = BY_NAME["compare"]
    with open_scene(stores.absurd, options(), view) as scene:
        names, rows = view.numbers(scene)
        counted = dict(zip(names, rows[-1], strict=True))
        assert counted["n"] == 10
        expected = run_metrics.population(scene.store, "vanilla", "dataaug")
        assert expected.sum() == 10
        np.testing.assert_array_equal(scene.common_base("dataaug"), expected)
        assert "10 trained on by dataaug left out" in view.summary(scene)


@pytest.fixture
def session(stores: Stores) -> Iterator[Session]:
    opened = Session(stores.absurd)
    yield opened
    opened.close()


@pytest.mark.parametrize(
    ("expression", "count"), [("trained", 20), ("split:train", 7), ("sim.split:validation", 13)]
)
def test_an_expression_of_trained_instances_says_that_they_are_left_out(session, expression, count):
    message = session.select(expression).message
    assert message == f"nothing is selected; {count} trained instances left out: M includes them"
    mixed = session.select(f"{expression} | ids(1, 3)")
    assert mixed.message == f"{count} trained instances left out: M includes them"
    session.dispatch(navigation.toggle_trained)
    assert session.select(expression).selected.sum() == count
    assert session.state.message == ""


def test_undo_restores_the_population_of_a_selection(session):
    session.select("worst(20%, real.error)")
    session.dispatch(navigation.toggle_trained)
    included = session.state.selected
    session.select("room:right")
    session.dispatch(navigation.toggle_trained)
    session.select("straight")
    for expression, with_trained in (
        ("room:right", False), ("room:right", True), ("worst(20%, real.error)", True),
    ):  # fmt: skip
        state = session.dispatch(navigation.undo)
        assert (state.expression, state.with_trained) == (expression, with_trained)
    np.testing.assert_array_equal(session.state.selected, included)
    session.dispatch(navigation.redo)
    state = session.dispatch(navigation.redo)
    assert (state.expression, state.with_trained) == ("room:right", False)
    assert "left out" in state.message


def test_a_shared_expression_keeps_its_population(session):
    def shared() -> str:
        saved = shared_selection.current_selection(session.state)
        return shared_selection.shared_text(saved, session.store.identity)

    session.select("worst(20%, real.error)")
    new_only = shared()
    session.dispatch(navigation.toggle_trained)
    included = shared()
    assert "4 new instances" in new_only
    assert "8 instances" in included
    for text, with_trained, count in ((new_only, False, 4), (included, True, 8)):
        session.select("all")
        state = session.dispatch(shared_selection.select_text, text)
        assert (state.with_trained, int(state.selected.sum())) == (with_trained, count)


def test_a_saved_selection_says_where_its_population_differs(stores, tmp_path):
    session = Session(stores.absurd, notebooks=lambda identity: Notebook(identity, tmp_path))
    session.select("worst(20%, real.error)")
    session.dispatch(navigation.toggle_trained)
    saved = shared_selection.current_selection(session.state)
    session.writable_notebook.save("mine", saved)
    assert session.select("@mine").message == ""
    session.dispatch(navigation.toggle_trained)
    message = session.select("@mine").message
    assert "evaluated again: 4 on vanilla, generation 3, new ones only" in message
    assert "saved: 8 on vanilla, generation 3, trained ones included" in message
    session.close()


def test_ranks_of_expressions_and_rows_count_the_instances_of_the_query(stores, capsys):
    """As on the screen: among the new instances, or among all where trained ones are included."""

    def rows(*options: str) -> list[dict[str, Any]]:
        command = ["query", str(stores.ordinary), "real.rank <= 5", "--run", "vanilla", "--json"]
        assert main([*command, "--columns", "iid,real.rank,real.error", *options]) == 0
        return json.loads(capsys.readouterr().out)

    for options in ((), ("--with-trained",)):
        found = sorted(rows(*options), key=lambda row: row["real.error"])
        assert [row["real.rank"] for row in found] == [1, 2, 3, 4, 5]
        with s2rstore.open(stores.ordinary) as store:
            best = evaluation.select(
                store, "best(5, real.error)", "vanilla", with_trained=bool(options)
            )
        assert {row["iid"] for row in found} == set(np.flatnonzero(best).tolist())
