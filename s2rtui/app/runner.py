"""Run the application on a terminal, and report unfinished work at its end."""

from __future__ import annotations

import contextlib
import sys

from s2rstore.errors import S2RError
from s2rtui.app.app import S2RApp
from s2rtui.app.process_signals import terminal_mode
from s2rtui.canvas import ColourMode
from s2rtui.jobs import background_thread
from s2rtui.security import Permissions
from s2rtui.session.session import Session
from s2rtui.terminal.capabilities import Terminal
from s2rtui.user_data import is_first_start

_SHUTDOWN_SECONDS = 0.3
"""How long background work may take after the application is closed."""


def run_app(
    session: Session, terminal: Terminal, access: Permissions, safe_csv: bool = False
) -> None:
    """Run the application on a session until the user quits; list unfinished work on stderr.

    Raises S2RError if the application fails.
    """
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
