"""Diagnostics of machine and terminal: pairs of a name and its state."""

from __future__ import annotations

import importlib.util
import os
import platform
import shutil
import sys
from pathlib import Path

from s2rtui.canvas.block_symbols import SYMBOL_SETS, symbol_stripes
from s2rtui.terminal.capabilities import Terminal, detect
from s2rtui.user_data import user_data_dir

Rows = list[tuple[str, str]]

PARTS = {
    "application": ("textual", "rich", "numpy", "PIL"),
    "store": ("zarr", "duckdb", "lark"),
    "figures": ("matplotlib",),
    "tools": ("torch", "cv2", "scipy", "sklearn", "umap", "safetensors"),
    "faster inference": ("openvino",),
    "in a browser": ("textual_serve",),
}


def machine() -> Rows:
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


def terminal(detected: Terminal | None = None) -> Rows:
    """Size, colours and characters, and why."""
    detected = detected or detect()
    size = shutil.get_terminal_size()
    return [
        ("terminal", f"{size.columns}x{size.lines}, {'yes' if sys.stdout.isatty() else 'none'}"),
        ("TERM", os.environ.get("TERM", "unset")),
        ("colours", f"{detected.mode.value}: {detected.reason}"),
        ("theme", f"{detected.theme.name}: {detected.theme_reason}"),
        ("characters", "ASCII" if detected.ascii else "Unicode"),
        ("symbols", "ASCII" if detected.ascii else detected.symbols),
        ("graphics", _graphics(detected)),
        ("over SSH", "yes" if os.environ.get("SSH_CONNECTION") else "no"),
        ("in tmux", "yes" if os.environ.get("TMUX") else "no"),
    ]


def symbol_samples(detected: Terminal) -> Rows:
    """Slanted stripes of each set of block characters, which a font without them breaks."""
    if detected.ascii:
        return []
    samples = {name: symbol_stripes(symbols, 5) for name, symbols in SYMBOL_SETS.items()}
    shown = [
        # Python before 3.14 does not know octants, and such characters are escaped in output.
        f"{name} {sample if sample.isprintable() else '(key D in the application)'}"
        for name, sample in samples.items()
    ]
    return [("stripes", ", ".join(shown))]


def _graphics(detected: Terminal) -> str:
    """Whether the terminal draws inline images, if it was probed."""
    if detected.graphics is None:
        return "cells; --graphics draws map and images in true pixels"
    reason, (width, height) = detected.graphics.reason, detected.graphics.cell
    return f"{reason}; cells of {width}x{height} px" if detected.graphics.supported else reason


def packages() -> Rows:
    """The installable parts of the program, with their missing packages."""
    rows = []
    for part, names in PARTS.items():
        missing = [name for name in names if importlib.util.find_spec(name) is None]
        rows.append((part, f"missing: {', '.join(missing)}" if missing else "installed"))
    return rows


def of_store(path: str | Path) -> Rows:
    """Generation, size and runs of a store. Raises RequestError."""
    import s2rstore

    with s2rstore.open(path) as store:
        computed = [name for name, run in store.runs.items() if run.key]
        writable = "writable" if os.access(path, os.W_OK) else "read-only"
        return [
            ("store", f"{path}: generation {store.generation}, {writable}"),
            ("instances", str(len(store.instances))),
            ("runs", f"{len(computed)} computed of {len(store.runs)}"),
        ]
