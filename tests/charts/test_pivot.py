"""The pivot: figures of cells, their colours, and their instances."""

import numpy as np
import pytest

import s2rstore
from s2rtui.charts.pivot import EVIDENT, VIEW
from tests.support.application import press, running


def test_cells_hold_the_figures_of_the_instances_that_they_select(tiny_store, s2r):
    cells = s2r("show", tiny_store, "pivot", "--group-by", "room,curvature", "--json").json
    with s2rstore.open(tiny_store) as store:
        real = store.run_columns("vanilla").real
        metres, degrees = store.dataset.recall_thresholds[-2]
        held = (real.error <= metres) & (np.degrees(real.heading_error) <= degrees)
        for cell in cells:
            found = s2r("query", tiny_store, cell["expression"], "--run", "vanilla", "--json").json
            iids = [row["iid"] for row in found]
            assert len(iids) == cell["n"]
            assert cell["median_m"] == pytest.approx(np.median(real.error[iids]))
            assert cell["recall"] == pytest.approx(held[iids].mean())
            assert cell["share"] == pytest.approx(real.error[iids].sum() / real.error.sum())
    assert sum(cell["share"] for cell in cells) == pytest.approx(1.0)


async def test_enter_selects_the_chosen_cell_which_is_the_worst_at_first(tiny_store):
    async with running(tiny_store) as (app, pilot):
        await press(app, pilot, "c", "right_parenthesis")
        cells = VIEW.input(app.updater.scene)
        assert not any(cell.real.is_known for cell in cells.values())
        worst = max(cells.values(), key=lambda cell: cell.share)
        await press(app, pilot, "enter")
        assert app.session.state.expression == worst.group.expression
        names = VIEW.row_names(app.updater.scene)
        across = VIEW.row_width(app.updater.scene)
        await press(app, pilot, *["left"] * across, "home", "right", "down")
        assert app.session.state.chosen_row("pivot") == names[across + 1]
        table = VIEW.drawing(app.updater.scene, 60).table
        assert (table.chosen, table.column) == (1, 2)
        filled = [cell for row in table.rows for cell in row.cells if cell.heat is not None]
        values = [float(cell.text.strip(EVIDENT)) for cell in filled]
        assert [cell.heat for cell in filled] == pytest.approx(
            np.divide(values, max(values)), abs=0.01
        )
        await press(app, pilot, "backslash")
        table = VIEW.drawing(app.updater.scene, 60).table
        counts = [cell.text.strip(EVIDENT) for row in table.rows for cell in row.cells[1:]]
        assert sum(int(text) for text in counts if text) == 40
