"""The gap command on synthetic worlds with known truth."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from s2rtui.cli import main
from tests.conftest import BuildOnce

WORLDS = {"all": "lights,latency,wheels", "none": "none"}
SWAPPED = {"lights": ("all", "none"), "robot": ("none", "all")}
"""Worlds that combine the images of one world with the drives of another."""
Gap = Callable[..., tuple[int, dict[str, Any]]]


@pytest.fixture(scope="module")
def worlds(build_once: BuildOnce) -> Path:
    """A folder of small worlds, one per choice of factors, with one pretrained model.

    Robot factors affect only drives; all others affect only images.
    """
    return build_once("worlds", _build)


def _build(folder: Path) -> None:
    from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
    from s2rtools.training import pretrained
    from tests.support.silent_reporter import SilentReporter

    folder.mkdir()
    for name, factors in WORLDS.items():
        path = folder / f"{name}.s2r"
        options = ["ingest", "world", "--instances", "28", "--size", "64", "--factors", factors]
        assert main([*options, "--store", str(path)]) == 0
        pretrained.add_pretrained_models(path)
        precompute(path, SilentReporter(), ["vanilla"], PrecomputeOptions(("activation",)))
    for name, (images, drives) in SWAPPED.items():
        path = folder / f"{name}.s2r"
        shutil.copytree(folder / f"{images}.s2r", path)
        shutil.rmtree(path / "drives")
        shutil.copytree(folder / f"{drives}.s2r" / "drives", path / "drives")
    frozen = ["--freeze", str(folder / "ref.json"), "--anchor-run", "vanilla"]
    assert main(["gap", str(folder / "all.s2r"), *frozen]) == 0


@pytest.fixture(scope="module")
def measured() -> dict[tuple[str, ...], tuple[int, dict[str, Any]]]:
    """What the command has reported: it is deterministic."""
    return {}


@pytest.fixture
def gap(worlds: Path, capsys: pytest.CaptureFixture[str], measured: dict[tuple, tuple]) -> Gap:
    """Exit code and report of the command on a world; for a rejected request its message."""

    def run(name: str, *options: str) -> tuple[int, dict[str, Any]]:
        if (name, *options) not in measured:
            capsys.readouterr()
            code = main(["gap", str(worlds / f"{name}.s2r"), *options, "--json"])
            out, err = capsys.readouterr()
            measured[name, *options] = code, json.loads(out) if out else {"refused": err}
        return measured[name, *options]

    return run


def test_a_world_without_factors_has_no_gap(worlds, gap):
    code, report = gap("none", "--reference", str(worlds / "ref.json"))
    assert (code, report["verdict"]["outcome"]) == (0, "PASS")
    by_axis = {entry["axis"]: entry for entry in report["axes"]}
    assert list(by_axis) == ["visual", "task", "dynamics", "delay"]
    assert by_axis["visual"]["gap"] == by_axis["task"]["gap"] == 0
    assert abs(report["verdict"]["gap"]) < 1


@pytest.mark.parametrize(
    ("name", "worst", "unaffected"),
    [("lights", {"visual", "task"}, {"dynamics", "delay"}), ("robot", {"delay"}, {"visual"})],
)
def test_each_axis_responds_to_its_factor(worlds, gap, name, worst, unaffected):
    code, report = gap(name, "--reference", str(worlds / "ref.json"))
    assert (code, report["verdict"]["outcome"]) == (1, "FAIL")
    assert report["verdict"]["worst"] in worst
    gaps = {entry["axis"]: entry["gap"] for entry in report["axes"]}
    assert all(abs(gaps[axis]) < 1 for axis in unaffected)
    assert all(gaps[axis] > 15 for axis in worst)


def test_latency_and_wheels_are_measured_from_the_drives(worlds, gap):
    _, report = gap("robot", "--reference", str(worlds / "ref.json"))
    delay = next(entry for entry in report["axes"] if entry["axis"] == "delay")["details"]
    assert delay["delay"] == pytest.approx(0.08, abs=0.002)
    truth = json.loads((worlds / "robot.s2r" / "drives" / "truth.json").read_text())
    assert truth["values"]["wheels"] > 0
    gaps = {}
    for name in ("none", "robot"):
        _, report = gap(name, "--reference", str(worlds / "ref.json"))
        gaps[name] = next(entry for entry in report["axes"] if entry["axis"] == "dynamics")
    assert gaps["robot"]["gap_low"] > 3
    assert gaps["none"]["gap_high"] < 1


def test_printed_details_equal_the_report(worlds, gap, capsys):
    _, report = gap("all")
    main(["gap", str(worlds / "all.s2r"), "--details"])
    printed = capsys.readouterr().out
    details = {entry["axis"]: entry["details"] for entry in report["axes"]}
    assert f"{details['task']['baseline']:.2f} m for the constant prediction" in printed
    assert f"delay {1000 * details['delay']['delay']:.1f} (" in printed
    assert f"{details['visual']['halves']['fid']['value']:.4g}" in printed
    for row in details["dynamics"]["horizons"]:
        assert f"{row['rmse']:.3f} ({row['rmse_low']:.3f}" in printed


@pytest.mark.parametrize(
    ("options", "code", "expected"),
    [
        (["--reference", "nowhere.json"], 2, "nowhere.json"),
        (["--select", "error >"], 2, "column"),
        (["--run", "nobody"], 2, "nobody"),
        (["--run", "dataaug"], 2, "not computed"),
        (["--threshold", "0"], 2, "--threshold"),
        (["--margin", "-1"], 2, "--margin"),
        (["--pca", "0"], 2, "--pca"),
        (["--drives", "/nowhere"], 2, "/nowhere"),
        (["--features", "/nowhere.toml"], 2, "/nowhere.toml"),
        (["--golden", "/nowhere.json"], 2, "/nowhere.json"),
        (["--freeze", "/nowhere/ref.json"], 2, "/nowhere/ref.json"),
        (["--axis", "visual", "--select", "seq:0..2", "--freeze", "x.json"], 3, "49"),
    ],
)
def test_invalid_requests_are_reported_in_one_line(
    gap, tmp_path, monkeypatch, options, code, expected
):
    monkeypatch.chdir(tmp_path)
    actual_code, report = gap("all", *options)
    assert actual_code == code
    assert expected in report["refused"]
    assert report["refused"].count("\n") == 1
    assert list(tmp_path.glob("*")) == []
