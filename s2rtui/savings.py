"""Runs on their way into the store, followed by worker threads until they are published."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

from textual.message import Message

from s2rstore.errors import S2RError
from s2rtui.desk import Desk
from s2rtui.saving import Progress, Saving


class Savings(Desk):
    """The runs that this application has begun to save."""

    @dataclass
    class Told(Message):
        """How far a run is."""

        run: str
        progress: Progress

    def begin_saving(self, name: str, start: Callable[[], Saving]) -> None:
        """Show how far a run is, and move on to its generation once it is published."""
        self.session.tell(f"run {name}: checking")
        self.run_worker(partial(self._listen, name, start), thread=True, group=f"saving {name}")

    def _listen(self, name: str, start: Callable[[], Saving]) -> None:
        try:
            saving = start()
        except (S2RError, OSError) as error:
            failed = Progress(0.0, "", "failed", str(error))
            self.post_message(self.Told(name, failed))
            return
        for progress in saving.follow():
            if not self.is_running:
                return
            self.post_message(self.Told(saving.run, progress))

    def on_savings_told(self, message: Told) -> None:
        run, progress = message.run, message.progress
        if progress.is_running:
            told = f"run {run}: {progress.fraction:.0%}, {progress.stage}"
            self.resources = replace(self.resources, saving=told)
            self.show_message()
            return
        self.resources = replace(self.resources, saving="")
        if progress.outcome == "done":
            try:
                self.session.move_on()
                self.session.tell(f"run {run} is saved: r turns to it")
            except S2RError as error:
                self.session.tell(str(error), is_error=True)
        else:
            why = progress.error or progress.outcome
            self.session.tell(f"run {run}: {why}", is_error=progress.outcome == "failed")
        self.refresh_views()
