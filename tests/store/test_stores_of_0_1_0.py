"""Everything that version 0.1.0 wrote is read by this version, and not a byte of it changes."""

from __future__ import annotations

import hashlib
import json
import shutil
import tarfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import s2rstore
from s2rstore.gap_history import reader
from s2rstore.language import evaluation
from s2rstore.maintenance.verify import check
from s2rtui.cli import main
from s2rtui.user_data.notebook import Notebook

ARCHIVE = Path(__file__).parents[1] / "fixtures" / "store-0.1.0" / "store.tar.xz"
AXES = ("--axis", "task", "--axis", "delay")


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("0.1.0")
    with tarfile.open(ARCHIVE) as archive:
        archive.extractall(folder, filter="data")
    return folder


@pytest.fixture
def folder(unpacked: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The unpacked archive as working folder; afterwards it must hold the same bytes."""
    before = _checksums(unpacked)
    monkeypatch.chdir(unpacked)
    yield unpacked
    assert _checksums(unpacked) == before


@pytest.fixture
def expected(folder: Path) -> dict[str, Any]:
    loaded: dict[str, Any] = json.loads((folder / "expected.json").read_text())
    return loaded


def _checksums(folder: Path) -> dict[str, str]:
    """SHA-256 of every file but the lock files, which hold the number of the last process."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.rglob("*")
        if path.is_file() and path.suffix != ".lock"
    }


def _printed(capsys: pytest.CaptureFixture[str], *arguments: str, code: int = 0) -> Any:
    assert main([*arguments, "--json"]) == code
    return json.loads(capsys.readouterr().out)


def test_it_is_complete_and_undamaged(folder: Path) -> None:
    report = check(folder / "demo.s2r")
    assert report.damages == ()
    assert any("0.1.0" in note for note in report.notes)


def test_images_predictions_and_heatmaps_are_read(folder: Path) -> None:
    with s2rstore.open(folder / "demo.s2r") as store:
        assert len(store.instances) == 24
        assert list(store.runs) == ["tiny"]
        frame = store.frame(3, "real")
        assert frame.rgb.shape == (16, 16, 3)
        assert frame.rgb.any()
        assert frame.depth.any()
        for record in store.arrays("tiny"):
            array = np.asarray(store.stored(record))
            assert array.shape == record.shape
        assert np.isfinite(store.run_columns("tiny").real.error).all()


def test_queries_print_what_they_printed(
    folder: Path, expected: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    text = "worst(25%, real.error)"
    assert _printed(capsys, "query", "demo.s2r", text, "--run", "tiny") == expected["query"]
    sql = (
        "SELECT side, count(*) AS n, avg(error) AS error FROM prediction "
        "GROUP BY side ORDER BY side"
    )
    assert _printed(capsys, "sql", "demo.s2r", sql) == expected["sql"]
    assert _printed(capsys, "show", "demo.s2r", "list", "--run", "tiny") == expected["list"]


@pytest.mark.parametrize(
    "view",
    ["overview", "map", "geomap", "instance", "umap", "orientation", "rooms", "errors", "history"],
)
def test_every_view_shows_it(folder: Path, view: str, capsys: pytest.CaptureFixture[str]) -> None:
    rows = _printed(capsys, "show", "demo.s2r", view)
    assert rows


def test_the_gap_is_judged_by_its_reference_and_golden_run(
    folder: Path, expected: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    judge = ("--reference", "reference.json", "--golden", "golden.json")
    before = expected["gap"]
    code = {"PASS": 0, "FAIL": 1}.get(before["verdict"]["outcome"], 3)
    found = _printed(capsys, "gap", "demo.s2r", *AXES, *judge, code=code)
    assert found["verdict"]["outcome"] == before["verdict"]["outcome"]
    assert found["golden"]["outcome"] == before["golden"]["outcome"]
    assert found["golden"]["change"] == 0
    for axis, old in zip(found["axes"], before["axes"], strict=True):
        for figure in ("axis", "n", "value", "floor", "gap", "anchor", "fingerprint"):
            assert axis[figure] == old[figure], figure
        for bound in ("gap_low", "gap_high"):
            assert axis[bound] == pytest.approx(old[bound], rel=0.05)


def test_its_history_holds_both_nights(folder: Path) -> None:
    nights = reader.read(reader.history_path(folder / "demo.s2r")).nights
    assert [str(night.night) for night in nights] == ["2026-11-20", "2026-11-21"]
    assert {axis.axis for axis in nights[-1].axes} >= {"task", "delay"}


def test_its_notebook_is_read(folder: Path, tmp_path: Path) -> None:
    with s2rstore.open(folder / "demo.s2r") as store:
        shutil.copytree(folder / "notebook", tmp_path / "notebook")
        notebook = Notebook(store.dataset.hash, tmp_path / "notebook")
        notes = notebook.notes
        assert set(notes.selections) == {"worst", "near"}
        assert notes.selections["near"].trajectories == ("traj1",)
        assert notes.remarks[3].note == "dark corner"
        assert notes.remarks[4].tags == ("corner",)
        for saved in notes.selections.values():
            chosen = evaluation.select(store, saved.expression, saved.run)
            if saved.trajectories is None:
                assert int(chosen.sum()) == saved.count
