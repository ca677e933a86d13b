"""The application on a run of imported predictions, and while a run is computed."""

from s2rstore.files import compute_progress
from s2rstore.index.transaction import edit
from s2rtui.app.pilot import settle, take_screenshot
from s2rtui.charts.registry import VIEWS
from s2rtui.cli import main
from tests.support.application import press, running
from tests.support.predictions import make, write_csv

MISSING = 7


async def test_every_view_draws_and_sliders_say_that_they_need_a_network(store_copy, tmp_path):
    made = make(store_copy)
    made.real[:MISSING, 0] = float("nan")
    file = str(write_csv(tmp_path / "p.csv", made))
    words = ["run", "import", "theirs", "--predictions", file, "--store", str(store_copy)]
    assert main(words) == 0
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
