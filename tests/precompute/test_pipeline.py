"""Precompute: correct, resumable results that survive a killed process."""

import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.errors import RequestError, StoreBusyError
from s2rstore.files import compute_progress
from s2rstore.files.ledger import Ledger
from s2rstore.files.store_files import LocalFiles
from s2rstore.index.transaction import IndexTransaction, edit
from s2rstore.maintenance.prune import KEPT
from s2rstore.maintenance.verify import verify
from s2rstore.reader import Store
from s2rstore.records import Run
from s2rtools.precompute import pipeline, publish_results
from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
from s2rtools.precompute.run_backends import RunBackends
from s2rtools.precompute.run_registration import add_run
from tests.support.copies import copy_store
from tests.support.silent_reporter import SilentReporter

KINDS = ("feature_distance",)


def test_black_input_gives_a_constant_prediction(computed_store):
    with s2rstore.open(computed_store) as store:
        black_columns, unadjusted = store.run_columns("black"), store.run_columns("vanilla")
        for name in ("x", "y", "heading"):
            assert np.ptp(getattr(black_columns.real, name)) < 1e-6
            assert (getattr(black_columns.sim, name) == getattr(unadjusted.sim, name)).all()
        assert (store.run_columns("bright").real.x != unadjusted.real.x).any()


def test_every_array_is_complete_and_finite(computed_store):
    with s2rstore.open(computed_store) as store:
        kinds = {record.kind for record in store.array_kinds("vanilla")}
        for kind in ("activation", "occlusion", "feature_distance", "pixel_difference"):
            assert {kind, f"map:{kind}"} <= kinds
        for record in store.array_kinds("vanilla"):
            _, array = store.array("vanilla", record.kind, record.side, record.mode)
            values = np.asarray(array[:], dtype=np.float64)
            assert values.shape == record.shape
            sparse = ("map:", "harmonised_", "pixel_difference")
            if not record.kind.startswith(sparse):
                assert np.isfinite(values).all(), record
            assert np.ptp(np.nan_to_num(values)) > 0, record
    assert verify(computed_store) == []


def test_training_instances_are_marked(computed_store):
    with s2rstore.open(computed_store) as store:
        counts = dict(
            store.execute(
                "SELECT side || split, count(*) FROM prediction WHERE run = 'vanilla' GROUP BY ALL"
            )
        )
    assert counts["realunseen"] == 40
    assert counts["simtrain"] + counts["simvalidation"] + counts["simtest"] == 40
    assert min(counts.values()) > 0


def test_several_workers_give_the_same_values(small_store, small_copy, tmp_path):
    alone = copy_store(small_store, tmp_path / "alone.s2r")
    precompute(alone, SilentReporter(), [], PrecomputeOptions(KINDS, workers=1))
    precompute(small_copy, SilentReporter(), [], PrecomputeOptions(KINDS, workers=2))
    assert verify(small_copy) == []
    _assert_equal_arrays(small_copy, alone, 1e-5)


THREAD_TOLERANCE = 2e-3
"""Of the standard deviation of occlusion, which is a difference of two nearly equal errors: with
other numbers of threads, matrix products add in another order (documented in the guide)."""


def _assert_equal_arrays(path: Path, reference: Path, tolerance: float) -> None:
    with s2rstore.open(path) as store, s2rstore.open(reference) as other:
        assert store.run("vanilla").key == other.run("vanilla").key
        for record in store.array_kinds("vanilla"):
            if record.kind in ("pca", "umap"):
                continue
            names = record.kind, record.side, record.mode
            computed_array = np.asarray(store.array("vanilla", *names)[1][:], dtype=np.float64)
            reference_array = np.asarray(other.array("vanilla", *names)[1][:], dtype=np.float64)
            atol = tolerance
            if tolerance and record.kind == "occlusion":
                atol = max(tolerance, THREAD_TOLERANCE * float(np.nanstd(reference_array)))
            assert np.allclose(
                computed_array, reference_array, atol=atol, rtol=1e-3, equal_nan=True
            ), record


