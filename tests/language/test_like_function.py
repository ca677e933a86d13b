"""The `like` function: an instance and its nearest neighbours in the embedding of a run."""

from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.index.transaction import edit
from s2rstore.language import ExpressionError, evaluation
from s2rstore.metrics import nearest_neighbours
from s2rstore.reader import Store
from tests.conftest import BuildOnce
from tests.support import embeddings
from tests.support.copies import copy_store

N = 40


@pytest.fixture(scope="module")
def store(tiny_store: Path, build_once: BuildOnce) -> Store:
    """In run `vanilla` the embedding of instance i is (i, 0) for real and (i // 2, 0) for sim."""
    return s2rstore.open(build_once("like.s2r", lambda path: _add(copy_store(tiny_store, path))))


def _add(path: Path) -> None:
    line = np.stack([np.arange(N), np.zeros(N)], axis=1).astype(np.float32)
    real, sim = line.copy(), line // 2
    real[11] = np.nan
    embeddings.add(path, "vanilla", {"sim": sim, "real": real})
    with edit(path) as draft:
        draft._connection.execute(
            "UPDATE prediction SET error = NULL WHERE run = 'vanilla' AND iid = 13"
        )


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("like(20, 4)", {18, 19, 20, 21, 22}),
        ("real.like(20, 1)", {19, 20}),  # 19 and 21 are at the same distance
        ("sim.like(20, 3)", {18, 19, 20, 21}),
        ("like(0, 2)", {0, 1, 2}),
        ("like(12, 2)", {10, 12, 14}),  # 11 has no embedding, 13 no prediction
        ("like(11, 5)", set()),
        ("like(20, 4) - ids(20)", {18, 19, 21, 22}),
        ("like(3, 100)", set(range(N)) - {11, 13}),
        ('run("vanilla").like(20, 1)', {19, 20}),
    ],
)
def test_like_selects_the_instance_and_its_nearest_neighbours(store, text, expected):
    assert set(np.flatnonzero(evaluation.select(store, text, "vanilla"))) == expected
    query, parameters = evaluation.sql(store, text, "vanilla")
    assert {row[0] for row in store.execute(query, parameters)} == expected


def test_neighbours_are_searched_in_the_chosen_trajectories(store):
    selected = np.flatnonzero(evaluation.select(store, "like(24, 3)", "vanilla", ("b",)))
    assert selected.tolist() == [25, 26, 27]  # instance 24 belongs to trajectory a
    neighbour_iids, distances = nearest_neighbours.neighbours(store, "vanilla", "real", 24, 3)
    assert neighbour_iids.tolist() == [24, 23, 25, 22]
    assert distances.tolist() == [0, 1, 1, 2]


def test_a_run_without_embeddings_is_an_error(store):
    for evaluate in (evaluation.select, evaluation.sql):
        with pytest.raises(
            ExpressionError, match=r"column 10: like: run 'dataaug' has no embeddings"
        ):
            evaluate(store, "gap > 0 |like(3, 4)", "dataaug")
        with pytest.raises(ExpressionError, match=r"instance 40: the store holds 0 \.\. 39"):
            evaluate(store, "like(40, 4)", "vanilla")


def test_embeddings_replace_missing_components(store_copy):
    rows = np.arange(N * 3, dtype=np.float32).reshape(N, 3)
    embeddings.add(store_copy, "vanilla", {"sim": rows, "real": rows}, "embedding")
    with s2rstore.open(store_copy) as store:
        assert set(np.flatnonzero(evaluation.select(store, "like(5, 2)"))) == {4, 5, 6}


def test_embeddings_of_other_instances_are_refused(store_copy):
    embeddings.add(store_copy, "vanilla", {"real": np.zeros((7, 2), np.float32)})
    with (
        s2rstore.open(store_copy) as store,
        pytest.raises(RequestError, match="7 rows; run `s2r verify`"),
    ):
        nearest_neighbours.neighbours(store, "vanilla", "real", 3, 2)


def test_neighbours_far_from_the_origin_are_ordered_exactly():
    points = np.full((50, 8), 3000.0, np.float32)
    points[:, 0] += np.arange(50, dtype=np.float32) * np.float32(0.01)
    neighbour_iids, _ = nearest_neighbours.nearest(points, 20, 6, np.ones(50, bool))
    assert set(neighbour_iids[1:]) == {17, 18, 19, 21, 22, 23}
