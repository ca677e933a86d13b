"""`s2r snapshot`: write a screenshot of the application after a sequence of keys."""

from __future__ import annotations

import argparse
from pathlib import Path

from s2rstore.errors import RequestError
from s2rtools.common.command_line import output, store_argument
from s2rtui.cli import scene_arguments
from s2rtui.cli.display_arguments import add_symbols, add_theme, size_argument

EXAMPLE = "s2r snapshot lab.s2r --size 160x48 --keys w,right,space --out screen.png"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    store_argument.add_readable(parser)
    scene_arguments.add_initial_state(parser)
    parser.add_argument("--keys", default="", metavar="KEY,...",
                        help="keys to press, for example w,&,right,space")  # fmt: skip
    parser.add_argument("--out", type=Path, required=True, help="output file, *.png or *.txt")
    screen = parser.add_argument_group("screen")
    add = screen.add_argument
    add("--size", default="120x40", metavar="COLUMNSxROWS",
        help="size in characters (default 120x40)")  # fmt: skip
    add("--ascii", action="store_true", help="use ASCII characters only")
    add("--colour", default="truecolor", help="truecolor, 256, 16 or none (default truecolor)")
    add_theme(screen, "the terminal's background, by COLORFGBG, else dark", "dark")
    add_symbols(screen)


def execute(options: argparse.Namespace) -> int:
    from s2rtui.canvas import ColourMode, RenderOptions
    from s2rtui.terminal.capabilities import COLUMNS, ROWS, detect

    size = size_argument("--size", options.size, (20, 5), (COLUMNS, ROWS), "columns x rows")
    if options.out.suffix not in (".png", ".txt"):
        raise RequestError(f"--out {options.out}: must end in .png or .txt")
    if options.colour not in ("truecolor", "256", "16", "none"):
        raise RequestError(f"--colour {options.colour}: must be truecolor, 256, 16 or none")
    mode = ColourMode(options.colour)
    theme = detect(options.colour, options.ascii, theme=options.theme).theme
    render_options = RenderOptions(theme, mode, options.ascii, options.symbols)
    from s2rtui.app.pilot import is_key, snapshot

    keys = [key.strip() for key in options.keys.split(",") if key.strip()]
    unknown = [key for key in keys if not is_key(key)]
    if unknown:
        raise RequestError(
            f"--keys {unknown[0]}: unknown key; use characters, or names such as enter, right, tab"
        )
    shot = snapshot(
        options.store, size, keys, render_options, run=options.run,
        with_trained=options.with_trained, poses=options.poses,
    )  # fmt: skip
    content = shot.text.encode() if options.out.suffix == ".txt" else shot.png(render_options)
    output.write_file(options.out, content)
    return 0
