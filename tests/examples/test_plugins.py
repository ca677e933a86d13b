"""The example package adds a part of each kind; what cannot be used is left out and named."""

import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest

import s2rstore
from tests.support.copies import copy_store

_PACKAGE = Path(__file__).parents[2] / "examples" / "plugins"
_KINDS = {"layout", "heatmap", "adjustment", "translator", "metric", "view", "renderer",
          "architecture"}  # fmt: skip


def _declare(folder, project, points):
    """Write what pip writes of an installed package with some entry points."""
    declared = folder / f"{project}-1.0.dist-info"
    declared.mkdir(parents=True)
    (declared / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project}\nVersion: 1.0\n")
    lines = [
        line for group, parts in points.items()
        for line in (f"[{group}]", *(f"{name} = {value}" for name, value in parts.items()))
    ]  # fmt: skip
    (declared / "entry_points.txt").write_text("\n".join(lines), encoding="utf-8")


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """Runs `s2r` commands where the example package is installed, one after another."""
    project = tomllib.loads((_PACKAGE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    site = tmp_path_factory.mktemp("site")
    _declare(site, project["name"], project["entry-points"])
    _declare(site, "broken", {
        "s2r.views": {"other": "s2r_example_plugins.view:VIEW"},
        "s2r.layouts": {"none": "s2r_example_plugins:MISSING\x1b"},
        "s2r.translators": {"mkl": "s2r_example_plugins.translator:METHOD"},
    })  # fmt: skip
    path = os.pathsep.join(map(str, (site, _PACKAGE, *sys.path)))
    program = (
        "import json, sys\nfrom s2rtui.cli import main\n"
        "for words in json.loads(sys.argv[1]):\n"
        "    print('#', *words)\n    assert main(words) in (0, 1, 3), words\n"
    )

    def run(*commands):
        words = json.dumps([[str(word) for word in command] for command in commands])
        environment = {**os.environ, "PYTHONPATH": path}
        done = subprocess.run([sys.executable, "-c", program, words], capture_output=True,
                              env=environment, text=True, check=False)  # fmt: skip
        assert done.returncode == 0, done.stderr
        return done

    return run


def test_each_kind_of_part_is_used(installed, tiny_store, tmp_path):
    store = copy_store(tiny_store, tmp_path / "own.s2r")
    images = tmp_path / "images"
    for number, shade in ((0, 60), (1, 160)):
        (images / str(number)).mkdir(parents=True)
        cv2.imwrite(str(images / str(number) / "a.png"), np.full((32, 32, 3), shade, np.uint8))
    walk = tmp_path / "walk"
    walk.mkdir()
    places = [f"{k}.png,{k},1,0" for k in range(4)]
    (walk / "walk.csv").write_text("\n".join(["file,x,y,heading", *places]))
    for k in range(4):
        cv2.imwrite(str(walk / f"{k}.png"), np.full((32, 32, 3), 50 * k, np.uint8))
    shown = installed(
        ["doctor"],
        ["show", store, "doors", "--format", "csv"],
        ["translate", "fit", "brighter", "--source", images / "0", "--target", images / "1",
         "--out", tmp_path / "b.safetensors", "--option", "share=0.5"],
        ["translate", "apply", tmp_path / "b.safetensors", images / "0", tmp_path / "out"],
        ["ingest", f"xyh:{walk}", "--side", "real", "--floor", "ground=0", "--store",
         tmp_path / "walk.s2r", "--size", "16"],
        ["render", store, "--renderer", "floor:90", "--random", "2"],
        ["train", "--store", store, "--recipe", "vanilla", "--arch", "small", "--name", "s",
         "--steps", "2"],
        ["precompute", store, "--run", "s", "--kinds", "edges"],
        ["run", "add", "g", "--model", "s", "--adjust", "sim:gamma=2", "--store", store],
        ["gap", store, "--run", "vanilla", "--axis", "brightness", "--json"],
    ).stdout  # fmt: skip
    listed = [line.split() for line in shown.splitlines() if line.startswith("plug-in ")]
    assert {words[1] for words in listed if "left" not in words} == _KINDS
    assert "real,doors,,2" in shown
    assert (cv2.imread(str(tmp_path / "out" / "a.png")) == 110).all()
    with s2rstore.open(tmp_path / "walk.s2r") as opened:
        assert opened.instances.x.tolist() == [0, 1, 2, 3]
    with s2rstore.open(store) as opened:
        (iid, _) = opened.iids_of("random-0")
        assert set(np.unique(opened.frame("sim", int(iid)).rgb)) <= {90, 200}
        assert opened.heatmap("s", "edges", "real", 0).shape == (32, 32)
        assert opened.models["s"].architecture == "small"
        assert opened.run("g").sim_adjustments == [{"name": "gamma", "value": 2.0}]
        levels = [[opened.frame(side, iid).rgb.mean() for iid in range(40)]
                  for side in ("sim", "real")]  # fmt: skip
    gap = json.loads(shown[shown.rindex("\n{") :])
    (axis,) = (each for each in gap["axes"] if each["axis"] == "brightness")
    assert axis["value"] == pytest.approx(np.abs(np.subtract(*levels)).mean())


def test_parts_that_cannot_be_used_are_named(installed, tiny_store):
    shown = installed(["doctor"], ["show", tiny_store, "overview"])
    for text in ("other: broken 1.0, left out: 'doors' is taken",
                 "none: broken 1.0, left out: cannot be loaded: ",
                 "mkl: broken 1.0, left out: the name is taken"):  # fmt: skip
        assert text in shown.stdout
    assert "s2r: plug-in left out: view other of broken 1.0" in shown.stderr
    assert "plug-in" not in installed(["doctor", "--no-plugins"]).stdout
