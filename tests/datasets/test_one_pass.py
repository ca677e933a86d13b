"""Ingest decodes every image once and holds no list of the instances."""

import gc
import hashlib
import itertools
import json
import tracemalloc
from collections import Counter
from dataclasses import asdict
from pathlib import Path

import cv2
import numpy as np
import pytest

import s2rstore
from s2rstore.maintenance.verify import verify
from s2rtools.datasets.recordings import recorded_files
from s2rtools.datasets.recordings.image_frame_source import ImageFrameSource
from s2rtools.datasets.scan import DecodedFrame
from s2rtools.datasets.writing import index_rows
from s2rtools.datasets.writing.build import build
from tests.datasets.helpers import SIZE, ingest, kinds, scan_of
from tests.support import image_folders, pairs

BYTES_PER_INSTANCE = 200


def _write_depth(path: Path, dtype: type) -> None:
    depth = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    cv2.imwrite(str(path), np.clip(depth, 0, 200).astype(dtype))


def _mixed(folder: Path, store: Path) -> None:
    manifest = pairs.manifest(folder, n=12, bits=16)
    _write_depth(folder / "real" / "0_depth.png", np.uint8)
    ingest("csv", manifest, store)


def _images(folder: Path, store: Path) -> None:
    sources = image_folders.folders(folder)
    (folder / "real" / "masks" / "night_0.png").unlink()
    image_folders.ingest(sources, store)


@pytest.mark.parametrize("make", [_mixed, _images])
def test_every_source_image_is_read_and_decoded_once(make, tmp_path, monkeypatch):
    read: Counter[Path] = Counter()
    decoded = []
    read_bytes, decode = recorded_files.read_bytes, cv2.imdecode

    def counted_read(path: Path, limit: int) -> bytes:
        read[path] += 1
        return read_bytes(path, limit)

    def counted_decode(content: np.ndarray, mode: int) -> np.ndarray:
        decoded.append(len(content))
        return decode(content, mode)

    monkeypatch.setattr(recorded_files, "read_bytes", counted_read)
    monkeypatch.setattr(recorded_files.cv2, "imdecode", counted_decode)
    make(tmp_path / "data", tmp_path / "s.s2r")
    files = {path for path in (tmp_path / "data").rglob("*") if path.suffix in (".png", ".jpeg")}
    assert read == dict.fromkeys(files, 1)
    assert len(decoded) == len(files)


@pytest.mark.parametrize("odd", [(0, 1, 5), (5,)])
def test_the_most_common_depth_type_is_kept_wherever_the_others_are(tmp_path, odd):
    manifest = pairs.manifest(tmp_path / "data", n=14, bits=16)
    for number in odd:
        _write_depth(tmp_path / "data" / "real" / f"{number}_depth.png", np.uint8)
    store = tmp_path / "s.s2r"
    scan = ingest("csv", manifest, store)
    assert kinds(scan) == {"mixed depth types": len(odd)}
    assert verify(store) == []
    kept = [number for number in range(14) if number not in odd]
    with s2rstore.open(store) as opened:
        assert len(opened.instances) == len(kept)
        for domain in ("sim", "real"):
            for iid, number in enumerate(kept):
                path = tmp_path / "data" / domain / f"{number}_depth.png"
                depth = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
                small = cv2.resize(depth, SIZE, interpolation=cv2.INTER_NEAREST_EXACT)
                assert np.array_equal(opened.frame(domain, iid).depth, small)
    assert {path.name for path in store.iterdir()} == {
        "CURRENT.json", "assets", "frames.zarr", "index", "ledger",
    }  # fmt: skip


def test_the_hash_of_a_data_set_is_that_of_one_json_document(tmp_path):
    scan = ingest("csv", pairs.manifest(tmp_path / "data", n=12), tmp_path / "s.s2r")
    rows = []
    for name in sorted(scan.trajectories):
        for position, record in enumerate(scan.trajectories[name]):
            seq = position if record.seq is None else record.seq
            sums = {d: s.checksum(scan, scan.domains[d]) for d, s in record.sources.items()}
            rows.append((name, seq, record.x, record.y, record.heading, sums))
    domains = [asdict(domain) for domain in scan.domains.values()]
    for domain in domains:
        assert domain.pop("has_depth")  # hashed only where it is false
    facts = {
        "frame": scan.frame, "y_down": scan.y_down, "accuracy_scale": scan.accuracy_scale,
        "bounds": asdict(scan.bounds), "rooms": [asdict(room) for room in scan.rooms],
        "domains": domains, "rows": rows,
    }  # fmt: skip
    document = json.dumps(facts, sort_keys=True).encode()
    with s2rstore.open(tmp_path / "s.s2r") as store:
        assert store.dataset.hash == hashlib.sha256(document).hexdigest()


def _manifest(folder: Path, count: int) -> Path:
    """A manifest of three trajectories whose rows name the same two files."""
    folder.mkdir()
    for name in ("rgb.png", "depth.png"):
        (folder / name).touch()
    lines = ["trajectory,seq,domain,rgb,depth,x,y,heading"]
    lines += [
        f"t{row % 3},{row},{domain},rgb.png,depth.png,{1 + row % 5},2,{row % 360}"
        for row in range(count)
        for domain in ("sim", "real")
    ]
    (folder / "m.csv").write_text("\n".join(lines))
    (folder / "m.toml").write_text(pairs.HEADER)
    return folder / "m.csv"


@pytest.mark.deep
def test_an_instance_takes_little_memory(tmp_path, monkeypatch):
    """The difference of two sizes, because buffers and caches have a fixed size.

    What only waits for the garbage collector does not count.
    """
    rgb, depth = np.zeros((*SIZE, 3), np.uint8), np.zeros(SIZE, np.uint8)
    decoded = itertools.count()

    def decode(*arguments: object) -> DecodedFrame:
        if next(decoded) % 60 == 0:
            gc.collect()
        return DecodedFrame(rgb, depth, "ab" * 32, 1.0)

    monkeypatch.setattr(ImageFrameSource, "decode", decode)
    monkeypatch.setattr(index_rows, "_BLOCK", 64)

    def peak(count: int) -> int:
        manifest = _manifest(tmp_path / str(count), count)
        gc.collect()
        tracemalloc.reset_peak()
        before, _ = tracemalloc.get_traced_memory()
        scan = scan_of("csv", manifest)
        build(scan, tmp_path / f"{count}.s2r", "", False, lambda steps: None)
        return tracemalloc.get_traced_memory()[1] - before

    small, large = 240, 840
    tracemalloc.start()
    try:
        peak(64)  # imports modules and fills caches
        gc.freeze()  # what exists by now would make each collection slow
        growth = peak(large) - peak(small)
    finally:
        gc.unfreeze()
        tracemalloc.stop()
    assert growth / (large - small) < BYTES_PER_INSTANCE
