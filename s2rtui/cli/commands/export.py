"""`s2r export`: write a figure of a view, an image of the screen, or a file for another program."""

from __future__ import annotations

import argparse
from pathlib import Path

from s2rstore.errors import RequestError
from s2rtools.common.command_line import output, store_argument
from s2rtui.cli import display_arguments, scene_arguments
from s2rtui.cli.coverage_notes import print_notes
from s2rtui.cli.display_arguments import add_theme, size_argument

Pixels = tuple[int, int]
SCREEN = "workbench"
_SCREEN_SIZE = (2000, 1200)
EXAMPLE = "s2r export lab.s2r --view geomap --select worst15 --out map.png"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from s2rtui.charts.registry import STORED
    from s2rtui.export.other_programs import FORMATS

    store_argument.add_readable(parser)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--view", choices=(*STORED, SCREEN),
                      help="view to draw; workbench is the whole screen")  # fmt: skip
    listed = "; ".join(f"{name}: {form.description}" for name, form in FORMATS.items())
    what.add_argument("--to", choices=tuple(FORMATS),
                      help=f"write selected instances for another program ({listed})")  # fmt: skip
    parser.add_argument("--out", type=Path, required=True,
                        help="output file, *.png, *.svg or *.pdf; with --to a new file or "
                        "folder")  # fmt: skip
    parser.add_argument("--size", metavar="WIDTHxHEIGHT", help="size in pixels, such as 1600x1200")
    page = display_arguments.add_page(parser, "page")
    page.add_argument(
        "--title", help="title of the figure, '' for none (default: the view's title)"
    )
    add_theme(page, "light, for paper")
    output.add_safe_csv(parser)
    scene_arguments.add_selection(parser)
    scene_arguments.add_drawing(parser)


def execute(options: argparse.Namespace) -> int:
    from s2rtui.canvas import RenderOptions
    from s2rtui.charts.registry import STORED
    from s2rtui.export.figures import draw_figure, format_of
    from s2rtui.export.load_scene import open_scene

    if options.to is not None:
        return _write_for_others(options)
    if options.safe_csv:
        raise RequestError("--safe-csv: needs --to csv")
    if options.view == SCREEN and options.out.suffix != ".png":
        raise RequestError(f"--out {options.out}: must end in .png")
    form = format_of(options.out, "--out")
    if options.poses is not None and options.view != SCREEN and STORED[options.view].name != "map":
        raise RequestError(f"--poses: drawn on the map; use --view map in place of {options.view}")
    page = display_arguments.page_options(
        options, size=_size(options.size), dark=options.theme == "dark"
    )
    scene_options = scene_arguments.scene_options(options)
    if options.view == SCREEN:
        from s2rtui.app.pilot import snapshot

        if page.is_physical or page.title or page.cmap != "turbo":
            raise RequestError(f"--view {SCREEN}: takes none of --title, --width, --dpi, --cmap")
        with open_scene(options.store, scene_options) as scene:
            print_notes(scene)
            pixels, render_options = page.size or _SCREEN_SIZE, RenderOptions(page.theme)
            cells = pixels[0] // 10, pixels[1] // 20
            shot = snapshot(options.store, cells, options=render_options, state=scene.state)
            image = shot.png(render_options, pixels)
    else:
        view = STORED[options.view]
        with open_scene(options.store, scene_options, view) as scene:
            print_notes(scene)
            image = draw_figure(scene, view, page, form)
    output.write_file(options.out, image)
    return 0


def _write_for_others(options: argparse.Namespace) -> int:
    from s2rtui.export.figures import PageOptions
    from s2rtui.export.load_scene import SceneOptions, open_scene
    from s2rtui.export.other_programs import FORMATS, ExportContent, write

    given = scene_arguments.scene_options(options)
    names = ["select", "run", "trajectories", "with_trained"]
    allowed = ["--select", "--run", "--trajectory", "--with-trained"]
    if FORMATS[options.to].has_heat:
        names.append("heat")
        allowed.append("--heat")
    if options.to == "csv":
        allowed.append("--safe-csv")
    page = display_arguments.page_options(options, size=_size(options.size))
    if (
        given != SceneOptions(**{name: getattr(given, name) for name in names})
        or page != PageOptions()
        or options.theme != "auto"
        or (options.safe_csv and options.to != "csv")
    ):
        raise RequestError(f"--to {options.to}: of the options takes only {', '.join(allowed)}")
    with open_scene(options.store, given) as scene:
        print_notes(scene)
        content = ExportContent.of(scene, given.heat is not None, options.safe_csv)
        write(options.to, content, options.out)
    return 0


def _size(text: str | None) -> Pixels | None:
    if text is None:
        return None
    return size_argument("--size", text, (200, 200), (8000, 8000), "pixels")
