"""`s2r ingest`: make or extend a store: pairs, recordings, images without poses, or the synthetic
world.
"""

from __future__ import annotations

import argparse
import contextlib
import shlex
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import s2rstore
from s2rstore.errors import RequestError, counted
from s2rstore.files.ingest_folder import staging_folders
from s2rstore.records import SIDES
from s2rstore.security.printable_text import printable
from s2rtools.common.command_line import store_argument
from s2rtools.common.command_line.progress import reporter
from s2rtools.common.input_issue import LISTED, InputIssue, issue_lines
from s2rtools.datasets import pair_arguments

if TYPE_CHECKING:
    from s2rtools.datasets.pairing.stored_worlds import StoredWorlds

_LISTED_STRICT = 100
"""Number of issues of one kind that are listed when `--strict` refuses the input."""
RECORDING = "LAYOUT:PATH"
"""How the help names a recording, which stands in place of the name of a layout."""
_DEFAULT_SIZE = 256
_DEFAULT_SIZES = {"world": 128, "images": 320}
EXAMPLE = "s2r ingest csv pairs.csv --calibration lab.toml --store lab.s2r"


class _LayoutNames(dict[str, Any]):
    """The parsers of layouts by name; `tum:FOLDER`, a recording, has that of `RECORDING`."""

    def __contains__(self, name: object) -> bool:
        return super().__contains__(name) or (name != RECORDING and ":" in str(name))

    def __missing__(self, name: str) -> Any:
        if ":" not in name:
            raise KeyError(name)
        return self[RECORDING]


class _Layouts(argparse._SubParsersAction):
    """The argument that names a layout, or a recording."""

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        self.choices = self._name_parser_map = _LayoutNames()


def add_arguments(parser: argparse.ArgumentParser) -> None:
    layouts = parser.add_subparsers(
        metavar="LAYOUT", title="layouts", dest="layout", required=True, action=_Layouts
    )
    sim2realviz = layouts.add_parser("sim2realviz", help="folder in the Sim2RealViz layout")
    manifest = layouts.add_parser("csv", help="CSV manifest of paired images")
    world = layouts.add_parser("world", help="the synthetic world, rendered by this command")
    images = layouts.add_parser("images", help="folders of sim and real images without poses")
    pairs = layouts.add_parser("pairs", help="a sim and a real recording, paired by pose, time or "
                               "name")  # fmt: skip
    recording = layouts.add_parser(RECORDING, help="one recording, as the images of one side")
    pair_arguments.add_arguments(pairs)
    pair_arguments.add_recording_arguments(recording)
    for side in SIDES:
        images.add_argument(f"--{side}", type=Path, required=True, metavar="DIR",
                            help=f"folder of {side} images; subfolders, or the conditions of its "
                            "index.csv (file, condition), are trajectories")  # fmt: skip
    for layout in (sim2realviz, manifest):
        layout.add_argument("path", type=Path, help="folder or manifest to read")
        layout.add_argument("--calibration", "--header", dest="header", type=Path, metavar="FILE",
                            help="TOML or JSON file with bounds, rooms and cameras")  # fmt: skip
    for layout in (sim2realviz, manifest, images, pairs, recording):
        layout.add_argument("--allow-outside", action="store_true",
                            help="allow images outside the folder of the data, and list their "
                            "folders")  # fmt: skip
    for name, layout in layouts.choices.items():
        size = _DEFAULT_SIZES.get(name, _DEFAULT_SIZE)
        edge = "longer edge" if layout is images else "height and width"
        layout.add_argument(
            "--store",
            type=store_argument.folder,
            required=True,
            help="store folder to create, or with --append to extend",
        )
        if layout is not pairs:
            layout.add_argument("--trajectory", action="append", default=[],
                                help="read only this trajectory (repeatable)")  # fmt: skip
        layout.add_argument("--append", action="store_true",
                            help="add what the store does not have: trajectories, instances "
                            "behind those of a trajectory, domains; frame size and cameras must "
                            "be those of the store")  # fmt: skip
        layout.add_argument("--size", type=int,
                            help=f"{edge} of stored frames, pixels (default {size}; with --append "
                            "that of the store)")  # fmt: skip
        layout.add_argument("--strict", action="store_true", help="refuse input that has any issue")
    group = world.add_argument_group("world")
    group.add_argument("--seed", type=int, default=1,
                       help="random seed of the building (default 1)")  # fmt: skip
    group.add_argument("--instances", type=int, default=120,
                       help="instances of each of the two trajectories (default 120), at most one "
                       "per 6 cm of path")  # fmt: skip
    group.add_argument("--survey", type=int, default=0, metavar="N",
                       help="add a training set of N random views and one tour")  # fmt: skip
    group.add_argument("--factors", default="all", metavar="NAME[=SEVERITY],...",
                       help="differences between the real and the sim side: all (severity 1), "
                       "none, or a list (default all)")  # fmt: skip
    group.add_argument("--constants", default="", metavar="FACTOR.NAME=VALUE,...",
                       help="other constants of the factors at severity 1, such as "
                       "exposure.vignette=0.4,depth.farthest=5 (default: those of the "
                       "factors)")  # fmt: skip


