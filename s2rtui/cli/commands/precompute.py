"""`s2r precompute`: compute and publish the missing predictions and heatmaps of runs."""

from __future__ import annotations

import argparse

from s2rstore.errors import RequestError
from s2rtui.cli import store_argument
from s2rtui.cli.formatting.progress import STYLES, reporter

EXAMPLE = "s2r precompute lab.s2r --run bright --workers 4"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("store", type=store_argument.folder, help="store folder")
    add("--run", action="append", default=[], help="compute only this run (repeatable)")
    add("--kinds", metavar="KIND,...", help="heatmap kinds (default: all)")
    add("--refit", action="store_true",
        help="fit the UMAP projection on all instances again; by default, the points of earlier "
        "instances stay where they are")  # fmt: skip
    add("--trust", action="store_true", help="allow model formats that execute code")
    add = parser.add_argument_group("execution").add_argument
    add("--workers", type=int, help="worker processes (default: as many as pay off)")
    add("--backend", default="auto",
        help="what runs the network: torch, torch-bfloat16, openvino, openvino-float32, cuda, "
        "cuda-float16, cuda-bfloat16, or auto (default): that of the run so far, else the fastest "
        "that stays within 1 cm and 0.5 degrees of float32 on images of this store")  # fmt: skip
    add("--progress", choices=STYLES, default="auto",
        help="json prints one object per line on standard output and ends "
        "together with the parent process")  # fmt: skip


def execute(options: argparse.Namespace) -> int:
    from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
    from s2rtui.security.restricted_process import end_with_parent

    if options.progress == "json":
        end_with_parent()
    if options.workers is not None and options.workers < 1:
        raise RequestError(f"--workers {options.workers}: must be at least 1")
    kinds = tuple(options.kinds.split(",")) if options.kinds else None
    with reporter(options.progress) as progress:
        settings = PrecomputeOptions(
            kinds, options.workers, options.backend, options.trust, options.refit
        )
        precompute(options.store, progress, options.run, settings)
    return 0
