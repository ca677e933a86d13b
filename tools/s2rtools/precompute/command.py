"""`s2r precompute`: compute and publish the missing predictions and heatmaps of runs."""

from __future__ import annotations

import argparse
from contextlib import AbstractContextManager, nullcontext
from typing import Any

from s2rstore.errors import RequestError
from s2rtools.common.command_line import store_argument
from s2rtools.common.command_line.progress import Reporter, add_progress, reporter

EXAMPLE = "s2r precompute lab.s2r --run bright --workers 4"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("store", type=store_argument.folder, help="store folder")
    add("--run", action="append", default=[], help="compute only this run (repeatable)")
    add("--kinds", metavar="KIND,...",
        help="heatmap kinds (default: all but those that take long for the model)")  # fmt: skip
    add("--refit", action="store_true",
        help="fit the UMAP projection on all instances again; by default, the points of earlier "
        "instances stay where they are")  # fmt: skip
    add("--trust", action="store_true", help="allow model formats that execute code")
    add = parser.add_argument_group("execution").add_argument
    add("--workers", type=int, help="worker processes (default: as many as pay off)")
    add(
        "--threads",
        type=int,
        help="threads of each worker (default: those of the arrays that are "
        "begun, else so many that the workers use all processors)",
    )
    add(
        "--restart",
        action="store_true",
        help="begin arrays again that are not complete or have lost a file; needed to go on with "
        "another kind of machine, because all values of an array come from one kind",
    )
    add(
        "--cluster",
        metavar="local:N|FILE",
        help="compute in N workers of this machine by Dask, or in SLURM jobs that the TOML file "
        "FILE describes (see the guide)",
    )
    add(
        "--scheduler",
        metavar="tcp://HOST:PORT",
        help="compute in the workers of this Dask scheduler; they must see the folder of the store",
    )
    add(
        "--show-job-script",
        action="store_true",
        help="print the script of a job that --cluster FILE submits, and compute nothing",
    )
    add(
        "--backend",
        default="auto",
        help="what runs the network: torch, torch-bfloat16, winograd, openvino, openvino-float32, "
        "cuda, cuda-float16, cuda-bfloat16, or auto (default): that of the run so far, else the "
        "usual one of this machine that stays within 1 cm and 0.5 degrees of float32",
    )
    add_progress(parser)


def execute(options: argparse.Namespace) -> int:
    from s2rtools.precompute.executors.clusters import job_script
    from s2rtools.precompute.pipeline import PrecomputeOptions, precompute

    _check(options)
    if options.show_job_script:
        print(job_script(options.cluster), end="")
        return 0
    kinds = None if options.kinds is None else tuple(options.kinds.split(","))
    with reporter(options.progress) as progress, _executor(options, progress) as executor:
        settings = PrecomputeOptions(
            kinds, options.workers, options.backend, options.trust, options.refit,
            options.threads, options.restart, executor,
        )  # fmt: skip
        precompute(options.store, progress, options.run, settings)
    return 0


def _check(options: argparse.Namespace) -> None:
    for name in ("workers", "threads"):
        if (value := getattr(options, name)) is not None and value < 1:
            raise RequestError(f"--{name} {value}: must be at least 1")
    for name in ("kinds", "cluster", "scheduler"):
        if getattr(options, name) == "":
            raise RequestError(f"--{name}: names nothing; give a value, or leave the option out")
    chosen = [f"--{name}" for name in ("workers", "cluster", "scheduler") if getattr(options, name)]
    if len(chosen) > 1:
        raise RequestError(f"{chosen[1]}: cannot be combined with {chosen[0]}; give one of them")
    is_remote = options.scheduler or (options.cluster and not options.cluster.startswith("local:"))
    if options.threads and is_remote:
        raise RequestError(
            "--threads: workers of a cluster have those that they were started with (`cores` in "
            "the file of SLURM settings, `dask worker --nthreads`)"
        )
    if options.show_job_script and not options.cluster:
        raise RequestError("--show-job-script: needs --cluster FILE")


def _executor(options: argparse.Namespace, progress: Reporter) -> AbstractContextManager[Any]:
    """What computes the units; None where that is this machine without a cluster."""
    from s2rtools.precompute.executors.clusters import open_cluster

    if not (options.cluster or options.scheduler):
        return nullcontext()
    return open_cluster(options.cluster, options.scheduler, options.threads, progress.say)
