"""`s2r verify`: does all that the published generation promises lie there, undamaged?"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from s2rtui.cli.formatting import rows


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", type=Path)
    rows.add_format(parser, with_parquet=False)


def execute(options: argparse.Namespace) -> int:
    from s2rstore.maintenance.verify import check
    from s2rstore.security.printable_text import printable

    report = check(options.store)
    found = report.damages
    if found or options.format != "table":
        rows.write(("where", "what"), [(d.where, d.what) for d in found], options)
    for note in report.notes:
        print(f"note: {printable(note)}", file=sys.stderr)
    if not found:
        quiet = options.format != "table" or options.out is not None
        line = f"{printable(str(options.store))}: nothing wrong"
        print(line, file=sys.stderr if quiet else sys.stdout)
    return 1 if found else 0
