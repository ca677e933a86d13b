"""`s2r query`: the instances that an expression selects."""

from __future__ import annotations

import argparse
import sys

from s2rtui.cli import output

_COLUMNS = (
    "iid", "trajectory", "seq", "x", "y", "degrees(heading) AS heading", "room", "sim_error",
    "real_error", "gap", "degrees(sim_heading_error) AS sim_heading_error",
    "degrees(real_heading_error) AS real_heading_error",
)  # fmt: skip


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store")
    parser.add_argument("expression", help="for example: 'worst15 & room:right'")
    parser.add_argument("--run", help="the run that plain fields mean (default: the first)")
    parser.add_argument("--trajectory", action="append", help="only these in view (repeat)")
    parser.add_argument("--count", action="store_true", help="print only how many there are")
    output.add_format(parser)


def execute(options: argparse.Namespace) -> int:
    import s2rstore
    from s2rstore import selection
    from s2rstore.errors import RequestError

    with s2rstore.open(options.store) as store:
        run = store.run(options.run).run
        known = {trajectory.trajectory for trajectory in store.trajectories}
        for name in options.trajectory or ():
            if name not in known:
                raise RequestError(f"--trajectory {name}: not in {options.store}")
        text, parameters = selection.sql(store, options.expression, run, options.trajectory)
        if options.count:
            print(store.execute(f"SELECT count(*) FROM ({text})", parameters)[0][0])
            return 0
        wanted = f"SELECT {', '.join(_COLUMNS)} FROM pair JOIN ({text}) USING (iid)"
        rows = store.execute(f"{wanted} WHERE run = ? ORDER BY iid", [*parameters, run])
    names = [column.split(" AS ")[-1] for column in _COLUMNS]
    output.write(names, rows, options)
    if options.format == "table" and options.out is None:
        print(f"{len(rows)} instances of run {run}", file=sys.stderr)
    return 0
