"""`--restart`: arrays that cannot be completed here are begun again, and recorded as such."""

import errno
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import s2rstore
from s2rstore.arrays import array_writer
from s2rstore.errors import RequestError, StoreBusyError
from s2rstore.files import atomic_writes, locks, safe_files
from s2rstore.files.ledger import Ledger, LedgerEntry
from s2rstore.maintenance.prune import prune
from s2rstore.maintenance.verify import verify
from s2rtools.precompute import restart, unit_computer
from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
from s2rtools.precompute.run_registration import add_run
from s2rtools.precompute.unit_computer import Machine, this_machine
from s2rtools.precompute.work_units import ArraySpec, Stage
from tests.conftest import BuildOnce
from tests.support.copies import copy_store
from tests.support.silent_reporter import SilentReporter

KINDS = ("activation", "pixel_difference")


@pytest.fixture(scope="module")
def computed(small_store: Path, build_once: BuildOnce) -> Path:
    """A store with two computed runs of one model."""
    return build_once("restart.s2r", lambda path: _compute(copy_store(small_store, path)))


def _compute(path: Path) -> None:
    add_run(path, "again", "vanilla", None, None, {"sim": [], "real": []})
    precompute(path, SilentReporter(), [], PrecomputeOptions(KINDS, workers=1))


def other_machine() -> Machine:
    here = this_machine()
    return replace(here, versions=(*here.versions, ("numpy", "9.9")))


def arrays_of(path: Path, run: str, kind: str) -> list[str]:
    with s2rstore.open(path) as store:
        return [record.path for record in store.array_parts(run) if record.kind == kind]


def versions_of(path: Path, run: str, kind: str) -> set[str]:
    """The versions of numpy that computed the arrays of a kind, by the provenance of a run."""
    keys = {each.split("/")[1] for each in arrays_of(path, run, kind)}
    with s2rstore.open(path) as store:
        facts = store.provenance_object(f"run:{run}", "arrays")
    return {facts[key]["libraries"]["numpy"] for key in keys}


@pytest.mark.parametrize("kind", KINDS)
def test_a_damaged_array_is_begun_again_with_other_libraries(computed, tmp_path, monkeypatch, kind):
    path, options = copy_store(computed, tmp_path / "s.s2r"), PrecomputeOptions(KINDS, workers=1)
    (shard,) = (path / "runs.zarr" / arrays_of(path, "vanilla", kind)[0]).glob("c*")
    shard.unlink()
    monkeypatch.setattr(unit_computer, "this_machine", other_machine)
    with pytest.raises(RequestError, match=r"numpy 9.9 instead of .*--restart"):
        precompute(path, SilentReporter(), ["vanilla"], options)
    here = dict(this_machine().versions)["numpy"]
    assert versions_of(path, "vanilla", kind) == {here}
    assert precompute(path, SilentReporter(), ["vanilla"], replace(options, restart=True))
    (other,) = set(KINDS) - {kind}
    assert versions_of(path, "vanilla", kind) == {"9.9"}
    assert versions_of(path, "vanilla", other) == {here}
    assert verify(path) == []
    is_shared = kind == "pixel_difference"
    assert precompute(path, SilentReporter(), ["again"], options) == ["again"] * is_shared
    assert versions_of(path, "again", kind) == ({"9.9"} if is_shared else {here})


def test_complete_arrays_are_kept(computed, tmp_path):
    path = copy_store(computed, tmp_path / "s.s2r")
    options = PrecomputeOptions(KINDS, workers=1, restart=True)
    files = {file: file.stat().st_ino for file in path.glob("runs.zarr/*/*/*/c*")}
    assert precompute(path, SilentReporter(), [], options) == []
    assert {file: file.stat().st_ino for file in path.glob("runs.zarr/*/*/*/c*")} == files != {}


def test_a_key_that_has_lost_all_files_is_not_computed_elsewhere_in_silence(
    computed, tmp_path, monkeypatch
):
    path, options = copy_store(computed, tmp_path / "s.s2r"), PrecomputeOptions(KINDS, workers=1)
    for array in arrays_of(path, "vanilla", "activation"):
        for shard in (path / "runs.zarr" / array).glob("c*"):
            shard.unlink()
    with monkeypatch.context() as patch:
        patch.setattr(unit_computer, "this_machine", other_machine)
        with pytest.raises(RequestError, match=r"numpy 9.9 instead of .*--restart"):
            precompute(path, SilentReporter(), ["vanilla"], options)
    assert precompute(path, SilentReporter(), ["vanilla"], options) == []
    assert verify(path) == []


