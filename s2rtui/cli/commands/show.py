"""`s2r show`: print the numbers of a view as a table, for scripts and screen readers."""

from __future__ import annotations

import argparse
import sys

from s2rstore.errors import sentence
from s2rtools.common.command_line import output, store_argument
from s2rtui.cli import scene_arguments
from s2rtui.cli.coverage_notes import print_notes

EXAMPLE = "s2r show lab.s2r rooms --select worst15 --format csv"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from s2rtui.charts.registry import STORED

    store_argument.add_readable(parser)
    parser.add_argument("view", choices=tuple(STORED), help="view to print")
    parser.add_argument("--words", action="store_true", help="print a sentence, not the table")
    scene_arguments.add_selection(parser)
    output.add_output_options(parser)


def execute(options: argparse.Namespace) -> int:
    from s2rtui.charts.registry import STORED
    from s2rtui.export.load_scene import open_scene

    view = STORED[options.view]
    with open_scene(options.store, scene_arguments.scene_options(options), view) as scene:
        print_notes(scene)
        if options.words:
            note = f" {sentence(scene.trained_note)}." if scene.trained_note else ""
            print(view.summary(scene) + note * view.counts_instances)
            return 0
        names, rows = view.numbers(scene)
        if not rows and (reasons := view.missing(scene)):
            print(f"{view.name}: {'; '.join(reasons)}", file=sys.stderr)
        without_nan = [[None if value != value else value for value in row] for row in rows]
        output.write(names, without_nan, options)
    return 0
