"""`s2r objects`: what labelled objects cost the real prediction of a run, by class."""

from __future__ import annotations

import argparse
import json
import shutil
import sys

import s2rstore
from s2rstore.errors import RequestError
from s2rtools.common.command_line import store_argument
from s2rtools.common.command_line.output import print_coverage
from s2rtui.cli import scene_arguments
from s2rtui.cli.coverage_notes import print_left_out

EXAMPLE = "s2r objects lab.s2r --run vanilla --select worst15"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    store_argument.add_readable(parser)
    parser.add_argument("--run", help="run (default: the first)")
    parser.add_argument("--select", default="all", metavar="EXPR",
                        help="instances, as a selection expression (default all)")  # fmt: skip
    scene_arguments.add_with_trained(parser.add_argument)
    parser.add_argument("--json", action="store_true", help="print JSON")


def execute(options: argparse.Namespace) -> int:
    from s2rstore.language import evaluation
    from s2rstore.metrics.object_gains import missing_gains, object_gains
    from s2rtui.charts.objects import NAMES, NOTHING, object_rows, objects_notes, objects_table
    from s2rtui.drawing.cells import text_lines
    from s2rtui.drawing.drawing import Drawing
    from s2rtui.user_data.notebook import ReadNotebook

    with s2rstore.open(options.store) as store:
        store.require_poses("objects")
        run = store.run_name(options.run)
        saved = ReadNotebook(store.identity, parts=store.parts).notes.nodes
        query = evaluation.query(
            store, options.select, run, saved=saved, with_trained=options.with_trained
        )
        print_coverage(store, [run])
        print_left_out(query)
        if reason := missing_gains(store, run):
            raise RequestError(f"{options.store}: run {run}: {reason}")
        found = object_gains(store, run, query.selected)
    if found is None:
        raise RequestError(f"--select {options.select}: {NOTHING}")
    if options.json:
        rows = [dict(zip(NAMES, row, strict=True)) for row in object_rows(found)]
        content = {"run": run, "n": found.n, "mean_error_m": found.error,
                   "has_sim_labels": found.has_sim_labels, "objects": rows}  # fmt: skip
        json.dump(content, sys.stdout, indent=1, allow_nan=False)
        sys.stdout.write("\n")
        return 0
    drawing = Drawing(table=objects_table(found, with_strips=False), notes=objects_notes(found))
    print("\n".join(text_lines(drawing, shutil.get_terminal_size().columns)))
    return 0
