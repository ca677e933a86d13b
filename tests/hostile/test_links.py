"""Symbolic links, pipes and devices inside a store are rejected."""

import os
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.arrays import array_writer
from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes, layout, safe_files
from s2rstore.files.ledger import Ledger
from s2rstore.index.transaction import edit
from s2rstore.maintenance.prune import prune
from s2rstore.maintenance.verify import verify
from s2rtui.cli import main
from tests.hostile.inputs import deadline

SHARD = "frames.zarr/sim/a/rgb/c.0.0.0.0"
ARRAY = "runs.zarr/vanilla/key0/activation.real"


def _replace_by_link(root: Path, relative: str, outside: Path) -> Path:
    """Move a part of a store outside and replace it by a link."""
    outside.mkdir(exist_ok=True)
    target = outside / Path(relative).name
    (root / relative).rename(target)
    (root / relative).symlink_to(target)
    return target


def _index_name(root: Path) -> str:
    return layout.read_current(root).index


def _read(root: Path) -> None:
    with s2rstore.open(root) as store:
        store.frame("sim", 0)
        store.heatmap("vanilla", "activation", "real", 0)


@pytest.mark.parametrize(
    "relative",
    [
        "CURRENT.json", "index", "frames.zarr", "frames.zarr/sim", "frames.zarr/sim/a/rgb", SHARD,
        "frames.zarr/sim/a/rgb/zarr.json", "runs.zarr",
        "runs.zarr/vanilla", f"{ARRAY}/zarr.json", f"{ARRAY}/c.0.0.0.0",
    ],
)  # fmt: skip
def test_links_inside_a_store_are_not_followed(store_copy, tmp_path, relative):
    _replace_by_link(store_copy, relative, tmp_path / "outside")
    with pytest.raises(RequestError, match="symbolic link"):
        _read(store_copy)
    damages = verify(store_copy)
    assert any("symbolic link" in damage.what for damage in damages)


@pytest.mark.parametrize("name", ["../secret", "index/../../secret", "/etc/hostname", "a\0b"])
def test_a_path_that_leads_out_of_a_store_is_refused(store_copy, name):
    (store_copy.parent / "secret").write_text("secret")
    for use in (safe_files.read, safe_files.sha256, safe_files.checked_path, atomic_writes.remove):
        with pytest.raises(RequestError, match="lies outside"):
            use(store_copy, name)
    with pytest.raises(RequestError, match="lies outside"):
        atomic_writes.write(store_copy, name, b"1")
    assert (store_copy.parent / "secret").read_text() == "secret"


def test_a_linked_index_is_rejected(store_copy, tmp_path):
    _replace_by_link(store_copy, _index_name(store_copy), tmp_path / "outside")
    assert verify(store_copy)
    with pytest.raises(RequestError, match="symbolic link"), edit(store_copy) as draft:
        draft.set_provenance("a", {"b": 1})


def test_a_store_can_be_opened_through_a_link(store_copy, tmp_path):
    (tmp_path / "link.s2r").symlink_to(store_copy)
    _read(tmp_path / "link.s2r")
    assert verify(tmp_path / "link.s2r") == []


def _keys(root: Path, outside: Path) -> None:
    (root / "runs.zarr" / "x").symlink_to(outside)


def _key(root: Path, outside: Path) -> None:
    (root / "runs.zarr" / "vanilla" / "x").symlink_to(outside)


def _models(root: Path, outside: Path) -> None:
    (root / "models").symlink_to(outside)


def _runs(root: Path, outside: Path) -> None:
    (root / "runs.zarr").rename(root / "elsewhere")
    (root / "runs.zarr").symlink_to(outside)


def _building(root: Path, outside: Path) -> None:
    (root / f".{root.name}.building-1").symlink_to(outside)
    (root.parent / f".{root.name}.building-99999999").symlink_to(outside)


def _nested(root: Path, outside: Path) -> None:
    orphan = root / "runs.zarr" / "vanilla" / "orphan"
    orphan.mkdir()
    (orphan / "link").symlink_to(outside)


@pytest.mark.parametrize(
    "add_link", [_keys, _key, _models, _runs, _building, _nested], ids=lambda f: f.__name__
)
def test_prune_removes_nothing_outside(store_copy, tmp_path, add_link):
    outside = tmp_path / "outside"
    subfolder = outside / "folder" / "sub"
    subfolder.mkdir(parents=True)
    for folder in (subfolder, subfolder.parent):
        (folder / "file").write_text("kept")
    (outside / "file.safetensors").write_text("kept")
    for number in range(3):
        with edit(store_copy) as draft:
            draft.set_provenance("n", {"number": number})
    add_link(store_copy, outside)
    links = prune(store_copy, keep=1).links
    assert ("runs.zarr/x" in links) == (add_link is _keys)
    for folder in (subfolder, subfolder.parent):
        assert (folder / "file").read_text() == "kept"
    assert (outside / "file.safetensors").read_text() == "kept"


@pytest.mark.parametrize("replacement", ["link", "pipe", "folder", "other content"])
@pytest.mark.parametrize("generation", ["published", "old"])
def test_prune_removes_nothing_if_an_index_is_unusable(
    store_copy, tmp_path, replacement, generation
):
    published = store_copy / layout.read_current(store_copy).index
    index = published if generation == "published" else published.with_name("index-000001.duckdb")
    moved_index = index.rename(tmp_path / "kept.duckdb")
    if replacement == "link":
        index.symlink_to(moved_index)
    elif replacement == "pipe":
        os.mkfifo(index)
    elif replacement == "folder":
        index.mkdir()
    else:
        index.write_bytes(b"no index")
    before = sorted((store_copy / "runs.zarr").rglob("*"))
    with deadline(), pytest.raises(RequestError, match=index.name):
        prune(store_copy)
    assert sorted((store_copy / "runs.zarr").rglob("*")) == before
    assert moved_index.exists()


def test_nothing_is_written_through_a_link(store_copy, tmp_path):
    outside = tmp_path / "outside"
    for part in ("runs.zarr/vanilla", "ledger"):
        _replace_by_link(store_copy, part, outside)
    before = sorted(outside.rglob("*"))
    with pytest.raises(RequestError, match="symbolic link"):
        array_writer.create(
            store_copy / "runs.zarr/vanilla/new/a", array_writer.plan_layout(4, (2,), "float32", 4)
        )
    rows = np.zeros((16, 4, 4, 4), np.float32)
    with pytest.raises(RequestError, match="symbolic link"):
        array_writer.write_shard(store_copy / ARRAY, 0, rows)
    with pytest.raises(RequestError, match="symbolic link"):
        Ledger(store_copy).add("unit", [(SHARD, 16)])
    assert sorted(outside.rglob("*")) == before


@pytest.mark.parametrize(
    "relative", ["CURRENT.json", SHARD, f"{ARRAY}/zarr.json", "ledger/a.jsonl"]
)
def test_a_pipe_is_rejected_without_blocking(store_copy, relative, capsys):
    (store_copy / relative).unlink(missing_ok=True)
    os.mkfifo(store_copy / relative)
    with deadline():
        assert main(["verify", str(store_copy)]) == 1
    assert "pipe" in capsys.readouterr().out
