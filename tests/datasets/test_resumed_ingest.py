"""A killed ingest is resumed to an equal store; the fingerprint changes with its sources."""

import hashlib
import os
import shutil
import tracemalloc
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from s2rstore.arrays import array_writer
from s2rstore.errors import RequestError
from s2rstore.files import layout
from s2rstore.files.ingest_folder import staging_folders
from s2rstore.files.ledger import Ledger
from s2rstore.maintenance.verify import verify
from s2rtools.datasets.recordings.image_frame_source import ImageFrameSource
from s2rtools.datasets.scan import Scan
from s2rtools.datasets.writing import build as build_module
from s2rtools.datasets.writing import frame_writing, ingest_journal, trajectory_arrays
from s2rtools.datasets.writing.build import build, fingerprint
from s2rtools.datasets.writing.ingest_journal import Block, IngestJournal
from tests.datasets.helpers import Killed, kill_after, rows_by_trajectory, scan_of
from tests.support import pairs

N = 38
"""Instances in two trajectories of 19; shards have 4."""
SHARD = 4
ODD = (0, 1, 6, 12, 25, 26, 27)
"""Instances whose real depth has another type; that of the first one is not the usual one."""
BROKEN = (3, 9, 10, 18, 20, 37)
OTHER_SIZE = (5, 30)


@pytest.fixture(autouse=True, scope="module")
def small_shards() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        for module in (trajectory_arrays, frame_writing, ingest_journal):
            patch.setattr(module, "SHARD_ROWS", SHARD)
        yield


