"""`s2r train`: train a model with a recipe and register it with a run."""

from __future__ import annotations

import argparse
import shlex
import sys

from s2rstore.errors import RequestError
from s2rtools.common.command_line import store_argument
from s2rtools.common.command_line.progress import percent_callback, reporter
from s2rtools.precompute.executors import slurm_command

EXAMPLE = "s2r train --recipe finetune --from vanilla --minutes 10 --store lab.s2r"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--store", type=store_argument.folder, required=True, help="store folder")
    add = parser.add_argument_group("model").add_argument
    add(
        "--recipe",
        required=True,
        help="vanilla, dataaug, finetune (with --from), perlin or translated",
    )
    add("--from", dest="start", metavar="RUN", help="continue with the model of this run")
    add("--translator", metavar="T", help="translator of the sim images (recipe translated)")
    add("--force", action="store_true", help="use a translator that failed a check of its content")
    add("--select", metavar="EXPR",
        help="learn from these instances alone, such as '!paired': those with images of one side; "
        "the others stay new to the model")  # fmt: skip
    add("--name", help="name of the model and its run (default: the recipe)")
    add("--arch", default="resposenet", help="architecture (default resposenet)")
    add = parser.add_argument_group("budget").add_argument
    add("--minutes", type=float, default=2.0, help="training time (default 2)")
    add("--steps", type=int, help="number of batches, in place of --minutes")
    add("--seed", type=int, default=0, help="random seed (default 0)")
    slurm_command.add_arguments(parser)


def execute(options: argparse.Namespace) -> int:
    from s2rtools.training.train_into_store import TrainingRequest, check_request, train_into_store

    if not 0 < options.minutes <= 10_000 or (options.steps is not None and options.steps < 1):
        raise RequestError("--minutes, --steps: must be more than 0, and --minutes at most 10000")
    if not 0 <= options.seed < 2**31:
        raise RequestError("--seed: must be 0 to 2147483647")
    request = TrainingRequest(
        options.recipe, options.name, options.start, options.arch, options.minutes, options.steps,
        options.seed, options.translator, options.force, options.select,
    )  # fmt: skip
    if slurm_command.is_requested(options):
        job = slurm_command.SlurmJob(options)
        if not options.show_job_script:
            check_request(options.store, request)
        seconds = 60 * options.minutes if options.steps is None else 0.0
        return job.run(
            command_arguments(options, job.store_folder(options.store)), seconds, "--minutes"
        )
    command = shlex.join(["s2r", *sys.argv[1:]])
    with reporter() as progress:
        report = percent_callback(progress, f"train {options.name or options.recipe}")
        name = train_into_store(options.store, request, report, command)
    print(f"{options.store}: run {name} registered; next: `s2r precompute {options.store}`")
    return 0


def command_arguments(options: argparse.Namespace, store: str) -> list[str]:
    """The arguments of `s2r` that train the same on the store in another folder."""
    values = {
        "store": store, "recipe": options.recipe, "from": options.start,
        "translator": options.translator, "select": options.select, "name": options.name,
        "arch": options.arch, "minutes": options.minutes, "steps": options.steps,
        "seed": options.seed,
    }  # fmt: skip
    given = [f"--{name}={value}" for name, value in values.items() if value is not None]
    flags = ["--force"] if options.force else []
    return ["train", *given, *flags]
