"""Stores, histories and Parquet files below folders whose names DuckDB takes for patterns."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import s2rstore
from s2rstore.files import plain_paths
from s2rstore.index import row_files
from s2rtools.training.train_into_store import TrainingRequest, train_into_store
from s2rtui.cli.main import main
from tests.support import pairs
from tests.support.copies import copy_store

ODD = "we?ird\\ [x]*,'\" %25#ü"
SIBLING = "weiird\\ xyz,'\" %25#ü"
_OPEN = """
import os, sys, s2rstore
store = s2rstore.open(sys.argv[1])
print(os.listdir(os.path.join(os.environ["XDG_CACHE_HOME"], "s2rtui", "plain")), flush=True)
if sys.argv[2] == "killed":
    os.kill(os.getpid(), 9)
"""


def _outputs(folder: Path, data: Path, capsys: pytest.CaptureFixture[str]) -> object:
    """What the commands print that make, grow and read a store in `folder`."""
    store, calibration = str(folder / "s.s2r"), str(data / "calibration.toml")
    ingest = ["ingest", "sim2realviz", str(data), "--store", store, "--calibration", calibration]
    compute = ["precompute", store, "--kinds", "feature_distance", "--workers", "1"]
    assert main([*ingest, "--trajectory", "a", "--size", "32"]) == 0
    train_into_store(Path(store), TrainingRequest("vanilla", steps=1), lambda *_: None, "")
    for command in (compute, [*ingest, "--append"], compute, ["verify", store], ["prune", store]):
        assert main(command) == 0
    capsys.readouterr()
    select = (
        "SELECT iid, sim_error::DECIMAL(9, 3), real_error::DECIMAL(9, 3) FROM pair ORDER BY iid"
    )
    parquet = folder / "rows?.parquet"
    assert main(["query", store, "worst15", "--format", "parquet", "--out", str(parquet)]) == 0
    assert parquet.is_file()
    for command in (
        ["sql", store, select, "--format", "csv"],
        ["query", store, "real.error > 0 & traj:b", "--format", "csv"],
        ["snapshot", store, "--size", "80x24", "--keys", "w", "--out", str(folder / "s.txt")],
    ):
        assert main(command) == 0
    rows = [line.split(",")[:3] for line in capsys.readouterr().out.splitlines()]
    return rows, (folder / "s.txt").read_text()


def test_commands_work_alike_below_a_folder_of_patterns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(row_files, "MAX_ROWS", 0)  # rows are in Parquet files
    pairs.sim2realviz(tmp_path / "data", n=5, trajectories=("a", "b"))
    plain, odd = tmp_path / "plain", tmp_path / ODD
    expected = _outputs(plain, tmp_path / "data", capsys)
    shutil.copytree(plain, tmp_path / SIBLING)
    for file in (tmp_path / SIBLING).rglob("*.parquet"):
        file.write_bytes(b"of another store")
    assert _outputs(odd, tmp_path / "data", capsys) == expected
    assert not list(tmp_path.rglob("*.building-*"))


@pytest.mark.parametrize("name", ["a?b", "a\\b", "a*b", "a[b]", "a,b"])
def test_each_character_of_a_pattern_may_stand_in_a_path(
    tiny_store: Path, tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(row_files, "MAX_ROWS", 0)
    store = copy_store(tiny_store, tmp_path / name)
    assert main(["run", "add", "more", "--model", "vanilla", "--store", str(store)]) == 0
    with s2rstore.open(store) as opened:
        assert opened.execute("SELECT count(*) FROM prediction") == [(160,)]


def test_files_of_another_file_system_are_copied(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*arguments: object, **options: object) -> None:
        raise OSError(errno.EXDEV, "Invalid cross-device link")

    monkeypatch.setattr(os, "link", refuse)
    monkeypatch.setattr(os, "rename", refuse)
    folder = tmp_path / "a?b"
    folder.mkdir()
    new = plain_paths.plain_path(folder, "new")
    plain_paths.make_parent(new)
    new.write_bytes(b"first")
    plain_paths.move_back(new, folder, "new")
    assert not new.exists()
    assert plain_paths.link(folder, "new").read_bytes() == b"first"
    (folder / "new").write_bytes(b"replaced")
    assert plain_paths.link(folder, "new").read_bytes() == b"replaced"


def test_private_folders_go_with_their_process_and_those_of_killed_ones_later(
    tiny_store: Path, tmp_path: Path
) -> None:
    store = copy_store(tiny_store, tmp_path / "a?b")
    listed = []
    for end in ("killed", "ended"):
        process = subprocess.run(
            [sys.executable, "-c", _OPEN, str(store), end],
            env={**os.environ, "XDG_CACHE_HOME": str(tmp_path)}, capture_output=True, text=True,
        )  # fmt: skip
        listed.append(process.stdout)
    assert len(set(listed)) == 2
    assert all(line.count("'") == 2 for line in listed)
    assert list((tmp_path / "s2rtui" / "plain").iterdir()) == []
