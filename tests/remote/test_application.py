"""The application on a store on a web server: equal screens, messages in place of tracebacks."""

import shutil
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

import pytest
from textual.pilot import Pilot

from bench.support.store_server import wait_for
from s2rstore.errors import RequestError
from s2rstore.files import layout
from s2rstore.gap_history import reader, writer
from s2rstore.index.transaction import edit
from s2rstore.remote.store_url import parse_url
from s2rtui.app.app import S2RApp
from s2rtui.app.pilot import settle, take_screenshot
from s2rtui.app.widgets.plot import PlotView
from tests.support import gaps
from tests.support.application import press, running

HEAT = "runs.zarr/vanilla/key0/"


@asynccontextmanager
async def opened(
    url: str, size: tuple[int, int] = (120, 40)
) -> AsyncIterator[tuple[S2RApp, Pilot[None]]]:
    """Run the application of a URL, which looks for changes each time that it is told to."""
    async with running(parse_url(url), size=size) as (app, pilot):
        app.store_updates.remote_check_seconds = 0.0
        yield app, pilot
    assert app.fault is None


async def until(condition: Callable[[], bool], pilot: Pilot[None]) -> None:
    """Let the application work until a condition is true, for half a minute at most."""
    for _ in range(3000):
        if condition():
            return
        await pilot.pause(0.01)
    raise AssertionError("the application did not get there")


async def test_a_cut_connection_is_a_message_and_no_end(served):
    async with opened(served.url, size=(160, 48)) as (app, pilot):
        served.server.fail(HEAT, "cut")
        await pilot.press("3", "n", "h")
        await settle(app, pilot)
        state = app.session.state
        assert state.is_error
        assert "the connection was cut; try again" in state.message
        assert served.url in state.message
        assert "the connection was cut" in take_screenshot(app).text
        served.server.heal()
        await press(app, pilot, "n")
        assert not app.session.state.is_error
        assert app.query_one("#instance", PlotView)


async def test_an_unreachable_server_is_a_message_until_it_is_back(served):
    async with opened(served.url) as (app, pilot):
        served.server.fail(layout.CURRENT, "denied")
        app.store_updates.check_store()
        await until(lambda: app.session.state.is_error, pilot)
        assert "access denied" in app.session.state.message
        served.server.heal()
        app.store_updates.check_store()
        await until(lambda: not app.session.state.is_error, pilot)


async def test_a_slow_server_does_not_stop_the_keys(served, monkeypatch):
    # No check but this test's own: on a slow machine one at an interval comes before it.
    monkeypatch.setattr("s2rtui.app.app.CHECK_SECONDS", 3600.0)
    async with opened(served.url) as (app, pilot):
        served.server.fail(layout.CURRENT, "slow", times=1)
        served.server.requests.clear()

        def checks() -> int:
            return sum(path.endswith(layout.CURRENT) for _, path in served.server.requests)

        app.store_updates.check_store()
        assert wait_for(checks)
        await pilot.press("w")
        await pilot.pause()
        assert app.session.state.expression == "worst15"
        app.store_updates.check_store()  # one check at a time
        assert checks() == 1
        served.server.released.set()


async def test_a_new_generation_and_history_are_noticed_and_followed(served, tmp_path):
    async with opened(served.url) as (app, pilot):
        before = app.session.state.generation
        assert app.session.state.history is None
        with edit(served.path) as draft:
            draft.set_provenance("test", {"key": "value"})
        history = tmp_path / "gap.jsonl"
        writer.append(history, gaps.night(1, {"task": 5.0}))
        target = reader.history_path(served.path)
        target.parent.mkdir()
        shutil.copy(history, target)
        app.store_updates.check_store()
        await until(lambda: app.session.state.newest == before + 1, pilot)
        assert app.session.state.history is not None
        await until(lambda: app.session.state.generation == before + 1, pilot)
        await settle(app, pilot)
        assert app.session.store.provenance("test") == {"key": "value"}
        assert not app.session.state.is_error


async def test_no_run_is_saved_on_a_server(served):
    async with opened(served.url) as (app, _):
        with pytest.raises(RequestError, match="a store on a server is only read"):
            app.adjust.save("brighter", lambda: pytest.fail("nothing may start"))


def test_a_restricted_session_opens_no_url(served, s2r):
    s2r("tui", served.url, "--restricted").assert_refused("reads only a store in a folder")
    assert not served.server.requests
