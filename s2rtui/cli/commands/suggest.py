"""`s2r suggest`: the search of the tools, and the figure of its answers."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from s2rstore.errors import RequestError
from s2rstore.records import Run
from s2rstore.suggestions import AIMS, SuggestReport
from s2rtools.common.command_line import output
from s2rtools.suggestions import command

EXAMPLE = command.EXAMPLE
add_arguments = command.add_arguments
_FIGURE_SIZE = (1400, 1000)


def execute(options: argparse.Namespace) -> int:
    if options.figure is not None:
        _check_figure(options.figure)
    return command.execute(options, _write_figure)


def _check_figure(path: Path) -> None:
    """Raise RequestError for a file of another format or in a folder that does not exist."""
    from s2rtui.export.figures import format_of

    format_of(path, "--figure")
    folder = path.resolve().parent
    if path.is_dir() or not folder.is_dir():
        reason = "is a folder" if path.is_dir() else f"there is no folder {folder}"
        raise RequestError(f"--figure {path}: {reason}")
    if not os.access(path if path.exists() else folder, os.W_OK):
        raise RequestError(f"--figure {path}: cannot be written")


def _write_figure(report: SuggestReport, run: Run, options: argparse.Namespace) -> None:
    from s2rtui.canvas import LIGHT
    from s2rtui.charts.suggestions import Direction, paper_drawing
    from s2rtui.drawing.page import figure_format
    from s2rtui.drawing.paper import draw_paper
    from s2rtui.export.figures import format_of

    store = str(options.store)
    commands = tuple(answer.command(store, run, report.side) for answer in report.answers)
    direction = Direction(report.side, AIMS[report.side], report, commands)
    with figure_format(format_of(options.figure, "--figure")):
        title = f"{report.run}: what would help"
        data = draw_paper(paper_drawing((direction,)), _FIGURE_SIZE, LIGHT, title)
    output.write_file(options.figure, data)