class _EndingReporter(SilentReporter):
    """Ends the precompute after its first units, as ctrl+c does."""

    def advance(self, steps: int) -> None:
        super().advance(steps)
        if self.steps > 15:
            raise KeyboardInterrupt


def test_an_interrupted_precompute_loses_only_unfinished_units(
    computed_store, trained_store, tmp_path
):
    path, options = copy_store(trained_store, tmp_path / "s.s2r"), PrecomputeOptions(KINDS)
    with pytest.raises(KeyboardInterrupt):
        precompute(path, _EndingReporter(), [], options)
    complete = {file: file.stat().st_mtime_ns for file in _finished(path)}
    assert complete
    with s2rstore.open(path) as store:
        assert store.run("vanilla").key is None
    precompute(path, SilentReporter(), [], options)
    assert verify(path) == []
    assert not list((path / "units").iterdir())
    kept = {file: time for file, time in complete.items() if "runs.zarr" in file.parts}
    assert {file: file.stat().st_mtime_ns for file in kept} == kept
    _assert_equal_arrays(path, computed_store, 1e-5)


@pytest.mark.deep
def test_a_killed_precompute_loses_only_unfinished_units(computed_store, trained_store, tmp_path):
    path = copy_store(trained_store, tmp_path / "s.s2r")
    for number in range(3):
        _start_and_kill(path, tmp_path, number)
    recorded = [path / e.path for e in Ledger(path).entries() if e.path.startswith("runs.zarr")]
    complete = {p: p.stat().st_mtime_ns for p in recorded}
    assert _finished(path)
    precompute(path, SilentReporter())
    assert verify(path) == []
    assert {p: p.stat().st_mtime_ns for p in complete} == complete
    assert not list((path / "units").iterdir())
    _assert_equal_arrays(path, computed_store, 0)


