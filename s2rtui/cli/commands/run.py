"""`s2r run add`: register a run, for `s2r precompute` to compute."""

from __future__ import annotations

import argparse
from pathlib import Path

EXAMPLE = "s2r run add bright --model mine --adjust real:brightness=1.15 --store lab.s2r"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(metavar="ACTION", title="actions", required=True)
    add = actions.add_parser("add", help="register a run of a model")
    add.add_argument("name", help="name of the run")
    add.add_argument("--store", type=Path, required=True, help="store folder")
    add.add_argument("--model", required=True, help="name of a registered model")
    add.add_argument("--sim", help="domain of the sim side (default: the first of kind sim)")
    add.add_argument("--real", help="domain of the real side (default: the first of kind real)")
    add.add_argument("--adjust", action="append", default=[], metavar="SIDE:NAME=VALUE,...",
                     help="adjustments of the images of one side, such as "
                     "real:brightness=1.15,contrast=1.1 or real:translate=T@0.5")  # fmt: skip

    add.add_argument(
        "--force",
        action="store_true",
        help="use a translator although it failed a check of its content",
    )


def execute(options: argparse.Namespace) -> int:
    from s2rtools.adjustments import parse_adjustment
    from s2rtools.precompute.run_registration import add_run

    chains: dict[str, list[dict[str, object]]] = {"sim": [], "real": []}
    for text in options.adjust:
        for side, steps in parse_adjustment(text).items():
            chains[side] += steps
    run = add_run(options.store, options.name, options.model, options.sim, options.real, chains,
                  options.force)  # fmt: skip
    print(f"{options.store}: run {run} registered; next: `s2r precompute {options.store}`")
    return 0
