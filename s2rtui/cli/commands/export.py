"""`s2r export`: a figure drawn for paper, from the same numbers as the screen."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import TYPE_CHECKING

from s2rtui.cli import scene_options
from s2rtui.cli.formatting import rows

if TYPE_CHECKING:
    from s2rtui.canvas import Theme
    from s2rtui.export.scene import SceneOptions

Pixels = tuple[int, int]
SCREEN = "workbench"
_SCREEN_SIZE = (2000, 1200)
_FORMS = (".png", ".svg", ".pdf")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from s2rtui.charts.registry import STORED

    parser.add_argument("store", type=Path)
    parser.add_argument("--view", required=True, choices=(*STORED, SCREEN),
                        help="what to draw; workbench is the screen")  # fmt: skip
    parser.add_argument("--out", type=Path, required=True, help="F.png, F.svg or F.pdf")
    parser.add_argument("--size", help="pixels, for example 1600x1200")
    parser.add_argument("--dark", action="store_true", help="dark background")
    scene_options.add_selection(parser)
    scene_options.add_drawing(parser)


def execute(options: argparse.Namespace) -> int:
    from s2rstore.errors import RequestError
    from s2rtui.canvas import DARK, LIGHT
    from s2rtui.charts.registry import STORED

    form = options.out.suffix
    if form not in _FORMS or (options.view == SCREEN and form != ".png"):
        ends = ".png" if options.view == SCREEN else ", ".join(_FORMS)
        raise RequestError(f"--out {options.out}: must end in {ends}")
    theme = DARK if options.dark else LIGHT
    wanted, size = scene_options.wanted(options), _size(options.size)
    if options.view == SCREEN:
        picture = _screen(options.store, wanted, size or _SCREEN_SIZE, theme)
    else:
        from s2rtui.charts.shared.paper import figure_format
        from s2rtui.export.scene import staged

        view = STORED[options.view]
        with staged(options.store, wanted, view) as scene, figure_format(form[1:]):
            picture = view.figure(scene, size or view.figure_size, theme)
    rows.write_file(options.out, picture)
    return 0


def _size(text: str | None) -> Pixels | None:
    from s2rstore.errors import RequestError

    if text is None:
        return None
    found = re.fullmatch(r"([0-9]{3,5})x([0-9]{3,5})", text)
    if not found or not all(200 <= int(part) <= 8000 for part in found.groups()):
        raise RequestError(f"--size {text}: pixels from 200x200 to 8000x8000")
    return int(found[1]), int(found[2])


def _screen(store: Path, wanted: SceneOptions, size: Pixels, theme: Theme) -> bytes:
    from s2rtui.app.pilot import screen_of
    from s2rtui.canvas import RenderOptions
    from s2rtui.export.scene import staged

    with staged(store, wanted) as scene:
        return screen_of(store, scene.state, size, RenderOptions(theme))
