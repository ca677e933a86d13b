"""Options that describe the state of the application, shared by `show` and `export`."""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

MAP_VALUES = (
    "shift", "real.error", "sim.error", "gap", "share.lighting", "share.depth", "share.objects",
    "share.sensor", "share.camera",
)  # fmt: skip
"""As the names of `session.map_values.MAP_VALUES`, likewise."""

if TYPE_CHECKING:
    from s2rtui.export.load_scene import SceneOptions


def add_selection(parser: argparse.ArgumentParser) -> None:
    """Add the options that choose runs and instances."""
    add = parser.add_argument_group("selection").add_argument
    add("--select", default="all", metavar="EXPR", help="selection expression (default all)")
    add("--run", help="run (default: the first)")
    add("--trajectory", action="append", help="show only this trajectory (repeatable)")
    add("--with", dest="other", metavar="RUN", help="second run of a comparison")
    add_with_trained(add)
    add("--iid", type=int, help="instance id (default: the worst selected)")
    add("--side", choices=("sim", "real"), help="side of heatmaps, lines and comparisons")
    add("--sort", metavar="COLUMN",
        help="sort column of the list, such as gap, or of the rooms, such as real_m")  # fmt: skip
    add("--group-by", type=_grouping, dest="group_by", metavar="G[,G]",
        help="grouping of the rooms view, or two joined by a comma: room, heading, curvature, "
        "trajectory (default room); counts compares predicted and true rooms")  # fmt: skip
    add("--ascending", action="store_true", help="sort the smallest value first")
    add_history(add)


def add_initial_state(parser: argparse.ArgumentParser) -> None:
    """Add the options of the application's first state: run, trained instances, planned poses."""
    add = parser.add_argument
    add("--run", help="initial run (default: the first)")
    add_with_trained(add)
    add_poses(add)


def add_history(add: Callable[..., argparse.Action]) -> None:
    """Add the option for another gap history, by the `add_argument` of a group."""
    add("--history", type=Path, metavar="FILE", help="gap history (default: the store's own)")


def add_poses(add: Callable[..., argparse.Action]) -> None:
    """Add the option for planned poses, by the `add_argument` of a group."""
    add("--poses", type=Path, metavar="FILE",
        help="draw the planned poses of this CSV file of `s2r collect` on the map")  # fmt: skip


def _grouping(text: str) -> str:
    from s2rstore.errors import RequestError
    from s2rstore.findings.groups import parts_of
    from s2rtui.session.error_groups import COUNTS

    if text == COUNTS:
        return text
    try:
        return ",".join(parts_of(text))
    except RequestError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def add_with_trained(add: Callable[..., argparse.Action]) -> None:
    """Add the option that includes trained instances, by the `add_argument` of a group."""
    add("--with-trained", action="store_true",
        help="include the instances that the model was trained on, and mark them (default: only "
        "instances that are new to the run)")  # fmt: skip


def add_drawing(parser: argparse.ArgumentParser) -> None:
    """Add the options for heatmaps and the map."""
    add = parser.add_argument_group("heatmaps and map").add_argument
    add("--heat", metavar="KIND[:MODE]",
        help="heatmap on the images and the map; none shows plain images (default on images: "
        "the one with the best score)")  # fmt: skip
    add("--on", dest="overlay", choices=("instance", "selection", "run"),
        help="instances whose heat is accumulated on the map (default with --heat: "
        "run)")  # fmt: skip
    add("--aggregate", choices=("mean", "max", "sum", "count"), default="mean",
        help="aggregation of the heat per map cell; count is the number of pixels "
        "(default mean)")  # fmt: skip
    add("--mode", dest="map_mode", choices=("colour", "glyph", "full"), default="colour",
        help="map: colour by shift, glyph (direction and size of both errors), or full "
        "(sim, truth and real joined by lines) (default colour)")  # fmt: skip
    add("--value", dest="map_value", choices=MAP_VALUES, default="shift",
        help="map: what colours the instances (default shift)")  # fmt: skip
    add("--images", choices=("real", "sim", "difference", "heat"), default="real",
        help="sheet: images of a side, differences of both, or heat (default real)")  # fmt: skip
    add("--clip", action="store_true", help="dim map cells that no selected instance observed")
    add_poses(add)
    add("--room-names", action="store_true", help="draw rooms with their names")


def scene_options(options: argparse.Namespace) -> SceneOptions:
    """Return the parsed options; drawing options of other commands keep their defaults."""
    from s2rtui.export.load_scene import SceneOptions

    names = {field.name for field in dataclasses.fields(SceneOptions)}
    values = {name: value for name, value in vars(options).items() if name in names}
    trajectories = tuple(options.trajectory) if options.trajectory else None
    return SceneOptions(**values, trajectories=trajectories)
