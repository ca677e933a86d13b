"""Write files (the screen as PNG, a report, the selected rows) and copy to the clipboard."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from s2rstore.errors import RequestError, S2RError
from s2rstore.reader import Store
from s2rtui.export.exclusive_files import create_exclusive, numbered_paths
from s2rtui.session import shared_selection
from s2rtui.session.evaluation import query_of
from s2rtui.session.session import Session
from s2rtui.session.state import State
from s2rtui.user_data.notebook import Notes

if TYPE_CHECKING:
    from s2rtui.app.app import S2RApp

ROW_FORMATS = (".csv", ".json", ".parquet")
_REPORT = ".html"
WriteFile = Callable[[Path], str]
"""Writes a file; the text it returns follows the file's name in the message."""


class ExportController:
    """Writes numbered files in background threads; never replaces a file."""

    def __init__(self, app: S2RApp) -> None:
        self._app = app
        self._in_progress: set[Path] = set()
        self.safe_csv = False
        """Whether cells of a CSV file are written so that spreadsheets run no formula."""

    def _show(self, text: str, finished: Path | None = None, is_error: bool = False) -> None:
        """Show how far an export is; `finished` is its target once it is written or has failed."""
        if finished is not None:
            self._in_progress.discard(finished)
        if text:
            self._app.session.show_message(text, is_error)
            self._app.updater.refresh_message()

    def copy_expression(self) -> None:
        """Copy the expression to the terminal's clipboard, by the control sequence OSC 52."""
        session = self._app.session
        saved = shared_selection.current_selection(session.state)
        text = shared_selection.shared_text(saved, session.store.identity)
        self._app.copy_to_clipboard(text)
        session.show_message("copied the expression, with run, generation and count")

    def write_screenshot(self) -> None:
        """Write the screen as PNG; it is taken now and encoded in the background."""
        from s2rtui.export.screenshot import Screenshot

        screen = Screenshot.of(self._app.screen)
        options = self._app.render_options

        def write(path: Path) -> str:
            path.write_bytes(screen.png(options))
            return ""

        self._export_numbered("s2r", ".png", write)

    def write_report(self) -> None:
        """Write the saved selections, or the present one if none is saved, as HTML."""
        if any(path.suffix == _REPORT for path in self._in_progress):
            self._app.session.show_message("a report is being written")
            return
        session = self._app.session
        write = partial(self._report, session.branch(), session.state, session.notes)
        self._export_numbered("s2r-report", _REPORT, write, "writing a report")

    def _report(self, session: Session, state: State, notes: Notes, path: Path) -> str:
        """Runs in a background thread."""
        from s2rtui.export.report.build_report import session_report
        from s2rtui.export.report.report_model import ReportRequest, RequestedSelection, saved

        selections = saved(notes) or (RequestedSelection(state.expression),)
        runs = () if notes.selections else (state.run,)
        request = ReportRequest(
            selections, runs, state.trajectories, with_trained=state.with_trained
        )
        path.write_bytes(session_report(session, request, self._report_progress))
        return ""

    def _report_progress(self, done: int, total: int, step: str) -> None:
        if not self._app.is_running:
            raise RequestError("the application was closed")
        if step:
            self._app.run_on_ui(self._show, f"report: {done} of {total}, {step}")

    def ask_selection_file(self) -> None:
        """Ask for a file name and write the selected rows there.

        Raises RequestError if nothing may be written.
        """
        name = self.free_path("s2r-selection", ".csv").name
        hint = f"a file for the selection: {', '.join(ROW_FORMATS)}"
        self._app.session.show_message(hint)
        self._app.prompt.ask(self.write_selection, name, hint)

    def write_selection(self, text: str) -> None:
        """Write the selected rows; raises RequestError for a file that may not be written."""
        target = self._path_of(text.strip())
        if target.suffix not in ROW_FORMATS:
            raise RequestError(f"{text}: must end in {', '.join(ROW_FORMATS)}")
        self._app.access.require_writable(target)
        if target.exists():
            raise RequestError(f"{target}: exists already")
        if target in self._in_progress:
            raise RequestError(f"{target}: is being written")
        session = self._app.session
        session.show_message(f"writing {target}")
        self._export(target, partial(self._rows, session.store, session.state, session.notes))

    def _path_of(self, text: str) -> Path:
        """The path of a typed name; raises RequestError if it is not a path."""
        try:
            target = self._app.output_folder / Path(text).expanduser()
            with suppress(OSError):
                target.lstat()
        except (RuntimeError, ValueError) as error:  # unknown home folder, or a NUL character
            raise RequestError(f"{text!r}: is not a path ({error})") from error
        return target

    def _rows(self, store: Store, state: State, notes: Notes, path: Path) -> str:
        """Runs in a background thread."""
        from s2rtui.export.rows import selected_rows, write_rows

        query = query_of(store, state, notes)
        rows = selected_rows(store, query, notes)
        write_rows(path, rows.names, rows.rows, rows.facts, self.safe_csv)
        return f": {query.count_text} instances"

    def free_path(self, stem: str, suffix: str) -> Path:
        """The first free numbered path; raises RequestError if nothing may be written."""
        paths = numbered_paths(self._app.output_folder, stem, suffix)
        free = (path for path in paths if not path.exists() and path not in self._in_progress)
        return self._app.access.require_writable(next(free))

    def _export_numbered(self, stem: str, suffix: str, write: WriteFile, message: str = "") -> None:
        """Write the next numbered file, or show why it may not be written."""
        try:
            target = self.free_path(stem, suffix)
        except (OSError, RequestError) as error:
            self._app.session.show_message(_reason(error), is_error=True)
        else:
            self._app.session.show_message(message)
            self._export(target, write, numbered_paths(self._app.output_folder, stem, suffix))

    def _export(self, target: Path, write: WriteFile, alternatives: Iterable[Path] = ()) -> None:
        """Write a file in a background thread; `alternatives` are used if the name is taken."""
        self._in_progress.add(target)
        work = partial(self._write, target, write, alternatives)
        self._app.jobs.start(work, f"{target} is not written")

    def _write(self, target: Path, write: WriteFile, alternatives: Iterable[Path]) -> None:
        """Runs in a background thread."""
        text, is_error = "", True
        try:
            path, summary = create_exclusive(target, write, alternatives)
            text, is_error = f"wrote {path}{summary}", False
        except (S2RError, OSError) as error:
            if not self._app.is_running:
                raise
            text = _reason(error)
        finally:
            self._app.run_on_ui(self._show, text, target, is_error)


def _reason(error: Exception) -> str:
    if isinstance(error, OSError) and error.filename:
        return f"{error.filename}: {error.strerror}"
    return str(error)
