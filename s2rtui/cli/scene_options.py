"""The options that describe a state of the application, the same for every command."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from s2rtui.export.scene import SceneOptions


def add_selection(parser: argparse.ArgumentParser) -> None:
    """Which instances, of which run, from which side."""
    parser.add_argument("--select", default="all", metavar="EXPR", help="an expression")
    parser.add_argument("--run", help="the run (default: the first)")
    parser.add_argument("--trajectory", action="append", help="only these in view (repeat)")
    parser.add_argument("--with", dest="other", metavar="RUN", help="the run to compare with")
    parser.add_argument("--iid", type=int, help="the instance (default: the selection's worst)")
    parser.add_argument("--side", choices=("sim", "real"), help="of heat, lines and comparisons")
    parser.add_argument("--sort", metavar="COLUMN", help="of the list, for example gap")
    parser.add_argument("--ascending", action="store_true", help="the list's smallest first")
    parser.add_argument("--history", type=Path, metavar="FILE",
                        help="nights of the gap (default: the store's own)")  # fmt: skip


def add_drawing(parser: argparse.ArgumentParser) -> None:
    """What lies on the pictures and on the map."""
    parser.add_argument("--heat", metavar="KIND[:MODE]", help="on the pictures and the map")
    parser.add_argument(
        "--on", choices=("instance", "selection", "run"),
        help="whose heat lies on the map (default with --heat: the run's)",
    )  # fmt: skip
    parser.add_argument(
        "--aggregate", choices=("mean", "max", "sum", "count"), default="mean",
        help="of the heat on the map; count = pixels that fell on each cell",
    )  # fmt: skip
    parser.add_argument("--mode", choices=("colour", "glyph", "full"), default="colour",
                        help="of the map")  # fmt: skip
    parser.add_argument("--clip", action="store_true", help="dim what the selection has not seen")
    parser.add_argument("--room-names", action="store_true", help="rooms and their names")


def wanted(options: argparse.Namespace) -> SceneOptions:
    """What these options ask for; those that a command does not have are the usual."""
    from s2rtui.export.scene import SceneOptions

    given = vars(options)
    trajectories = given.get("trajectory")
    return SceneOptions(
        select=options.select,
        run=options.run,
        trajectories=tuple(trajectories) if trajectories else None,
        iid=options.iid,
        other=options.other,
        side=options.side,
        sort=options.sort,
        ascending=options.ascending,
        history=options.history,
        heat=given.get("heat"),
        overlay=given.get("on"),
        aggregate=given.get("aggregate", "mean"),
        map_mode=given.get("mode", "colour"),
        clip=given.get("clip", False),
        room_names=given.get("room_names", False),
    )
