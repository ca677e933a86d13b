"""Everything that version 0.1.0 wrote can be read by this version, without modifying it."""

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
from s2rstore.files import layout
from s2rstore.gap_history import reader
from s2rstore.index.transaction import edit
from s2rstore.language import evaluation
from s2rstore.maintenance.verify import check
from s2rtui.cli import main
from s2rtui.user_data.notebook import Notebook
from tests.support.copies import copy_store

ARCHIVE = Path(__file__).parents[1] / "fixtures" / "store-0.1.0" / "store.tar.xz"
AXES = ("--axis", "task", "--axis", "delay")


@pytest.fixture(scope="module")
def unpacked_archive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("0.1.0")
    with tarfile.open(ARCHIVE) as archive:
        archive.extractall(folder, filter="data")
    return folder


@pytest.fixture
def folder(unpacked_archive: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The unpacked archive as working folder; afterwards its files must be unchanged."""
    before = _checksums(unpacked_archive)
    monkeypatch.chdir(unpacked_archive)
    yield unpacked_archive
    assert _checksums(unpacked_archive) == before


@pytest.fixture
def expected_output(folder: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((folder / "expected.json").read_text())
    return content


def _checksums(folder: Path) -> dict[str, str]:
    """SHA-256 of every file except lock files, which contain a process id."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.rglob("*")
        if path.is_file() and path.suffix != ".lock"
    }


def _json_output(capsys: pytest.CaptureFixture[str], *arguments: str, code: int = 0) -> Any:
    assert main([*arguments, "--json"]) == code
    return json.loads(capsys.readouterr().out)


def test_the_store_verifies_and_can_be_read(folder: Path) -> None:
    report = check(folder / "demo.s2r")
    assert report.damages == ()
    assert any("0.1.0" in note for note in report.notes)
    with s2rstore.open(folder / "demo.s2r") as store:
        assert (len(store.instances), list(store.runs)) == (24, ["tiny"])
        frame = store.frame(3, "real")
        assert frame.rgb.shape == (16, 16, 3)
        assert frame.rgb.any()
        assert frame.depth.any()
        for record in store.array_kinds("tiny"):
            assert np.asarray(store.stored(record)).shape == record.shape
        assert np.isfinite(store.run_columns("tiny").real.error).all()


def test_the_next_generation_has_the_schema_that_the_release_refuses(
    folder: Path, tmp_path: Path
) -> None:
    store = copy_store(folder / "demo.s2r", tmp_path / "demo.s2r")
    assert layout.read_current(store).schema == 1
    with edit(store) as draft:
        draft.set_provenance("dataset", {"note": "x"})
    assert layout.read_current(store).schema == 2
    assert check(store).damages == ()


def test_queries_give_the_recorded_output(
    folder: Path, expected_output: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    run = ("--run", "tiny", "--column-names", "old")
    query = _json_output(capsys, "query", "demo.s2r", "worst(25%, real.error)", *run)
    assert query == expected_output["query"]
    assert _json_output(capsys, "show", "demo.s2r", "list", *run) == expected_output["list"]


def test_the_recorded_reference_and_golden_run_give_the_recorded_verdict(
    folder: Path, expected_output: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    judge_options = ("--reference", "reference.json", "--golden", "golden.json")
    before = expected_output["gap"]
    code = {"PASS": 0, "FAIL": 1}.get(before["verdict"]["outcome"], 3)
    report = _json_output(capsys, "gap", "demo.s2r", *AXES, *judge_options, code=code)
    assert report["verdict"]["outcome"] == before["verdict"]["outcome"]
    assert report["golden"]["outcome"] == before["golden"]["outcome"]
    for axis, old_axis in zip(report["axes"], before["axes"], strict=True):
        for field in ("axis", "n", "value", "floor", "gap", "anchor", "fingerprint"):
            assert axis[field] == old_axis[field], field


def test_the_history_and_the_notebook_can_be_read(folder: Path, tmp_path: Path) -> None:
    nights = reader.read(reader.history_path(folder / "demo.s2r")).nights
    assert [str(night.night) for night in nights] == ["2026-11-20", "2026-11-21"]
    with s2rstore.open(folder / "demo.s2r") as store:
        shutil.copytree(folder / "notebook", tmp_path / "notebook")
        notes = Notebook(store.dataset.hash, tmp_path / "notebook").notes
        assert set(notes.selections) == {"worst", "near"}
        assert notes.remarks[3].note == "dark corner"
        saved = notes.selections["worst"]
        assert int(evaluation.select(store, saved.expression, saved.run).sum()) == saved.count
