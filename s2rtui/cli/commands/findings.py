"""`s2r findings`: print what a store shows about a run, with n, intervals and expressions."""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import textwrap
from typing import TYPE_CHECKING

import s2rstore
from s2rtools.common.command_line import store_argument
from s2rtools.common.command_line.output import print_coverage
from s2rtui.cli import scene_arguments

if TYPE_CHECKING:
    from s2rstore.findings import FindingReport

EXAMPLE = "s2r findings lab.s2r --run vanilla --json"
_WIDEST = 100


def add_arguments(parser: argparse.ArgumentParser) -> None:
    store_argument.add_readable(parser)
    parser.add_argument("--run", help="run (default: the first)")
    scene_arguments.add_history(parser.add_argument)
    parser.add_argument("--json", action="store_true", help="print JSON")


def execute(options: argparse.Namespace) -> int:
    from s2rstore.errors import RequestError
    from s2rstore.findings import find_all
    from s2rstore.gap_history import reader

    if options.history is not None:
        if not options.history.is_file():
            message = "no such file; `s2r nightly` writes one"
            raise RequestError(f"--history {options.history}: {message}")
        reader.read(options.history)  # what the user names must be a history
    with s2rstore.open(options.store) as store:
        store.require_poses("findings")
        run = store.run_name(options.run)
        print_coverage(store, [run])
        report = find_all(store, run, options.history)
        generation, dataset = store.generation, store.dataset.hash
    if options.json:
        content = {
            "run": run,
            "generation": generation,
            "dataset": dataset,
            "findings": [finding.as_json() for finding in report.findings],
            "missing": list(report.missing),
        }
        json.dump(content, sys.stdout, indent=2, allow_nan=False)
        sys.stdout.write("\n")
        return 0
    print("\n".join(report_lines(report, min(shutil.get_terminal_size().columns, _WIDEST))))
    return 0


def report_lines(report: FindingReport, width: int) -> list[str]:
    """The report as text: an entry per finding, `?` before those that are not evident."""
    from s2rtui.charts.findings import findings_drawing
    from s2rtui.drawing.cells import text_lines

    header = (
        f"{report.summary} (?: not evident); intervals are 95 %, n counts instances new to the run"
    )
    return [*textwrap.wrap(header, width), "",
            *text_lines(findings_drawing(report, selections=True), width)]  # fmt: skip
