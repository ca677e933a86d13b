"""Commands that maintain a store: `s2r prune`, `push`, `rooms` and `verify`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.security.printable_text import printable
from s2rtools.common.command_line import output, store_argument
from s2rtools.common.command_line.progress import STYLES, reporter
from s2rtui.cli.command_parser import Command


def _add_prune_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", type=store_argument.folder, help="store folder")
    parser.add_argument("--keep", type=int, default=3, metavar="N",
                        help="number of newest generations to keep (default 3)")  # fmt: skip
    parser.add_argument("--dry-run", action="store_true", help="only list what would be deleted")
    output.add_output_options(parser, with_parquet=False)


def _prune(options: argparse.Namespace) -> int:
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


def _add_push_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("store", type=store_argument.folder, help="store folder")
    add("url", type=store_argument.url, help="target, such as s3://bucket/lab.s2r")
    add("--force", action="store_true",
        help="replace a newer generation or another data set that is published there")  # fmt: skip
    add("--progress", choices=STYLES, default="auto",
        help="json prints one object per line on standard output")  # fmt: skip


def _push(options: argparse.Namespace) -> int:
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


def _add_rooms_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", type=store_argument.folder, help="store folder")
    parser.add_argument("--rename", nargs=2, metavar=("OLD", "NEW"),
                        help="give a room another name; computed results stay valid")  # fmt: skip
    output.add_output_options(parser)


def _rooms(options: argparse.Namespace) -> int:
    if options.rename:
        from s2rstore.maintenance.room_names import rename_room

        old, new = options.rename
        count = rename_room(options.store, old, new)
        print(f"{options.store}: room {old} is now {new} ({count} instances)")
        return 0
    with s2rstore.open(options.store) as store:
        truth, areas = store.instances, dict.fromkeys(store.stored_rooms, 0.0)
        for room in store.rooms:
            areas[room.room] += (room.x1 - room.x0) * (room.y1 - room.y0)
        codes = truth.room.tolist()
        counts = {name: codes.count(code) for code, name in enumerate(truth.room_names)}
        table = [(name, counts.get(name, 0), round(area, 2)) for name, area in areas.items()]
    output.write(("room", "instances", "area m2"), table, options)
    return 0


def _add_verify_arguments(parser: argparse.ArgumentParser) -> None:
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


def _verify(options: argparse.Namespace) -> int:
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


COMMANDS = {
    "prune": Command("s2r prune lab.s2r --keep 1 --dry-run", _add_prune_arguments, _prune),
    "push": Command("s2r push lab.s2r s3://bucket/lab.s2r", _add_push_arguments, _push),
    "rooms": Command("s2r rooms lab.s2r --rename Room_3 kitchen", _add_rooms_arguments, _rooms),
    "verify": Command("s2r verify lab.s2r", _add_verify_arguments, _verify),
}
