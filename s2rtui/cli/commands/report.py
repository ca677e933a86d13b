"""`s2r report`: write selections with their figures to one HTML file."""

from __future__ import annotations

import argparse
from pathlib import Path

import s2rstore
from s2rstore.errors import RequestError
from s2rtools.common.command_line import output, store_argument
from s2rtools.common.command_line.output import print_coverage
from s2rtools.common.command_line.progress import reporter
from s2rtools.common.result_files import check_writable
from s2rtui.cli import display_arguments, scene_arguments
from s2rtui.cli.display_arguments import add_theme

EXAMPLE = "s2r report lab.s2r --select worst15 --out report.html"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    store_argument.add_readable(parser)
    add = parser.add_argument_group("content").add_argument
    add("--select", action="append", default=[], metavar="EXPR",
        help="selection expression (repeatable; default: your saved selections)")  # fmt: skip
    add("--saved", action="store_true", help="include your saved selections")
    add("--run", action="append", default=[], help="run to report (repeatable)")
    add("--trajectory", action="append", help="use only this trajectory (repeatable)")
    add("--with", dest="other", metavar="RUN", help="run to compare with the first run")
    scene_arguments.add_with_trained(add)
    add("--heat", metavar="KIND[:MODE]", help="heatmap on the example images")
    add = parser.add_argument_group("page").add_argument
    add("--out", type=Path, required=True, help="output file, *.html")
    add("--title", default="", help="title of the page")
    add("--date", default="", help="date to print, as text (default: none)")
    figures = display_arguments.add_page(parser, "figures")
    add_theme(figures, "both, by the setting of the reader's screen")


def execute(options: argparse.Namespace) -> int:
    from s2rtui.export.report.build_report import render_report
    from s2rtui.export.report.report_model import ReportRequest, selections
    from s2rtui.user_data.notebook import ReadNotebook

    if options.out.suffix != ".html":
        raise RequestError(f"--out {options.out}: must end in .html")
    check_writable({"--out": options.out}, devices=True)
    runs = tuple(dict.fromkeys(options.run))
    with s2rstore.open(options.store) as store:
        notes = ReadNotebook(store.identity, parts=store.parts).notes
        print_coverage(store, runs or store.runs)
    request = ReportRequest(
        selections(notes, tuple(options.select), options.saved),
        runs=runs,
        trajectories=tuple(options.trajectory) if options.trajectory else None,
        other=options.other,
        with_trained=options.with_trained,
        heat=options.heat,
        title=options.title,
        date=options.date,
        theme=options.theme,
        page=display_arguments.page_options(options, title=None),
    )
    with reporter() as progress:

        def on_step(done: int, total: int, next_step: str) -> None:
            if done == 0:
                progress.begin("report", total)
            else:
                progress.advance(1)

        page = render_report(options.store, request, on_step)
    output.write_file(options.out, page)
    return 0
