"""`s2r tui`: open the application on a store."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", type=Path)
    parser.add_argument("--run", help="the run to begin with (default: the first)")
    parser.add_argument("--ascii", action="store_true", help="ASCII characters only")
    parser.add_argument(
        "--colour", default="auto", choices=("auto", "truecolor", "256", "16", "none"),
        help="colours to use (default: what the terminal says)",
    )  # fmt: skip


def execute(options: argparse.Namespace) -> int:
    from s2rtui.terminal import detect, prepare_environment, refuse_unusable

    refuse_unusable()
    prepare_environment(detect(options.colour, options.ascii))
    from s2rtui.app import run_app

    run_app(options.store, options.run, options.colour, options.ascii)
    return 0
