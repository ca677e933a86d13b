"""The gap of worlds whose truth is known, by the command."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from s2rtui.cli import main

pytestmark = pytest.mark.xdist_group("world")
WORLDS = {"all": "lights,latency,wheels", "none": "none"}
SWAPPED = {"lights": ("all", "none"), "robot": ("none", "all")}
"""Worlds with the images of one and the drives of another."""
Gap = Callable[..., tuple[int, dict[str, Any]]]


@pytest.fixture(scope="module")
def worlds(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of small worlds, one for each choice of factors, seen by one shipped model.

    A robot's factors show in drives alone, the others in images alone.
    """
    from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
    from s2rtools.training import pretrained
    from tests.support.silent_reporter import SilentReporter

    folder = tmp_path_factory.mktemp("worlds")
    for name, factors in WORLDS.items():
        path = folder / f"{name}.s2r"
        words = ["ingest", "world", "--instances", "24", "--factors", factors]
        assert main([*words, "--store", str(path)]) == 0
        pretrained.add_pretrained_models(path)
        precompute(path, SilentReporter(), ["vanilla"], PrecomputeOptions(("activation",)))
    for name, (images, drives) in SWAPPED.items():
        path = folder / f"{name}.s2r"
        shutil.copytree(folder / f"{images}.s2r", path)
        shutil.rmtree(path / "drives")
        shutil.copytree(folder / f"{drives}.s2r" / "drives", path / "drives")
    assert main(["gap", str(folder / "all.s2r"), "--freeze", str(folder / "ref.json")]) == 0
    return folder


@pytest.fixture
def gap(worlds: Path, capsys: pytest.CaptureFixture[str]) -> Gap:
    """Exit code and report of the command on a world; a refusal's line as the report."""

    def run(name: str, *words: str) -> tuple[int, dict[str, Any]]:
        capsys.readouterr()
        code = main(["gap", str(worlds / f"{name}.s2r"), *words, "--json"])
        out, err = capsys.readouterr()
        return code, json.loads(out) if out else {"refused": err}

    return run


def test_without_factors_there_is_no_gap(worlds: Path, gap: Gap) -> None:
    code, found = gap("none", "--reference", str(worlds / "ref.json"))
    assert (code, found["verdict"]["outcome"]) == (0, "PASS")
    by_axis = {each["axis"]: each for each in found["axes"]}
    assert list(by_axis) == ["visual", "task", "dynamics", "delay"]
    assert by_axis["visual"]["gap"] == by_axis["task"]["gap"] == 0
    assert abs(found["verdict"]["gap"]) < 1


@pytest.mark.parametrize(
    ("name", "worst", "calm"),
    [("lights", {"visual", "task"}, {"dynamics", "delay"}), ("robot", {"delay"}, {"visual"})],
)
def test_each_axis_answers_to_its_own_factor(
    worlds: Path, gap: Gap, name: str, worst: set[str], calm: set[str]
) -> None:
    code, found = gap(name, "--reference", str(worlds / "ref.json"))
    assert (code, found["verdict"]["outcome"]) == (1, "FAIL")
    assert found["verdict"]["worst"] in worst
    gaps = {each["axis"]: each["gap"] for each in found["axes"]}
    assert all(abs(gaps[axis]) < 1 for axis in calm)
    assert all(gaps[axis] > 15 for axis in worst)


def test_the_drives_are_those_of_the_factors(worlds: Path, gap: Gap) -> None:
    code, found = gap("robot")
    assert code == 3
    delay = next(each for each in found["axes"] if each["axis"] == "delay")["details"]
    assert delay["delay"] == pytest.approx(0.08, abs=0.002)
    truth = json.loads((worlds / "robot.s2r" / "drives" / "truth.json").read_text())
    assert truth["values"]["wheels"] > 0


