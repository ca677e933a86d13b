"""`s2r ingest`: make a store from paired images, or from the default world."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

_SHOWN = 5


def add_arguments(parser: argparse.ArgumentParser) -> None:
    layouts = parser.add_subparsers(metavar="LAYOUT", dest="layout", required=True)
    pictures = layouts.add_parser(
        "sim2realviz", help="a folder that holds traj1/, or the repository"
    )
    manifest = layouts.add_parser("csv", help="a CSV manifest with a header beside it")
    world = layouts.add_parser("world", help="the default world, rendered; takes no PATH")
    for files in (pictures, manifest):
        files.add_argument("path", type=Path)
        files.add_argument(
            "--calibration", "--header", dest="header", type=Path,
            help="TOML or JSON with bounds, rooms and cameras",
        )  # fmt: skip
        files.add_argument(
            "--allow-outside", action="store_true",
            help="read files that the data names outside of its folder, and tell which folders",
        )  # fmt: skip
    for layout in (pictures, manifest, world):
        size = 128 if layout is world else 256
        layout.add_argument("--store", type=Path, required=True, help="the store to make")
        layout.add_argument("--trajectory", action="append", default=[],
                            help="only this one (repeat)")  # fmt: skip
        layout.add_argument("--size", type=int, default=size,
                            help=f"rows and columns of stored frames (default {size})")  # fmt: skip
        layout.add_argument("--strict", action="store_true", help="refuse input with any problem")
    world.add_argument("--seed", type=int, default=1, help="which building (default 1)")
    world.add_argument("--instances", type=int, default=120, help="on each of the two trajectories")
    world.add_argument(
        "--survey", type=int, default=0,
        help="a training set: so many random views, and one tour of its own",
    )  # fmt: skip
    world.add_argument(
        "--factors", default="all", metavar="NAME[=SEVERITY],...",
        help="what the real side differs by; all (at severity 1) by default, none",
    )  # fmt: skip


def execute(options: argparse.Namespace) -> int:
    import shlex

    from s2rstore.errors import RequestError
    from s2rstore.security.printable_text import printable
    from s2rtools.datasets import IMPORTERS
    from s2rtools.datasets.build import build
    from s2rtools.datasets.scan import ScanOptions
    from s2rtui.cli.formatting.progress import reporter

    if not 16 <= options.size <= 2048:
        raise RequestError("--size: 16 .. 2048")
    world = _world(options) if options.layout == "world" else {}
    frame = options.size, options.size
    header = getattr(options, "header", None)
    allow_outside = getattr(options, "allow_outside", False)
    scan_options = ScanOptions(tuple(options.trajectory), header, frame, world, allow_outside)
    scan = IMPORTERS[options.layout](getattr(options, "path", Path()), scan_options)
    views = sum(len(s.sources) for rows in scan.trajectories.values() for s in rows)
    for folder, count in sorted(scan.outside_folders.items()):
        files = "1 file" if count == 1 else f"{count} files"
        print(printable(f"outside of the data's folder: {folder} ({files})"), file=sys.stderr)
    command = shlex.join(["s2r", *sys.argv[1:]])
    try:
        with reporter() as told:
            told.begin("ingest", 2 * views)
            build(scan, options.store, command, options.strict, told.advance, told.say)
    except KeyboardInterrupt:
        kept = f"{options.store} is complete" if options.store.exists() else "nothing was kept"
        print(printable(f"s2r: interrupted; {kept}"), file=sys.stderr)
        return 130
    finally:
        _report(scan.issues)
    _tell(options.store)
    return 0


def _world(options: argparse.Namespace) -> dict[str, Any]:
    """What the world's recipe takes from the command line."""
    from s2rtools.synthetic_world.factors import parse_factors

    return {
        "seed": options.seed, "count": options.instances, "survey": options.survey,
        "factors": parse_factors(options.factors),
    }  # fmt: skip


def _report(problems: list[Any]) -> None:
    """Print how many problems of each kind there were, with the first file names."""
    from s2rstore.security.printable_text import printable

    kinds: dict[str, list[Any]] = {}
    for issue in problems:
        kinds.setdefault(issue.kind, []).append(issue)
    for kind, found in kinds.items():
        print(f"{kind}: {len(found)}", file=sys.stderr)
        for issue in found[:_SHOWN]:
            print(printable(f"  {issue.file} {issue.detail}".rstrip()), file=sys.stderr)
        if len(found) > _SHOWN:
            print(f"  ... and {len(found) - _SHOWN} more", file=sys.stderr)


def _tell(path: Path) -> None:
    import s2rstore

    with s2rstore.open(path) as store:
        domains = ", ".join(store.domains)
        trajectories = ", ".join(f"{t.trajectory} ({t.instances})" for t in store.trajectories)
        print(f"{path}: {len(store.instances)} instances in {domains}; trajectories {trajectories}")