def test_a_restart_that_was_killed_is_repeated(computed, tmp_path, monkeypatch):
    """It has removed the files of an array, and not yet their entries in the ledger."""
    path, options = copy_store(computed, tmp_path / "s.s2r"), PrecomputeOptions(KINDS, workers=1)
    (shard,) = (path / "runs.zarr" / arrays_of(path, "vanilla", "activation")[0]).glob("c*")
    shard.unlink()

    def killed(ledger: Ledger, removed: set[str]) -> None:
        raise KeyboardInterrupt

    again = replace(options, restart=True)
    monkeypatch.setattr(unit_computer, "this_machine", other_machine)
    with monkeypatch.context() as patch:
        patch.setattr(Ledger, "remove_entries", killed)
        with pytest.raises(KeyboardInterrupt):
            precompute(path, SilentReporter(), ["vanilla"], again)
    with pytest.raises(RequestError, match=r"numpy 9.9 instead of .*--restart"):
        precompute(path, SilentReporter(), ["vanilla"], options)
    assert precompute(path, SilentReporter(), ["vanilla"], again)
    assert versions_of(path, "vanilla", "activation") == {"9.9"}
    assert verify(path) == []


def test_nothing_is_removed_where_a_file_cannot_be_examined(computed, tmp_path, monkeypatch):
    path, options = (
        copy_store(computed, tmp_path / "s.s2r"),
        PrecomputeOptions(KINDS, workers=1, restart=True),
    )
    size = safe_files.size

    def failing(root: Path, relative: str) -> int:
        if "/activation." in relative:
            raise OSError(errno.EIO, "Input/output error", str(root / relative))
        return size(root, relative)

    with monkeypatch.context() as patch:
        patch.setattr(restart.safe_files, "size", failing)
        with pytest.raises(OSError, match="Input/output"):
            precompute(path, SilentReporter(), ["vanilla"], options)
    assert verify(path) == []


def test_nothing_is_removed_without_the_lease(computed):
    def lost() -> None:
        raise StoreBusyError("lost")

    with s2rstore.open(computed) as store, pytest.raises(StoreBusyError):
        restart.discard_incomplete(store, [], lost)


@pytest.mark.parametrize("is_prune", [False, True], ids=["restart", "prune"])
def test_lines_that_a_publisher_adds_meanwhile_stay_in_the_ledger(
    store_copy, monkeypatch, is_prune
):
    """An append or a registered model adds its lines under the publish lock."""
    spec = ArraySpec("activation", "sim", None, (2,), "float32", ("iid", "x"), "m", "begun", 4)
    stage = Stage("activation", "vanilla", (spec,), 4)
    ledger, write = Ledger(store_copy), atomic_writes.write
    file = array_writer.write_shard(
        stage.create(store_copy, spec).path, 0, np.ones((4, 2), "f4"), store_copy
    )
    ledger.add_entries([LedgerEntry("unit", file.path, file.bytes, file.sha256, 4)])
    ledger.add_array_entries(
        spec.folder("vanilla"), [LedgerEntry("unit", file.path, file.bytes, file.sha256, 4)]
    )
    (store_copy / "weights").write_bytes(b"weights")
    added = []

    def add() -> None:
        with locks.publish_lock(store_copy, timeout=0.0):
            ledger.add("model", [("weights", 1)])
            added.append("weights")

    def compacting(*arguments: Any, **options: Any) -> None:
        with suppress(StoreBusyError):  # it waits for the lock
            add()
        write(*arguments, **options)

    with s2rstore.open(store_copy) as store, monkeypatch.context() as patch:
        patch.setattr(atomic_writes, "write", compacting)
        prune(store_copy) if is_prune else restart.discard_incomplete(store, [stage], lambda: None)
    if not added:
        add()
    assert file.path not in ledger.by_path()
    assert "weights" in ledger.by_path()