@pytest.fixture(scope="module")
def manifest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("source")
    path = pairs.manifest(folder, n=N, bits=16)
    for number in ODD:
        name = str(folder / "real" / f"{number}_depth.png")
        cv2.imwrite(name, (cv2.imread(name, cv2.IMREAD_UNCHANGED) // 256).astype(np.uint8))
    for number in BROKEN:
        (folder / "sim" / f"{number}_rgb.png").write_bytes(b"no image")
    for number in OTHER_SIZE:
        name = str(folder / "sim" / f"{number}_rgb.png")
        cv2.imwrite(name, cv2.resize(cv2.imread(name), (32, 24)))
    for number in (2, 16, 33):
        name = str(folder / "real" / f"{number}_rgb.png")
        cv2.imwrite(name, cv2.imread(name).astype(np.uint16) * 257)
    return path


def ingest(manifest: Path, store: Path, lines: list[str] | None = None) -> tuple[Scan, list[int]]:
    """The scan and the reported steps."""
    steps: list[int] = []
    scan = scan_of("csv", manifest)
    build(
        scan, store, "s2r ingest", False, steps.append, [].append if lines is None else lines.append
    )
    return scan, steps


def content(store: Path) -> dict[str, object]:
    """All rows and ledger entries, and the checksums of all files but the index and the ledger."""
    found: dict[str, object] = {
        path.relative_to(store).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in store.rglob("*")
        if path.is_file()
        and path.relative_to(store).parts[0] not in (layout.INDEX, layout.LEDGER)
        and path.name != layout.CURRENT
    }
    found["ledger"] = sorted(
        (entry.key, entry.path, entry.bytes, entry.checksum, entry.count)
        for entry in Ledger(store).entries()
    )
    return found | rows_by_trajectory(store)


@pytest.fixture(scope="module")
def undisturbed(
    manifest: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[dict[str, object], Scan, int]:
    store = tmp_path_factory.mktemp("undisturbed") / "s.s2r"
    scan, steps = ingest(manifest, store)
    return content(store), scan, sum(steps)


@dataclass(frozen=True)
class Ingest:
    """An ingest that is interrupted and done again, and the content of an undisturbed one."""

    manifest: Path
    store: Path
    undisturbed: tuple[dict[str, object], Scan, int]

    def interrupt(self, owner: object, name: str, calls: int) -> Path:
        """End an ingest at a call of a function; gives its folder, as if its process had ended."""
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(owner, name, kill_after(getattr(owner, name), calls))
            with pytest.raises(Killed):
                ingest(self.manifest, self.store)
        (folder,) = staging_folders(self.store)
        return folder.path

    def check_resumed(self) -> str:
        """Ingest again; the result must be the undisturbed one. Gives the line about the resume."""
        expected, scan, steps = self.undisturbed
        lines: list[str] = []
        resumed, done = ingest(self.manifest, self.store, lines)
        assert content(self.store) == expected
        assert resumed.issues == scan.issues
        assert sum(done) == steps
        assert verify(self.store) == []
        assert staging_folders(self.store) == []
        return lines[0]


@pytest.fixture
def begun(
    manifest: Path, tmp_path: Path, undisturbed: tuple[dict[str, object], Scan, int]
) -> Ingest:
    return Ingest(manifest, tmp_path / "s.s2r", undisturbed)


@pytest.fixture(autouse=True)
def all_processes_have_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("s2rstore.files.process_identity.has_ended", lambda identity: True)


@pytest.mark.parametrize(
    ("owner", "name", "calls"),
    [
        (array_writer, "write_chunks", 0),
        (array_writer, "write_chunks", 17),
        (array_writer, "create", 1),
        (Ledger, "add_entries", 1),
        (Path, "rename", 0),
        *(
            pytest.param(array_writer, "write_chunks", calls, marks=pytest.mark.deep)
            for calls in (3, 4, 9, 30, 41)
        ),
    ],
)
def test_a_kill_is_resumed(begun, owner, name, calls):
    begun.interrupt(owner, name, calls)
    line = begun.check_resumed()
    assert "is resumed" in line or name != "write_chunks"


def test_a_resume_that_is_killed_is_resumed(begun):
    for calls in (9, 6, 7):
        begun.interrupt(array_writer, "write_chunks", calls)
    begun.check_resumed()


def test_a_finished_trajectory_is_not_decoded_again(begun, monkeypatch):
    begun.interrupt(build_module, "write_index", 0)
    monkeypatch.setattr(ImageFrameSource, "decode", lambda *arguments: pytest.fail("decoded"))
    assert f"{N} of {N} instances are not decoded again" in begun.check_resumed()


@pytest.mark.parametrize(("cut", "is_changed"), [(1, False), (700, True)])
def test_a_damaged_journal_counts_up_to_the_damage(begun, cut, is_changed):
    journal = begun.interrupt(array_writer, "write_chunks", 36) / ingest_journal.NAME
    whole = journal.read_bytes()
    place = len(whole) - cut
    tail = bytes([whole[place] ^ 1]) + whole[place + 1 :] if is_changed else b""
    journal.write_bytes(whole[:place] + tail)
    begun.check_resumed()


def test_a_journal_is_read_block_by_block(tmp_path):
    count, rows = 60, list(range(200))
    journal = IngestJournal(tmp_path, "mark")
    for _ in range(count):
        journal.add(Block("a", rows=rows, digests={"real": "0" * 64 * len(rows)}))
    size = (tmp_path / ingest_journal.NAME).stat().st_size
    tracemalloc.start()
    try:
        resumed = IngestJournal(tmp_path, "mark")
        announced = resumed.taken_instances
        taken = sum(len(block.rows) for block in resumed.taken("a"))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert announced == taken == count * len(rows)
    assert list(resumed.taken("a")) == []
    assert peak < size / 3


def test_a_missing_or_shortened_shard_is_written_again(begun):
    folder = begun.interrupt(array_writer, "write_chunks", 36)
    shards = sorted(path for path in folder.rglob("c.*") if path.is_file())
    shards[0].unlink()
    shards[-3].write_bytes(shards[-3].read_bytes()[:-1])
    begun.check_resumed()


@pytest.mark.parametrize("change", ["image", "size", "journal"])
def test_the_folder_of_other_data_is_removed_instead(begun, tmp_path, change):
    source, store, manifest = tmp_path / "data", begun.store, begun.manifest
    shutil.copytree(manifest.parent, source)
    other = replace(begun, manifest=source / manifest.name)
    folder = other.interrupt(array_writer, "write_chunks", 20)
    scan = scan_of("csv", source / manifest.name)
    if change == "image":
        os.utime(source / "sim" / "7_rgb.png", (1, 1))
    elif change == "size":
        scan = scan_of("csv", source / manifest.name, frame=(16, 16))
    else:
        (folder / ingest_journal.NAME).write_bytes(b"no journal\n")
    lines: list[str] = []
    build(scan, store, "s2r ingest", False, lambda steps: None, lines.append)
    assert lines[0].startswith(f"{folder}: removed")
    assert verify(store) == []


def test_a_refused_ingest_leaves_no_folder(manifest, tmp_path):
    store = tmp_path / "s.s2r"
    with pytest.raises(RequestError, match="nothing was ingested"):
        build(scan_of("csv", manifest), store, "", True, lambda steps: None)
    assert list(tmp_path.iterdir()) == []


def test_equal_scans_have_one_fingerprint_and_other_sources_another(tmp_path):
    manifest = pairs.manifest(tmp_path / "data", n=4)
    found = {fingerprint(scan_of("csv", manifest)) for _ in range(2)}
    assert len(found) == 1
    image = tmp_path / "data" / "real" / "2_depth.png"
    state = image.stat()
    os.utime(image, ns=(state.st_atime_ns, state.st_mtime_ns + 1))
    found.add(fingerprint(scan_of("csv", manifest)))
    os.utime(image, ns=(state.st_atime_ns, state.st_mtime_ns))
    image.write_bytes(image.read_bytes() + b"0")
    os.utime(image, ns=(state.st_atime_ns, state.st_mtime_ns))
    found.add(fingerprint(scan_of("csv", manifest)))
    found.add(fingerprint(scan_of("csv", manifest, frame=(48, 48))))
    found.add(fingerprint(scan_of("csv", manifest, trajectories=("a",))))
    header = manifest.with_suffix(".toml")
    header.write_text(header.read_text().replace("depth_raw_max = 249", "depth_raw_max = 248"))
    found.add(fingerprint(scan_of("csv", manifest)))
    assert None not in found
    assert len(found) == 6


def test_the_fingerprint_of_a_world_is_that_of_its_recipe():
    found = [
        fingerprint(scan_of("world", Path(), frame=(32, 32), world={"count": 3, "seed": seed}))
        for seed in (1, 1, 2)
    ]
    assert found[0] is not None
    assert found[0] == found[1]
    assert found[0] != found[2]


def test_a_source_of_unknown_origin_has_no_fingerprint(tmp_path):
    scan = scan_of("csv", pairs.manifest(tmp_path / "data", n=4))
    records = scan.trajectories["a"]
    scan.trajectories["a"] = list(records)
    scan.trajectories["a"][0].sources["sim"] = object()  # type: ignore[index]
    assert fingerprint(scan) is None
