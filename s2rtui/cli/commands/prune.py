"""`s2r prune`: remove what no kept generation needs."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from s2rtui.cli.formatting import rows


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", type=Path)
    parser.add_argument("--keep", type=int, default=3, help="generations to keep (default 3)")
    parser.add_argument("--dry-run", action="store_true", help="only tell what would go")
    rows.add_format(parser, with_parquet=False)


def execute(options: argparse.Namespace) -> int:
    from s2rstore.errors import RequestError
    from s2rstore.maintenance.prune import prune
    from s2rstore.security.printable_text import printable

    if options.keep < 1:
        raise RequestError("--keep: at least 1")
    pruned = prune(options.store, options.keep, options.dry_run)
    for link in pruned.links:
        told = printable(f"{options.store / link}: a symbolic link, left alone; remove it yourself")
        print(f"note: {told}", file=sys.stderr)
    if options.format != "table":
        rows.write(("path",), [(path,) for path in pruned.paths], options)
        return 0
    verb = "would remove" if options.dry_run else "removed"
    for path in pruned.paths:
        print(f"{verb} {printable(path)}")
    count = len(pruned.paths)
    entries = "1 entry" if count == 1 else f"{count} entries"
    print(f"{verb} {entries}, {pruned.bytes / 1e6:.1f} MB")
    return 0
