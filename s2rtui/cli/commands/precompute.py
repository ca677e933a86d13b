"""`s2r precompute`: compute what is missing for runs and publish it."""

from __future__ import annotations

import argparse
from pathlib import Path

from s2rtui.cli.formatting.progress import STYLES, reporter


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", type=Path)
    parser.add_argument("--run", action="append", default=[], help="only this run (repeat)")
    parser.add_argument("--kinds", help="heatmap kinds, comma separated (default: all)")
    parser.add_argument("--workers", type=int, default=1, help="processes (default 1)")
    parser.add_argument("--backend", default="torch",
                        help="torch (default), torch-bfloat16, openvino, or auto")  # fmt: skip
    parser.add_argument("--progress", choices=STYLES, default="auto",
                        help="json: one object per line on standard output, for a program "
                             "that starts this one; it ends with that program")  # fmt: skip
    parser.add_argument("--trust", action="store_true", help="allow models that execute code")


def execute(options: argparse.Namespace) -> int:
    from s2rstore.errors import RequestError
    from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
    from s2rtui.security.restricted_process import end_with_parent

    if options.progress == "json":
        end_with_parent()
    if options.workers < 1:
        raise RequestError("--workers: at least 1")
    kinds = tuple(options.kinds.split(",")) if options.kinds else None
    with reporter(options.progress) as told:
        wanted = PrecomputeOptions(kinds, options.workers, options.backend, options.trust)
        precompute(options.store, told, options.run, wanted)
    return 0
