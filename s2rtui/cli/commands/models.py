"""`s2r model` registers models; `s2r models` lists the models of a store, with their input."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import s2rstore
from s2rstore.records import Model
from s2rtools.common.command_line import output, store_argument
from s2rtui.cli.command_parser import Command

_NAMES = (
    "model", "architecture", "channels", "height", "width", "rgb resized by", "depth resized by",
    "rgb", "depth", "output", "trained by", "runs", "sha256",
)  # fmt: skip
_JSON_NAMES = (
    "model", "architecture", "input", "convention", "trained_by", "runs", "sha256"
)  # fmt: skip


def _add_model_arguments(parser: argparse.ArgumentParser) -> None:
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
    pretrained = actions.add_parser(
        "pretrained", help="register the pretrained models of the synthetic world, each with a run"
    )
    pretrained.add_argument(
        "--store", type=store_argument.folder, required=True, help="store folder"
    )
    add.set_defaults(action=_add)
    pretrained.set_defaults(action=_add_pretrained)


def _model(options: argparse.Namespace) -> int:
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


def _add_pretrained(options: argparse.Namespace) -> None:
    from s2rtools.training import pretrained

    added = ", ".join(pretrained.add_pretrained_models(options.store)) or "no new model"
    print(f"{options.store}: {added} registered; next: `s2r precompute`")


def _add_models_arguments(parser: argparse.ArgumentParser) -> None:
    store_argument.add_readable(parser)
    output.add_output_options(parser)


def _models(options: argparse.Namespace) -> int:
    with s2rstore.open(options.store) as store:
        models = list(store.models.values())
        runs = {m.model: [r.run for r in store.runs.values() if r.model == m.model] for m in models}
    if options.format == "json":
        output.write(
            _JSON_NAMES, [_document(model, runs[model.model]) for model in models], options
        )
    else:
        output.write(_NAMES, [_row(model, runs[model.model]) for model in models], options)
    if not models:
        print("no model; add one with `s2r model add` or `s2r train`", file=sys.stderr)
    return 0


def _document(model: Model, runs: list[str]) -> tuple[Any, ...]:
    return (model.model, model.architecture, model.input, json.loads(model.convention),
            model.trained_by, runs, model.sha256)  # fmt: skip


def _row(model: Model, runs: list[str]) -> tuple[Any, ...]:
    table = model.input
    has_rgb, has_depth = model.channels != "depth", model.channels != "rgb"
    convention = json.loads(model.convention)
    return (
        model.model, model.architecture, model.channels, model.input_height, model.input_width,
        table["rgb_interpolation"] if has_rgb else None,
        table["depth_interpolation"] if has_depth else None,
        _colours(table) if has_rgb else None, _depth(table) if has_depth else None,
        f"{convention.get('heading')}, {convention.get('frame', 'map')}",
        model.trained_by, ", ".join(runs) or None, model.sha256[:12],
    )  # fmt: skip


def _colours(table: dict[str, Any]) -> str:
    """Order, mean and deviation of the colours, in units of the whole range."""
    mean, std = (_list(table[key]) for key in ("mean", "std"))
    scale = table["rgb_scale"]
    factor = "" if scale == 1 else f" x {scale:g}"
    return f"{table['colour_order']}{factor} mean {mean} std {std}"


def _depth(table: dict[str, Any]) -> str:
    low, high = table["depth_range"]
    missing = table.get("missing_depth")
    missing = "" if missing is None else f", missing = {missing:g} m"
    mean, std, unit = table["depth_mean"], table["depth_std"], table["depth_unit"]
    return f"{low:g}..{high:g} m / {unit:g} m mean {mean:g} std {std:g}{missing}"


def _list(values: Any) -> str:
    return ",".join(f"{value:g}" for value in values)


COMMANDS = {
    "model": Command(
        "s2r model add mine weights.safetensors --arch resposenet --store lab.s2r",
        _add_model_arguments,
        _model,
    ),
    "models": Command("s2r models lab.s2r --json", _add_models_arguments, _models),
}
