"""What an append adds to a store, and what stays."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.files import layout
from s2rstore.files.ingest_folder import append_staging_folders
from s2rstore.maintenance.verify import verify
from s2rtools.datasets.appending import append
from s2rtools.datasets.files.image_decoding import ImageFiles
from tests.datasets.conftest import N
from tests.datasets.helpers import (
    add,
    files,
    ingest,
    scan_of,
)
from tests.support import image_folders, pairs


def test_what_is_stored_stays_and_what_is_new_is_added_once(scan, store, monkeypatch):
    before = files(store)
    with s2rstore.open(store) as opened:
        rows = opened.execute("FROM instance ORDER BY iid"), opened.execute("FROM frame")
        frame = opened.frame(3, "real").rgb
    decoded, decode = list[Path](), ImageFiles.decode

    def counted(self: ImageFiles, *arguments: object) -> object:
        decoded.append(self.rgb)
        return decode(self, *arguments)

    monkeypatch.setattr(ImageFiles, "decode", counted)
    lines, steps = list[str](), list[int]()
    append.append(scan, store, "s2r ingest", False, steps.append, lines.append)
    assert lines[:-1] == ["trajectory c: already in the store"]
    assert sum(steps) == 2 * 2 * 3 * N
    assert len(decoded) == len(set(decoded)) == 2 * 2 * N
    assert not any("/c/" in path.as_posix() for path in decoded)
    after = files(store)
    assert {path: after[path] for path in before} == before
    with s2rstore.open(store) as opened:
        assert opened.generation == 2
        assert opened.execute(f"FROM instance WHERE iid < {N} ORDER BY iid") == rows[0]
        assert sorted(opened.execute(f"FROM frame WHERE iid < {N}")) == sorted(rows[1])
        assert (opened.frame(3, "real").rgb == frame).all()
        assert [t.trajectory for t in opened.trajectories] == ["c", "a", "b"]
        assert opened.instances.trajectory.tolist() == [0] * N + [1] * N + [2] * N
        assert [opened.iids_of(name)[0] for name in "cab"] == [0, N, 2 * N]
        both = opened.frames("sim", N - 2, N + 2)["rgb"]
        for row, iid in enumerate(range(N - 2, N + 2)):
            assert (both[row] == opened.frame(iid, "sim").rgb).all()
        expected = opened.frames_array("sim", opened.trajectory_parts[1], "rgb")[0]
        assert (opened.frame(N, "sim").rgb == expected).all()
    lines.clear()
    assert add(scan, store, lines=lines) == {}
    assert lines[:3] == [f"trajectory {name}: already in the store" for name in "abc"]
    assert "nothing to append" in lines[3]
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


def test_an_unusable_pair_is_left_out_and_strict_refuses_it(tmp_path):
    header = pairs.sim2realviz(tmp_path / "data", n=N, trajectories=("a", "b"))
    store = tmp_path / "s.s2r"
    ingest("sim2realviz", tmp_path / "data", store, header=header, trajectories=("a",))
    image = sorted((tmp_path / "data" / "b" / "sim").glob("*_depth.jpeg"))[1]
    image.write_bytes(b"")
    options = {"header": header, "trajectories": ("b",)}
    before = files(store)
    with pytest.raises(RequestError, match="nothing was ingested"):
        add(scan_of("sim2realviz", tmp_path / "data", **options), store, strict=True)
    assert files(store) == before
    assert not append_staging_folders(store)
    assert add(scan_of("sim2realviz", tmp_path / "data", **options), store) == {"b": N - 1}
    assert verify(store) == []


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
