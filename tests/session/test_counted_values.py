"""Scales and ranks of a run count the population of the state, in one place."""

from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.index.population import NEW_INSTANCES, Population
from s2rstore.language import evaluation
from s2rtui.session.population_values import population_ranks, population_values
from tests.support import tiny

ALL = Population(with_trained=True)


@pytest.fixture(scope="module")
def half_trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny.build(tmp_path_factory.mktemp("half") / "s.s2r", n=40, trained=("vanilla",))


def test_trained_instances_have_no_value_unless_they_count(half_trained):
    with s2rstore.open(half_trained) as store:
        columns = store.run_columns("vanilla")
        errors = columns.real.error
        assert columns.trained.any()
        counted = population_values(NEW_INSTANCES, columns, errors)
        assert np.array_equal(np.isnan(counted), columns.trained | np.isnan(errors))
        assert population_values(NEW_INSTANCES, columns, errors) is counted
        assert population_values(ALL, columns, errors) is errors
        points = population_values(NEW_INSTANCES, columns, np.stack([errors, errors], axis=1))
        assert np.isnan(points[columns.trained]).all()
        other = store.run_columns("dataaug")
        assert population_values(NEW_INSTANCES, other, other.real.error) is other.real.error


def test_counted_ranks_agree_with_best_and_the_language_and_stored_ranks_count_all(half_trained):
    with s2rstore.open(half_trained) as store:
        columns = store.run_columns("vanilla")
        ranks = population_ranks(NEW_INSTANCES, columns, "real")
        best = evaluation.select(store, "best(3, real.error)", "vanilla")
        assert np.array_equal(best, (ranks > 0) & (ranks <= 3))
        ranked = evaluation.select(store, "real.rank <= 3", "vanilla")
        assert np.array_equal(ranked, best)
        assert np.array_equal(population_ranks(ALL, columns, "real"), columns.real.rank)
        stored = evaluation.select(store, "real.rank <= 3", "vanilla", with_trained=True)
        assert np.array_equal(stored, columns.real.rank <= 3)
        (comment,) = store.execute(
            "SELECT comment FROM duckdb_columns() WHERE table_name = 'prediction' "
            "AND column_name = 'rank'"
        )[0]
        assert "trained ones included" in comment
