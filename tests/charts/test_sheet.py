"""The sheet of thumbnails, and images of an instance: pages, pictures, zoom, divider."""

from dataclasses import replace

import numpy as np

from s2rstore.heatmap_kinds import NO_HEAT
from s2rtui.charts.instance import VIEW as INSTANCE
from s2rtui.charts.sheet import VIEW, sheet_page
from s2rtui.drawing.image import Image, ImageValues
from s2rtui.session import images, instance_list
from s2rtui.session.session import Session
from s2rtui.user_data.notebook import Notes, ReadNotebook
from tests.support.application import press, running


def test_a_page_shows_images_in_the_order_of_the_list(tiny_store, s2r, tmp_path):
    session = Session(tiny_store, notebooks=ReadNotebook)
    session.select("all")
    order = instance_list.order(session.store, session.state, Notes())
    session.set_cursor(int(order[14]))
    assert images.page(session.store, session.state).tolist() == order[12:24].tolist()
    iid = int(order[14])
    sides = [session.store.frame(side, iid).rgb.astype(int) for side in ("sim", "real")]
    expected = {"real": sides[1], "sim": sides[0], "difference": abs(sides[1] - sides[0])}
    for _ in expected:
        shown = sheet_page(session.store, session.state).images[iid]
        assert np.array_equal(shown.ground, expected[session.state.images.picture])
        session.dispatch(images.change_picture)
    heated = sheet_page(session.store, session.state)
    heat = session.state.shown_heat
    stored = session.store.heatmap(session.state.run, heat.kind, "real", iid, heat.mode)
    assert np.array_equal(heated.images[iid].overlay.values, stored)
    assert heated.bar is not None
    plain = replace(session.state, heat=replace(heat, kind=NO_HEAT))
    assert images.shown_picture(plain) == "real"
    words = "export", tiny_store, "--out", tmp_path / "sheet.png", "--images", "heat", "--view"
    for view, *heat_option in (("map",), ("sheet", "--heat", "none")):
        s2r(*words, view, *heat_option).assert_refused("--images heat")
    rows = s2r("show", tiny_store, "sheet", "--select", "worst(3, real.error)", "--json").json
    assert [row["iid"] for row in rows] == order[:3].tolist()


async def test_keys_turn_pages_and_enter_opens_the_instance(tiny_store):
    async with running(tiny_store, size=(80, 24)) as (app, pilot):
        await press(app, pilot, "c", "underscore")
        session = app.session
        order = instance_list.order(session.store, session.state, session.notes)
        await press(app, pilot, "home", "pagedown", "right")
        assert session.state.cursor == order[13]
        panels = app.brush.panels(VIEW)
        across = sum(panel.y == panels[0].y for panel in panels)
        await press(app, pilot, "down")
        assert session.state.cursor == order[13 + across]
        await press(app, pilot, "less_than_sign")
        assert len(app.brush.panels(VIEW)) == 6
        await press(app, pilot, "enter")
        assert session.state.view == "instance"
        assert app.loaded.pictures.iid == order[13 + across]


async def test_sides_blink_or_share_one_image_with_a_divider(tiny_store):
    async with running(tiny_store, size=(80, 24)) as (app, pilot):
        await press(app, pilot, "3", "backslash")
        before = app.session.state.images.front
        app.player.blink()
        plots = INSTANCE.drawing(app.updater.scene, 80).plots
        assert {plot.name.split()[0] for plot in plots} == {app.session.state.images.front}
        assert before != app.session.state.images.front
        await press(app, pilot, "backslash", "greater_than_sign")
        shown = INSTANCE.drawing(app.updater.scene, 80).plots[0].image.ground
        sides = [side.rgb for _, side in app.loaded.pictures.sides]
        split = round(0.6 * shown.shape[1])
        assert np.array_equal(shown[:, :split], sides[0][:, :split])
        assert np.array_equal(shown[:, split:], sides[1][:, split:])


async def test_zoom_shows_the_middle_of_both_images(tiny_store):
    async with running(tiny_store, size=(80, 24)) as (app, pilot):
        await press(app, pilot, "3", "z", "z")
        area = app.session.state.viewport_of("instance")
        plot = INSTANCE.drawing(app.updater.scene, 80).plots[0]
        size = app.loaded.pictures.sim.rgb.shape[0]
        assert plot.image.ground.shape[0] == round(area.height * size) < size
        for _ in range(9):
            await press(app, pilot, "shift+right")
        assert app.session.state.viewport_of("instance").x1 == 1.0
        await press(app, pilot, "0")
        assert app.session.state.viewport_of("instance") is None


def test_parts_of_images_hold_the_same_place_at_every_resolution():
    ground = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)
    over = ImageValues(np.arange(4.0).reshape(2, 2), (0.0, 4.0), "overlay")
    part = Image(ground, over).part((0.5, 0.0, 1.0, 0.5))
    assert np.array_equal(part.ground, ground[:2, 2:])
    assert (part.overlay.values == 1.0).all()
