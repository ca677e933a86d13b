"""The focused view: zoom, full screen, the instance under the mouse, first and last instance."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from textual.pilot import Pilot

from s2rtui.app.app import S2RApp
from s2rtui.app.pilot import settle
from s2rtui.app.status_line import Bar
from s2rtui.app.widgets.plot import PlotView
from s2rtui.canvas import RenderOptions
from s2rtui.charts.registry import BY_NAME
from s2rtui.session import Session, instance_list
from s2rtui.session.instance_text import instance_text

SIZE = (120, 40)


def make_app(store: Path) -> S2RApp:
    app = S2RApp(Session(store), RenderOptions())
    app.load_scheduler.debounce_seconds = 0.001
    return app


async def press(app: S2RApp, pilot: Pilot[None], *keys: str) -> None:
    for key in keys:
        await pilot.press(key)
        await settle(app, pilot)


def message(app: S2RApp) -> str:
    return str(app.query_one("#message", Bar).render())


def shown(app: S2RApp) -> set[str]:
    return {str(view.id) for view in app.query(PlotView) if view.placed and view.region.area}


async def test_zoom_and_pan_keys_move_the_focused_view_alone(tiny_store: Path) -> None:
    app = make_app(tiny_store)
    async with app.run_test(size=SIZE) as pilot:
        await settle(app, pilot)
        await press(app, pilot, "4", "z")
        state = app.session.state
        closer = state.viewport_of("umap")
        assert closer is not None
        assert state.viewport is None
        assert "umap enlarged 1.67 times" in message(app)
        await press(app, pilot, "shift+right")
        moved = app.session.state.viewport_of("umap")
        assert moved is not None
        assert moved.x0 > closer.x0
        await press(app, pilot, "2", "z")
        assert app.session.state.viewport is not None
        await press(app, pilot, "4", "0")
        assert app.session.state.viewport_of("umap") is None
        assert app.session.state.viewport is not None


async def test_zooming_shows_fewer_points_of_the_umap(tiny_store: Path) -> None:
    app = make_app(tiny_store)
    async with app.run_test(size=(80, 24)) as pilot:
        await press(app, pilot, "c", "4")
        view, size = BY_NAME["umap"], (80, 20)
        before = view.panels(app.renderer.scene, size, app.render_options)[0]
        await press(app, pilot, "z")
        after = view.panels(app.renderer.scene, size, app.render_options)[0]
        points = view.points(app.renderer.scene, after)  # type: ignore[attr-defined]
        inside = [
            sum(panel.holds(*map(int, panel.to_cells(*point))) for point in points)
            for panel in (before, after)
        ]
        assert inside[1] < inside[0]


async def test_a_view_without_zoom_says_which_views_have_one(tiny_store: Path) -> None:
    app = make_app(tiny_store)
    async with app.run_test(size=SIZE) as pilot:
        await press(app, pilot, "7", "z")
        assert "errors cannot be zoomed (2 map, 4 umap" in message(app)
        assert app.session.state.viewports == ()


async def test_a_view_fills_the_screen_and_the_layout_comes_back(tiny_store: Path) -> None:
    app = make_app(tiny_store)
    async with app.run_test(size=SIZE) as pilot:
        await press(app, pilot, "3")
        before = shown(app)
        await press(app, pilot, "V")
        assert shown(app) == {"instance"}
        assert app.query_one("#instance", PlotView).size.width == SIZE[0]
        await press(app, pilot, "2")
        assert shown(app) == {"map"}
        await press(app, pilot, "V")
        assert shown(app) == before


async def test_a_small_screen_says_that_one_view_fills_it(tiny_store: Path) -> None:
    app = make_app(tiny_store)
    async with app.run_test(size=(80, 24)) as pilot:
        await press(app, pilot, "V")
        assert "room for one view" in message(app)
        assert not app.session.state.fills_screen


@pytest.mark.parametrize("name", ["map", "umap", "compare", "list", "overview"])
async def test_the_mouse_describes_the_instance_under_it(tiny_store: Path, name: str) -> None:
    app = make_app(tiny_store)
    async with app.run_test(size=(120, 40)) as pilot:
        await press(app, pilot, "c", BY_NAME[name].key)
        scene, plot = app.renderer.scene, app.query_one(f"#{name}", PlotView)
        view = BY_NAME[name]
        panel = app.brush.panels(view)[0]
        cells = [
            (column, row)
            for row in range(panel.y, panel.y + panel.height)
            for column in range(panel.x, panel.x + panel.width)
        ]
        found = {
            cell: iid
            for cell in cells
            if (iid := view.instance_at(scene, panel, (cell[0] + 0.5, cell[1] + 0.5))) is not None
        }
        cell, iid = next((c, i) for c, i in found.items() if i != app.session.state.cursor)
        await pilot.hover(plot, offset=(cell[0], cell[1] + app.renderer.title_rows(name)))
        await settle(app, pilot)
        assert message(app) == instance_text(app.session.store, app.session.state, iid)
        assert message(app).startswith(f"#{iid} ")
        await pilot.hover("#keys")
        await settle(app, pilot)
        assert not message(app).startswith(f"#{iid} ")


async def test_the_instance_under_the_mouse_is_drawn_there(tiny_store: Path) -> None:
    app = make_app(tiny_store)
    async with app.run_test(size=(120, 40)) as pilot:
        await press(app, pilot, "c", "2")
        view, scene = BY_NAME["map"], app.renderer.scene
        panel = app.brush.panels(view)[0]
        points = view.points(scene, panel)  # type: ignore[attr-defined]
        for iid in range(len(points)):
            cell = panel.to_cells(*points[iid])
            near = view.instance_at(scene, panel, cell)
            assert near is not None
            distance = np.hypot(*(points[near] - points[iid]))
            assert distance == pytest.approx(0, abs=1e-9)


async def test_moving_the_cursor_shows_its_errors(tiny_store: Path) -> None:
    app = make_app(tiny_store)
    async with app.run_test(size=SIZE) as pilot:
        await press(app, pilot, "c", "n")
        state = app.session.state
        assert state.cursor is not None
        real = app.session.store.run_columns(state.run).real.error[state.cursor]
        assert message(app).startswith(f"#{state.cursor} ")
        assert f"real {real:.2f} m, gap " in message(app)


async def test_home_and_end_go_to_the_ends_of_the_list(tiny_store: Path) -> None:
    app = make_app(tiny_store)
    async with app.run_test(size=SIZE) as pilot:
        await press(app, pilot, "w", "8", "end")
        session = app.session
        rows = instance_list.order(session.store, session.state, session.notes)
        assert session.state.cursor == rows[-1]
        await press(app, pilot, "home")
        assert session.state.cursor == rows[0]
        await press(app, pilot, "2", "end")
        assert session.state.cursor == np.flatnonzero(session.state.selected)[-1]


async def test_sorting_keeps_the_cursor_on_the_screen(tiny_store: Path) -> None:
    app = make_app(tiny_store)
    async with app.run_test(size=(80, 12)) as pilot:
        await press(app, pilot, "c", "8", "end")
        cursor = app.session.state.cursor
        for key in (".", "comma", ".", ".", "comma"):
            await press(app, pilot, key)
            assert app.session.state.cursor == cursor
            panel = app.brush.panels(BY_NAME["list"])[0]
            rows = [
                BY_NAME["list"].instance_at(app.renderer.scene, panel, (1.5, row + 0.5))
                for row in range(panel.y, panel.y + panel.height)
            ]
            assert cursor in rows


async def test_a_drawn_brush_becomes_a_lasso_and_a_box_again(tiny_store: Path) -> None:
    app = make_app(tiny_store)
    async with app.run_test(size=SIZE) as pilot:
        await press(app, pilot, "c", "x", "Z", "Z")
        box = app.session.state.brush
        assert box is not None
        await press(app, pilot, "L")
        lasso = app.session.state.brush
        assert lasso is not None
        assert lasso.mark.lasso
        corners = {(x, y) for x in (p[0] for p in box.mark.points) for y in
                   (p[1] for p in box.mark.points)}  # fmt: skip
        assert set(lasso.mark.points) == corners
        await press(app, pilot, "L")
        again = app.session.state.brush
        assert again is not None
        assert not again.mark.lasso
        assert {p[0] for p in again.mark.points} == {p[0] for p in box.mark.points}
        await press(app, pilot, "L", "enter")
        by_lasso = app.session.state.selected
        await press(app, pilot, "u")
        app.session.set_state(app.session.state)
        assert app.session.state.expression == "all"
        x, y = zip(*box.mark.points, strict=True)
        by_box = app.session.select(f"box({min(x)}, {min(y)}, {max(x)}, {max(y)})").selected
        assert np.count_nonzero(by_lasso != by_box) <= 1  # an instance on the border
        assert by_lasso.any()
