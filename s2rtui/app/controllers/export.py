"""What leaves the application as a file: the screen, a report, the selection's rows."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from textual.message import Message

from s2rstore.errors import RequestError, S2RError
from s2rstore.reader import Store
from s2rtui.app.controllers.prompt import Prompts
from s2rtui.export.exclusive_files import create_exclusive, numbered_paths
from s2rtui.session import State
from s2rtui.user_data.notebook import Notes

FORMS = (".csv", ".json", ".parquet")
_REPORT = ".html"
Fill = Callable[[Path], str]
"""Fills a file; what it gives is told after the file's name."""


class Papers(Prompts):
    """Files are numbered, never replaced, and written where the session may write."""

    files_at: Path
    safe_csv = False

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self._filing: set[Path] = set()

    @dataclass
    class Filed(Message):
        """How far a file is; `done` is the name under which it is written, or failed."""

        text: str
        done: Path | None = None
        is_error: bool = False

    def on_papers_filed(self, message: Filed) -> None:
        if message.done is not None:
            self._filing.discard(message.done)
        if message.text:
            self.session.tell(message.text, message.is_error)
            self.show_message()

    def _free(self, stem: str, suffix: str) -> Path:
        """The first name that is free. Raises RequestError where nothing may be written."""
        names = numbered_paths(self.files_at, stem, suffix)
        free = (name for name in names if not name.exists() and name not in self._filing)
        return self.access.require_writable(next(free))

    def action_snapshot(self) -> None:
        """Write the screen as PNG beside earlier ones."""
        from s2rtui.app.pilot import screen_png

        try:
            target = self._free("s2r", ".png")
            png = screen_png(self)
            others = numbered_paths(self.files_at, "s2r", ".png")
            made, _ = create_exclusive(target, lambda path: path.write_bytes(png), others)
        except (OSError, RequestError) as error:
            self.session.tell(_reason(error), is_error=True)
        else:
            self.session.tell(f"wrote {made}")
        self.refresh_views()

    def action_report(self) -> None:
        """Write the saved selections, or the present one where none is saved, as HTML."""
        if any(path.suffix == _REPORT for path in self._filing):
            self.session.tell("a report is being written")
        else:
            try:
                target = self._free("s2r-report", _REPORT)
            except RequestError as error:
                self.session.tell(str(error), is_error=True)
            else:
                self.session.tell("writing a report")
                state, notes = self.session.state, self.session.notes
                work = partial(self._report, self.session.store.path, state, notes)
                self._begin_file(target, work, numbered_paths(self.files_at, "s2r-report", _REPORT))
        self.show_message()

    def _report(self, store: Path, state: State, notes: Notes, path: Path) -> str:
        """In a thread of its own."""
        from s2rtui.export.report.build_report import render_report
        from s2rtui.export.report.report_request import ReportRequest, RequestedSelection, saved

        asked = saved(notes) or (RequestedSelection(state.expression),)
        runs = () if notes.selections else (state.run,)
        request = ReportRequest(asked, runs, state.trajectories)
        path.write_bytes(render_report(store, request, self._going_on))
        return ""

    def _going_on(self, done: int, total: int, what: str) -> None:
        if not self.is_running:
            raise RequestError("the application was left")
        if what:
            self.post(self.Filed(f"report: {done} of {total}, {what}"))

    def action_write_selection(self) -> None:
        try:
            name = self._free("s2r-selection", ".csv").name
        except RequestError as error:
            self.refuse(error)
            return
        hint = f"a file for the selection: {', '.join(FORMS)}"
        self.session.tell(hint)
        self._ask(self._write_selection, name, hint)
        self.show_message()

    def _write_selection(self, text: str) -> None:
        """Raises RequestError where the file exists, may not be written, or has another end."""
        target = self._target(text.strip())
        if target.suffix not in FORMS:
            raise RequestError(f"{text}: must end in {', '.join(FORMS)}")
        self.access.require_writable(target)
        if target.exists():
            raise RequestError(f"{target}: is there already")
        if target in self._filing:
            raise RequestError(f"{target}: is being written")
        self.session.tell(f"writing {target}")
        session = self.session
        self._begin_file(target, partial(self._write, session.store, session.state, session.notes))

    def _target(self, text: str) -> Path:
        """The file that is meant. Raises RequestError for what is no path."""
        try:
            target = self.files_at / Path(text).expanduser()
            with suppress(OSError):
                target.lstat()
        except (RuntimeError, ValueError) as error:  # whose home is not known; no text of a path
            raise RequestError(f"{text!r}: is no path ({error})") from error
        return target

    def _write(self, store: Store, state: State, notes: Notes, path: Path) -> str:
        """In a thread of its own."""
        from s2rtui.export.rows.formats import write_rows
        from s2rtui.export.rows.selected_instances import selected_rows

        asked = state.expression, state.run, state.trajectories, notes
        found = selected_rows(store, *asked, selected=state.selected)
        write_rows(path, found.names, found.rows, found.facts.as_dict(), self.safe_csv)
        return f": {found.facts.count} instances"

    def _begin_file(self, target: Path, fill: Fill, others: Iterable[Path] = ()) -> None:
        """Have a file filled, and tell of it what `fill` says."""
        self._filing.add(target)
        work = partial(self._fill_file, target, fill, others)
        self.in_background(work, f"{target} is not written")

    def _fill_file(self, target: Path, fill: Fill, others: Iterable[Path]) -> None:
        """In a thread of its own."""
        told, is_error = "", True
        try:
            made, words = create_exclusive(target, fill, others)
            told, is_error = f"wrote {made}{words}", False
        except (S2RError, OSError) as error:
            if not self.is_running:
                raise
            told = _reason(error)
        finally:
            self.post(self.Filed(told, target, is_error))


def _reason(error: Exception) -> str:
    if isinstance(error, OSError) and error.filename:
        return f"{error.filename}: {error.strerror}"
    return str(error)