def execute(options: argparse.Namespace) -> int:
    size = _frame_size(options)
    if not 16 <= size <= 2048:
        raise RequestError(f"--size {size}: must be 16 to 2048")
    if options.layout == "pairs":
        return _ingest_pairs(options, size)
    if ":" in options.layout:
        return _ingest_recording(options, size)
    from s2rtools.datasets.importers import IMPORTERS
    from s2rtools.datasets.scan import ScanOptions

    world: dict[str, Any] = {}
    if options.layout == "world":
        from s2rtools.synthetic_world.factors import parse_constants, parse_factors

        world = {"seed": options.seed, "count": options.instances, "survey": options.survey,
                 "factors": parse_factors(options.factors),
                 "constants": parse_constants(options.constants)}  # fmt: skip
    frame = size, size
    header = getattr(options, "header", None)
    allow_outside = getattr(options, "allow_outside", False)
    folders = {side: getattr(options, side) for side in SIDES if options.layout == "images"}
    scan_options = ScanOptions(
        tuple(options.trajectory), header, frame, world, allow_outside, folders
    )
    scan = IMPORTERS[options.layout](getattr(options, "path", Path()), scan_options)
    code = _ingest(scan, options)
    if code == 0 and options.layout == "world" and not options.survey:
        from s2rtools.labels.write_labels import label_world

        label_world(options.store, _command())
    return code


def _ingest_pairs(options: argparse.Namespace, size: int) -> int:
    stored = None
    _check_store(options)
    if options.append:
        stored = _stored_worlds(options)
    with reporter() as progress:
        made = pair_arguments.scan(options, (size, size), progress, stored)
    if options.report is not None:
        made.write_report(options.report)
    return _ingest(made.scan, options, made.summary)


def _ingest_recording(options: argparse.Namespace, size: int) -> int:
    _check_store(options)
    store = options.store if options.append else None
    made = pair_arguments.scan_one(options, (size, size), store)
    return _ingest(made.scan, options, made.summary)


def _ingest(scan: Any, options: argparse.Namespace, summary: Sequence[str] = ()) -> int:
    """Make a store of a scan, or append it to one; prints the summary and the issues."""
    for line in summary:
        print(printable(line))
    for folder, count in sorted(scan.outside_folders.items()):
        files = counted(count, "file")
        print(printable(f"read from outside the data folder: {folder} ({files})"), file=sys.stderr)
    try:
        if options.append:
            return append_scan(scan, options.store, options.strict)
        return _build(scan, options)
    finally:
        print_issues(scan.issues, options.strict)


def _check_store(options: argparse.Namespace) -> None:
    """Raise RequestError unless there is a store to append recordings to, or none otherwise."""
    if options.append and not options.store.exists():
        raise RequestError(
            f"{options.store}: no such store to append to; leave out --append to make it"
        )
    if options.store.exists() and not options.append:
        raise RequestError(
            f"{options.store}: exists; choose another --store, or add recordings by --append"
        )


def _stored_worlds(options: argparse.Namespace) -> StoredWorlds:
    """The worlds of the store that recordings are appended to; prints which options are ignored."""
    from s2rtools.datasets.pairing.stored_worlds import stored_worlds

    with s2rstore.open(options.store) as store:
        worlds = stored_worlds(store)
    for side in SIDES:
        if getattr(options, f"{side}_floor"):
            print(f"--{side}-floor is not used: the floor is that of the store")
    return worlds


