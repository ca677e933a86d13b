"""Instances that another program did not localise are failures in recall and medians."""

from __future__ import annotations

import numpy as np
import pytest

import s2rstore
from s2rstore.index.transaction import edit
from s2rstore.maintenance.verify import verify
from s2rstore.metrics import recall, run_metrics
from s2rstore.records import RECALL_THRESHOLDS
from s2rtui.cli import main
from tests.support.predictions import COLUMNS, make, rows_of, write_rows

TRAJECTORY = 12
"""Instances of either trajectory."""


@pytest.fixture
def file(store, tmp_path):
    """Predictions of the first trajectory: iid 3 has no real pose, iid 5 no row at all."""
    rows = rows_of(make(store))
    rows[2 * TRAJECTORY + 3] = (3, "real", "", "nan", "")
    kept = [row for row in rows if row[0] < TRAJECTORY and row[0] != 5]
    return write_rows(tmp_path / "p.csv", COLUMNS, kept)


def truth_errors(opened, side):
    """Position errors in metres and heading errors in degrees, by another way."""
    part, truth = opened.run_columns("theirs").side(side), opened.instances
    turn = np.angle(np.exp(1j * (part.heading - truth.heading)), deg=True)
    return np.sqrt((part.x - truth.x) ** 2 + (part.y - truth.y) ** 2), np.abs(turn)


def test_missing_poses_count_as_failures(store, file, capsys):
    command = ["run", "import", "theirs", "--predictions", str(file), "--store", str(store)]
    assert main(command) == 0
    text = "2 not localised, which count as failures (1 of them have no row; --absent ignore"
    assert text in capsys.readouterr().out
    with s2rstore.open(store) as opened:
        columns = opened.run_columns("theirs")
        assert np.flatnonzero(columns.attempted).tolist() == list(range(TRAJECTORY))
        assert np.flatnonzero(columns.attempted & ~columns.valid).tolist() == [3, 5]
        assert opened.coverage("theirs").summary == (
            "imported for 12 of 24 instances, 2 not localised"
        )
        for side, lost in (("sim", 1), ("real", 2)):
            metres, degrees = (errors[:TRAJECTORY] for errors in truth_errors(opened, side))
            found = recall.side_recall(opened, "theirs", side)
            assert (found.n, found.not_localised, found.trained_on) == (TRAJECTORY, lost, 0)
            for point, (m, deg) in zip(found.points, RECALL_THRESHOLDS, strict=True):
                held = sum(e <= m and h <= deg for e, h in zip(metres, degrees, strict=True))
                assert point.share.value == pytest.approx(held / TRAJECTORY)
            filled = np.sort(np.nan_to_num(metres, nan=np.inf))
            assert found.position.value == pytest.approx(filled[5:7].mean())
            filled = np.sort(np.nan_to_num(degrees, nan=np.inf))
            assert np.degrees(found.heading.value) == pytest.approx(filled[5:7].mean())
            x, y, valid = opened.instances.x, opened.instances.y, columns.valid
            away = np.hypot(x - x[valid].mean(), y - y[valid].mean())[:TRAJECTORY]
            known = ~np.isnan(metres)
            skill = 1 - metres[known].mean() / away[known].mean()
            assert found.skill.value == pytest.approx(skill)
            curve = recall.recall_curve(opened, "theirs", side)
            assert curve.at(np.array([0.5, 1.0, 2.0, np.float64(1e9)])).tolist() == pytest.approx(
                [*(point.share.value for point in found.points[1:]), 1 - lost / TRAJECTORY]
            )
    assert verify(store) == []


def test_absent_instances_can_be_left_out_and_the_pose_of_a_row_not(store, file):
    command = ["run", "import", "theirs", "--predictions", str(file), "--store", str(store)]
    assert main([*command, "--absent", "ignore"]) == 0
    with s2rstore.open(store) as opened:
        columns = opened.run_columns("theirs")
        assert np.flatnonzero(columns.attempted & ~columns.valid).tolist() == [3]
        assert recall.side_recall(opened, "theirs", "real").n == TRAJECTORY - 1


def test_a_median_among_the_not_localised_is_infinite():
    codes, errors = np.zeros(60, dtype=np.int32), np.linspace(1.0, 2.0, 60)
    errors[::2] = np.nan
    found = recall.median_error(errors, codes)
    assert (found.value, found.high, found.low <= 2.0) == (np.inf, np.inf, True)
    assert recall.metres_text(found.value) == "not localised"
    errors[:10:2] = 1.0
    found = recall.median_error(errors, codes)
    assert found.value == np.median(np.nan_to_num(errors, nan=9.0))
    assert found.bounds_text("{:.1f}".format).endswith(f"to >{np.nanmax(errors):.1f}")


def test_thresholds_come_from_the_data_set_and_trained_instances_are_left_out(store_copy):
    with edit(store_copy) as draft:
        draft.update("dataset", {"name": "tiny"}, {"recall_thresholds": [[0.7, 20], [3, 60]]})
        draft.update("prediction", {"run": "vanilla", "iid": 7}, {"split": "train"})
    with s2rstore.open(store_copy) as opened:
        columns, found = opened.run_columns("vanilla"), recall.side_recall(opened, "vanilla", "sim")
        held_out = run_metrics.population(opened, "vanilla")
        errors = columns.sim.error[held_out], np.degrees(columns.sim.heading_error[held_out])
        assert (found.n, found.trained_on, found.headline.name) == (39, 1, "0.7 m, 20 deg")
        shares = [np.mean((errors[0] <= m) & (errors[1] <= d)) for m, d in ((0.7, 20), (3, 60))]
        assert [point.share.value for point in found.points] == pytest.approx(shares)
        assert 0 < shares[0] < shares[1]
