"""`s2r doctor`: what this machine and terminal can do, and what is missing."""

from __future__ import annotations

import argparse
from dataclasses import replace

from s2rtui.cli.formatting import rows as output


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", nargs="?", help="also tell about this store")
    parser.add_argument("--graphics", action="store_true",
                        help="also ask the terminal whether it draws pictures")  # fmt: skip
    output.add_format(parser, with_parquet=False)


def execute(options: argparse.Namespace) -> int:
    from s2rtui.terminal import diagnostics
    from s2rtui.terminal.capabilities import detect

    terminal = detect()
    if options.graphics:
        from s2rtui.terminal.graphics.probe import probe_terminal

        terminal = replace(terminal, graphics=probe_terminal(terminal))
    rows = [*diagnostics.machine(), *diagnostics.terminal(terminal), *diagnostics.packages()]
    if options.store:
        rows += diagnostics.of_store(options.store)
    output.write(("what", "state"), rows, options)
    return 0
