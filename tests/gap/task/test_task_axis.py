"""The task axis on synthetic stores: paired gap, anchor, groups, refusals."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import s2rstore
from s2rstore.errors import InconclusiveError, RequestError
from s2rstore.index.transaction import edit
from s2rstore.metrics import bootstrap
from s2rstore.metrics.bootstrap import mean_replicates, split_into_blocks
from s2rstore.reader import Store
from s2rtools.gap.axis_result import Evidence, GapSettings
from s2rtools.gap.gate import gate
from s2rtools.gap.report import plain
from s2rtools.gap.task.group_metrics import GroupErrors, group_metrics, no_gap_interval
from s2rtools.gap.task.task_axis import TaskAxis, heading_sectors
from s2rtui.cli.formatting.gap_details import details as shown
from tests.support import tiny
from tests.support.copies import copy_store

N = 120
SETTINGS = GapSettings(replicates=300, seed=2)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny.build(tmp_path_factory.mktemp("task") / "s.s2r", N)


@pytest.fixture
def store(path: Path) -> Iterator[Store]:
    with s2rstore.open(path) as opened:
        yield opened


def evidence(store: Store, run: str = "vanilla", iids: np.ndarray | None = None) -> Evidence:
    return Evidence(store, run, np.arange(N) if iids is None else iids)


def test_m_is_the_mean_paired_gap_of_what_the_model_was_not_trained_on(store: Store) -> None:
    rows = store.execute(
        "SELECT r.error - s.error FROM prediction s JOIN prediction r USING (run, iid) "
        "WHERE run = 'vanilla' AND s.side = 'sim' AND r.side = 'real' AND s.split = 'test'"
    )
    found = TaskAxis().measure(evidence(store), SETTINGS)
    assert found.n == len(rows) == N // 5
    assert found.value == pytest.approx(np.mean(rows))
    assert found.floor == 0
    assert not found.floor_replicates.any()
    low, high = np.percentile(found.replicates, [2.5, 97.5])
    assert 0 < low < found.value < high
    assert found.details["no_gap_interval"][1] < found.value
    assert "96 instances" in found.notes[1]
    json.dumps([found.details, dict(found.fingerprint)], allow_nan=False)


def test_the_details_break_the_gap_down(store: Store) -> None:
    found = TaskAxis().measure(evidence(store), SETTINGS)
    details = found.details
    assert details["real"] - details["sim"] == pytest.approx(found.value)
    assert details["gap"]["value"] == pytest.approx(found.value)
    assert details["relative_drop"]["value"] == pytest.approx(found.value / details["sim"])
    for groups in ("rooms", "headings", "trajectories"):
        parts = details[groups].values()
        assert sum(part["n"] for part in parts) == found.n
        total = sum(part["n"] * part["gap"]["value"] for part in parts)
        assert total / found.n == pytest.approx(found.value)
    assert set(details["rooms"]) == {"left hall", "right"}
    assert set(details["runs"]) == {"vanilla", "dataaug"}
    other = TaskAxis().measure(evidence(store, "dataaug"), SETTINGS)
    assert details["runs"]["dataaug"]["gap"]["value"] == pytest.approx(other.value)
    truth = store.instances
    held_out = np.arange(N) % 5 == 4
    away = np.hypot(truth.x - truth.x[held_out].mean(), truth.y - truth.y[held_out].mean())[
        held_out
    ]
    assert details["baseline"] == pytest.approx(away.mean())
    iids, sector = np.flatnonzero(held_out), heading_sectors(truth.heading[held_out])
    groupings = {
        "runs": (np.zeros(iids.size, int), ["vanilla"]),
        "rooms": (truth.room[iids], truth.room_names),
        "headings": sector,
        "trajectories": (truth.trajectory[iids], truth.trajectory_names),
    }
    for kind, (codes, names) in groupings.items():
        for name, part in details[kind].items():
            inside = codes == list(names).index("vanilla" if kind == "runs" else name)
            assert part["baseline"] == pytest.approx(away[inside].mean())
    assert "intervals by bootstrap over" in found.notes[0]
    printed = "\n".join(shown({"axis": "task", "details": plain(details)}))
    assert printed.count("constant m") == 4


def test_a_trajectory_is_told_by_its_blocks_where_whole_ones_are_drawn(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bootstrap, "MIN_TRAJECTORIES", 2)
    monkeypatch.setattr(bootstrap, "MAX_TRAJECTORY_SHARE", 1)
    found = TaskAxis().measure(evidence(store), SETTINGS)
    assert "2 whole trajectories" in found.notes[0]
    assert found.details["trajectories"]["a"]["gap"]["low"] is not None
    assert found.details["rooms"]["right"]["gap"]["low"] is None


def test_the_anchor_is_the_constant_prediction(store: Store) -> None:
    measured = TaskAxis().measure(evidence(store), SETTINGS)
    anchor = TaskAxis().anchor(evidence(store), SETTINGS)
    assert anchor.value == pytest.approx(measured.details["baseline"] - measured.details["sim"])
    assert anchor.replicates.shape == (300,)
    assert "constant prediction" in anchor.state


def test_identical_predictions_have_no_gap(path: Path, tmp_path: Path) -> None:
    root = copy_store(path, tmp_path / "s.s2r")
    with edit(root) as draft:
        rows = draft.rows(
            "SELECT iid, x, y, error FROM prediction WHERE run = 'vanilla' AND side = 'sim'"
        )
        draft.delete("prediction", run="vanilla", side="real")
        iid, x, y, error = (list(column) for column in zip(*rows, strict=True))
        draft.insert(
            "prediction",
            {"run": ["vanilla"] * N, "iid": iid, "side": ["real"] * N, "x": x, "y": y,
             "error": error, "split": ["unseen"] * N},
        )  # fmt: skip
    with s2rstore.open(root) as store:
        found = TaskAxis().measure(evidence(store), SETTINGS)
        assert found.value == 0
        assert not found.replicates.any()
        assert found.details["no_gap_interval"] == [0, 0]


def test_too_few_instances_are_inconclusive(store: Store) -> None:
    for iids in (np.array([4, 9, 14]), np.arange(0), np.arange(90)):
        with pytest.raises(InconclusiveError, match="at least 20"):
            TaskAxis().measure(evidence(store, iids=iids), SETTINGS)
    with pytest.raises(RequestError, match="run 'nobody'"):
        TaskAxis().missing(evidence(store, "nobody"))
    assert TaskAxis().missing(evidence(store)) is None


def test_an_uncomputed_run_is_missing(path: Path, tmp_path: Path) -> None:
    root = copy_store(path, tmp_path / "s.s2r")
    with edit(root) as draft:
        draft.update("run", {"run": "vanilla"}, {"key": None})
    with s2rstore.open(root) as store:
        assert "s2r precompute" in str(TaskAxis().missing(evidence(store)))


def test_rows_without_an_error_leave_the_figures(path: Path, tmp_path: Path) -> None:
    root = copy_store(path, tmp_path / "s.s2r")
    with edit(root) as draft:
        draft.update("prediction", {"run": "vanilla", "side": "real", "iid": "4"}, {"error": None})
    with s2rstore.open(root) as store:
        found = TaskAxis().measure(evidence(store), SETTINGS)
        assert found.n == N // 5 - 1
        assert np.isfinite(found.replicates).all()


def test_a_run_without_predictions_is_refused(path: Path, tmp_path: Path) -> None:
    root = copy_store(path, tmp_path / "s.s2r")
    with edit(root) as draft:
        draft.delete("prediction", run="vanilla")
    with s2rstore.open(root) as store, pytest.raises(RequestError, match="both sides predicted"):
        gate.collect_evidence(store, gate.GapRequest(run="vanilla"))


def test_trajectories_keep_their_intervals_where_whole_ones_are_drawn() -> None:
    rng = np.random.default_rng(4)
    codes = np.repeat(np.arange(6), 40).astype(np.int32)
    made = GroupErrors(*rng.gamma(2, 1, size=(3, 240)), split_into_blocks(codes, 8))
    names = [f"t{k}" for k in range(6)]
    assert made.blocks.by_trajectory
    assert group_metrics(made, codes, names, SETTINGS)["t1"]["gap"]["low"] is None
    apart = group_metrics(replace(made, blocks=made.blocks.ungrouped()), codes, names, SETTINGS)
    assert all(part["gap"]["low"] < part["gap"]["high"] for part in apart.values())


def errors(rng: np.random.Generator, n: int) -> GroupErrors:
    sim, real, constant = rng.gamma(2, 1, size=(3, n))
    return GroupErrors(
        sim, real, constant, split_into_blocks(np.repeat([0, 1], [n // 3, n - n // 3]))
    )


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.integers(10, 80), st.integers(1, 6))
def test_groups_agree_with_brute_force(seed: int, n: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    made, codes = errors(rng, n), rng.integers(-1, count, n)
    names = [f"g{k}" for k in range(count)]
    found = group_metrics(made, codes, names, GapSettings(50))
    assert set(found) == {names[k] for k in set(codes) if k >= 0}
    for k in range(count):
        if names[k] in found:
            inside, group = codes == k, found[names[k]]
            assert group["n"] == inside.sum()
            assert group["gap"]["value"] == pytest.approx(made.gap[inside].mean())
            assert group["sim"] == pytest.approx(made.sim[inside].mean())
    json.dumps(found, allow_nan=False)


def test_a_group_in_two_blocks_has_no_interval() -> None:
    made = errors(np.random.default_rng(0), 100)
    codes = np.where(np.arange(100) < 3, 0, 1)
    found = group_metrics(made, codes, ["few", "many"], SETTINGS)
    assert found["few"]["gap"]["low"] is None
    assert found["many"]["gap"]["low"] < found["many"]["gap"]["high"]


def test_the_mean_of_all_is_that_of_its_only_group() -> None:
    made = errors(np.random.default_rng(1), 100)
    found = group_metrics(made, np.zeros(100, int), ["all"], SETTINGS)["all"]["gap"]
    replicates = mean_replicates(made.gap, made.blocks, SETTINGS)
    assert [found["low"], found["high"]] == pytest.approx(np.percentile(replicates, [2.5, 97.5]))


def test_intervals_hold_the_truth_where_neighbours_are_alike() -> None:
    rng = np.random.default_rng(2)
    held = 0
    for seed in range(300):
        noise = rng.normal(size=102)
        values = noise[2:] + noise[1:-1] + noise[:-2]
        cut = split_into_blocks(np.repeat([0, 1], 50).astype(np.int32))
        low, high = np.percentile(mean_replicates(values, cut, GapSettings(200, seed)), [2.5, 97.5])
        held += low <= 0 <= high
    assert held / 300 >= 0.87


def test_without_a_gap_the_swap_interval_holds_the_mean() -> None:
    rng = np.random.default_rng(3)
    held = 0
    for seed in range(200):
        made = errors(rng, 80)
        low, high = no_gap_interval(made, GapSettings(200, seed))
        held += low <= made.gap.mean() <= high
    assert held / 200 == pytest.approx(0.95, abs=0.06)


def test_heading_sectors_are_centred_and_wrap() -> None:
    degrees = np.array([0, 22.4, 22.6, 45, 90, 179, -179, 180, -90, -23, 337.6, -22.4])
    code, names = heading_sectors(np.radians(degrees))
    assert names == ["0", "45", "90", "135", "-180", "-135", "-90", "-45"]
    wanted = ["0", "0", "45", "45", "90", "-180", "-180", "-180", "-90", "-45", "0", "0"]
    assert [names[k] for k in code] == wanted
