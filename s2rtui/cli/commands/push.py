"""`s2r push`: copy the published generation of a store to object storage."""

from __future__ import annotations

import argparse

from s2rtools.common.command_line import store_argument
from s2rtools.common.command_line.progress import STYLES, reporter

EXAMPLE = "s2r push lab.s2r s3://bucket/lab.s2r"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("store", type=store_argument.folder, help="store folder")
    add("url", type=store_argument.url, help="target, such as s3://bucket/lab.s2r")
    add("--force", action="store_true",
        help="replace a newer generation or another data set that is published there")  # fmt: skip
    add("--progress", choices=STYLES, default="auto",
        help="json prints one object per line on standard output")  # fmt: skip


def execute(options: argparse.Namespace) -> int:
    from s2rstore.maintenance.push import push

    with reporter(options.progress) as progress:
        result = push(options.store, options.url, progress, options.force)
        megabytes = result.bytes / 1e6
        line = (
            f"{options.url}: generation {result.generation}, {result.sent} objects sent "
            f"({megabytes:.1f} MB), {result.skipped} were there"
        )
        if options.progress == "json":
            progress.say(line)
    if options.progress != "json":
        print(line)
    return 0
