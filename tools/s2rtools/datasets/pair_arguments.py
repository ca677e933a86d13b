"""Arguments of `s2r ingest pairs` and `s2r ingest LAYOUT:PATH`, and scans of the recordings that
they name.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.records import SIDES, Side
from s2rtools.common.command_line.assignments import parse_assignments, parse_number
from s2rtools.common.command_line.progress import Reporter

if TYPE_CHECKING:
    from s2rtools.datasets.floor.floor_poses import FloorOptions
    from s2rtools.datasets.pairing.paired_recordings import PairedScan
    from s2rtools.datasets.pairing.recorded_scan import RecordedScan
    from s2rtools.datasets.pairing.stored_worlds import StoredWorlds
    from s2rtools.datasets.recording import Recording

_FLOOR = ("up", "ground", "camera_height", "metres_per_unit")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that only pairs have."""
    for side in SIDES:
        group = parser.add_argument_group(f"{side} recording")
        group.add_argument(f"--{side}", required=True, metavar="LAYOUT:PATH",
                           help=f"layout and folder or file of the {side} recording")  # fmt: skip
        group.add_argument(f"--{side}-option", action="append", default=[], metavar="KEY=VALUE",
                           help="option of the layout (repeatable)")  # fmt: skip
        group.add_argument(f"--{side}-trajectory", action="append", default=[], metavar="NAME",
                           help="read only this trajectory (repeatable)")  # fmt: skip
        group.add_argument(f"--{side}-floor", action="append", default=[], metavar="KEY=VALUE",
                           help="how poses are put on the floor: up=z (or -y, or three numbers), "
                           "ground=Z, camera_height=METRES, metres_per_unit=SCALE; with --append "
                           "the floor is that of the store")  # fmt: skip
    group = parser.add_argument_group("pairing")
    group.add_argument("--match", choices=("pose", "time", "name"), default="pose",
                       help="what the images of a pair have in common (default pose)")  # fmt: skip
    group.add_argument("--tolerance", metavar="T",
                       help="largest difference of a pair: of poses as 0.2m,10deg (default), of "
                       "times as 0.05s (default)")  # fmt: skip
    group.add_argument("--align", action="store_true",
                       help="fit the sim world to the real one by the pairs; with --match time or "
                       "name; with --append the alignment is that of the store")  # fmt: skip
    group.add_argument("--report", type=Path, metavar="FILE.csv",
                       help="write all pairs and all unmatched images to a file")  # fmt: skip
    parser.add_argument("--calibration", "--header", dest="header", type=Path, metavar="FILE",
                        help="TOML or JSON file with bounds, rooms and floor plan (default: the "
                        "bounds of the poses and 2 m around them)")  # fmt: skip


def add_recording_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that only one recording has."""
    parser.add_argument("--side", choices=SIDES, required=True,
                        help="side of its images; the instances have none of the other "
                        "side")  # fmt: skip
    parser.add_argument("--option", action="append", default=[], metavar="KEY=VALUE",
                        help="option of the layout (repeatable)")  # fmt: skip
    parser.add_argument("--floor", action="append", default=[], metavar="KEY=VALUE",
                        help="how poses are put on the floor, as --sim-floor of `s2r ingest "
                        "pairs`; with --append the world of the store")  # fmt: skip
    parser.add_argument("--calibration", "--header", dest="header", type=Path, metavar="FILE",
                        help="TOML or JSON file with bounds, rooms and floor plan (default: the "
                        "bounds of the poses and 2 m around them)")  # fmt: skip


def scan_one(
    options: argparse.Namespace, frame: tuple[int, int], store: Path | None
) -> RecordedScan:
    """Read the recording `options.layout`, in the world of a store that it is appended to.

    Raises RequestError for unusable arguments and input.
    """
    from s2rtools.datasets.pairing.recorded_scan import MapOptions, scan_recording
    from s2rtools.datasets.pairing.stored_worlds import stored_worlds

    side: Side = options.side
    domain = worlds = None
    if store is not None:
        with s2rstore.open(store) as opened:
            worlds, domain = stored_worlds(opened, ()), opened.domains.get(side)
    floor = _floor("--floor", options.floor)
    recording = read_recording(
        "", options.layout, options.option, options.trajectory, options.allow_outside
    )
    map_options = MapOptions(frame, options.header, options.allow_outside, worlds)
    return scan_recording(recording, side, floor, map_options, domain)


def scan(
    options: argparse.Namespace,
    frame: tuple[int, int],
    progress: Reporter,
    stored: StoredWorlds | None = None,
) -> PairedScan:
    """Read and pair both recordings, in the worlds of a store that they are appended to.

    Raises RequestError for unusable arguments and input.
    """
    from s2rtools.datasets.pairing.paired_recordings import PairOptions, scan_pairs
    from s2rtools.datasets.pairing.recorded_scan import MapOptions
    from s2rtools.datasets.pairing.recording_pairs import parse_tolerance

    floors = {side: _floor(f"--{side}-floor", getattr(options, f"{side}_floor")) for side in SIDES}
    pair_options = PairOptions(
        options.match, parse_tolerance(options.tolerance, options.match),
        MapOptions(frame, options.header, options.allow_outside, stored), options.align, floors,
    )  # fmt: skip
    sim, real = (_recording(side, options) for side in SIDES)
    count = sum(len(t.frames) for each in (sim, real) for t in each.trajectories.values())
    progress.begin("pair", count)
    return scan_pairs(sim, real, pair_options, progress.advance)


def _recording(side: Side, options: argparse.Namespace) -> Recording:
    place, texts, trajectories = (
        getattr(options, f"{side}{name}") for name in ("", "_option", "_trajectory")
    )
    return read_recording(f"{side}", place, texts, trajectories, options.allow_outside)


def read_recording(
    side: str, place: str, texts: Sequence[str], trajectories: Sequence[str], allow_outside: bool
) -> Recording:
    """The recording LAYOUT:PATH; `side` begins the names of its arguments, if they have one."""
    from s2rtools.datasets.layouts import LAYOUTS, read
    from s2rtools.datasets.recording import ReadOptions

    layout, separator, path = place.partition(":")
    if not separator or not path:
        known, argument = ", ".join(sorted(LAYOUTS)), f"--{side} " if side else ""
        raise RequestError(f"{argument}{place}: give LAYOUT:PATH; layouts are {known}")
    values = parse_assignments(f"--{side}-option" if side else "--option", texts)
    return read(layout, Path(path), ReadOptions(values, tuple(trajectories), allow_outside))


def _floor(argument: str, arguments: Sequence[str]) -> FloorOptions:
    from s2rtools.datasets.floor.floor_poses import FloorOptions

    values = parse_assignments(argument, arguments, _FLOOR)
    up = values.pop("up", None)
    numbers = {name: parse_number(argument, name, text) for name, text in values.items()}
    return FloorOptions(up=up, **numbers)
