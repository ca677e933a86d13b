"""Compute suggestions and poses of new images, which the view of suggestions shows."""

from __future__ import annotations

import math
import shlex
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.files.planned_poses import read_planned_poses
from s2rstore.records import Side
from s2rstore.suggestions import read_report
from s2rtui.charts.suggestions import VIEW, search_arguments
from s2rtui.jobs.command_job import CommandJob
from s2rtui.session import view_settings

if TYPE_CHECKING:
    from s2rtui.app.app import S2RApp

_SEARCH = "s2r suggest"
_NOTHING_HELPS = 3
"""Exit code of a search whose answer is that no change helps."""


class SuggestionsController:
    """Starts `s2r suggest` and `s2r collect` for the present run; a second key press cancels."""

    def __init__(self, app: S2RApp) -> None:
        self._app = app

    def search(self) -> None:
        """Search the answers of the present run that the store lacks, or cancel the search."""
        session, computation = self._app.session, self._app.computation
        if computation.running.startswith(_SEARCH):
            computation.cancel()
            return
        missing = VIEW.missing_sides(self._app.updater.scene)
        if missing:
            self._search(session.state.run, missing)
        else:
            session.show_message("both searches are stored; enter applies an answer")

    def _search(self, run: str, sides: tuple[Side, ...]) -> None:
        """Search for the first of some sides, and then for the others."""
        arguments = search_arguments(self._app.session.store.path, run, sides[0])
        start = partial(
            CommandJob, f"suggestions for {run}", arguments, None, (0, _NOTHING_HELPS)
        )  # fmt: skip
        missing = f"suggestions are missing: `{shlex.join(['s2r', *arguments])}` computes them"
        done = partial(self._searched, run, sides[0], sides[1:])
        self._app.computation.start(f"{_SEARCH} --for {sides[0]}", start, missing, done)

    def _searched(self, run: str, side: Side, others: tuple[Side, ...]) -> None:
        self._app.session.open_newest_generation()
        with s2rstore.open(self._app.session.store.path) as store:
            report = read_report(store, run, side)
        if report is None:
            raise RequestError(
                f"run {run}, --for {side}: the time was used up before the search found an answer; "
                f"`s2r suggest --for {side} --budget 30m` takes more"
            )
        found = report.verdict if report.best is None else f"answer {report.best + 1} helps"
        message = f"run {run}, --for {side}: {found}"
        if others:
            self._search(run, others)
            message += f"; --for {others[0]} is being searched (S: cancel)"
        self._app.session.show_message(message)

    def collect(self) -> None:
        """Choose poses of new images for the present run, and show them on the map."""
        session, run = self._app.session, self._app.session.state.run
        session.store.require_poses("collect")
        path = self._app.export.free_path("poses", ".csv")
        store = session.store.path.absolute()
        arguments = ["collect", str(store), "--run", run, "--out", str(path)]
        start = partial(CommandJob, f"poses for {run}", arguments)
        missing = f"{path} is missing: `{shlex.join(['s2r', *arguments])}` writes it"
        done = partial(self._collected, path, run)
        self._app.computation.start("s2r collect", start, missing, done)

    def _collected(self, path: Path, run: str) -> None:
        planned = read_planned_poses(path)
        if not planned:
            raise RequestError(f"{path}: no poses")
        session = self._app.session
        session.dispatch(view_settings.show_planned, planned, run)
        gains = [pose.expected_gain_m for pose in planned if math.isfinite(pose.expected_gain_m)]
        session.show_message(
            f"{len(planned)} poses of new images for run {run} on the map, which lower its mean "
            f"real error by at most {sum(gains):.2f} m; written to {path}"
        )