def test_wheels_that_no_parameter_follows_move_the_dynamics(worlds: Path, gap: Gap) -> None:
    gaps = {}
    for name in ("none", "robot"):
        _, found = gap(name, "--reference", str(worlds / "ref.json"))
        gaps[name] = next(each for each in found["axes"] if each["axis"] == "dynamics")
    assert gaps["robot"]["gap_low"] > 3
    assert gaps["none"]["gap_high"] < 1


def test_details_are_the_figures_of_the_report(
    worlds: Path, gap: Gap, capsys: pytest.CaptureFixture[str]
) -> None:
    _, found = gap("all")
    main(["gap", str(worlds / "all.s2r"), "--details"])
    printed = capsys.readouterr().out
    details = {each["axis"]: each["details"] for each in found["axes"]}
    assert f"{details['task']['baseline']:.2f} m for the constant prediction" in printed
    assert f"delay {1000 * details['delay']['delay']:.1f} (" in printed
    assert f"{details['visual']['halves']['fid']['value']:.4g}" in printed
    for row in details["dynamics"]["horizons"]:
        assert f"{row['rmse']:.3f} ({row['rmse_low']:.3f}" in printed


def test_without_a_reference_nothing_is_decided(gap: Gap) -> None:
    code, found = gap("lights")
    assert (code, found["verdict"]["outcome"]) == (3, "INCONCLUSIVE")
    assert found["verdict"]["gap"] is None
    assert all(each["value"] is not None for each in found["axes"])


def test_one_seed_gives_one_text(worlds: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["gap", str(worlds / "all.s2r"), "--json", "--seed", "3"]
    texts = []
    for _ in range(2):
        main(words)
        texts.append(capsys.readouterr().out)
    assert texts[0] == texts[1]


def test_a_golden_run_notices_the_lights(gap: Gap, tmp_path: Path) -> None:
    path = str(tmp_path / "golden.json")
    code, _ = gap("none", "--axis", "task", "--freeze-golden", path)
    assert code == 0
    code, found = gap("none", "--axis", "task", "--golden", path)
    assert (code, found["golden"]["outcome"]) == (0, "PASS")
    code, found = gap("lights", "--axis", "task", "--golden", path)
    assert (code, found["golden"]["outcome"]) == (1, "FAIL")


def test_a_store_of_one_axis_is_refused_by_a_reference_of_four(
    worlds: Path, gap: Gap, tmp_path: Path
) -> None:
    copy = tmp_path / "none.s2r"
    shutil.copytree(worlds / "none.s2r", copy)
    shutil.rmtree(copy / "drives")
    code, found = gap(str(copy.with_suffix("")), "--reference", str(worlds / "ref.json"))
    assert code == 2
    assert "judges delay, which cannot be measured here (no drives" in found["refused"]
    assert found["refused"].count("\n") == 1


@pytest.mark.parametrize(
    ("words", "code", "told"),
    [
        (["--reference", "nowhere.json"], 2, "nowhere.json"),
        (["--select", "none"], 2, "no instance"),
        (["--select", "error >"], 2, "column"),
        (["--run", "nobody"], 2, "nobody"),
        (["--run", "dataaug"], 2, "not computed"),
        (["--threshold", "0"], 2, "--threshold"),
        (["--threshold", "nan"], 2, "--threshold"),
        (["--margin", "-1"], 2, "--margin"),
        (["--replicates", "5"], 2, "--replicates"),
        (["--pca", "0"], 2, "--pca"),
        (["--drives", "/nowhere"], 2, "/nowhere"),
        (["--features", "/nowhere.toml"], 2, "/nowhere.toml"),
        (["--golden", "/nowhere.json"], 2, "/nowhere.json"),
        (["--freeze", "/nowhere/ref.json"], 2, "/nowhere/ref.json"),
        (["--axis", "visual", "--select", "seq:0..2", "--freeze", "x.json"], 3, "40"),
    ],
)
def test_wrong_requests_are_told_in_one_line(
    gap: Gap, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    words: list[str], code: int, told: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    found_code, found = gap("all", *words)
    assert found_code == code
    assert told in found["refused"]
    assert found["refused"].count("\n") == 1
    assert list(tmp_path.glob("*")) == []
