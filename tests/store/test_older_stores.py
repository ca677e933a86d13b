"""Stores of earlier releases, without columns that were added later."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.index import schema
from s2rstore.index.transaction import edit
from s2rstore.language import evaluation
from s2rstore.maintenance.verify import verify
from tests.support.older_stores import without


@pytest.fixture
def older_store(store_copy: Path) -> Path:
    return without(store_copy, ("outlier",))


def test_an_older_store_opens_and_its_absent_columns_are_missing(older_store: Path) -> None:
    with s2rstore.open(older_store) as store:
        assert store.missing_columns("prediction") == {"outlier"}
        assert store.missing_columns("instance") == set(schema.PAIR_OFFSETS)
        assert np.isnan(store.run_columns("vanilla").real.outlier).all()
        for text in (
            "sim.outlier > 1",
            "worst(15%, real.outlier)",
            "!(real.outlier < 2)",
            "worst15",
        ):
            selected = np.flatnonzero(evaluation.select(store, text))
            query, parameters = evaluation.sql(store, text)
            assert [row[0] for row in store.execute(query, parameters)] == selected.tolist()
    assert verify(older_store) == []


def test_the_next_generation_adds_the_column(older_store: Path) -> None:
    with edit(older_store) as draft:
        draft._connection.execute("UPDATE prediction SET outlier = 2 WHERE iid < 3")
    with s2rstore.open(older_store) as store:
        assert not store.missing_columns("prediction")
        assert np.flatnonzero(evaluation.select(store, "sim.outlier = 2")).tolist() == [0, 1, 2]
        assert store.execute("SELECT count(*) FROM pair WHERE real_outlier = 2") == [(6,)]
    assert verify(older_store) == []


def test_pairs_of_an_older_store_have_no_offset_and_their_instances_poses(
    store_copy: Path,
) -> None:
    path = without(store_copy, ())
    with s2rstore.open(path) as store:
        assert not store.has_loose_pairs
        assert all(domain.has_depth for domain in store.domains.values())
        np.testing.assert_array_equal(store.poses("real")[:, 0], store.instances.x)
        for text, count in (
            ("pair_offset_m = 0", len(store.instances)),
            ("pair_offset_deg > 0", 0),
            ("!(pair_offset_m < 1)", 0),
        ):
            query, parameters = evaluation.sql(store, text)
            assert np.count_nonzero(evaluation.select(store, text)) == count
            assert len(store.execute(query, parameters)) == count
    assert verify(path) == []


def test_the_next_generation_of_an_older_store_has_pairs_without_offset(store_copy: Path) -> None:
    path = without(store_copy, ())
    with edit(path) as draft:
        draft.set_provenance("dataset", {"note": "x"})
    with s2rstore.open(path) as store:
        assert not store.missing_columns("instance")
        assert (store.instances.pair_offset_m == 0).all()
        assert store.execute("SELECT DISTINCT pair_offset_m, pair_offset_deg FROM pair") == [(0, 0)]
    assert verify(path) == []
