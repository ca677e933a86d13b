"""The focused view: zoom, full screen, the instance under the mouse, first and last instance."""

import numpy as np

from s2rtui.app.app import S2RApp
from s2rtui.app.controllers.hover import instance_text
from s2rtui.app.pilot import settle
from s2rtui.app.status_line import TextBar
from s2rtui.app.widgets.plot import PlotView
from s2rtui.charts.registry import BY_NAME
from s2rtui.session import instance_list
from tests.support.application import press, running

SIZE = (120, 40)


def message(app: S2RApp) -> str:
    return str(app.query_one("#message", TextBar).render())


def shown(app: S2RApp) -> set[str]:
    return {str(view.id) for view in app.query(PlotView) if view.placed and view.region.area}


def instance_cells(app: S2RApp, name: str) -> dict[int, tuple[int, int]]:
    """A cell of each instance that a view shows, as column and row of its widget."""
    view, top = BY_NAME[name], app.updater.title_rows(name)
    panel = app.brush.panels(view)[0]
    return {
        iid: (column, row + top)
        for row in range(panel.y, panel.y + panel.height)
        for column in range(panel.x, panel.x + panel.width)
        if (iid := view.instance_at(app.updater.scene, panel, (column + 0.5, row + 0.5)))
        is not None
    }


async def test_zoom_and_pan_keys_move_the_focused_view_alone(tiny_store):
    async with running(tiny_store, size=SIZE) as (app, pilot):
        view, size = BY_NAME["umap"], (80, 20)
        await press(app, pilot, "c", "4")
        panels = [view.panels(app.updater.scene, size, app.render_options)[0]]
        await press(app, pilot, "z")
        panels.append(view.panels(app.updater.scene, size, app.render_options)[0])
        points = view.points(app.updater.scene, panels[1])  # type: ignore[attr-defined]
        inside = [
            sum(panel.holds(*map(int, panel.to_cells(*point))) for point in points)
            for panel in panels
        ]
        assert inside[1] < inside[0]
        state = app.session.state
        closer = state.viewport_of("umap")
        assert state.viewport is None
        assert "umap enlarged 1.67 times" in message(app)
        await press(app, pilot, "shift+right")
        moved = app.session.state.viewport_of("umap")
        assert moved.x0 > closer.x0
        await press(app, pilot, "2", "z")
        assert app.session.state.viewport is not None
        await press(app, pilot, "4", "0")
        assert app.session.state.viewport_of("umap") is None
        assert app.session.state.viewport is not None


async def test_a_view_fills_the_screen_and_the_layout_comes_back(tiny_store):
    async with running(tiny_store, size=SIZE) as (app, pilot):
        await press(app, pilot, "3")
        before = shown(app)
        await press(app, pilot, "V")
        assert shown(app) == {"instance"}
        assert app.query_one("#instance", PlotView).size.width == SIZE[0]
        await press(app, pilot, "2")
        assert shown(app) == {"map"}
        await press(app, pilot, "V")
        assert shown(app) == before


async def test_keys_that_change_nothing_say_why(tiny_store):
    async with running(tiny_store, size=(80, 24)) as (app, pilot):
        await press(app, pilot, "7", "z")
        assert "errors cannot be zoomed (2 map, 3 instance, 4 umap" in message(app)
        assert app.session.state.viewports == ()
        await press(app, pilot, "V")
        assert "room for one view" in message(app)
        assert not app.session.state.fills_screen


async def test_the_mouse_describes_the_instance_under_it(tiny_store):
    async with running(tiny_store) as (app, pilot):
        for name in ("map", "umap", "compare", "list", "overview"):
            await press(app, pilot, "c", BY_NAME[name].key)
            cells = instance_cells(app, name)
            iid = next(iid for iid in cells if iid != app.session.state.cursor)
            await pilot.hover(f"#{name}", offset=cells[iid])
            await settle(app, pilot)
            assert message(app) == instance_text(app.session.store, app.session.state, iid), name
            assert message(app).startswith(f"#{iid} "), name
            await pilot.hover("#keys")
            await settle(app, pilot)
            assert not message(app).startswith(f"#{iid} "), name


async def test_home_and_end_go_to_the_ends_of_the_list_and_show_errors(tiny_store):
    async with running(tiny_store, size=(80, 24)) as (app, pilot):
        await press(app, pilot, "w", "8", "end")
        session = app.session
        rows = instance_list.order(session.store, session.state, session.notes)
        assert session.state.cursor == rows[-1]
        real = session.store.run_columns(session.state.run).real.error[rows[-1]]
        assert message(app).startswith(f"#{rows[-1]} ")
        assert f"real {real:.2f} m, gap " in message(app)
        await press(app, pilot, "home")
        assert session.state.cursor == rows[0]
        await press(app, pilot, "2", "end")
        assert session.state.cursor == np.flatnonzero(session.state.selected)[-1]


async def test_a_drawn_brush_becomes_a_lasso_and_a_box_again(tiny_store):
    async with running(tiny_store, size=SIZE) as (app, pilot):
        await press(app, pilot, "c", "x", "Z", "Z")
        box = app.session.state.brush
        await press(app, pilot, "L")
        lasso = app.session.state.brush
        assert lasso.mark.lasso
        corners = {(x, y) for x in (p[0] for p in box.mark.points) for y in
                   (p[1] for p in box.mark.points)}  # fmt: skip
        assert set(lasso.mark.points) == corners
        await press(app, pilot, "L")
        again = app.session.state.brush
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


async def test_a_message_shows_while_the_mouse_rests_on_an_instance(tiny_store):
    async with running(tiny_store, size=SIZE) as (app, pilot):
        await press(app, pilot, "c", BY_NAME["map"].key)
        cells = instance_cells(app, "map")
        first, second = list(cells)[:2]
        await pilot.hover("#map", offset=cells[first])
        await settle(app, pilot)
        assert message(app).startswith(f"#{first} ")
        for iid in (second, first):  # the second message has the same text
            app.session.select("none")
            app.updater.refresh()
            assert message(app).startswith("nothing is selected")
            await pilot.hover("#map", offset=cells[iid])
            await settle(app, pilot)
            assert message(app).startswith(f"#{iid} ")
