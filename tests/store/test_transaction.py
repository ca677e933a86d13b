"""Index generations: published atomically, never modified, readable by plain DuckDB."""

import json
import multiprocessing
from functools import partial
from pathlib import Path

import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes, layout
from s2rstore.index.transaction import edit
from s2rstore.maintenance.prune import prune, remove_superseded
from s2rstore.maintenance.verify import verify


def test_readers_keep_their_generation(store_copy):
    with s2rstore.open(store_copy) as store:
        first = store.generation
        with edit(store_copy) as draft:
            draft.set_provenance("test", {"told": "new"})
            draft.delete("run", run="dataaug")
        assert store.provenance("test") == {}
        assert "dataaug" in store.runs
        assert store.latest_generation() == first + 1
    with s2rstore.open(store_copy) as store:
        assert store.provenance("test") == {"told": "new"}
        assert "dataaug" not in store.runs


def test_a_file_that_names_the_generation_is_replaced_as_a_whole(store_copy):
    with (store_copy / layout.CURRENT).open() as held:
        with edit(store_copy) as draft:
            draft.set_provenance("a", {"b": 1})
        named = json.load(held)["generation"]
    assert layout.read_current(store_copy).generation == named + 1


def test_a_lease_is_checked_when_all_but_the_name_of_the_generation_is_written(store_copy):
    index = store_copy / layout.index_name(layout.read_current(store_copy).generation + 1)
    is_there: list[bool] = []
    with edit(store_copy, lambda: is_there.append(index.exists())) as draft:
        draft.set_provenance("a", {"b": 1})
    assert is_there[-1]


def test_an_index_is_on_the_disk_before_it_has_its_name(store_copy, monkeypatch):
    calls, rename, sync = [], atomic_writes.rename, atomic_writes.sync

    def recorded(use, root, path, *others):
        calls.append((use, path))
        use(root, path, *others)

    monkeypatch.setattr(atomic_writes, "sync", partial(recorded, sync))
    monkeypatch.setattr(atomic_writes, "rename", partial(recorded, rename))
    with edit(store_copy) as draft:
        draft.set_provenance("a", {"b": 1})
    (index,) = (path for use, path in calls if use is rename)
    assert calls.index((sync, index)) < calls.index((rename, index))


def test_an_index_name_is_never_used_again(store_copy):
    with edit(store_copy) as draft:
        draft.set_provenance("a", {"b": 1})
    newest = layout.read_current(store_copy).generation
    (store_copy / layout.index_name(newest + 5)).touch()
    with edit(store_copy) as draft:
        draft.set_provenance("a", {"b": 2})
    assert layout.read_current(store_copy).generation == newest + 6


def test_nan_becomes_null(store_copy):
    with edit(store_copy) as draft:
        draft.insert("instance", {"iid": [99], "x": [float("nan")], "room": [None]})
    with s2rstore.open(store_copy) as store:
        assert store.execute("SELECT x, room FROM instance WHERE iid = 99") == [(None, None)]


def _publish_many(path: str, count: int) -> None:
    for number in range(count):
        with edit(Path(path)) as draft:
            draft.set_provenance("many", {f"n{number}": number})


def test_readers_always_see_a_consistent_generation(store_copy):
    """While two writers publish, one after the other."""
    context = multiprocessing.get_context("spawn")
    writers = [context.Process(target=_publish_many, args=(str(store_copy), 4)) for _ in range(2)]
    before = layout.read_current(store_copy).generation
    generations = set()
    try:
        for writer in writers:
            writer.start()
        while any(writer.is_alive() for writer in writers):
            with s2rstore.open(store_copy) as store:
                values = store.provenance("many")
                assert len(values) in {*range(5)}
                assert len(store.run_columns("vanilla").valid) == 40
                generations.add(store.generation)
    finally:
        for writer in writers:
            writer.join()
    assert [writer.exitcode for writer in writers] == [0, 0]
    assert layout.read_current(store_copy).generation == before + 8
    assert len(generations) >= 2
    assert verify(store_copy) == []


@pytest.mark.parametrize(
    ("content", "hint"),
    [(None, "not a store"), ("{", "damaged"), ('{"generation": 1}', "damaged"),
     (" " * 10**6, "at most"), (Path.mkdir, "a folder, not a regular file")],
    ids=["none", "cut", "incomplete", "huge", "folder"],
)  # fmt: skip
def test_an_invalid_store_is_refused(tmp_path, content, hint):
    current = tmp_path / "CURRENT.json"
    if content is Path.mkdir:
        current.mkdir()
    elif content is not None:
        current.write_text(content)
    with pytest.raises(RequestError, match=hint):
        s2rstore.open(tmp_path)


def test_a_store_of_another_schema_is_refused(store_copy):
    current = json.loads((store_copy / "CURRENT.json").read_text())
    current["schema"] = 999
    (store_copy / "CURRENT.json").write_text(json.dumps(current))
    for function in (s2rstore.open, prune):
        with pytest.raises(RequestError, match="schema 999"):
            function(store_copy)


def test_prune_keeps_data_of_retained_generations(store_copy):
    for number in range(4):
        with edit(store_copy) as draft:
            draft.set_provenance("n", {"number": number})
    with edit(store_copy) as draft:
        draft.delete("zarr_array", run="dataaug")
    orphan = store_copy / "runs.zarr" / "vanilla" / "orphan"
    orphan.mkdir()
    (orphan / "file").write_bytes(b"123")
    planned = prune(store_copy, keep=1, dry_run=True)
    assert orphan.exists()
    assert prune(store_copy, keep=1) == planned
    assert not orphan.exists()
    assert not (store_copy / "runs.zarr" / "dataaug").exists()
    assert verify(store_copy) == []
    with s2rstore.open(store_copy) as store:
        assert store.heatmap("vanilla", "occlusion", "real", 3).shape == (6, 6)


def test_superseded_generations_are_removed_and_open_ones_stay_readable(store_copy):
    made = []
    with s2rstore.open(store_copy) as before:
        for number in range(5):
            with edit(store_copy) as draft:
                draft.set_provenance("n", {"number": number})
            made.append(draft.generation)
            if number == 0:
                first = s2rstore.open(store_copy)
        remove_superseded(store_copy, made)
        assert first.provenance("n") == {"number": "0"}
        first.close()
        with pytest.raises(RequestError):
            s2rstore.open(store_copy, generation=made[1])
        for kept in (before.generation, *made[2:]):
            s2rstore.open(store_copy, generation=kept).close()
