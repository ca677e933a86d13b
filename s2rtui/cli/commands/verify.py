"""`s2r verify`: check that the published generation is complete and undamaged."""

from __future__ import annotations

import argparse
import sys

from s2rstore.security.printable_text import printable
from s2rtui.cli import store_argument
from s2rtui.cli.formatting import rows

EXAMPLE = "s2r verify lab.s2r"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    store_argument.add_readable(parser)
    rows.add_output_options(parser, with_parquet=False)


def execute(options: argparse.Namespace) -> int:
    from s2rstore.maintenance.verify import check

    report = check(options.store)
    damages = report.damages
    if damages or options.format != "table":
        rows.write(("where", "what"), [(d.where, d.what) for d in damages], options)
    for note in report.notes:
        print(f"note: {printable(note)}", file=sys.stderr)
    if not damages:
        quiet = options.format != "table" or options.out is not None
        line = f"{printable(str(options.store))}: no damage found"
        print(line, file=sys.stderr if quiet else sys.stdout)
    return 1 if damages else 0
