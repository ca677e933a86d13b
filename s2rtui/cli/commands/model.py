"""`s2r model`: register a weights file, or the models that come with the program."""

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
    shipped = actions.add_parser(
        "shipped", help="register the models of the default world, each with a run"
    )
    shipped.add_argument("--store", type=Path, required=True)
    add.set_defaults(action=_add)
    shipped.set_defaults(action=_shipped)


def execute(options: argparse.Namespace) -> int:
    options.action(options)
    return 0


def _add(options: argparse.Namespace) -> None:
    from s2rtools.precompute.registration import add_model

    add_model(options.store, options.name, options.file, options.arch, options.convention,
              options.trust)  # fmt: skip
    print(f"{options.store}: model {options.name} registered; `s2r run add` makes a run of it")


def _shipped(options: argparse.Namespace) -> None:
    from s2rtools.training import pretrained as shipped

    added = shipped.add_pretrained_models(options.store)
    print(f"{options.store}: {', '.join(added) or 'nothing'} registered; `s2r precompute` fills it")
