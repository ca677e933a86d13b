"""A store without a computed run, and one with a single run, which is compared with a baseline."""

from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.index.transaction import edit
from s2rstore.metrics import run_metrics
from s2rtui.app.key_bindings import ACTIONS
from s2rtui.app.pilot import settle, snapshot, take_screenshot
from s2rtui.canvas import RenderOptions
from s2rtui.charts.compare import constant_errors
from s2rtui.charts.registry import BY_NAME, VIEWS
from s2rtui.export.load_scene import SceneOptions, open_scene
from s2rtui.export.report.build_report import render_report
from s2rtui.export.report.report_model import ReportRequest
from s2rtui.session.session import Session
from tests.support import tiny
from tests.support.application import make_app, press, running
from tests.support.copies import copy_store


@pytest.fixture(scope="module")
def store(tiny_store: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store whose runs were removed; its models are there."""
    path = copy_store(tiny_store, tmp_path_factory.mktemp("browse") / "s.s2r")
    with edit(path) as draft:
        for table in ("prediction", "projection", "zarr_array", "run"):
            draft.delete(table)
    return path


def lines(store: Path, size: tuple[int, int], *keys: str) -> list[str]:
    return snapshot(store, size, keys, RenderOptions()).text.splitlines()


def test_screens_show_images_true_positions_and_the_command(store):
    screen = lines(store, (80, 24))
    assert "no runs" in screen[0]
    assert "40 of 40" in screen[0]
    assert any("3 instance  0" in line for line in screen)
    assert sum("▀" in line for line in screen) >= 4
    message = " ".join(" ".join(screen[-5:-1]).split())
    assert "no run; register one of a model (`s2r run add NAME --model" in message
    screen = lines(store, (80, 24), "2", "right")
    assert "true positions" in screen[1]
    assert sum(line.count("●") + line.count("?") for line in screen[2:-3]) >= 3
    screen = lines(store, (120, 40), "8", "end")
    assert "40 of 40, by iid" in screen[1]
    assert any("▶" in line and " 39 " in line for line in screen)


async def test_views_of_predictions_name_the_command(store):
    async with running(store, size=(80, 24)) as (app, pilot):
        for view in (view for view in VIEWS if view.needs_run and view.from_store):
            await press(app, pilot, view.key)
            screen = " ".join(take_screenshot(app).text.splitlines()[2:-2])
            assert "s2r run add NAME --model" in " ".join(screen.split()), view.name
            with (
                pytest.raises(RequestError, match="s2r run add"),
                open_scene(store, SceneOptions(), view),
            ):
                pass
        await press(app, pilot, "J", "enter")
        assert "s2r run add NAME --model" in app.session.state.message
    assert app.fault is None


async def test_no_key_fails(store):
    app = make_app(store)
    left_out = {"quit", "snapshot", "write_selection", "report", "tour", "help", "doctor", "jump"}
    async with app.run_test(size=(80, 24)) as pilot:
        await settle(app, pilot)
        for action in ACTIONS:
            if action.name in left_out or action.when == "brushing":
                continue
            await press(app, pilot, action.keys[0])
            await pilot.press("escape", "escape")
        assert not app.loaded.failed
    assert app.fault is None


def test_numbers_and_figures_of_the_truth(store):
    for name in ("map", "instance", "list"):
        view = BY_NAME[name]
        with open_scene(store, SceneOptions(), view) as scene:
            columns, rows = view.numbers(scene)
            assert rows
            assert len(rows[0]) == len(columns)
            assert view.summary(scene)
            assert view.figure(scene, (400, 300), RenderOptions().theme)[1:4] == b"PNG"


def test_a_report_names_the_command(store):
    with pytest.raises(RequestError, match="s2r run add"):
        render_report(store, ReportRequest(()))


def test_a_run_that_is_not_computed_is_named_and_opened_when_it_is(store_copy):
    with edit(store_copy) as draft:
        keys = draft._connection.execute("SELECT key, run FROM run").fetchall()
        draft.rows("UPDATE run SET key = NULL")
    session = Session(store_copy)
    assert "no run is computed (vanilla, dataaug); `s2r precompute" in session.state.message
    assert session.state.runs == ()
    with edit(store_copy) as draft:
        draft._connection.executemany("UPDATE run SET key = ? WHERE run = ?", keys)
    updates = session.read_updates()
    assert session.apply_updates(updates)
    assert session.follow(updates)
    assert session.state.run == "vanilla"
    assert session.state.message.startswith("worst room: ")
    assert session.state.selected.any()


@pytest.fixture(scope="module")
def one_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny.build(tmp_path_factory.mktemp("one") / "one.s2r", runs=("vanilla",))


def test_errors_of_the_constant_prediction_give_the_baseline_of_the_store(one_run):
    with s2rstore.open(one_run) as store:
        truth, columns = store.instances, store.run_columns("vanilla")
        errors = constant_errors(truth.x, truth.y, columns.valid, columns.trained)
        accuracy = np.maximum(0, 1 - errors[columns.valid] / store.dataset.accuracy_scale)
        assert accuracy.mean() == pytest.approx(run_metrics.baseline_accuracy(store, "vanilla"))


def test_new_instances_alone_decide_the_constant_prediction():
    x, y = np.array([0.0, 2.0, 8.0, np.nan]), np.zeros(4)
    valid, trained = np.array([True, True, True, True]), np.array([False, False, True, False])
    assert constant_errors(x, y, valid, trained)[:3].tolist() == [1.0, 1.0, 7.0]
    everywhere = constant_errors(x, y, valid, np.ones(4, dtype=np.bool_))
    assert everywhere[:2].tolist() == pytest.approx([10 / 3, 4 / 3])


@pytest.mark.parametrize("size", [(80, 24), (200, 60)])
def test_one_run_is_compared_with_its_baseline(one_run, size):
    text = " ".join(snapshot(one_run, size, ["c", "9"], RenderOptions()).text.split())
    assert "real errors of the only run and of its constant baseline" in text
    if size[0] < 150:
        assert "Real errors of vanilla (A) and baseline (B): baseline is better on" in text
    assert "left hall" in text
    assert "better in baseline" in text
