"""What leaves the application as a file: the screen, a report, the selection's rows."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from textual.message import Message

from s2rstore.errors import RequestError, S2RError
from s2rstore.reader import Store
from s2rtui.notebook import Notes
from s2rtui.prompts import Prompts
from s2rtui.session import State

FORMS = (".csv", ".json", ".parquet")


class Papers(Prompts):
    """Files are numbered, never replaced, and written where the session may write."""

    files_at: Path
    _reporting = False

    @dataclass
    class Filed(Message):
        """How far a file is; `done` that it is written, or failed."""

        text: str
        done: bool = False
        is_error: bool = False

    def on_papers_filed(self, message: Filed) -> None:
        if message.done:
            self._reporting = False
        self.session.tell(message.text, message.is_error)
        self.show_message()

    def _next(self, stem: str, suffix: str) -> Path:
        """The first name that is free. Raises RequestError where nothing may be written."""
        number = 1
        while (target := self.files_at / f"{stem}-{number:03d}{suffix}").exists():
            number += 1
        return self.access.writable(target)

    def action_snapshot(self) -> None:
        """Write the screen as PNG beside earlier ones."""
        from s2rtui.headless import screen_png

        try:
            target = self._next("s2r", ".png")
            target.write_bytes(screen_png(self))
        except (OSError, RequestError) as error:
            self.session.tell(_reason(error), is_error=True)
        else:
            self.session.tell(f"wrote {target}")
        self.refresh_views()

    def action_report(self) -> None:
        """Write the saved selections, or the present one where none is saved, as HTML."""
        if self._reporting:
            self.session.tell("a report is being written")
        else:
            try:
                target = self._next("s2r-report", ".html")
            except RequestError as error:
                self.session.tell(str(error), is_error=True)
            else:
                self._reporting = True
                self.session.tell("writing a report")
                state, notes = self.session.state, self.session.notes
                work = partial(self._report, self.session.store.path, state, notes, target)
                self.in_background(work, f"{target} is not written")
        self.show_message()

    def _report(self, store: Path, state: State, notes: Notes, target: Path) -> None:
        """In a thread of its own."""
        from s2rtui.report import Asked, Request, report, saved

        asked = saved(notes) or (Asked(state.expression),)
        runs = () if notes.selections else (state.run,)
        request = Request(asked, runs, state.trajectories)
        try:
            target.write_bytes(report(store, request, self._going_on))
        except (S2RError, OSError) as error:
            if not self.is_running:
                raise
            self.post(self.Filed(_reason(error), True, True))
        else:
            self.post(self.Filed(f"wrote {target}", True))

    def _going_on(self, done: int, total: int, what: str) -> None:
        if not self.is_running:
            raise RequestError("the application was left")
        if what:
            self.post(self.Filed(f"report: {done} of {total}, {what}"))

    def action_write_selection(self) -> None:
        try:
            name = self._next("s2r-selection", ".csv").name
        except RequestError as error:
            self.refuse(error)
            return
        hint = f"a file for the selection: {', '.join(FORMS)}"
        self.session.tell(hint)
        self._ask(self._write_selection, name, hint)
        self.show_message()

    def _write_selection(self, text: str) -> None:
        """Raises RequestError where the file exists, may not be written, or has another end."""
        target = self.files_at / Path(text.strip()).expanduser()
        if target.suffix not in FORMS:
            raise RequestError(f"{text}: must end in {', '.join(FORMS)}")
        self.access.writable(target)
        if target.exists():
            raise RequestError(f"{target}: is there already")
        self.session.tell(f"writing {target}")
        session = self.session
        work = partial(self._write, session.store, session.state, session.notes, target)
        self.in_background(work, f"{target} is not written")

    def _write(self, store: Store, state: State, notes: Notes, target: Path) -> None:
        """In a thread of its own."""
        from s2rtui.rows.formats import save
        from s2rtui.rows.picked import picked

        beside = target.with_name(f".{os.getpid()}.{target.name}")
        try:
            found = picked(store, state.expression, state.run, state.trajectories, notes)
            save(beside, found.names, found.rows, found.facts.told())
            beside.replace(target)
        except (S2RError, OSError) as error:
            beside.unlink(missing_ok=True)
            told = _reason(error).replace(str(beside), str(target))
            self.post(self.Filed(told, is_error=True))
        else:
            self.post(self.Filed(f"wrote {target}: {found.facts.count} instances"))


def _reason(error: Exception) -> str:
    if isinstance(error, OSError) and error.filename:
        return f"{error.filename}: {error.strerror}"
    return str(error)
