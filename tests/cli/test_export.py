"""The export command: views, sizes, options and deterministic output."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from s2rtui.canvas import DARK, LIGHT
from s2rtui.charts.registry import BY_NAME, STORED, VIEWS
from s2rtui.cli import main
from s2rtui.export.load_scene import SceneOptions, open_scene
from s2rtui.user_data.notebook import Notebook, SavedSelection
from tests.support import nights
from tests.support.copies import copy_store
from tests.support.suggestions import store_reports

HEAT_OPTION = ["--heat", "feature_distance"]
SELECTION_HEATMAP = ["--heat", "occlusion:rgb", "--on", "selection"]


def export(store: Path, folder: Path, view: str, *options: str, suffix: str = ".png") -> bytes:
    out = folder / f"figure{suffix}"
    size = [] if "--size" in options else ["--size", "480x360"]
    assert main(["export", str(store), "--view", view, *size, *options, "--out", str(out)]) == 0
    return out.read_bytes()


@pytest.fixture(scope="module")
def default_figure(
    tiny_store: Path, tmp_path_factory: pytest.TempPathFactory
) -> Callable[[str], bytes]:
    """Draws a view once as 800x600 without further options."""
    folder = tmp_path_factory.mktemp("usual")
    return cache(lambda view: export(tiny_store, folder, view, "--size", "800x600"))


@pytest.mark.parametrize("view", [*(name for name in STORED if name != "history"), "workbench"])
def test_every_view_is_drawn_in_both_themes_at_the_requested_size(
    tiny_store: Path, tmp_path: Path, view: str
) -> None:
    if view == "suggestions":
        tiny_store = copy_store(tiny_store, tmp_path / "own.s2r")
        store_reports(tiny_store, "vanilla", "real")
    for options, theme, size in (([], LIGHT, (615, 433)), (["--dark"], DARK, (300, 640))):
        data = export(tiny_store, tmp_path, view, *options, "--size", "{}x{}".format(*size))
        image = Image.open(BytesIO(data))
        assert image.size == size
        assert image.convert("RGB").getpixel((size[0] - 1, size[1] - 1)) == theme.background


def test_all_views_except_adjust_can_be_exported() -> None:
    assert {view.name for view in VIEWS if not view.from_store} == {"adjust"}
    assert STORED["geomap"] is STORED["map"]


@pytest.mark.parametrize(("view", "suffix"), [("map", ".png"), ("rooms", ".svg"), ("umap", ".pdf")])
def test_two_processes_write_the_same_bytes(
    tiny_store: Path, tmp_path: Path, view: str, suffix: str
) -> None:
    options = [sys.executable, "-m", "s2rtui", "export", str(tiny_store), "--view", view,
             "--select", "worst15", "--size", "640x480", "--out"]  # fmt: skip
    root = Path(__file__).resolve().parents[2]
    paths = os.pathsep.join(str(root / part) for part in (".", "store", "tools"))
    for seed in ("1", "2"):
        environment = {**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": paths}
        subprocess.run([*options, str(tmp_path / (seed + suffix))], check=True, env=environment)
    assert (tmp_path / f"1{suffix}").read_bytes() == (tmp_path / f"2{suffix}").read_bytes()


def test_vector_files_contain_no_date(tiny_store: Path, tmp_path: Path) -> None:
    svg = export(tiny_store, tmp_path, "errors", suffix=".svg")
    assert b"<svg" in svg
    assert b"<dc:date>" not in svg
    pdf = export(tiny_store, tmp_path, "errors", suffix=".pdf")
    assert pdf.startswith(b"%PDF")
    assert b"CreationDate" not in pdf


@pytest.mark.parametrize(
    ("view", "options"),
    [
        ("map", ["--select", "worst15"]), ("map", ["--run", "dataaug"]), ("map", ["--iid", "3"]),
        ("map", ["--mode", "full"]), ("map", ["--mode", "glyph"]), ("map", ["--room-names"]),
        ("map", ["--trajectory", "b"]), ("map", SELECTION_HEATMAP),
        ("map", ["--heat", "occlusion:rgb", "--on", "instance", "--iid", "4"]),
        ("instance", ["--iid", "7"]), ("instance", ["--heat", "occlusion:rgb"]),
        ("compare", ["--side", "sim"]), ("compare", ["--select", "best15"]),
        ("overview", ["--side", "sim"]), ("overview", ["--select", "worst15"]),
        ("list", ["--sort", "gap"]), ("list", ["--ascending"]),
        ("scatter", ["--select", "worst15"]), ("scatter", ["--run", "dataaug"]),
        ("rooms", ["--select", "worst15"]), ("orientation", ["--run", "dataaug"]),
        ("workbench", ["--select", "worst15"]), ("workbench", ["--mode", "full"]),
    ],
)  # fmt: skip
def test_options_change_the_figure(
    tiny_store: Path,
    tmp_path: Path,
    default_figure: Callable[[str], bytes],
    view: str,
    options: list[str],
) -> None:
    assert export(tiny_store, tmp_path, view, *options, "--size", "800x600") != default_figure(view)


@pytest.mark.parametrize("options", [["--aggregate", "count"], ["--aggregate", "max"], ["--clip"],
                                   ["--side", "sim"]])  # fmt: skip
def test_options_change_the_selection_heatmap(
    tiny_store: Path, tmp_path: Path, options: list[str]
) -> None:
    default = export(tiny_store, tmp_path, "map", *SELECTION_HEATMAP)
    assert export(tiny_store, tmp_path, "map", *SELECTION_HEATMAP, *options) != default


def test_the_caption_describes_the_selection(tiny_store: Path) -> None:
    with open_scene(tiny_store, SceneOptions("worst(3, gap)"), BY_NAME["map"]) as scene:
        assert scene.caption == "tiny  ·  3 of 40 instances  ·  worst(3, gap)"
        assert scene.state.cursor is None
    with open_scene(tiny_store, SceneOptions("worst(3, gap)"), BY_NAME["instance"]) as scene:
        gap = scene.store.run_columns("vanilla").real.error
        selected = np.flatnonzero(scene.state.selected)
        assert scene.state.cursor == selected[np.argmax(gap[selected])]


def test_heatmap_counts_are_in_pixels_and_missing_where_zero(tiny_store: Path) -> None:
    scene_options = SceneOptions(heat="occlusion:rgb", overlay="selection", aggregate="count")
    with open_scene(tiny_store, scene_options, BY_NAME["map"]) as scene:
        view = BY_NAME["map"].input(scene)
        assert view.heat_unit == "pixels"
        assert view.heat_label.endswith("count")
        grid = scene.resources.floor_heat
        assert grid is not None
        assert np.nanmin(grid) >= 1


def test_saved_selections_can_be_exported_by_name(tiny_store: Path, tmp_path: Path) -> None:
    Notebook("0" * 64).save("mine", SavedSelection("worst15", 1, "vanilla", 6))
    named = export(tiny_store, tmp_path, "rooms", "--select", "@mine")
    assert named != export(tiny_store, tmp_path, "rooms")


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["--view", "adjust", "--out", "a.png"], "adjust"),
        (["--view", "map", "--out", "a.gif"], ".pdf"),
        (["--view", "workbench", "--out", "a.svg"], ".png"),
        (["--view", "map", "--out", "a.png", "--size", "10x10"], "--size"),
        (["--view", "map", "--out", "a.png", *HEAT_OPTION], "--on selection"),
        (["--view", "map", "--out", "a.png", "--heat", "rubbish"], "feature_distance"),
        (["--view", "map", "--out", "a.png", "--heat", "occlusion:x"], "occlusion:rgb"),
        (["--view", "map", "--out", "a.png", "--trajectory", "c"], "one of a, b"),
        (["--view", "map", "--out", "a.png", "--iid", "40"], "0 to 39"),
        (["--view", "compare", "--out", "a.png", "--with", "vanilla"], "dataaug"),
        (["--view", "list", "--out", "a.png", "--sort", "rubbish"], "real.error"),
        (["--view", "instance", "--out", "a.png", "--select", "none"], "selects nothing"),
        (["--view", "map", "--out", "no/folder/a.png"], "cannot be written"),
    ],
)
def test_an_invalid_request_prints_one_line(
    tiny_store: Path, tmp_path: Path, options: list[str], expected: str, capsys, monkeypatch
) -> None:
    monkeypatch.chdir(tmp_path)
    try:
        code = main(["export", str(tiny_store), *options])
    except SystemExit as stop:
        code = int(stop.code or 0)
    error = capsys.readouterr().err
    assert code == 2
    assert error.count("\n") == 1
    assert expected in error
    assert not list(tmp_path.glob("a.*"))


def test_the_history_is_exported_and_a_missing_one_is_rejected(
    store_copy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["export", str(store_copy), "--view", "history", "--out", str(tmp_path / "gap.png")]
    assert main(options) == 2
    assert "no nights yet" in capsys.readouterr().err
    (tmp_path / "drives").mkdir()
    week = nights.Week(nights.write_config(tmp_path, store_copy), {}, from_day=9)
    week.night(1)
    assert main([*options, "--size", "615x433"]) == 0
    assert Image.open(tmp_path / "gap.png").size == (615, 433)


def test_pages_of_paper_have_their_width_title_and_colours(
    tiny_store: Path, tmp_path: Path
) -> None:
    def page(*options: str) -> bytes:
        out = tmp_path / "page.png"
        arguments = ["export", str(tiny_store), "--view", "map", *options, "--out", str(out)]
        assert main(arguments) == 0
        return out.read_bytes()

    narrow = page("--width", "80", "--dpi", "100")
    assert Image.open(BytesIO(narrow)).width == round(80 / 25.4 * 100)
    assert Image.open(BytesIO(narrow)).info["dpi"] == pytest.approx((100, 100), abs=0.1)
    assert Image.open(BytesIO(page("--dpi", "100"))).width == round(160 / 25.4 * 100)
    assert page("--width", "80", "--dpi", "100", "--title", "Doors") != narrow
    assert page("--width", "80", "--dpi", "100", "--cmap", "viridis") != narrow
    assert page("--width", "80", "--dpi", "100", "--cmap", "turbo") == narrow


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["--cmap", "jet"], "--cmap jet: must be one of turbo, viridis"),
        (["--width", "900"], "--width 900: must be 40 to 420"),
        (["--dpi", "5"], "--dpi 5: must be 72 to 1200"),
        (["--width", "80", "--size", "300x300"], "--size: pixels; leave it out"),
    ],
)
def test_wrong_pages_are_refused_in_one_line(
    tiny_store: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    options: list[str],
    expected: str,
) -> None:
    out = str(tmp_path / "a.png")
    assert main(["export", str(tiny_store), "--view", "map", *options, "--out", out]) == 2
    error = capsys.readouterr().err
    assert expected in error
    assert error.count("\n") == 1


def test_the_colours_of_a_map_are_those_of_the_colour_map(tiny_store: Path) -> None:
    from matplotlib import colormaps

    from s2rtui.charts.shared.paper import figure_format, value_colours

    with figure_format(colour_map="cividis"):
        colours = value_colours([0.0, 0.5, 1.0, -1.0, np.nan])
    expected = [colormaps["cividis"](share, bytes=True)[:3] for share in (0.0, 0.5, 1.0, 0.0, 0.0)]
    assert colours.tolist() == [[int(part) for part in colour] for colour in expected]
    assert (value_colours([1.0]) != colours[2]).any()
