"""`s2r doctor`: what this machine and terminal can do, and what is missing."""

from __future__ import annotations

import argparse
import importlib.util
import os
import platform
import shutil
import sys

from s2rtui.cli import output

_PARTS = {
    "application": ("textual", "rich", "numpy", "PIL"),
    "store": ("zarr", "duckdb", "lark"),
    "figures": ("matplotlib",),
    "tools": ("torch", "cv2", "scipy", "sklearn", "umap", "safetensors"),
    "faster inference": ("openvino",),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", nargs="?", help="also tell about this store")
    output.add_format(parser, with_parquet=False)


def execute(options: argparse.Namespace) -> int:
    rows = [*_machine(), *_terminal(), *_packages()]
    if options.store:
        rows += _store(options.store)
    output.write(("what", "state"), rows, options)
    return 0


def _machine() -> list[tuple[str, str]]:
    flags = ""
    if os.path.exists("/proc/cpuinfo"):
        with open("/proc/cpuinfo") as file:
            text = file.read()
        found = [flag for flag in ("avx2", "avx512f", "avx512_bf16", "amx_bf16") if flag in text]
        flags = f", {' '.join(found)}" if found else ""
    threads = os.environ.get("OMP_WAIT_POLICY", "unset")
    return [
        ("python", f"{platform.python_version()} on {platform.system()} {platform.machine()}"),
        ("processors", f"{os.cpu_count()}{flags}"),
        ("OMP_WAIT_POLICY", threads),
        ("data folder", os.environ.get("XDG_DATA_HOME", "~/.local/share") + "/s2rtui"),
    ]


def _terminal() -> list[tuple[str, str]]:
    from s2rtui.terminal import detect

    size = shutil.get_terminal_size()
    found = detect()
    characters = "ASCII" if found.ascii else "Unicode"
    return [
        ("terminal", f"{size.columns}x{size.lines}, {'yes' if sys.stdout.isatty() else 'none'}"),
        ("colours", f"{found.mode.value}: {found.reason}"),
        ("characters", characters),
        ("over SSH", "yes" if os.environ.get("SSH_CONNECTION") else "no"),
    ]


def _packages() -> list[tuple[str, str]]:
    rows = []
    for part, names in _PARTS.items():
        missing = [name for name in names if importlib.util.find_spec(name) is None]
        rows.append((part, f"missing: {', '.join(missing)}" if missing else "installed"))
    return rows


def _store(path: str) -> list[tuple[str, str]]:
    import s2rstore

    with s2rstore.open(path) as store:
        computed = [name for name, run in store.runs.items() if run.key]
        writable = "writable" if os.access(path, os.W_OK) else "read-only"
        return [
            ("store", f"{path}: generation {store.generation}, {writable}"),
            ("instances", str(len(store.instances))),
            ("runs", f"{len(computed)} computed of {len(store.runs)}"),
        ]
