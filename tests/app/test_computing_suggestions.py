"""Keys of the view of suggestions that compute what it lacks."""

import threading
from collections.abc import Iterator, Sequence
from types import SimpleNamespace

from s2rstore.files.planned_poses import read_planned_poses
from s2rtui.app.controllers import suggestions
from s2rtui.app.pilot import settle, take_screenshot
from s2rtui.jobs.command_job import JobProgress
from tests.support.application import press, running


async def test_poses_of_new_images_are_chosen_and_shown(tiny_store, tmp_path):
    async with running(tiny_store) as (app, pilot):
        app.output_folder = tmp_path
        await press(app, pilot, "J", "backslash")
        while not app.session.state.planned:
            await pilot.pause(0.05)
            assert not app.session.state.is_error, app.session.state.message
        await settle(app, pilot)
        planned = read_planned_poses(next(tmp_path.glob("*.csv")))
        assert app.session.state.planned == planned
        text = " ".join(take_screenshot(app).text.split())
        assert f"{len(planned)} poses of new images for run vanilla, on the map" in text


async def test_both_searches_run_one_after_the_other_and_the_key_cancels(
    few_pairs_store, monkeypatch
):
    started: list[str] = []

    class Job:
        def __init__(
            self, name: str, arguments: Sequence[str], stages: None, successes: Sequence[int]
        ) -> None:
            self.side, self.cancelled = arguments[-1], threading.Event()
            started.append(self.side)
            assert tuple(successes) == (0, 3)

        def follow(self) -> Iterator[JobProgress]:
            yield JobProgress(None, "search 1/9")
            is_cancelled = self.side == "sim" and self.cancelled.wait(60)
            yield JobProgress(None, "", "cancelled" if is_cancelled else "done")

        def cancel(self) -> None:
            self.cancelled.set()

    monkeypatch.setattr(suggestions, "CommandJob", Job)
    report = SimpleNamespace(best=None, verdict="nothing helps")
    monkeypatch.setattr(suggestions, "read_report", lambda *_: report)
    async with running(few_pairs_store, with_trained=True) as (app, pilot):
        await pilot.press("J", "S")
        while app.computation.running and len(started) < 2:
            await pilot.pause(0.01)
        await pilot.press("S")
        await settle(app, pilot)
        assert started == ["real", "sim"]
        assert app.session.state.message == "s2r suggest --for sim: cancelled"
        assert not app.computation.running
