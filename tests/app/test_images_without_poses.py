"""The application on a data set of images without poses."""

from pathlib import Path

import pytest

from s2rstore.index.catalog import NO_POSES
from s2rstore.records import Side
from s2rtools.datasets.writing.image_instances import ImageInstance, build_from_images
from s2rtui.app.key_bindings import ACTIONS
from s2rtui.app.pilot import settle, snapshot, take_screenshot
from s2rtui.canvas import RenderOptions
from s2rtui.charts.registry import VIEWS
from tests.support import image_folders
from tests.support.application import make_app, press, running


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return image_folders.image_store(tmp_path_factory.mktemp("images"))


def lines(images: Path, size: tuple[int, int], *keys: str) -> list[str]:
    return snapshot(images, size, keys, RenderOptions()).text.splitlines()


def test_screens_show_an_image_beside_the_list_and_its_neighbours(images):
    screen = lines(images, (40, 12))
    assert "14 of 14" in screen[0]
    assert any("3 instance  0" in line for line in screen)
    assert sum("▀" in line for line in screen) >= 4
    screen = lines(images, (120, 40), "down", "8", "down")
    assert "no runs" in screen[0]
    assert screen[1].startswith("8 list  14 of 14, by iid")
    assert "real_day" in screen[4]
    assert "▶" in screen[4]
    assert any("3 instance  1" in line for line in screen)
    screen = lines(images, (80, 24), "t", "t", "right", "right")
    assert "traj real_night" in screen[0]
    assert "3 of 3" in screen[0]
    assert any("where real_night 2" in line for line in screen)


async def test_views_and_selections_that_need_poses_say_so(images):
    async with running(images, size=(80, 24)) as (app, pilot):
        for view in (view for view in VIEWS if view.needs_poses and view.from_store):
            await press(app, pilot, view.key)
            screen = take_screenshot(app).text.splitlines()
            assert screen[1].startswith(f"{view.key} {view.name}")
            assert [line.strip() for line in screen[2:-2] if line.strip()] == [NO_POSES], view.name
        await press(app, pilot, "w")
        message = take_screenshot(app).text.splitlines()[-2]
        assert f"nothing is selected: {NO_POSES}" in message


def test_two_domains_of_one_moment_stand_side_by_side(tmp_path):
    picture = image_folders.picture(1, image_folders.REAL_SIZE)
    images = {"camera": picture, "mkl": 255 - picture}
    moments = (ImageInstance("bag", images, number / 30, f"image/{number}") for number in range(3))
    domains: dict[str, Side] = {"camera": "real", "mkl": "sim"}
    build_from_images(moments, domains, tmp_path / "bag.s2r", "bag", "s2r ros replay", 64)
    screen = lines(tmp_path / "bag.s2r", (80, 24), "right")
    titles = next(line for line in screen if "camera" in line)
    assert titles.index("mkl") < titles.index("camera")
    assert any("time 0.033 s" in line for line in screen)
    assert any("camera file image/1" in line for line in screen)


async def test_no_key_ends_the_application(images):
    """The first key of every action that leads to no other screen."""
    app = make_app(images)
    left_out = {"quit", "snapshot", "report", "doctor", "tour", "help", "copy"}
    elsewhere, messages = ("brushing", "adjust", "list", "suggestions"), {}
    async with app.run_test(size=(80, 24)) as pilot:
        await settle(app, pilot)
        for action in ACTIONS:
            if action.name in left_out or action.when in elsewhere:
                continue
            await pilot.press("c", "3")
            await settle(app, pilot)
            await press(app, pilot, action.keys[0])
            messages[action.name] = app.session.state.message
            await pilot.press("escape", "escape")
        await settle(app, pilot)
        assert app.fault is None
        assert not app.updater.scene.loaded.failed
        assert app.is_running
    assert {messages[a.name] for a in ACTIONS if a.needs_poses and a.name in messages} == {NO_POSES}
    assert "no runs" in messages["next_run"]
