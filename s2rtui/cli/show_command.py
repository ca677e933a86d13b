"""`s2r show`: a view's numbers as a flat table, for scripts and screen readers."""

from __future__ import annotations

import argparse
from pathlib import Path

from s2rtui.cli import output

VIEWS = (
    "overview", "map", "instance", "umap", "orientation", "rooms", "errors", "list", "compare",
)  # fmt: skip


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", type=Path)
    parser.add_argument("view", choices=VIEWS, help="what to print")
    parser.add_argument("--select", default="all", metavar="EXPR", help="an expression")
    parser.add_argument("--run", help="the run (default: the first)")
    parser.add_argument("--with", dest="other", metavar="RUN", help="the run to compare with")
    parser.add_argument("--iid", type=int, help="the instance (default: the selection's worst)")
    output.add_format(parser)


def execute(options: argparse.Namespace) -> int:
    from s2rtui.offstage import Wanted, staged
    from s2rtui.views import BY_NAME

    wanted = Wanted(options.select, options.run, options.iid, options.other)
    with staged(options.store, wanted, options.view) as scene:
        names, rows = BY_NAME[options.view].numbers(scene)
        output.write(names, rows, options)
    return 0
