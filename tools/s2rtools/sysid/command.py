"""`s2r sysid`: identify simulator parameters from recorded drives, with intervals."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from s2rstore.errors import InconclusiveError, RequestError
from s2rtools.common.command_line.assignments import parse_assignments, parse_number
from s2rtools.common.command_line.progress import reporter

if TYPE_CHECKING:
    from s2rtools.sysid.identify import Identification
EXAMPLE = "s2r sysid drives/ --simulator planar --out identified/"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("drives", type=Path,
                        help="folder of drives: NAME/real.csv, sim.csv, commands.csv")  # fmt: skip
    parser.add_argument("--topic", help="ROS topic that carries the poses")
    add = parser.add_argument_group("simulator").add_argument
    add("--simulator", default="planar", help="planar or mujoco (default planar)")
    add("--parameters", metavar="NAME,...",
        help="parameters to estimate beside the latency, such as mass,friction "
        "(default: those of the simulator)")  # fmt: skip
    add("--fix", action="append", default=[], metavar="NAME=VALUE",
        help="known parameter value, such as track=0.4 (repeatable)")  # fmt: skip
    add("--range", action="append", default=[], metavar="NAME=LOW..HIGH[:log]",
        help="search range, such as latency=0..0.5 (repeatable)")  # fmt: skip
    add = parser.add_argument_group("search").add_argument
    add("--seeds", type=int, default=3, help="independent searches (default 3)")
    add("--seed", type=int, default=1, help="random seed (default 1)")
    add("--evaluations", type=int, help="evaluations of the simulator per search")
    add("--held-out", type=int, metavar="N",
        help="drives used for validation only (default: a quarter)")  # fmt: skip
    add("--window", type=float, default=3.0, metavar="SECONDS",
        help="time after which a simulation restarts from the recorded state "
        "(default 3)")  # fmt: skip
    add("--residual", action="store_true",
        help="train a network on the residuals; it is kept only if it helps "
        "on the held-out drives")  # fmt: skip
    add = parser.add_argument_group("output").add_argument
    add("--out", type=Path, required=True, help="folder for the results")
    add("--json", action="store_true", help="print the result as JSON")


def execute(options: argparse.Namespace) -> int:
    from s2rtools.common.result_files import check_folder
    from s2rtools.motion_logs import read_drives
    from s2rtools.sysid import report
    from s2rtools.sysid.identify import SysidSettings, identify
    from s2rtools.sysid.parameter_space import parse_ranges

    names = None if options.parameters is None else _names(options.parameters)
    fixed = parse_assignments("--fix", options.fix)
    ranges = parse_assignments("--range", options.range)
    settings = SysidSettings(
        options.simulator, names,
        {name: parse_number("--fix", name, text) for name, text in fixed.items()},
        options.seeds, options.held_out, options.window, options.evaluations, seed=options.seed,
        ranges=parse_ranges(ranges, "--range "),
    )  # fmt: skip
    check_folder("--out", options.out)
    drives = read_drives(options.drives, options.topic)
    with reporter() as progress:
        identification = identify(drives, settings, progress)
        residual, residual_error = None, None
        if options.residual:
            from s2rtools.sysid.residual_network import learn

            try:
                residual = learn(identification, progress)
            except InconclusiveError as error:
                residual_error = error
    result = report.write(options.out, identification, residual)
    if options.json:
        json.dump(result, sys.stdout, indent=1)
        print()
    else:
        print(report.table(result), end="")
    _check_conclusive(str(options.drives), identification)
    if residual_error is not None:
        raise residual_error
    return 0


def _check_conclusive(drives: str, identification: Identification) -> None:
    if identification.at_ends:
        raise InconclusiveError(
            f"{drives}: {', '.join(identification.at_ends)} at a bound of the search range; "
            "widen it with --range, or set known parameters with --fix"
        )
    if identification.identifiability.undetermined:
        names = ", ".join(identification.identifiability.undetermined)
        raise InconclusiveError(
            f"{drives}: these drives do not determine {names}; "
            "record more varied drives, or set known parameters with --fix"
        )
    if identification.unsettled:
        raise InconclusiveError(
            f"{drives}: the searches disagree ({', '.join(identification.unsettled)} outside "
            "its interval); raise --evaluations or --seeds"
        )


def _names(text: str) -> tuple[str, ...]:
    names = tuple(name.strip() for name in text.split(",") if name.strip())
    if not names:
        raise RequestError("--parameters: is empty; give names such as mass,friction")
    return names
