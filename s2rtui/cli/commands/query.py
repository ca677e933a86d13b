"""`s2r query`: the instances that an expression selects."""

from __future__ import annotations

import argparse
import sys

from s2rtui.cli.formatting import rows


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store")
    parser.add_argument("expression", help="for example: 'worst15 & room:right - @handled'")
    parser.add_argument("--run", help="the run that plain fields mean (default: the first)")
    parser.add_argument("--trajectory", action="append", help="only these in view (repeat)")
    parser.add_argument("--count", action="store_true", help="print only how many there are")
    parser.add_argument(
        "--columns", metavar="F,...",
        help="fields of the language, tags and note, for example iid,room,real.outlier,tags",
    )  # fmt: skip
    parser.add_argument(
        "--with-expression", action="store_true",
        help="write expression, run, generation and data set with the rows",
    )  # fmt: skip
    rows.add_format(parser)


def execute(options: argparse.Namespace) -> int:
    import s2rstore
    from s2rstore.errors import RequestError
    from s2rstore.language import evaluation
    from s2rtui.export.rows.selected_instances import picked
    from s2rtui.user_data.notebook import ReadNotebook

    with s2rstore.open(options.store) as store:
        run = store.run(options.run).run
        known = {trajectory.trajectory for trajectory in store.trajectories}
        for name in options.trajectory or ():
            if name not in known:
                raise RequestError(f"--trajectory {name}: not in {options.store}")
        notes = ReadNotebook(store.dataset.hash).notes
        asked = options.expression, run, options.trajectory
        if options.count:
            text, parameters = evaluation.sql(store, *asked, notes.nodes)
            print(store.execute(f"SELECT count(*) FROM ({text})", parameters)[0][0])
            return 0
        columns = options.columns.split(",") if options.columns else None
        found = picked(store, *asked, notes, columns)
    facts = found.facts.told() if options.with_expression else None
    rows.write(found.names, found.rows, options, facts)
    if options.format == "table" and options.out is None:
        print(f"{found.facts.count} instances of run {run}", file=sys.stderr)
    return 0
