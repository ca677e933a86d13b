"""The application from its opening on a store to what it leaves undone."""

from __future__ import annotations

import contextlib
import sys
from functools import partial
from pathlib import Path

from s2rstore.errors import S2RError
from s2rtui.app.app import S2RApp
from s2rtui.app.signals import terminal_mode
from s2rtui.canvas import ColourMode, RenderOptions
from s2rtui.jobs import background_thread
from s2rtui.security import Permissions
from s2rtui.session import Session
from s2rtui.terminal.capabilities import Terminal
from s2rtui.user_data.notebook import Notebook
from s2rtui.user_data.user_data_dir import is_first_start

_PATIENCE = 0.3
"""Seconds that work in the background is given when the application is left."""


def run_app(
    path: Path,
    run: str | None,
    terminal: Terminal,
    access: Permissions,
    nights: Path | None = None,
    safe_csv: bool = False,
) -> None:
    """Open the application on a store; the environment was prepared for the terminal.

    What it leaves undone is told on stderr. Raises RequestError where it cannot run, S2RError for a
    fault of the program.
    """
    look = RenderOptions(mode=terminal.mode, ascii=terminal.ascii)
    app = S2RApp(Session(path, run, partial(Notebook, tolerant=True), nights), look, access=access)
    app.safe_csv = safe_csv
    app.first_run, app.terminal = is_first_start(), terminal
    if terminal.graphics is not None:
        from s2rtui.app.inline_images import hang

        hang(app, terminal.graphics)
    terminal_mode.remember()
    app.run(mouse=terminal.mode is not ColourMode.NONE)
    background_thread.rest(_PATIENCE)
    with contextlib.suppress(OSError):  # the terminal may be gone
        for told in app.undone:
            print(f"s2r: {told}", file=sys.stderr)
    if app.fault is not None:
        what = f"{type(app.fault).__name__}: {app.fault}"
        raise S2RError(f"a fault of the program: {what} (--debug shows where)") from app.fault