def _frame_size(options: argparse.Namespace) -> int:
    """The requested longer edge of frames; by default that of the store which is extended."""
    if options.size is not None:
        return int(options.size)
    if getattr(options, "append", False) and options.store.exists():
        with s2rstore.open(options.store) as store:
            return max(store.dataset.frame_height, store.dataset.frame_width)
    return _DEFAULT_SIZES.get(options.layout, _DEFAULT_SIZE)


def _build(scan: Any, options: argparse.Namespace) -> int:
    from s2rtools.datasets.writing.build import build

    try:
        with _sigterm_as_interrupt(), reporter() as progress:
            progress.begin("ingest", _steps(scan))
            build(scan, options.store, _command(), options.strict, progress.advance, progress.say)
    except KeyboardInterrupt:
        line = f"s2r: interrupted; {_interrupted_state(options.store)}"
        print(printable(line), file=sys.stderr)
        return 130
    with s2rstore.open(options.store) as store:
        domains = ", ".join(store.domains)
        trajectories = ", ".join(f"{t.trajectory} ({t.instances})" for t in store.trajectories)
        count = len(store.instances)
    total = sum(len(records) for records in scan.trajectories.values())
    left_out = f"; {total - count} of {total} {scan.unit}s left out" if count < total else ""
    print(f"{options.store}: {count} instances in {domains}; trajectories {trajectories}{left_out}")
    return 0


@contextlib.contextmanager
def _sigterm_as_interrupt() -> Iterator[None]:
    """Raise KeyboardInterrupt for a SIGTERM, too; without effect outside the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _interrupted_state(target: Path) -> str:
    """What an interrupted ingest has left, and how it is resumed."""
    from s2rtools.datasets.writing.ingest_journal import fingerprint_of

    if target.exists():
        return f"{target} is complete"
    folders = [each.path for each in staging_folders(target) if fingerprint_of(each.path)]
    if not folders:
        return f"{target} was not created"
    names = " ".join(shlex.quote(str(folder)) for folder in folders)
    return (
        f"{target} was not created; the same command resumes, and begins anew after: rm -r {names}"
    )


def append_scan(scan: Any, target: Path, strict: bool) -> int:
    """Append what a scan has to a store, print what was added, and return the exit code."""
    from s2rtools.datasets.appending.append import append

    try:
        with reporter() as progress:
            progress.begin("ingest", _steps(scan))
            added = append(scan, target, _command(), strict, progress.advance, progress.say)
    except KeyboardInterrupt:
        line = f"s2r: interrupted; {target} is unchanged; the same command resumes"
        print(printable(line), file=sys.stderr)
        return 130
    with s2rstore.open(target) as store:
        count = len(store.instances)
        computed = [
            run for run in store.runs.values() if run.key and store.coverage(run.run).is_outdated
        ]
    if added.domains:
        print(f"{target}: {', '.join(added.domains)} added")
    if not added.instances:
        return 0
    trajectories = ", ".join(f"{name} ({number})" for name, number in added.instances.items())
    print(
        f"{target}: {sum(added.instances.values())} instances added, now {count}; "
        f"trajectories {trajectories}"
    )
    if any(not run.is_imported for run in computed):
        command = f"s2r precompute {shlex.quote(str(target))}"
        print(f"`{command}` computes the runs for the new instances")
    if imported := [run.run for run in computed if run.is_imported]:
        names = printable(", ".join(imported))
        print(f"import the predictions of {names} again (`s2r run import`) for the new instances")
    return 0


def _steps(scan: Any) -> int:
    """Every frame is checked once and written once."""
    return 2 * sum(len(row.sources) for rows in scan.trajectories.values() for row in rows)


def _command() -> str:
    return shlex.join(["s2r", *sys.argv[1:]])


def print_issues(issues: list[InputIssue], is_strict: bool) -> None:
    """Print the issues of a scan by kind on standard error."""
    for line in issue_lines(issues, _LISTED_STRICT if is_strict else LISTED):
        print(line, file=sys.stderr)
