"""`s2r show`: a view's numbers as a flat table, for scripts and screen readers."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from s2rtui.cli import scene_options
from s2rtui.cli.formatting import rows as output


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from s2rtui.charts.registry import STORED

    parser.add_argument("store", type=Path)
    parser.add_argument("view", choices=tuple(STORED), help="what to print")
    scene_options.add_selection(parser)
    parser.add_argument("--words", action="store_true", help="a sentence instead of the table")
    output.add_format(parser)


def execute(options: argparse.Namespace) -> int:
    from s2rtui.charts.registry import STORED
    from s2rtui.export.scene import staged

    view = STORED[options.view]
    with staged(options.store, scene_options.wanted(options), view) as scene:
        if options.words:
            print(view.summary(scene))
            return 0
        names, rows = view.numbers(scene)
        output.write(names, [[_known(value) for value in row] for row in rows], options)
    return 0


def _known(value: object) -> object:
    return None if isinstance(value, float) and math.isnan(value) else value
