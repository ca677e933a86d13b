"""`s2r verify`: check that the published generation is complete and undamaged."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from s2rstore.errors import RequestError
from s2rstore.security.printable_text import printable
from s2rtools.common.command_line import output, store_argument

EXAMPLE = "s2r verify lab.s2r"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    store_argument.add_readable(parser)
    parser.add_argument(
        "--source", action="append", default=[], type=_source, metavar="[DOMAIN=]FOLDER",
        help="also compare the images of this folder, or of one domain, with those ingested from "
             "it, by SHA-256; repeatable",
    )  # fmt: skip
    output.add_output_options(parser, with_parquet=False)


def _source(text: str) -> tuple[str, Path]:
    """The domain, empty for all, and the folder of `--source`."""
    domain, sign, folder = text.partition("=")
    if not sign or Path(text).is_dir():
        return "", Path(text)
    return domain, Path(folder)


def execute(options: argparse.Namespace) -> int:
    import s2rstore
    from s2rstore.maintenance.source_images import changed_images
    from s2rstore.maintenance.verify import check

    for _, folder in options.source:
        if not folder.is_dir():
            raise RequestError(f"--source {folder}: no such folder")
    report = check(options.store)
    damages, notes = list(report.damages), list(report.notes)
    if options.source and damages:
        notes.append("the source images were not compared, because the store is damaged")
    elif options.source:
        with s2rstore.open(options.store) as store:
            damages += changed_images(store, dict(options.source))
    if damages or options.format != "table":
        output.write(("where", "what"), [(d.where, d.what) for d in damages], options)
    for note in notes:
        print(f"note: {printable(note)}", file=sys.stderr)
    if not damages:
        quiet = options.format != "table" or options.out is not None
        line = f"{printable(str(options.store))}: no damage found"
        print(line, file=sys.stderr if quiet else sys.stdout)
    return 1 if damages else 0
