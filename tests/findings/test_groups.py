"""Errors per room, heading sector, curvature and trajectory."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import s2rstore
from s2rstore.findings.groups import GROUPINGS, SECTORS, Grouping, group_errors, groups_of
from s2rstore.index.transaction import edit
from s2rstore.language import evaluation
from s2rstore.metrics import run_metrics
from s2rstore.reader import Store
from tests.support import tiny


def pairs(store: Store, run: str) -> pd.DataFrame:
    """The new instances of a run as stored, with their groups computed by pandas."""
    names = ("iid", "room", "trajectory", "heading", "curvature", "sim_error", "real_error")
    rows = store.execute(
        f"SELECT {', '.join(names)} FROM pair WHERE run = ? AND sim_split NOT IN "
        "('train', 'validation') AND real_split NOT IN ('train', 'validation')", [run],
    )  # fmt: skip
    table = pd.DataFrame(rows, columns=list(names))
    degrees = np.degrees(table.heading)
    centres = (np.round(degrees / 45) * 45).astype(int).replace(-180, 180)
    return table.assign(
        gap=table.real_error - table.sim_error,
        room=table.room.fillna("no room"),
        heading=centres.astype(str) + " deg",
        curvature=np.where(table.curvature.abs() < 10, "straight", "curved"),
    )


@pytest.mark.parametrize("grouping", GROUPINGS)
@pytest.mark.parametrize("run", ["vanilla", "dataaug"])
def test_medians_and_counts_equal_those_of_pandas(
    marked: Path, grouping: Grouping, run: str
) -> None:
    with s2rstore.open(marked) as store:
        new = run_metrics.population(store, run)
        rows = group_errors(store, run, groups_of(store, grouping), new)
        table = pairs(store, run).groupby(grouping)
    assert {row.group.name: row.n for row in rows} == table.size().to_dict()
    for row in rows:
        expected = table.get_group(row.group.name)
        assert row.real.value == pytest.approx(expected.real_error.median())
        assert row.sim == pytest.approx(expected.sim_error.median())
        assert row.gap == pytest.approx(expected.gap.median())


@pytest.mark.parametrize("grouping", GROUPINGS)
def test_the_expression_of_a_group_selects_exactly_its_instances(
    marked: Path, grouping: Grouping
) -> None:
    with s2rstore.open(marked) as store:
        new = run_metrics.population(store, "vanilla")
        grouped = groups_of(store, grouping)
        for code, group in enumerate(grouped.groups):
            selected = evaluation.select(store, group.expression, "vanilla")
            assert np.array_equal(selected, new & (grouped.codes == code))


def test_headings_on_the_edge_of_two_sectors_belong_to_one(tmp_path: Path) -> None:
    path = tiny.build(tmp_path / "s.s2r", n=32)
    with edit(path) as draft:
        draft.rows("UPDATE instance SET heading = radians(iid * 11.25 - 180)")
    with s2rstore.open(path) as store:
        grouped = groups_of(store, "heading")
        selections = [evaluation.select(store, g.expression, "vanilla") for g in grouped.groups]
    assert np.array_equal(np.sum(selections, axis=0), np.ones(32))
    assert np.bincount(grouped.codes, minlength=SECTORS).tolist() == [4] * SECTORS


def test_an_unknown_curvature_belongs_to_no_group(store_copy: Path) -> None:
    path = store_copy
    with edit(path) as draft:
        draft.rows("UPDATE instance SET curvature = NULL WHERE iid < 10")
    with s2rstore.open(path) as store:
        grouped = groups_of(store, "curvature")
        rows = group_errors(store, "vanilla", grouped, np.ones(40, dtype=np.bool_))
    assert (grouped.codes[:10] == -1).all()
    assert sum(row.n for row in rows) == 30


def test_groups_without_instances_are_left_out(plain: Path) -> None:
    with s2rstore.open(plain) as store:
        left = np.zeros(120, dtype=np.bool_)
        left[5] = True
        rows = group_errors(store, "vanilla", groups_of(store, "trajectory"), left)
    assert [(row.group.name, row.n) for row in rows] == [("a", 1)]
    assert math.isnan(rows[0].real.low)
