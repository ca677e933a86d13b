"""`s2r prune`: delete files that none of the newest generations needs."""

from __future__ import annotations

import argparse
import sys

from s2rstore.errors import RequestError
from s2rstore.security.printable_text import printable
from s2rtools.common.command_line import output, store_argument

EXAMPLE = "s2r prune lab.s2r --keep 1 --dry-run"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", type=store_argument.folder, help="store folder")
    parser.add_argument("--keep", type=int, default=3, metavar="N",
                        help="number of newest generations to keep (default 3)")  # fmt: skip
    parser.add_argument("--dry-run", action="store_true", help="only list what would be deleted")
    output.add_output_options(parser, with_parquet=False)


def execute(options: argparse.Namespace) -> int:
    from s2rstore.maintenance.prune import prune

    if options.keep < 1:
        raise RequestError(f"--keep {options.keep}: must be at least 1")
    pruned = prune(options.store, options.keep, options.dry_run)
    for link in pruned.links:
        print(f"note: {printable(str(options.store / link))}: a symbolic link is not deleted; "
              "delete it yourself", file=sys.stderr)  # fmt: skip
    if options.format != "table":
        output.write(("path",), [(path,) for path in pruned.paths], options)
        return 0
    verb = "would remove" if options.dry_run else "removed"
    for path in pruned.paths:
        print(f"{verb} {printable(path)}")
    count = len(pruned.paths)
    entries = "1 entry" if count == 1 else f"{count} entries"
    print(f"{verb} {entries}, {pruned.bytes / 1e6:.1f} MB")
    return 0
