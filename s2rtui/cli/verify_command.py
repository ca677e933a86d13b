"""`s2r verify`: does all that the published generation promises lie there, undamaged?"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from s2rtui.cli import output


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", type=Path)
    output.add_format(parser, with_parquet=False)


def execute(options: argparse.Namespace) -> int:
    from s2rstore.verify import verify

    found = verify(options.store)
    if found or options.format == "json":
        output.write(("where", "what"), [(d.where, d.what) for d in found], options)
    if not found:
        print(f"{options.store}: nothing wrong", file=sys.stderr)
    return 1 if found else 0
