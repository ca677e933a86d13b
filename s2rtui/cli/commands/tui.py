"""`s2r tui`: open the application on a store."""

from __future__ import annotations

import argparse
import signal
from dataclasses import replace
from pathlib import Path

from s2rtui.cli.formatting import rows

_FORCED = "this account opens the application and nothing else; connect with `ssh -t`"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", type=Path)
    parser.add_argument("--run", help="the run to begin with (default: the first)")
    parser.add_argument("--history", type=Path, metavar="FILE",
                        help="nights of the gap (default: the store's own)")  # fmt: skip
    rows.add_safe_csv(parser)
    parser.add_argument("--ascii", action="store_true", help="ASCII characters only")
    parser.add_argument(
        "--colour", default="auto", choices=("auto", "truecolor", "256", "16", "none"),
        help="colours to use (default: what the terminal says)",
    )  # fmt: skip
    parser.add_argument(
        "--graphics", action="store_true",
        help="pictures of an instance in true pixels: kitty and ghostty, over SSH too, and inside "
             "tmux after `tmux set -g allow-passthrough on`",
    )  # fmt: skip
    parser.add_argument(
        "--restricted", action="store_true",
        help="for a shared account: writes in the user's own folder only, loads no model",
    )  # fmt: skip


def execute(options: argparse.Namespace) -> int:
    from s2rstore.errors import RequestError
    from s2rtui.security import Permissions
    from s2rtui.security.restricted_process import confine, end_with_parent, is_served, server_id
    from s2rtui.terminal.capabilities import detect, prepare_environment, refuse_unusable

    if options.graphics and options.ascii:
        raise RequestError("--graphics: pictures are not ASCII; leave out --ascii")
    if options.restricted and options.history is not None:
        raise RequestError("--history: a restricted session shows the store's own history only")
    if options.restricted:
        if is_served():
            end_with_parent(signal.SIGKILL, server_id())
        else:
            refuse_unusable(instead=_FORCED)
        access = Permissions.of(options.store, restricted=True)
        confine(access)
    else:
        refuse_unusable()
        access = Permissions.of(options.store)
    terminal = detect(options.colour, options.ascii)
    if options.graphics:
        from s2rtui.terminal.graphics.probe import probe_terminal

        terminal = replace(terminal, graphics=probe_terminal(terminal))
    prepare_environment(terminal)
    from s2rtui.app.runner import run_app

    run_app(options.store, options.run, terminal, access, options.history, options.safe_csv)
    return 0
