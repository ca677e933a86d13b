"""`s2r doctor`: report what this machine and this terminal support."""

from __future__ import annotations

import argparse
import os
import platform
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import s2rstore
from s2rstore import plugins
from s2rtools.common.command_line import output
from s2rtui.cli.display_arguments import add_display_options, detect_display
from s2rtui.user_data import user_data_dir

if TYPE_CHECKING:
    from s2rtui.terminal.capabilities import Terminal

Rows = list[tuple[str, str]]
EXAMPLE = "s2r doctor lab.s2r --graphics"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", nargs="?", help="store folder to report on as well")
    parser.add_argument("--graphics", action="store_true",
                        help="query the terminal for its graphics protocol")  # fmt: skip
    add_display_options(parser)
    output.add_output_options(parser, with_parquet=False)


def execute(options: argparse.Namespace) -> int:
    from s2rtui.terminal import diagnostics

    terminal = detect_display(options)
    if options.graphics:
        from s2rtui.terminal.graphics.choice import probe_terminal

        terminal = replace(terminal, graphics=probe_terminal(terminal))
    rows = [*_machine(), *diagnostics.terminal(terminal)]
    rows += [*_symbol_samples(terminal), *diagnostics.packages()]
    rows += _plugins()
    if options.store:
        rows += _of_store(options.store)
    output.write(("what", "state"), rows, options)
    return 0


def _machine() -> Rows:
    """Interpreter, processor and the user's folder."""
    flags = ""
    if os.path.exists("/proc/cpuinfo"):
        with open("/proc/cpuinfo") as file:
            text = file.read()
        present = [flag for flag in ("avx2", "avx512f", "avx512_bf16", "amx_bf16") if flag in text]
        flags = f", {' '.join(present)}" if present else ""
    return [
        ("python", f"{platform.python_version()} on {platform.system()} {platform.machine()}"),
        ("processors", f"{os.cpu_count()}{flags}"),
        ("OMP_WAIT_POLICY", os.environ.get("OMP_WAIT_POLICY", "unset")),
        ("data folder", str(user_data_dir())),
    ]


def _symbol_samples(detected: Terminal) -> Rows:
    """Slanted stripes of each set of block characters, which a font without them breaks."""
    from s2rtui.canvas.block_symbols import SYMBOL_SETS, symbol_stripes

    if detected.ascii:
        return []
    samples = {name: symbol_stripes(symbols, 5) for name, symbols in SYMBOL_SETS.items()}
    shown = [
        # Python before 3.14 does not know octants, and such characters are escaped in output.
        f"{name} {sample if sample.isprintable() else '(key D in the application)'}"
        for name, sample in samples.items()
    ]
    return [("stripes", ", ".join(shown))]


def _plugins() -> Rows:
    """The parts of other packages, and why some of them are left out."""
    if not any(plugins.declared(kind) for kind in plugins.KINDS):
        return []
    from s2rtools.adjustments import ADJUSTMENTS
    from s2rtools.datasets.layouts import LAYOUTS
    from s2rtools.gap.axes import AXES
    from s2rtools.heatmaps import HEATMAP_KINDS
    from s2rtools.models import ARCHITECTURES
    from s2rtools.simulated_frames.pose_renderer import RENDERERS
    from s2rtools.translation import METHODS
    from s2rtui.charts.registry import REGISTRY

    registries: list[plugins.Registry[Any]] = [
        ADJUSTMENTS, ARCHITECTURES, AXES, HEATMAP_KINDS, LAYOUTS, METHODS, REGISTRY, RENDERERS,
    ]  # fmt: skip
    return [
        (f"plug-in {each.kind}", f"{each.name}: {each.package}"
                                 + (f", left out: {each.problem}" if each.problem else ""))
        for registry in registries for each in registry.plugins
    ]  # fmt: skip


def _of_store(path: str | Path) -> Rows:
    """Generation, size and runs of a store. Raises RequestError."""
    with s2rstore.open(path) as store:
        computed = [name for name, run in store.runs.items() if run.key]
        writable = "writable" if os.access(path, os.W_OK) else "read-only"
        return [
            ("store", f"{path}: generation {store.generation}, {writable}"),
            ("instances", str(len(store.instances))),
            ("runs", f"{len(computed)} computed of {len(store.runs)}"),
        ]
