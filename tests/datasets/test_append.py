"""What an append adds to a store, and what stays."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import s2rstore
from s2rstore.files import layout
from s2rstore.maintenance.verify import verify
from s2rtools.datasets.appending import append
from s2rtools.datasets.recordings.image_frame_source import ImageFrameSource
from tests.datasets.conftest import N
from tests.datasets.helpers import add, files, scan_of
from tests.support import image_folders


def test_what_is_new_is_decoded_and_added_once(scan, store, monkeypatch):
    decoded, decode = list[Path](), ImageFrameSource.decode

    def counted(self: ImageFrameSource, *arguments: object) -> object:
        decoded.append(self.files[0])
        return decode(self, *arguments)

    monkeypatch.setattr(ImageFrameSource, "decode", counted)
    steps = list[int]()
    append.append(scan, store, "s2r ingest", False, steps.append)
    assert sum(steps) == 2 * 2 * 3 * N
    assert len(decoded) == len(set(decoded)) == 2 * 2 * N
    assert not any("/c/" in path.as_posix() for path in decoded)
    after = files(store)
    with s2rstore.open(store) as opened:
        assert opened.generation == 2
        assert [t.trajectory for t in opened.trajectories] == ["c", "a", "b"]
        assert opened.instances.trajectory.tolist() == [0] * N + [1] * N + [2] * N
        assert [opened.iids_of(name)[0] for name in "cab"] == [0, N, 2 * N]
    assert add(scan, store) == {}
    assert files(store) == after


def test_parts_hash_and_provenance(scan, store, source):
    with s2rstore.open(store) as opened:
        original, facts = opened.dataset.hash, opened.provenance("dataset")
        assert opened.identity == original
    for name in ("b", "a"):
        add(scan_of("sim2realviz", source[0], header=source[1], trajectories=(name,)), store)
    with s2rstore.open(store) as opened:
        parts = opened.parts
        assert [(p.part, p.first_iid, p.instances) for p in parts] == [
            (0, 0, N), (1, N, N), (2, 2 * N, N)
        ]  # fmt: skip
        assert parts[0].hash == original == opened.identity
        assert parts[0].added_at == facts["ingested_at"]
        assert len({part.hash for part in parts}) == 3
        joined = "".join(part.hash for part in parts)
        assert opened.dataset.hash == hashlib.sha256(joined.encode()).hexdigest()
        assert layout.read_current(store).dataset_hash == opened.dataset.hash
        now = opened.provenance("dataset")
        assert facts.items() <= now.items()
        added = json.loads(now["append:2"])
        assert added["command"] == "s2r ingest"
        assert added["trajectories"] == {"a": N}
        assert added["problems"] == {}


def test_images_without_poses_can_be_appended(tmp_path):
    sources = image_folders.folders(tmp_path / "data")
    frame = (64, 64)
    names = ("real_day", "sim_loop")
    store = tmp_path / "s.s2r"
    image_folders.ingest(sources, store, trajectories=names)
    lines: list[str] = []
    added = add(scan_of("images", Path(), folders=sources, frame=frame), store, lines=lines)
    assert added == {"real_night": 3, "sim_city": 2}
    assert lines == [f"trajectory {name}: already in the store" for name in names]
    assert verify(store) == []
    with s2rstore.open(store) as opened:
        assert [t.trajectory for t in opened.trajectories] == [*names, "real_night", "sim_city"]
        imaged = {part.trajectory for part in opened.imaged_parts["real"]}
        assert imaged == {"real_day", "real_night"}
        assert opened.imaged("real").tolist() == [True] * 4 + [False] * 5 + [True] * 3 + [False] * 2
        assert opened.frames("real", 9, 12)["rgb"].shape == (3, 32, 64, 3)
