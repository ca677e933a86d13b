"""The application on a run of imported predictions, and after instances are appended."""

import asyncio
from pathlib import Path

from s2rstore.files import compute_progress
from s2rstore.index.transaction import edit
from s2rtui.app.pilot import settle, take_screenshot
from s2rtui.charts.registry import VIEWS
from s2rtui.cli import main
from tests.support.appended import append_trajectory
from tests.support.application import press, running
from tests.support.predictions import Made, make, write_csv

N, MISSING = 40, 7


def import_predictions(store: Path, folder: Path, made: Made) -> None:
    file = str(write_csv(folder / "p.csv", made))
    assert main(["run", "import", "theirs", "--predictions", file, "--store", str(store)]) == 0


async def test_every_view_draws_and_sliders_say_that_they_need_a_network(store_copy, tmp_path):
    made = make(store_copy)
    made.real[:MISSING, 0] = float("nan")
    import_predictions(store_copy, tmp_path, made)
    async with running(store_copy, run="theirs", size=(80, 24)) as (app, pilot):
        assert app.session.state.run == "theirs"
        assert f"imported, {MISSING} not localised" in app.updater.status_text()
        for view in VIEWS:
            if view.name in ("adjust", "history"):
                continue
            await press(app, pilot, view.key)
            assert not app.session.state.is_error, (view.name, app.session.state.message)
        await press(app, pilot, "h")
        assert app.session.state.message.startswith("run theirs has no heatmaps")
        await press(app, pilot, "l")
        assert "`s2r run import --embeddings` makes them" in app.session.state.message
        app.session.set_cursor(0)
        app.updater.refresh()
        await settle(app, pilot)
        assert dict(app.loaded.pictures.notes)["gap"] == "unknown: no real prediction"
        await press(app, pilot, "a")
        assert app.session.state.message == (
            "run 'theirs': its predictions were imported; live prediction needs a network"
        )


async def test_a_session_moves_on_to_predictions_that_were_imported_again(store_copy, tmp_path):
    import_predictions(store_copy, tmp_path, make(store_copy))
    async with running(store_copy, run="theirs", size=(80, 24)) as (app, pilot):
        before = app.session.store.run_columns("theirs").real.x.copy()
        message = app.session.state.message
        again = make(store_copy, seed=1)
        await asyncio.to_thread(import_predictions, store_copy, tmp_path, again)
        app.store_updates.check_store()
        await settle(app, pilot)
        assert app.session.state.message == message
        assert app.session.state.run == "theirs"
        assert (app.session.store.run_columns("theirs").real.x != before).any()
        assert "imported" in app.updater.status_text()


ADDED = 5


async def test_every_view_draws_after_an_append(store_copy):
    async with running(store_copy) as (app, pilot):
        append_trajectory(store_copy, "a0", ADDED)
        app.store_updates.check_store()
        await settle(app, pilot)
        assert app.session.state.newest > app.session.state.generation
        await press(app, pilot, "g")
        assert "5 instances added" in app.session.state.message
        for view in VIEWS:
            if view.name == "adjust":  # the store has no weights
                continue
            await press(app, pilot, view.key)
            assert not app.session.state.is_error, (view.name, app.session.state.message)
        assert app.session.state.selected.size == N + ADDED
        assert "computed for 40 of 45 instances" in app.updater.status_text()
        app.session.set_cursor(N)
        app.updater.refresh()
        await settle(app, pilot)
        assert not app.session.state.is_error
        notes = dict(app.loaded.pictures.notes)
        assert notes["heat"] == (
            "instance 40: feature_distance of run 'vanilla' is not computed; run `s2r precompute`"
        )
        assert app.loaded.pictures.sim.rgb.size


async def test_what_precompute_publishes_appears_by_itself(store_copy):
    """Kinds of a run, its projection, and the progress of the process that computes."""
    with edit(store_copy) as draft:
        rows = draft.rows("SELECT * FROM zarr_array WHERE run = 'vanilla'")
        names = [column for column, *_ in draft.rows("DESCRIBE zarr_array")]
        draft.delete("projection", run="vanilla")
        draft.delete("zarr_array", run="vanilla")
        kept = [dict(zip(names, row, strict=True)) for row in rows]
        predictions = [row for row in kept if row["kind"] in ("prediction", "embedding")]
        draft.insert_rows("zarr_array", predictions)
    async with running(store_copy, run="vanilla", size=(120, 40)) as (app, pilot):
        await press(app, pilot, "4")
        compute_progress.write(store_copy, "vanilla: forward", 1, 2, 30.0)
        app.store_updates.check_store()
        await settle(app, pilot)
        text = take_screenshot(app).text
        assert "run vanilla has no projection" in text
        assert "computing vanilla: forward 1/2, about 30 s left" in " ".join(text.split())
        assert app.session.state.heat is None
        generation, selected = app.session.state.generation, app.session.state.selected
        with edit(store_copy) as draft:
            draft.delete("zarr_array", run="vanilla")
            draft.insert_rows("zarr_array", kept)
        compute_progress.remove(store_copy)
        app.store_updates.check_store()
        await settle(app, pilot)
        assert app.session.state.generation == generation + 1
        assert (app.session.state.selected == selected).all()
        assert app.session.state.heat is not None
        assert "computing" not in take_screenshot(app).text
