"""Diagnostics of machine and terminal: pairs of a name and its state."""

from __future__ import annotations

import importlib.util
import os
import shutil
import sys

from s2rtui.terminal.capabilities import Terminal, detect

Rows = list[tuple[str, str]]

PARTS = {
    "application": ("textual", "rich", "numpy", "PIL"),
    "store": ("zarr", "duckdb", "lark"),
    "figures": ("matplotlib",),
    "tools": ("torch", "av", "cv2", "scipy", "sklearn", "umap", "safetensors"),
    "faster inference": ("openvino",),
    "in a browser": ("textual_serve",),
}


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
