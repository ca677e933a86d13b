"""`s2r tui`: open the application on a store."""

from __future__ import annotations

import argparse
import gc
import signal
from dataclasses import replace
from functools import partial

from s2rstore.errors import RequestError
from s2rstore.remote.store_url import StoreUrl
from s2rtools.common.command_line import output, store_argument
from s2rtui.cli import scene_arguments
from s2rtui.cli.display_arguments import add_display_options, detect_display, size_argument

EXAMPLE = "s2r tui lab.s2r --run finetune"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    store_argument.add_readable(parser)
    scene_arguments.add_initial_state(parser)
    scene_arguments.add_history(parser.add_argument)
    output.add_safe_csv(parser)
    add = parser.add_argument_group("terminal").add_argument
    add("--ascii", action="store_true", help="use ASCII characters only")
    add("--colour", default="auto", choices=("auto", "truecolor", "256", "16", "none"),
        help="colours to use (default: detected from the terminal)")  # fmt: skip
    add_display_options(parser)
    add("--graphics", nargs="?", const="auto", default="off",
        choices=("auto", "kitty", "iterm2", "sixel", "off"),
        help="protocol that draws map and images in true pixels; auto (where no value is given) "
        "uses environment variables, and draws none over SSH (default: off)")  # fmt: skip
    add("--cell-size", metavar="WxH",
        help="pixels of a cell for --graphics, such as 10x20 (default: asked for)")  # fmt: skip
    add("--restricted", action="store_true",
        help="for a shared account: write only in the user data folder, load no model")  # fmt: skip


def execute(options: argparse.Namespace) -> int:
    from s2rtools.common.parent_process import end_with_parent
    from s2rtui.security import Permissions
    from s2rtui.security.restricted_process import (
        is_served,
        restrict_process,
        server_process_id,
    )
    from s2rtui.terminal.capabilities import prepare_environment, refuse_unusable

    if options.graphics != "off" and options.ascii:
        raise RequestError("--graphics and --ascii: give one of them")
    if options.graphics == "off" and options.cell_size:
        raise RequestError("--cell-size: give --graphics with a protocol, too")
    if options.restricted and isinstance(options.store, StoreUrl):
        raise RequestError(f"{options.store}: a restricted session reads only a store in a folder")
    if options.restricted and options.history is not None:
        raise RequestError("--history: a restricted session shows only the history of the store")
    if options.restricted and options.poses is not None:
        raise RequestError("--poses: a restricted session reads no files of its own")
    if options.restricted:
        if is_served():
            end_with_parent(signal.SIGKILL, server_process_id())
        else:
            hint = "this account can only open the application; connect with `ssh -t`"
            refuse_unusable(instead=hint)
    else:
        refuse_unusable()
    permissions = Permissions.for_store(options.store, options.restricted)
    if options.restricted:
        restrict_process(permissions)
    terminal = detect_display(options, options.colour, options.ascii)
    if options.graphics != "off":
        from s2rtui.terminal.graphics.choice import choose_graphics

        cell = None
        if options.cell_size:
            cell = size_argument(
                "--cell-size", options.cell_size, (4, 4), (100, 200), "pixels of a cell"
            )
        graphics = choose_graphics(options.graphics, terminal, cell)
        terminal = replace(terminal, graphics=graphics)
    prepare_environment(terminal)
    gc.disable()  # looking for garbage among new modules takes a tenth of the start
    try:
        from s2rtui.app.runner import run_app
        from s2rtui.session.session import Session
        from s2rtui.user_data.notebook import Notebook

        session = Session(
            options.store, options.run, partial(Notebook, tolerant=True), options.history,
            options.with_trained, poses=options.poses,
        )  # fmt: skip
        gc.freeze()
    finally:
        gc.enable()
    run_app(session, terminal, permissions, options.safe_csv)
    return 0
