"""`s2r doctor`: what this machine and terminal can do, and what is missing."""

from __future__ import annotations

import argparse

from s2rtui.cli import output


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", nargs="?", help="also tell about this store")
    output.add_format(parser, with_parquet=False)


def execute(options: argparse.Namespace) -> int:
    from s2rtui import diagnosis

    rows = [*diagnosis.machine(), *diagnosis.terminal(), *diagnosis.packages()]
    if options.store:
        rows += diagnosis.of_store(options.store)
    output.write(("what", "state"), rows, options)
    return 0