class _RoundsReporter(SilentReporter):
    """Records, when a stage begins, which kinds of arrays each run has published."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path, self.seen = path, list[tuple[str, dict[str, set[str]]]]()

    def begin(self, stage: str, total: int) -> None:
        super().begin(stage, total)
        with s2rstore.open(self._path) as store:
            kinds = {run: {r.kind for r in store.array_kinds(run)} for run in store.runs}
            self.seen.append((stage, kinds))
            for run in store.runs.values():
                assert (run.key is None) == (not kinds[run.run])
        progress = compute_progress.read(LocalFiles(self._path))
        assert progress is not None
        assert progress.text.startswith(f"computing {stage} 0/{total}")


def test_predictions_of_all_runs_are_published_before_any_heatmap(trained_store, tmp_path):
    path = copy_store(trained_store, tmp_path / "s.s2r")
    dim = {"sim": [], "real": [{"name": "brightness", "value": 0.8}]}
    add_run(path, "dim", "vanilla", None, None, dim)
    reporter, before = _RoundsReporter(path), _generations(path)
    precompute(path, reporter, [], PrecomputeOptions(("feature_distance", "occlusion")))
    assert len(_generations(path) - before) == KEPT
    stages = [stage for stage, _ in reporter.seen]
    heatmaps = next(kinds for stage, kinds in reporter.seen if stage == "vanilla: maps")
    occlusion = next(kinds for _, kinds in reporter.seen if "umap" in kinds["dim"])
    assert stages[:2] == ["vanilla: forward", "dim: forward"]
    assert list(heatmaps.values()) == [{"prediction", "embedding"}] * 2
    for kinds in occlusion.values():
        assert {"feature_distance", "map:feature_distance", "umap"} <= kinds
        assert "occlusion" not in kinds
    assert compute_progress.read(LocalFiles(path)) is None


def _generations(path: Path) -> set[Path]:
    return set((path / "index").glob("*.duckdb"))


def test_a_run_that_cannot_be_computed_stops_no_other_run(trained_store, tmp_path, monkeypatch):
    path = copy_store(trained_store, tmp_path / "s.s2r")
    dim = {"sim": [], "real": [{"name": "brightness", "value": 0.8}]}
    add_run(path, "dim", "vanilla", None, None, dim)
    choose = pipeline.run_backends

    def refuse(store: Store, run: Run, *arguments: object) -> RunBackends:
        if run.run == "vanilla":
            raise RequestError("run 'vanilla': no backend")
        return choose(store, run, *arguments)

    monkeypatch.setattr(pipeline, "run_backends", refuse)
    with pytest.raises(RequestError, match="run 'vanilla': no backend"):
        precompute(path, SilentReporter(), [], PrecomputeOptions(KINDS))
    with s2rstore.open(path) as store:
        assert store.run("vanilla").key is None
        assert {"feature_distance", "umap"} <= {record.kind for record in store.array_kinds("dim")}


def _start_and_kill(path: Path, tmp_path: Path, number: int) -> None:
    """Start a precompute and kill it once it has finished a unit."""
    command = [sys.executable, "-m", "s2rtui", "precompute", str(path)]
    before = _finished(path)
    with (tmp_path / f"{number}.log").open("w") as log:
        process = subprocess.Popen(command, stderr=log, stdout=log)
        deadline = time.monotonic() + 120
        while _finished(path) == before and process.poll() is None:
            assert time.monotonic() < deadline
            time.sleep(0.002)
        process.send_signal(signal.SIGKILL)
        process.wait()


def _finished(path: Path) -> set[Path]:
    """The results of units and the files of shards."""
    results = (p for p in (path / "units").rglob("*") if p.name.isdigit())
    return {*results, *(path / "runs.zarr").rglob("c.*")}


class _TakingReporter(SilentReporter):
    """Removes the lock of the running precompute when it reports its first work."""

    def __init__(self, lock: Path) -> None:
        super().__init__()
        self._lock = lock

    def begin(self, what: str, total: int) -> None:
        self._lock.unlink(missing_ok=True)


def test_a_precompute_that_lost_its_lock_publishes_nothing(trained_store, tmp_path):
    path = copy_store(trained_store, tmp_path / "s.s2r")
    reporter = _TakingReporter(path / "ledger" / "compute.lock")
    with pytest.raises(StoreBusyError, match="compute lock was removed"):
        precompute(path, reporter, ["vanilla"], PrecomputeOptions(()))
    with s2rstore.open(path) as store:
        assert store.run("vanilla").key is None


def test_invalid_requests_list_the_valid_values(small_copy):
    with pytest.raises(RequestError, match="runs: vanilla"):
        precompute(small_copy, SilentReporter(), ["nothing"])
    with pytest.raises(RequestError, match="activation"):
        precompute(small_copy, SilentReporter(), [], PrecomputeOptions(("heat",)))
    with pytest.raises(RequestError, match="backend"):
        precompute(small_copy, SilentReporter(), [], PrecomputeOptions(backend="abacus"))
    with pytest.raises(RequestError, match="models: vanilla"):
        add_run(small_copy, "x", "nothing", None, None, {"sim": [], "real": []})


@pytest.mark.parametrize("is_removed", [True, False], ids=["removed", "registered anew"])
def test_a_run_that_is_not_what_was_computed_is_not_published(
    computed_store, tmp_path, monkeypatch, is_removed
):
    path = copy_store(computed_store, tmp_path / "s.s2r")
    tables = "prediction", "projection", "zarr_array"
    with edit(path) as draft:  # all arrays are there, and not published
        for table in tables:
            draft.delete(table, run="black")
        draft.update("run", {"run": "black"}, {"key": None})

    def changed(root: Path, check: Callable[[], None]) -> AbstractContextManager[IndexTransaction]:
        with edit(path) as draft:
            if is_removed:
                draft.delete("run", run="black")
            else:
                draft.update("run", {"run": "black"}, {"real_adjustments": "[]"})
        return edit(root, check)

    monkeypatch.setattr(publish_results, "edit", changed)
    with pytest.raises(RequestError, match="'black': was removed or registered anew meanwhile"):
        precompute(path, SilentReporter(), ["black"], PrecomputeOptions(()))
    assert verify(path) == []
    with s2rstore.open(path) as store:
        assert not any(
            store.execute(f"SELECT 1 FROM {table} WHERE run = 'black'") for table in tables
        )
