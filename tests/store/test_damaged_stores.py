"""Damaged, hostile and incomplete stores are refused or detected."""

import json
import multiprocessing
import time
from pathlib import Path

import pytest

import s2rstore
from bench.edited_index import edited
from s2rstore.errors import RequestError
from s2rstore.files import layout
from s2rstore.index.transaction import edit
from s2rstore.maintenance.prune import prune
from s2rstore.maintenance.verify import verify


def _change_current(root: Path, **values: object) -> None:
    path = root / layout.CURRENT
    path.write_text(json.dumps({**json.loads(path.read_text()), **values}))


@pytest.mark.parametrize(
    "values",
    [
        {"generation": 1_000}, {"generation": "a"}, {"index": ""}, {"index": "/etc/hostname"},
        {"index": "../x.duckdb"}, {"bytes": 1}, {"sha256": "0"},
    ],
)  # fmt: skip
def test_a_wrong_current_file_is_detected_and_prevents_pruning(store_copy, values):
    _change_current(store_copy, **values)
    before = sorted(store_copy.rglob("*"))
    assert verify(store_copy)
    if "bytes" not in values and "sha256" not in values:
        with pytest.raises(RequestError):
            prune(store_copy, keep=1)
        assert sorted(store_copy.rglob("*")) == before


def _publish_slowly(root: Path, started) -> None:
    with edit(root) as draft:
        draft.set_provenance("late", {"a": 1})
        started.set()
        time.sleep(0.7)


def test_prune_keeps_a_generation_published_while_it_waits(store_copy):
    context = multiprocessing.get_context("spawn")
    started = context.Event()
    writer = context.Process(target=_publish_slowly, args=(store_copy, started))
    writer.start()
    assert started.wait(60)
    prune(store_copy, keep=1)
    writer.join()
    with s2rstore.open(store_copy) as store:
        assert store.provenance("late") == {"a": "1"}
    assert verify(store_copy) == []


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE prediction SET rank = 1 WHERE side = 'real'",
        "UPDATE prediction SET loss = loss * 1.000001 WHERE iid = 3",
        "UPDATE prediction SET accuracy = 0.5 WHERE iid = 3",
        "DELETE FROM prediction WHERE iid > 30 AND side = 'sim'",
        "UPDATE instance SET iid = 4 WHERE iid = 5",
        "UPDATE instance SET iid = 90 WHERE iid = 39",
        "INSERT INTO run SELECT * FROM run LIMIT 1",
        "INSERT INTO model SELECT * FROM model LIMIT 1",
    ],
)
def test_verify_recomputes_the_derived_columns(store_copy, statement):
    edited(store_copy, [statement])
    assert verify(store_copy)


@pytest.mark.parametrize("path", ["/etc/hostname", "../../secret"])
def test_a_floor_plan_cannot_be_a_file_outside_the_store(store_copy, path):
    edited(store_copy, [f"UPDATE dataset SET floor_plan = '{path}'"])
    with s2rstore.open(store_copy) as store, pytest.raises(RequestError):
        store.floor_plan_path()
    assert verify(store_copy)


@pytest.mark.parametrize("iid", [-1, 40])
def test_an_instance_out_of_range_has_no_heatmap(tiny_store, iid):
    with s2rstore.open(tiny_store) as store, pytest.raises(RequestError, match="holds 0"):
        store.heatmap("vanilla", "occlusion", "real", iid)
