"""Stores, histories and Parquet files below folders whose names DuckDB takes for patterns."""

import errno
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import s2rstore
from s2rstore.files import plain_paths
from s2rstore.index import parquet_table, row_files
from s2rtools.training.train_into_store import TrainingRequest, train_into_store
from s2rtui.cli import main
from tests.support import pairs
from tests.support.copies import copy_store

_OPEN = """
import os, sys, s2rstore
store = s2rstore.open(sys.argv[1])
print(os.listdir(os.path.join(os.environ["XDG_CACHE_HOME"], "s2rtui", "plain")), flush=True)
if sys.argv[2] == "killed":
    os.kill(os.getpid(), 9)
"""


def _printed(folder: Path, capsys: pytest.CaptureFixture[str]) -> list[str]:
    """What commands print that read the store in `folder`."""
    store, out = str(folder / "s.s2r"), folder / "out?.parquet"
    assert main(["verify", store]) == 0
    capsys.readouterr()
    for command in (
        ["sql", store, "SELECT iid, sim_error_m, real_error_m FROM pair ORDER BY iid"],
        ["query", store, "real.error > 0 & traj:b"],
        ["query", store, "worst15", "--format", "parquet", "--out", str(out)],
        ["snapshot", store, "--size", "80x24", "--keys", "w", "--out", str(folder / "s.txt")],
    ):
        assert main(command) == 0
    read = parquet_table.read_columns(out, ["iid"], [])["iid"]
    return [capsys.readouterr().out, (folder / "s.txt").read_text(), str(read)]


def test_commands_make_grow_and_read_a_store_below_a_folder_of_patterns(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(row_files, "MAX_ROWS", 0)  # rows are in Parquet files
    calibration = pairs.sim2realviz(tmp_path / "data", n=5, trajectories=("a", "b"))
    folder = tmp_path / "we?ird\\ [x]*,'\" %25#\u00fc"
    store = str(folder / "s.s2r")
    ingest = ["ingest", "sim2realviz", str(tmp_path / "data"), "--calibration", str(calibration)]
    assert main([*ingest, "--store", store, "--trajectory", "a", "--size", "32"]) == 0
    train_into_store(Path(store), TrainingRequest("vanilla", steps=1), lambda *_: None, "")
    assert main([*ingest, "--store", store, "--append"]) == 0
    for command in (
        ["precompute", store, "--kinds", "feature_distance", "--workers", "1"],
        ["prune", store],
    ):
        assert main(command) == 0
    assert not list(tmp_path.rglob(".building-*"))
    shutil.copytree(folder, tmp_path / "plain")
    assert _printed(folder, capsys) == _printed(tmp_path / "plain", capsys)


@pytest.mark.parametrize("name", ["a?b", "a\\b", "a*b", "a[x]b", "a,b"])
def test_rows_are_those_of_the_folder_and_not_of_one_that_its_name_matches(
    tiny_store, tmp_path, name, monkeypatch
):
    monkeypatch.setattr(row_files, "MAX_ROWS", 0)
    store = copy_store(tiny_store, tmp_path / name)
    assert main(["run", "add", "more", "--model", "vanilla", "--store", str(store)]) == 0
    shutil.copytree(store, tmp_path / "axb")
    for file in (tmp_path / "axb").rglob("*.parquet"):
        file.write_bytes(b"of another store")
    with s2rstore.open(store) as opened:
        assert opened.execute("SELECT count(*) FROM prediction") == [(160,)]


def test_files_of_another_file_system_are_copied(tmp_path, monkeypatch):
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


def test_private_folders_go_with_their_process_and_those_of_killed_ones_later(tiny_store, tmp_path):
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
