"""`s2r model`: register a weights file or the pretrained models; `s2r models` lists them."""

from __future__ import annotations

import argparse
from pathlib import Path

from s2rtools.common.command_line import store_argument

EXAMPLE = "s2r model add mine weights.safetensors --arch resposenet --store lab.s2r"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(metavar="ACTION", title="actions", required=True)
    add = actions.add_parser("add", help="register a weights file")
    add.add_argument("name", help="name of the model")
    add.add_argument(
        "file",
        type=Path,
        help="state dict (.pt, .pth), .safetensors file, or an archive of "
        "TorchScript or torch.export (.pt2)",
    )
    add.add_argument("--arch", required=True,
                     help="architecture: posest or resposenet; with --trust also torchscript, "
                     "torch.export or module:factory")  # fmt: skip
    add.add_argument("--input", type=Path, metavar="FILE.toml",
                     help="how images become the input of the network: keys that differ from what "
                     "the architecture declares (channels, size, mean, std ...)")  # fmt: skip
    add.add_argument("--store", type=store_argument.folder, required=True, help="store folder")
    add.add_argument("--convention", metavar="HEADING[,FRAME]",
                     help="convention of the output: degrees, radians or cos_sin; "
                     "map or habitat")  # fmt: skip
    add.add_argument("--trust", action="store_true", help="allow file formats that execute code")
    shipped = actions.add_parser(
        "shipped", help="register the pretrained models of the synthetic world, each with a run"
    )
    shipped.add_argument("--store", type=store_argument.folder, required=True, help="store folder")
    add.set_defaults(action=_add)
    shipped.set_defaults(action=_shipped)


def execute(options: argparse.Namespace) -> int:
    options.action(options)
    return 0


def _add(options: argparse.Namespace) -> None:
    from s2rtools.models.model_registration import add_model

    contract = add_model(options.store, options.name, options.file, options.arch,
                         options.convention, options.trust, options.input)  # fmt: skip
    height, width = contract.size
    print(
        f"{options.store}: model {options.name} registered (takes {contract.channels} of "
        f"{height} x {width}); next: `s2r run add`"
    )


def _shipped(options: argparse.Namespace) -> None:
    from s2rtools.training import pretrained

    added = ", ".join(pretrained.add_pretrained_models(options.store)) or "no new model"
    print(f"{options.store}: {added} registered; next: `s2r precompute`")
