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


@pytest.fixture
def older_store(store_copy: Path) -> Path:
    view = schema._pair_view()
    for side, alias in (("sim", "s"), ("real", "r")):
        view = view.replace(f"{alias}.outlier AS {side}_outlier, ", "")
    assert "outlier" not in view
    with edit(store_copy) as draft:
        draft._connection.execute("DROP VIEW pair")
        draft._connection.execute("ALTER TABLE prediction DROP COLUMN outlier")
        draft._connection.execute(view)
    return store_copy


def test_an_older_store_opens_and_its_absent_columns_are_missing(older_store: Path) -> None:
    with s2rstore.open(older_store) as store:
        assert store.missing_columns("prediction") == {"outlier"}
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


def test_a_negative_outlier_score_is_reported_as_damage(store_copy: Path) -> None:
    with edit(store_copy) as draft:
        draft._connection.execute(
            "UPDATE prediction SET outlier = -1 WHERE iid = 3 AND side = 'sim'"
        )
    assert [damage.what for damage in verify(store_copy)] == ["2 rows: outlier is no distance"]
