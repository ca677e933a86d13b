"""The application from its opening on a store to what it leaves undone."""

from __future__ import annotations

import contextlib
import sys
from functools import partial
from pathlib import Path

from s2rstore.errors import S2RError
from s2rtui import background, notebook
from s2rtui.access import Access
from s2rtui.app import S2RApp
from s2rtui.canvas import ColourMode, Look
from s2rtui.notebook import Notebook
from s2rtui.session import Session
from s2rtui.terminal import Terminal, accept_any_bytes

_PATIENCE = 0.3
"""Seconds that work in the background is given when the application is left."""


def run_app(
    path: Path,
    run: str | None,
    terminal: Terminal,
    access: Access,
    nights: Path | None = None,
    safe_csv: bool = False,
) -> None:
    """Open the application on a store; the environment was prepared for the terminal.

    What it leaves undone is told on stderr. Raises RequestError where it cannot run, S2RError for a
    fault of the program.
    """
    look = Look(mode=terminal.mode, ascii=terminal.ascii)
    app = S2RApp(Session(path, run, partial(Notebook, patient=True), nights), look, access=access)
    app.safe_csv = safe_csv
    app.first_run, app.terminal = notebook.first_run(), terminal
    if terminal.graphics is not None:
        from s2rtui.graphics.hanging import hang

        hang(app, terminal.graphics)
    accept_any_bytes()
    app.run(mouse=terminal.mode is not ColourMode.NONE)
    background.rest(_PATIENCE)
    with contextlib.suppress(OSError):  # the terminal may be gone
        for told in app.undone:
            print(f"s2r: {told}", file=sys.stderr)
    if app.fault is not None:
        what = f"{type(app.fault).__name__}: {app.fault}"
        raise S2RError(f"a fault of the program: {what} (--debug shows where)") from app.fault
