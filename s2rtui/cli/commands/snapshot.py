"""`s2r snapshot`: the application's screen after given keys, as PNG or text."""

from __future__ import annotations

import argparse
import re
from pathlib import Path

from s2rtui.cli.formatting import rows


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", type=Path)
    parser.add_argument("--size", default="120x40", help="columns x rows (default 120x40)")
    parser.add_argument("--keys", default="", help="comma separated, for example w,&,right,space")
    parser.add_argument("--run", help="the run to begin with (default: the first)")
    parser.add_argument("--ascii", action="store_true", help="ASCII characters only")
    parser.add_argument("--colour", default="truecolor", help="truecolor, 256, 16 or none")
    parser.add_argument("--light", action="store_true", help="light background")
    parser.add_argument("--out", type=Path, required=True, help="F.png or F.txt")


def execute(options: argparse.Namespace) -> int:
    from s2rstore.errors import RequestError
    from s2rtui.canvas import DARK, LIGHT, ColourMode, RenderOptions

    size = _size(options.size)
    if options.out.suffix not in (".png", ".txt"):
        raise RequestError(f"--out {options.out}: must end in .png or .txt")
    try:
        mode = ColourMode(options.colour)
    except ValueError:
        raise RequestError(f"--colour {options.colour}: truecolor, 256, 16 or none") from None
    look = RenderOptions(LIGHT if options.light else DARK, mode, options.ascii)
    from s2rtui.app.pilot import is_key, snapshot

    keys = [key.strip() for key in options.keys.split(",") if key.strip()]
    unknown = [key for key in keys if not is_key(key)]
    if unknown:
        raise RequestError(f"--keys {unknown[0]}: no key; letters, or such as enter, right, tab")
    shot = snapshot(options.store, size, keys, look, options.run)
    content = shot.text.encode() if options.out.suffix == ".txt" else shot.png(look)
    rows.write_file(options.out, content)
    return 0


def _size(text: str) -> tuple[int, int]:
    from s2rstore.errors import RequestError
    from s2rtui.terminal.size_limits import COLUMNS, ROWS

    found = re.fullmatch(r"([0-9]{1,4})x([0-9]{1,4})", text)
    if not found or not (20 <= int(found[1]) <= COLUMNS and 5 <= int(found[2]) <= ROWS):
        raise RequestError(f"--size {text}: 20x5 .. {COLUMNS}x{ROWS} columns x rows, as 120x40")
    return int(found[1]), int(found[2])
