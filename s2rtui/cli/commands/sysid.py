"""`s2r sysid`: a simulator's parameters from recorded drives, with intervals and warnings."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from s2rstore.errors import InconclusiveError, RequestError

if TYPE_CHECKING:
    from s2rtools.sysid.identify import Identification
    from s2rtools.sysid.parameter_space import Range


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("drives", type=Path,
                        help="folder of folders with real.csv, sim.csv, commands.csv")  # fmt: skip
    parser.add_argument("--simulator", default="planar", help="planar or mujoco (default planar)")
    parser.add_argument("--parameters",
                        help="searched, as mass,friction (default: the simulator's); "
                        "the latency always is")  # fmt: skip
    parser.add_argument("--fix", action="append", default=[], metavar="NAME=VALUE",
                        help="a known value, as track=0.4 (repeat)")  # fmt: skip
    parser.add_argument("--range", action="append", default=[], metavar="NAME=LOW..HIGH[:log]",
                        help="where to search, as latency=0..0.5 (repeat)")  # fmt: skip
    parser.add_argument("--topic", help="of poses, in ROS bags that have several")
    parser.add_argument("--seeds", type=int, default=3, help="searches (default 3)")
    parser.add_argument("--evaluations", type=int, help="of the simulator, per search")
    parser.add_argument("--held-out", type=int, metavar="N",
                        help="drives that only judge (default a quarter)")  # fmt: skip
    parser.add_argument("--window", type=float, default=3.0,
                        help="seconds between restarts from real states (default 3)")  # fmt: skip
    parser.add_argument("--residual", action="store_true",
                        help="learn what the simulator leaves; kept only if it helps")  # fmt: skip
    parser.add_argument("--seed", type=int, default=1, help="of all chance (default 1)")
    parser.add_argument("--out", type=Path, required=True, help="folder for the results")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")


def execute(options: argparse.Namespace) -> int:
    from s2rtools.motion_logs import read_drives
    from s2rtools.sysid import SysidSettings, identify, report
    from s2rtools.sysid.residual_training import learn
    from s2rtui.cli.formatting.progress import reporter

    names = None if options.parameters is None else _names(options.parameters)
    settings = SysidSettings(
        options.simulator, names, _fixed(options.fix), options.seeds, options.held_out,
        options.window, options.evaluations, seed=options.seed, ranges=_ranges(options.range),
    )  # fmt: skip
    report.check_writable(options.out)
    drives = read_drives(options.drives, options.topic)
    with reporter() as told:
        found = identify(drives, settings, told)
        residual, coarse = None, None
        if options.residual:
            try:
                residual = learn(found, told)
            except InconclusiveError as error:
                coarse = error
    result = report.write(options.out, found, residual)
    if options.json:
        json.dump(result, sys.stdout, indent=1)
        print()
    else:
        print(report.table(result), end="")
    _judge(str(options.drives), found)
    if coarse is not None:
        raise coarse
    return 0


def _judge(drives: str, found: Identification) -> None:
    """Raises InconclusiveError for estimates that are not to be trusted, with what to do."""
    if found.at_ends:
        raise InconclusiveError(
            f"{drives}: {', '.join(found.at_ends)} at the end of the range; "
            "give another with --range, or --fix what is known"
        )
    if found.identifiability.undetermined:
        names_open = ", ".join(found.identifiability.undetermined)
        raise InconclusiveError(
            f"{drives}: these drives do not determine {names_open}; "
            "record more varied drives, or --fix what is known"
        )
    if found.unsettled:
        raise InconclusiveError(
            f"{drives}: the search has not settled ({', '.join(found.unsettled)} outside "
            "its interval); give more --evaluations or --seeds"
        )


def _names(text: str) -> tuple[str, ...]:
    names = tuple(name.strip() for name in text.split(",") if name.strip())
    if not names:
        raise RequestError("--parameters: give names, as mass,friction")
    return names


def _fixed(words: list[str]) -> dict[str, float]:
    found = {}
    for word in words:
        name, _, value = word.partition("=")
        try:
            found[name.strip()] = float(value)
        except ValueError:
            raise RequestError(f"--fix {word}: give NAME=VALUE, as track=0.4") from None
    return found


def _ranges(words: list[str]) -> dict[str, Range]:
    from s2rtools.sysid.parameter_space import parse_range

    found = {}
    for word in words:
        name, _, text = word.partition("=")
        try:
            found[name.strip()] = parse_range(text)
        except RequestError as error:
            raise RequestError(f"--range {word}: NAME={error}") from None
    return found
