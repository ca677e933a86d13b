"""Appends that are killed or run at the same time, and what prune makes of their remains."""

import re
import shutil
from pathlib import Path

import pytest

import s2rstore
from s2rstore.arrays import array_writer
from s2rstore.errors import RequestError, StoreBusyError
from s2rstore.files import atomic_writes, layout
from s2rstore.files.ingest_folder import append_staging_folder, append_staging_folders
from s2rstore.maintenance.prune import prune
from s2rstore.maintenance.verify import verify
from s2rstore.records import Domain
from s2rtools.datasets.appending import append
from s2rtools.datasets.recordings.image_frame_source import ImageFrameSource
from s2rtools.datasets.scan import Scan
from s2rtools.datasets.writing import build, frame_writing, ingest_journal, trajectory_arrays
from tests.datasets.conftest import N
from tests.datasets.helpers import Killed, add, files, kill, kill_after, rows_by_trajectory, scan_of


@pytest.mark.parametrize(
    ("owner", "name", "calls"),
    [(build, "write_trajectory", 1), (atomic_writes, "move", 3), (layout, "write_current", 0)],
)
def test_a_kill_keeps_the_old_generation_and_a_rerun_works(
    scan, store, monkeypatch, owner, name, calls
):
    """The building folder stays, too, as after a real kill."""
    before, current = files(store), layout.read_current(store)
    with monkeypatch.context() as patch:
        patch.setattr(append.shutil, "rmtree", lambda *arguments, **options: None)
        patch.setattr(owner, name, kill_after(getattr(owner, name), calls))
        with pytest.raises(Killed):
            add(scan, store)
    assert layout.read_current(store) == current
    after = files(store)
    assert {path: after[path] for path in before} == before
    assert verify(store) == []
    assert add(scan, store) == {"a": N, "b": N}
    assert verify(store) == []
    with s2rstore.open(store) as opened:
        assert len(opened.instances) == 3 * N


def test_prune_removes_unreferenced_frames_and_keeps_all_others(scan, store, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(append, "insert_instances", kill)
        with pytest.raises(Killed):
            add(scan, store)
    leftovers = {f"{layout.FRAMES}/{domain}/{name}" for domain in ("sim", "real") for name in "ab"}
    assert leftovers <= set(prune(store, dry_run=True).paths)
    assert set(prune(store).paths) == leftovers
    assert verify(store) == []
    add(scan, store)
    assert prune(store, keep=1).paths == ("index/index-000001.duckdb",)
    assert verify(store) == []
    with s2rstore.open(store) as opened:
        assert opened.frame("sim", 0).rgb.any()


def test_prune_keeps_the_folder_in_which_another_process_appends(store):
    folder = append_staging_folder(store)
    (folder / "ledger").mkdir(parents=True)
    (folder / ".x.partial").write_bytes(b"1")
    assert prune(store).paths == ()
    assert (folder / ".x.partial").exists()
    assert verify(store) == []


def test_frames_of_a_kept_generation_are_never_replaced(scan, store):
    """A user has put back an older generation of the data under a new number."""
    old = layout.read_current(store)
    add(scan, store)
    third = layout.index_name(3)
    shutil.copy(store / old.index, store / third)
    layout.write_current(
        store, layout.Current(3, third, old.sha256, old.bytes, old.schema, old.dataset_hash)
    )
    before = files(store)
    with pytest.raises(RequestError, match="a kept generation has these frames"):
        add(scan, store)
    assert files(store) == before


def test_two_appends_do_not_mix(scan, source, store, monkeypatch):
    other = scan_of("sim2realviz", source[0], header=source[1], trajectories=("a",))
    checked = append._checked_entries

    def interrupted(folder: Path) -> object:
        entries = checked(folder)
        monkeypatch.setattr(append, "_checked_entries", checked)
        add(other, store)
        return entries

    monkeypatch.setattr(append, "_checked_entries", interrupted)
    with pytest.raises(RequestError, match="append again"):
        add(scan, store)
    assert add(scan, store) == {"b": N}
    assert verify(store) == []


def _is_shard(path: Path) -> bool:
    return path.is_file() and path.name != "zarr.json"


def test_damaged_frames_are_not_moved(scan, store, monkeypatch):
    write = append.write_frames

    def damaged(*arguments: object) -> object:
        stored = write(*arguments)
        shard = next(path for path in arguments[1].rglob("a/rgb/**/*") if _is_shard(path))
        shard.write_bytes(shard.read_bytes()[:-1])
        return stored

    monkeypatch.setattr(append, "write_frames", damaged)
    with pytest.raises(RequestError, match="differs from what was written"):
        add(scan, store)
    assert verify(store) == []


@pytest.mark.parametrize(("error", "is_kept"), [(StoreBusyError, True), (RequestError, False)])
def test_an_append_to_a_busy_store_keeps_its_frames(scan, store, monkeypatch, error, is_kept):
    def fail(*arguments: object) -> None:
        raise error("no")

    monkeypatch.setattr(append, "_publish", fail)
    with pytest.raises(error):
        add(scan, store)
    assert bool(append_staging_folders(store)) == is_kept


def test_an_interrupted_append_is_resumed(source, tmp_path, monkeypatch):
    """It equals an append that was not interrupted, and decodes what was not written alone."""
    for module in (trajectory_arrays, frame_writing, ingest_journal):
        monkeypatch.setattr(module, "SHARD_ROWS", 4)
    monkeypatch.setattr("s2rstore.files.process_identity.has_ended", lambda identity: True)
    decode = ImageFrameSource.decode
    decoded = []

    def counted(source: ImageFrameSource, scan: Scan, domain: Domain) -> object:
        decoded.append(source)
        return decode(source, scan, domain)

    def whole() -> Scan:
        return scan_of("sim2realviz", source[0], header=source[1], trajectories=("a",))

    stores = [tmp_path / "one.s2r", tmp_path / "other.s2r"]
    for path in stores:
        short = whole()
        short.trajectories["a"] = list(short.trajectories["a"])[:2]
        build.build(short, path, "s2r ingest", False, lambda steps: None)
    monkeypatch.setattr(ImageFrameSource, "decode", counted)
    expected = add(whole(), stores[0])
    undisturbed, lines = len(decoded), list[str]()
    with monkeypatch.context() as patch:
        patch.setattr(array_writer, "write_chunks", kill_after(array_writer.write_chunks, 10))
        with pytest.raises(Killed):
            add(whole(), stores[1])
    decoded.clear()
    assert add(whole(), stores[1], lines=lines) == expected
    (line,) = (each for each in lines if "is resumed" in each)
    kept = int(re.search(r"(\d+) of \d+ instances are not decoded again", line)[1])
    assert kept == 4
    assert len(decoded) == undisturbed - 2 * kept
    assert rows_by_trajectory(stores[1]) == rows_by_trajectory(stores[0])
    assert verify(stores[1]) == []
    assert append_staging_folders(stores[1]) == []
