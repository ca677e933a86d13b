"""`s2r model add`: register a trained model from a weights file."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(metavar="ACTION", required=True)
    add = actions.add_parser("add", help="register a weights file")
    add.add_argument("name")
    add.add_argument("file", type=Path, help=".pt / .pth state dict, .safetensors or TorchScript")
    add.add_argument(
        "--arch",
        required=True,
        help="posest, resposenet; with --trust also torchscript or module:factory",
    )
    add.add_argument("--store", type=Path, required=True)
    add.add_argument(
        "--convention",
        help="HEADING[,FRAME] of the output: degrees, radians or cos_sin; map or habitat",
    )
    add.add_argument("--trust", action="store_true", help="allow formats that execute code")


def execute(options: argparse.Namespace) -> int:
    from s2rtools.precompute.registry import add_model

    add_model(options.store, options.name, options.file, options.arch, options.convention,
              options.trust)  # fmt: skip
    print(f"{options.store}: model {options.name} registered; `s2r run add` makes a run of it")
    return 0
