"""`s2r doctor`: report what this machine and this terminal support."""

from __future__ import annotations

import argparse
from dataclasses import replace

from s2rtools.common.command_line import output
from s2rtui.cli.display_arguments import add_display_options, detect_display

EXAMPLE = "s2r doctor lab.s2r --graphics"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", nargs="?", help="store folder to report on as well")
    parser.add_argument("--graphics", action="store_true",
                        help="query the terminal for its graphics protocol")  # fmt: skip
    add_display_options(parser)
    output.add_output_options(parser, with_parquet=False)


def execute(options: argparse.Namespace) -> int:
    from s2rtui.terminal import diagnostics

    terminal = detect_display(options)
    if options.graphics:
        from s2rtui.terminal.graphics.probe import probe_terminal

        terminal = replace(terminal, graphics=probe_terminal(terminal))
    rows = [*diagnostics.machine(), *diagnostics.terminal(terminal)]
    rows += [*diagnostics.symbol_samples(terminal), *diagnostics.packages()]
    if options.store:
        rows += diagnostics.of_store(options.store)
    output.write(("what", "state"), rows, options)
    return 0
