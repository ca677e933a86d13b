"""The task axis on synthetic stores: paired gap, anchor, groups and errors."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.errors import InconclusiveError, RequestError
from s2rstore.index.transaction import edit
from s2rstore.reader import Store
from s2rtools.gap.axis import Evidence, GapSettings
from s2rtools.gap.gate import gate
from s2rtools.gap.report import plain
from s2rtools.gap.task.task_axis import GroupErrors, TaskAxis, group_metrics, heading_sectors
from tests.support.copies import copy_store

N = 400
SETTINGS = GapSettings()


@pytest.fixture(scope="module")
def store(store_of_400: Path) -> Iterator[Store]:
    with s2rstore.open(store_of_400) as opened:
        yield opened


def evidence(store: Store, run: str = "vanilla", iids: np.ndarray | None = None) -> Evidence:
    return Evidence(store, run, np.arange(N) if iids is None else iids)


def test_the_value_is_the_mean_paired_gap_of_held_out_instances(store: Store) -> None:
    rows = store.execute(
        "SELECT r.error - s.error FROM prediction s JOIN prediction r USING (run, iid) "
        "WHERE run = 'vanilla' AND s.side = 'sim' AND r.side = 'real' AND s.split = 'test'"
    )
    result = TaskAxis().measure(evidence(store), SETTINGS)
    assert result.n == len(rows) == N // 5
    assert result.value == pytest.approx(np.mean(rows))
    assert result.floor == 0
    found = result.bounds(0.95)
    assert 0 < found.low < found.value == result.value < found.high
    assert result.bounds(0.99).low < found.low
    assert f"{N - N // 5} instances" in result.notes[1]
    json.dumps([result.details, dict(result.fingerprint)], allow_nan=False)


def test_the_details_split_the_gap_into_groups(store: Store) -> None:
    result = TaskAxis().measure(evidence(store), SETTINGS)
    details = result.details
    assert details["real"] - details["sim"] == pytest.approx(result.value)
    assert details["gap"]["value"] == pytest.approx(result.value)
    assert details["relative_drop"]["value"] == pytest.approx(result.value / details["sim"])
    for groups in ("rooms", "headings", "trajectories"):
        parts = details[groups].values()
        assert sum(part["n"] for part in parts) == result.n
        total = sum(part["n"] * part["gap"]["value"] for part in parts)
        assert total / result.n == pytest.approx(result.value)
    assert set(details["rooms"]) == {"left hall", "right"}
    assert set(details["runs"]) == {"vanilla", "dataaug"}
    other = TaskAxis().measure(evidence(store, "dataaug"), SETTINGS)
    assert details["runs"]["dataaug"]["gap"]["value"] == pytest.approx(other.value)
    truth = store.instances
    held_out = np.arange(N) % 5 == 4
    distances = np.hypot(truth.x - truth.x[held_out].mean(), truth.y - truth.y[held_out].mean())[
        held_out
    ]
    assert details["baseline"] == pytest.approx(distances.mean())
    iids, sector = np.flatnonzero(held_out), heading_sectors(truth.heading[held_out])
    groupings = {
        "runs": (np.zeros(iids.size, int), ["vanilla"]),
        "rooms": (truth.room[iids], truth.room_names),
        "headings": sector,
        "trajectories": (truth.trajectory[iids], truth.trajectory_names),
    }
    for kind, (codes, names) in groupings.items():
        for name, part in details[kind].items():
            in_group = codes == list(names).index("vanilla" if kind == "runs" else name)
            assert part["baseline"] == pytest.approx(distances[in_group].mean())
    assert "about these 2 trajectories alone" in result.notes[0]
    printed = "\n".join(TaskAxis().describe(plain(details)))
    assert printed.count("constant m") == 4


def test_too_few_instances_are_inconclusive(store: Store) -> None:
    for iids in (np.array([4, 9, 14]), np.arange(0), np.arange(240)):
        with pytest.raises(InconclusiveError, match="at least 49"):
            TaskAxis().measure(evidence(store, iids=iids), SETTINGS)
    with pytest.raises(RequestError, match="run 'nobody'"):
        TaskAxis().missing(evidence(store, "nobody"))
    assert TaskAxis().missing(evidence(store)) is None


def test_an_uncomputed_run_is_missing(store_of_400: Path, tmp_path: Path) -> None:
    root = copy_store(store_of_400, tmp_path / "s.s2r")
    with edit(root) as draft:
        draft.update("run", {"run": "vanilla"}, {"key": None})
    with s2rstore.open(root) as store:
        assert "s2r precompute" in str(TaskAxis().missing(evidence(store)))


def test_missing_errors_are_excluded(store_of_400: Path, tmp_path: Path) -> None:
    root = copy_store(store_of_400, tmp_path / "s.s2r")
    with edit(root) as draft:
        draft.update("prediction", {"run": "vanilla", "side": "real", "iid": "4"}, {"error": None})
    with s2rstore.open(root) as store:
        result = TaskAxis().measure(evidence(store), SETTINGS)
        assert result.n == N // 5 - 1
        assert result.bounds(0.95).is_known


def test_a_run_without_predictions_is_rejected(store_of_400: Path, tmp_path: Path) -> None:
    root = copy_store(store_of_400, tmp_path / "s.s2r")
    with edit(root) as draft:
        draft.delete("prediction", run="vanilla")
    with s2rstore.open(root) as store, pytest.raises(RequestError, match="both sides predicted"):
        gate.collect_evidence(store, gate.GapRequest(run="vanilla"))


def errors(rng: np.random.Generator, n: int) -> GroupErrors:
    sim, real, constant = rng.gamma(2, 1, size=(3, n))
    return GroupErrors(sim, real, constant, np.repeat([0, 1], [n // 3, n - n // 3]))


def test_a_small_group_has_a_reason_in_place_of_an_interval() -> None:
    group_errors = errors(np.random.default_rng(0), 100)
    codes = np.where(np.arange(100) < 3, 0, 1)
    result = group_metrics(group_errors, codes, ["few", "many"], 0.95)
    assert result["few"]["gap"]["low"] is None
    assert result["few"]["gap"]["reason"] == "n 3, a mean difference needs 49"
    assert result["many"]["gap"]["low"] < result["many"]["gap"]["high"]


def test_heading_sectors_are_centred_and_wrap_around() -> None:
    degrees = np.array([0, 22.4, 22.6, 45, 90, 179, -179, 180, -90, -23, 337.6, -22.4])
    code, names = heading_sectors(np.radians(degrees))
    assert names == ["0", "45", "90", "135", "-180", "-135", "-90", "-45"]
    expected = ["0", "0", "45", "45", "90", "-180", "-180", "-180", "-90", "-45", "0", "0"]
    assert [names[k] for k in code] == expected


def test_the_constant_prediction_is_measured_from_the_poses_of_sim_images(
    store_of_400: Path, tmp_path: Path
) -> None:
    root = copy_store(store_of_400, tmp_path / "s.s2r")
    with s2rstore.open(root) as store:
        truth = store.instances
        x, y, heading = 2 * truth.x, 3 * truth.y, truth.heading.copy()
    own = {"iid": np.arange(N), "domain": ["sim"] * N, "x": x, "y": y, "heading": heading}
    with edit(root) as draft:
        draft.insert("frame_pose", own)
    with s2rstore.open(root) as store:
        held_out = np.arange(N) % 5 == 4
        constant = np.hypot(*(part[held_out] - part[held_out].mean() for part in (x, y)))
        sim = store.run_columns("vanilla").sim.error[held_out]
        anchor = TaskAxis().anchor(evidence(store), SETTINGS)
        assert anchor.interval.value == pytest.approx((constant - sim).mean())
