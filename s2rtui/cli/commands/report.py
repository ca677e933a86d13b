"""`s2r report`: selections with their figures as one HTML file."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from s2rtui.cli.formatting import rows

if TYPE_CHECKING:
    from s2rtui.cli.formatting.progress import Reporter


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", type=Path)
    parser.add_argument("--out", type=Path, required=True, help="F.html")
    parser.add_argument("--title", default="", help="of the page")
    parser.add_argument("--select", action="append", default=[], metavar="EXPR",
                        help="an expression (repeat; default: your saved selections)")  # fmt: skip
    parser.add_argument("--saved", action="store_true", help="your saved selections as well")
    parser.add_argument("--run", action="append", default=[], help="in this run (repeat)")
    parser.add_argument("--trajectory", action="append", help="only these in view (repeat)")
    parser.add_argument("--with", dest="other", metavar="RUN",
                        help="the run that the first is compared with")  # fmt: skip
    parser.add_argument("--heat", metavar="KIND[:MODE]", help="on the images of instances")
    parser.add_argument("--date", default="", help="printed as it is; without it there is none")
    parser.add_argument("--light", action="store_true", help="no figures for dark screens")


def execute(options: argparse.Namespace) -> int:
    import s2rstore
    from s2rstore.errors import RequestError
    from s2rtui.cli.formatting.progress import reporter
    from s2rtui.export.report.request import ReportRequest, selections
    from s2rtui.export.report.write import report
    from s2rtui.user_data.notebook import ReadNotebook

    if options.out.suffix != ".html":
        raise RequestError(f"--out {options.out}: must end in .html")
    with s2rstore.open(options.store) as store:
        notes = ReadNotebook(store.dataset.hash).notes
    request = ReportRequest(
        selections(notes, tuple(options.select), options.saved),
        runs=tuple(options.run),
        trajectories=tuple(options.trajectory) if options.trajectory else None,
        other=options.other,
        heat=options.heat,
        title=options.title,
        date=options.date,
        dark=not options.light,
    )
    with reporter() as told:
        page = report(options.store, request, _steps(told))
    rows.write_file(options.out, page)
    return 0


def _steps(reporter: Reporter) -> Callable[[int, int, str], None]:
    """A callback that begins a stage of all steps and advances it."""

    def told(done: int, total: int, what: str) -> None:
        if done == 0:
            reporter.begin("report", total)
        else:
            reporter.advance(1)

    return told
