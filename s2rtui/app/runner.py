"""Run the application on a terminal, and report unfinished work at its end."""

from __future__ import annotations

import contextlib
import sys
from functools import partial
from pathlib import Path

from s2rstore.errors import S2RError
from s2rtui.app.app import S2RApp
from s2rtui.app.process_signals import terminal_mode
from s2rtui.canvas import ColourMode
from s2rtui.jobs import background_thread
from s2rtui.security import Permissions
from s2rtui.session.session import Session
from s2rtui.terminal.capabilities import Terminal
from s2rtui.user_data import is_first_start
from s2rtui.user_data.notebook import Notebook

_SHUTDOWN_SECONDS = 0.3
"""How long background work may take after the application is closed."""


def run_app(
    path: Path,
    run: str | None,
    terminal: Terminal,
    access: Permissions,
    gap_history: Path | None = None,
    safe_csv: bool = False,
    with_trained: bool = False,
    poses: Path | None = None,
) -> None:
    """Run the application on a store until the user quits.

    `with_trained` includes the instances that the models were trained on. `poses` is a CSV file of
    planned poses for the map. Unfinished work is listed
    on stderr. Raises RequestError if the store or run cannot be opened, S2RError if the application
    fails.
    """
    session = Session(
        path, run, partial(Notebook, tolerant=True), gap_history, with_trained, poses=poses
    )
    app = S2RApp(session, terminal.render_options, access=access)
    app.export.safe_csv = safe_csv
    app.is_first_start, app.terminal = is_first_start(), terminal
    if terminal.graphics is not None:
        from s2rtui.app.inline_images import enable_inline_images

        enable_inline_images(app, terminal.graphics)
    terminal_mode.remember()
    app.run(mouse=terminal.mode is not ColourMode.NONE)
    background_thread.wait_until_idle(_SHUTDOWN_SECONDS)
    with contextlib.suppress(OSError):  # the terminal may be gone
        for line in app.jobs.unfinished:
            print(f"s2r: {line}", file=sys.stderr)
    if app.fault is not None:
        raise S2RError(f"{type(app.fault).__name__}: {app.fault}") from app.fault
