"""`s2r train`: train a model with a recipe; registers the model and a run of it."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--recipe", required=True, help="vanilla, dataaug, finetune (with --from) or perlin"
    )
    parser.add_argument("--store", type=Path, required=True)
    parser.add_argument("--from", dest="start", metavar="RUN", help="train this run's model on")
    parser.add_argument("--name", help="of the model and the run (default: the recipe)")
    parser.add_argument("--arch", default="resposenet", help="architecture (default resposenet)")
    parser.add_argument("--minutes", type=float, default=2.0, help="time to train (default 2)")
    parser.add_argument("--steps", type=int, help="batches to train, in place of --minutes")
    parser.add_argument("--seed", type=int, default=0)


def execute(options: argparse.Namespace) -> int:
    import shlex
    import sys

    from s2rstore.errors import RequestError
    from s2rtools.training.train_into_store import TrainingRequest, train_into_store
    from s2rtui.cli.formatting.progress import percent, reporter

    if not 0 < options.minutes <= 10_000 or (options.steps is not None and options.steps < 1):
        raise RequestError("--minutes, --steps: more than 0; --minutes at most 10000")
    if not 0 <= options.seed < 2**31:
        raise RequestError("--seed: 0 .. 2147483647")
    request = TrainingRequest(
        options.recipe, options.name, options.start, options.arch, options.minutes, options.steps,
        options.seed,
    )  # fmt: skip
    command = shlex.join(["s2r", *sys.argv[1:]])
    with reporter() as told:
        report = percent(told, f"train {options.name or options.recipe}")
        name = train_into_store(options.store, request, report, command)
    print(f"{options.store}: run {name} registered; `s2r precompute {options.store}` fills it")
    return 0
