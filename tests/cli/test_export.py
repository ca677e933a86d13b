"""Figures from the command line: every view, any size, the same bytes, what options change."""

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

HEAT = ["--heat", "feature_distance"]
GATHERED = ["--heat", "occlusion:rgb", "--on", "selection"]


def export(store: Path, folder: Path, view: str, *words: str, end: str = ".png") -> bytes:
    out = folder / f"figure{end}"
    size = [] if "--size" in words else ["--size", "480x360"]
    assert main(["export", str(store), "--view", view, *size, *words, "--out", str(out)]) == 0
    return out.read_bytes()


@pytest.fixture(scope="module")
def usual(tiny_store: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], bytes]:
    """Figures of 800x600 without further options, each drawn once."""
    folder = tmp_path_factory.mktemp("usual")
    return cache(lambda view: export(tiny_store, folder, view, "--size", "800x600"))


@pytest.mark.parametrize("view", [*(name for name in STORED if name != "history"), "workbench"])
def test_every_view_is_drawn_light_and_dark_at_the_size_asked_for(
    tiny_store: Path, tmp_path: Path, view: str
) -> None:
    for words, theme, size in (([], LIGHT, (615, 433)), (["--dark"], DARK, (300, 640))):
        data = export(tiny_store, tmp_path, view, *words, "--size", "{}x{}".format(*size))
        picture = Image.open(BytesIO(data))
        assert picture.size == size
        assert picture.convert("RGB").getpixel((size[0] - 1, size[1] - 1)) == theme.background


def test_what_is_stored_is_drawn_and_listed_flat() -> None:
    assert {view.name for view in VIEWS if not view.from_store} == {"adjust"}
    assert STORED["geomap"] is STORED["map"]


@pytest.mark.parametrize(("view", "end"), [("map", ".png"), ("rooms", ".svg"), ("umap", ".pdf")])
def test_two_processes_write_the_same_bytes(
    tiny_store: Path, tmp_path: Path, view: str, end: str
) -> None:
    words = [sys.executable, "-m", "s2rtui", "export", str(tiny_store), "--view", view,
             "--select", "worst15", "--size", "640x480", "--out"]  # fmt: skip
    root = Path(__file__).resolve().parents[2]
    paths = os.pathsep.join(str(root / part) for part in (".", "store", "tools"))
    for seed in ("1", "2"):
        environment = {**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": paths}
        subprocess.run([*words, str(tmp_path / (seed + end))], check=True, env=environment)
    assert (tmp_path / f"1{end}").read_bytes() == (tmp_path / f"2{end}").read_bytes()


def test_vector_forms_carry_no_date(tiny_store: Path, tmp_path: Path) -> None:
    drawn = export(tiny_store, tmp_path, "errors", end=".svg")
    assert b"<svg" in drawn
    assert b"<dc:date>" not in drawn
    pages = export(tiny_store, tmp_path, "errors", end=".pdf")
    assert pages.startswith(b"%PDF")
    assert b"CreationDate" not in pages


@pytest.mark.parametrize(
    ("view", "words"),
    [
        ("map", ["--select", "worst15"]), ("map", ["--run", "dataaug"]), ("map", ["--iid", "3"]),
        ("map", ["--mode", "full"]), ("map", ["--mode", "glyph"]), ("map", ["--room-names"]),
        ("map", ["--trajectory", "b"]), ("map", GATHERED),
        ("map", ["--heat", "occlusion:rgb", "--on", "instance", "--iid", "4"]),
        ("instance", ["--iid", "7"]), ("instance", ["--heat", "occlusion:rgb"]),
        ("compare", ["--side", "sim"]), ("compare", ["--select", "best15"]),
        ("overview", ["--side", "sim"]), ("overview", ["--select", "worst15"]),
        ("list", ["--sort", "gap"]), ("list", ["--ascending"]),
        ("rooms", ["--select", "worst15"]), ("orientation", ["--run", "dataaug"]),
        ("workbench", ["--select", "worst15"]), ("workbench", ["--mode", "full"]),
    ],
)  # fmt: skip
def test_options_change_the_figure(
    tiny_store: Path, tmp_path: Path, usual: Callable[[str], bytes], view: str, words: list[str]
) -> None:
    assert export(tiny_store, tmp_path, view, *words, "--size", "800x600") != usual(view)


@pytest.mark.parametrize("words", [["--aggregate", "count"], ["--aggregate", "max"], ["--clip"],
                                   ["--side", "sim"]])  # fmt: skip
def test_options_change_gathered_heat(tiny_store: Path, tmp_path: Path, words: list[str]) -> None:
    usual = export(tiny_store, tmp_path, "map", *GATHERED)
    assert export(tiny_store, tmp_path, "map", *GATHERED, *words) != usual


def test_the_words_under_a_title_say_what_is_shown(tiny_store: Path) -> None:
    with open_scene(tiny_store, SceneOptions("worst(3, gap)"), BY_NAME["map"]) as scene:
        assert scene.caption == "tiny  ·  3 of 40 instances  ·  worst(3, gap)"
        assert scene.state.cursor is None
    with open_scene(tiny_store, SceneOptions("worst(3, gap)"), BY_NAME["instance"]) as scene:
        gap = scene.store.run_columns("vanilla").real.error
        chosen = np.flatnonzero(scene.state.selected)
        assert scene.state.cursor == chosen[np.argmax(gap[chosen])]


def test_counts_of_gathered_heat_are_pixels_and_absent_where_none_fell(tiny_store: Path) -> None:
    wanted = SceneOptions(heat="occlusion:rgb", overlay="selection", aggregate="count")
    with open_scene(tiny_store, wanted, BY_NAME["map"]) as scene:
        view = BY_NAME["map"].input(scene)
        assert view.heat_unit == "pixels"
        assert view.heat_label.endswith("count")
        grid = scene.resources.floor_heat
        assert grid is not None
        assert np.nanmin(grid) >= 1


def test_saved_selections_have_names_here_too(tiny_store: Path, tmp_path: Path) -> None:
    Notebook("0" * 64).save("mine", SavedSelection("worst15", 1, "vanilla", 6))
    named = export(tiny_store, tmp_path, "rooms", "--select", "@mine")
    assert named != export(tiny_store, tmp_path, "rooms")


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--view", "adjust", "--out", "a.png"], "adjust"),
        (["--view", "map", "--out", "a.gif"], ".pdf"),
        (["--view", "workbench", "--out", "a.svg"], ".png"),
        (["--view", "map", "--out", "a.png", "--size", "10x10"], "--size"),
        (["--view", "map", "--out", "a.png", *HEAT], "--on selection"),
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
def test_a_wrong_request_is_one_line(
    tiny_store: Path, tmp_path: Path, words: list[str], told: str, capsys, monkeypatch
) -> None:
    monkeypatch.chdir(tmp_path)
    try:
        code = main(["export", str(tiny_store), *words])
    except SystemExit as stop:
        code = int(stop.code or 0)
    said = capsys.readouterr().err
    assert code == 2
    assert said.count("\n") == 1
    assert told in said
    assert not list(tmp_path.glob("a.*"))


def test_nights_are_drawn_and_none_are_told(
    store_copy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["export", str(store_copy), "--view", "history", "--out", str(tmp_path / "gap.png")]
    assert main(words) == 2
    assert "no nights yet" in capsys.readouterr().err
    (tmp_path / "drives").mkdir()
    week = nights.Week(nights.write_config(tmp_path, store_copy), {}, from_day=9)
    week.night(1)
    assert main([*words, "--size", "615x433"]) == 0
    assert Image.open(tmp_path / "gap.png").size == (615, 433)
