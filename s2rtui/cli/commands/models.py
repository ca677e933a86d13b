"""`s2r models`: list the models of a store, with the input that each takes."""

from __future__ import annotations

import argparse
import json
from typing import Any

import s2rstore
from s2rstore.records import Model
from s2rtools.common.command_line import output, store_argument

_NAMES = (
    "model", "architecture", "channels", "height", "width", "rgb resized by", "depth resized by",
    "rgb", "depth", "output", "trained by", "runs", "sha256",
)  # fmt: skip
_JSON_NAMES = (
    "model", "architecture", "input", "convention", "trained_by", "runs", "sha256"
)  # fmt: skip
EXAMPLE = "s2r models lab.s2r --json"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    store_argument.add_readable(parser)
    output.add_output_options(parser)


def execute(options: argparse.Namespace) -> int:
    with s2rstore.open(options.store) as store:
        models = list(store.models.values())
        runs = {m.model: [r.run for r in store.runs.values() if r.model == m.model] for m in models}
    if options.format == "json":
        output.write(
            _JSON_NAMES, [_document(model, runs[model.model]) for model in models], options
        )
    else:
        output.write(_NAMES, [_row(model, runs[model.model]) for model in models], options)
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
