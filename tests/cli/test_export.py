"""The export command: views, sizes, options and deterministic output."""

import subprocess
import sys
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from bench.support.processes import program_environment
from s2rtui.canvas import DARK, LIGHT
from s2rtui.charts.registry import BY_NAME, STORED, VIEWS
from s2rtui.cli import main
from s2rtui.export.load_scene import SceneOptions, open_scene
from tests.support.copies import copy_store
from tests.support.drives import add_drives
from tests.support.suggestions import store_reports

SELECTION_HEATMAP = ["--heat", "occlusion:rgb", "--on", "selection"]


def export(store: Path, folder: Path, view: str, *options: str, suffix: str = ".png") -> bytes:
    out = folder / f"figure{suffix}"
    size = [] if "--size" in options else ["--size", "320x240"]
    assert main(["export", str(store), "--view", view, *size, *options, "--out", str(out)]) == 0
    return out.read_bytes()


@pytest.mark.parametrize("view", [*(name for name in STORED if name != "history"), "workbench"])
def test_every_view_is_drawn_in_both_themes_at_the_requested_size(tiny_store, tmp_path, view):
    if view in ("suggestions", "drives"):
        tiny_store = copy_store(tiny_store, tmp_path / "own.s2r")
        store_reports(tiny_store, "vanilla", "real")
        add_drives(tiny_store)
    for options, theme, size in (([], LIGHT, (615, 433)), (["--theme", "dark"], DARK, (300, 640))):
        data = export(tiny_store, tmp_path, view, *options, "--size", "{}x{}".format(*size))
        image = Image.open(BytesIO(data))
        assert image.size == size
        assert image.convert("RGB").getpixel((size[0] - 1, size[1] - 1)) == theme.background


def test_all_views_except_adjust_can_be_exported():
    assert {view.name for view in VIEWS if not view.from_store} == {"adjust"}
    assert STORED["geomap"] is STORED["map"]


def test_two_processes_write_the_same_bytes(tiny_store, tmp_path):
    code = (
        "import sys; from s2rtui.cli import main\n"
        "for view, suffix in (('map', 'png'), ('rooms', 'svg'), ('umap', 'pdf')):\n"
        "    words = ['export', sys.argv[1], '--view', view, '--select', 'worst15', '--size',\n"
        "             '320x240', '--out', f'{sys.argv[2]}-{view}.{suffix}']\n"
        "    assert main(words) == 0"
    )
    for seed in ("1", "2"):
        environment = program_environment(PYTHONHASHSEED=seed)
        command = [sys.executable, "-c", code, str(tiny_store), str(tmp_path / seed)]
        subprocess.run(command, check=True, env=environment)
    for name in ("map.png", "rooms.svg", "umap.pdf"):
        assert (tmp_path / f"1-{name}").read_bytes() == (tmp_path / f"2-{name}").read_bytes()
    assert b"<dc:date>" not in (tmp_path / "1-rooms.svg").read_bytes()
    assert b"CreationDate" not in (tmp_path / "1-umap.pdf").read_bytes()


def test_options_change_the_figure(tiny_store, tmp_path):
    changes: dict[tuple[str, ...], list[str]] = {
        ("map",): ["--select worst15", "--run dataaug", "--iid 3", "--mode full", "--mode glyph",
                   "--room-names", "--trajectory b",
                   "--heat occlusion:rgb --on instance --iid 4"],
        ("map", *SELECTION_HEATMAP, "--size", "480x360"): [
            "--aggregate count", "--aggregate max", "--clip", "--side sim",
        ],
        ("instance",): ["--iid 7", "--heat occlusion:rgb"],
        ("compare",): ["--side sim", "--iid 3"],
        ("scatter",): ["--iid 3"],
        ("list",): ["--sort gap", "--ascending"],
        ("workbench", "--size", "800x600"): ["--mode full"],
    }  # fmt: skip
    for view, options in changes.items():
        default = export(tiny_store, tmp_path, *view)
        for words in options:
            figure = export(tiny_store, tmp_path, *view, *words.split())
            assert figure != default, (view, words)


def test_the_caption_describes_the_selection(tiny_store):
    with open_scene(tiny_store, SceneOptions("worst(3, gap)"), BY_NAME["map"]) as scene:
        assert scene.caption == "tiny  ·  3 of 40 instances  ·  worst(3, gap)"
        assert scene.state.cursor is None
    with open_scene(tiny_store, SceneOptions("worst(3, gap)"), BY_NAME["instance"]) as scene:
        gap = scene.store.run_columns("vanilla").real.error
        selected = np.flatnonzero(scene.state.selected)
        assert scene.state.cursor == selected[np.argmax(gap[selected])]


def test_heatmap_counts_are_in_pixels_and_missing_where_zero(tiny_store):
    scene_options = SceneOptions(heat="occlusion:rgb", overlay="selection", aggregate="count")
    with open_scene(tiny_store, scene_options, BY_NAME["map"]) as scene:
        view = BY_NAME["map"].input(scene)
        assert view.heat_unit == "pixels"
        assert view.heat_label.endswith("count")
        grid = scene.loaded.floor_heat
        assert grid is not None
        assert np.nanmin(grid) >= 1


def test_pages_of_paper_have_their_width_title_and_colours(tiny_store, tmp_path):
    def page(*options: str) -> bytes:
        out = tmp_path / "page.png"
        arguments = ["export", str(tiny_store), "--view", "map", *options, "--out", str(out)]
        assert main(arguments) == 0
        return out.read_bytes()

    narrow = page("--width", "80", "--dpi", "100")
    assert Image.open(BytesIO(narrow)).width == round(80 / 25.4 * 100)
    assert Image.open(BytesIO(narrow)).info["dpi"] == pytest.approx((100, 100), abs=0.1)
    assert Image.open(BytesIO(page("--dpi", "100"))).width == round(160 / 25.4 * 100)
    titled = page("--width", "80", "--dpi", "100", "--title", "Doors")
    assert len({narrow, titled, page("--width", "80", "--dpi", "100", "--title", "")}) == 3
    assert page("--width", "80", "--dpi", "100", "--cmap", "viridis") != narrow
    assert page("--width", "80", "--dpi", "100", "--cmap", "turbo") == narrow


def test_the_colours_of_a_map_are_those_of_the_colour_map(tiny_store):
    from matplotlib import colormaps

    from s2rtui.drawing.figure_format import FigureFormat, figure_format, value_colours

    with figure_format(FigureFormat(colour_map="cividis")):
        colours = value_colours([0.0, 0.5, 1.0, -1.0, np.nan])
    expected = [colormaps["cividis"](share, bytes=True)[:3] for share in (0.0, 0.5, 1.0, 0.0, 0.0)]
    assert colours.tolist() == [[int(part) for part in colour] for colour in expected]
    assert (value_colours([1.0]) != colours[2]).any()
