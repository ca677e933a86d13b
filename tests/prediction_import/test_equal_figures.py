"""Predictions of a run, exported and imported under another name, give equal figures everywhere."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.maintenance.verify import verify
from s2rstore.records import SIDES
from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
from s2rtui.cli import main
from tests.conftest import BuildOnce
from tests.support.appended import append_trajectory
from tests.support.silent_reporter import SilentReporter

KINDS = ("activation", "pixel_difference")
ARRAYS = (
    "prediction", "embedding", "pca", "umap", "neighbour_distance", "pixel_difference",
    "map:pixel_difference",
)  # fmt: skip


def sql(store: Path, query: str, out: Path) -> Path:
    assert main(["sql", str(store), query, "--format", "csv", "--out", str(out)]) == 0
    return out


def import_exported(store: Path, folder: Path, name: str = "exported") -> None:
    """Import the predictions and embeddings of run `vanilla` as another run."""
    query = "SELECT * EXCLUDE run FROM prediction WHERE run = 'vanilla' ORDER BY iid % 7, side, iid"
    file = sql(store, query, folder / "predictions.csv")
    order = np.genfromtxt(file, delimiter=",", names=True, dtype=None, encoding="utf-8")
    words = ["run", "import", name, "--predictions", str(file), "--store", str(store)]
    with s2rstore.open(store) as opened:
        for side in SIDES:
            _, array = opened.array("vanilla", "embedding", side)
            iids = order["iid"][order["side"] == side]
            np.save(folder / f"{side}.npy", array.at(iids))
            words += ["--embeddings", f"{side}:{folder}/{side}.npy"]
    assert main(words) == 0


@pytest.fixture(scope="module")
def imported(trained_store: Path, build_once: BuildOnce) -> Path:
    """A store with the computed runs `vanilla` and, imported from its predictions, `exported`."""
    return build_once("imported", lambda folder: _build(trained_store, folder)) / "s.s2r"


def _build(trained_store: Path, folder: Path) -> None:
    store = folder / "s.s2r"
    shutil.copytree(trained_store, store)
    precompute(store, SilentReporter(), ["vanilla"], PrecomputeOptions(KINDS))
    import_exported(store, folder)
    reporter = SilentReporter()
    assert precompute(store, reporter, ["exported"], PrecomputeOptions(KINDS)) == ["exported"]
    assert any("activation left out" in line for line in reporter.lines)


def test_all_arrays_without_a_network_are_equal(imported):
    with s2rstore.open(imported) as store:
        found = {(r.kind, r.side, r.mode): r for r in store.array_kinds("exported")}
        expected = {
            (r.kind, r.side, r.mode): r for r in store.array_kinds("vanilla") if r.kind in ARRAYS
        }
        assert found.keys() == expected.keys()
        for key, record in found.items():
            values, others = (np.asarray(store.stored(r)[:]) for r in (record, expected[key]))
            assert values.dtype == others.dtype
            np.testing.assert_allclose(
                values.astype(float), others.astype(float), rtol=1e-5, atol=1e-5, err_msg=str(key)
            )


def test_all_rows_are_equal(imported):
    columns = "iid, * EXCLUDE (run, iid, outlier, sim_u, sim_v, real_u, real_v)"
    with s2rstore.open(imported) as store:
        columns = columns.replace("outlier, ", "")
        query = f"SELECT {columns} FROM pair WHERE run = ? ORDER BY iid"
        names = [d[0] for d in store.connection().execute(query, ["vanilla"]).description]
        found, expected = (store.execute(query, [run]) for run in ("exported", "vanilla"))
    assert len(found) == 40
    for row, other in zip(found, expected, strict=True):
        for name, a, b in zip(names, row, other, strict=True):
            if name.endswith("_outlier"):
                assert a == pytest.approx(b, rel=1e-4)
            else:
                assert a == b, name


@pytest.mark.parametrize("words", [
    ("export", "{store}", "--run", "exported", "--view", "geomap", "--heat", "activation",
     "--out", "{out}.png"),
    ("train", "--recipe", "finetune", "--from", "exported", "--store", "{store}"),
])  # fmt: skip
def test_commands_that_need_a_network_name_the_run(imported, tmp_path, words, s2r):
    result = s2r(*[word.format(store=imported, out=tmp_path / "f") for word in words])
    result.assert_refused("run 'exported': its predictions were imported", "needs a network")


def test_lost_predictions_have_to_be_imported_again(imported, tmp_path):
    path = tmp_path / "s.s2r"
    shutil.copytree(imported, path)
    with s2rstore.open(path) as store:
        arrays = {(r.kind, r.side): r.path for r in store.array_parts("exported")}
    for name in (arrays["prediction", "sim"], arrays["umap", "real"]):
        (shard,) = (path / "runs.zarr" / name).glob("c*")
        shard.unlink()
    files = sorted(path.rglob("c.*"))
    for restart in (False, True):
        options = PrecomputeOptions((), restart=restart)
        with pytest.raises(RequestError, match="its imported arrays are missing; import it again"):
            precompute(path, SilentReporter(), ["exported"], options)
        assert sorted(path.rglob("c.*")) == files


def test_instances_that_are_appended_stay_without_predictions(imported, tmp_path, capsys):
    store = tmp_path / "s.s2r"
    shutil.copytree(imported, store)
    append_trajectory(store, "zz", 5)
    options = PrecomputeOptions(("pixel_difference",))
    precompute(store, SilentReporter(), ["exported"], options)
    with s2rstore.open(store) as opened:
        assert opened.coverage("exported").summary == "imported for 40 of 45 instances"
        assert np.count_nonzero(opened.run_columns("exported").valid) == 40
        assert np.isnan(opened.run_columns("exported").sim.x[40:]).all()
    assert verify(store) == []
    assert main(["show", str(store), "rooms", "--run", "exported"]) == 0
    note = "run exported: imported for 40 of 45 instances"
    assert note in capsys.readouterr().err
    import_exported(store, tmp_path, "again")
    precompute(store, SilentReporter(), ["again"], options)
    assert verify(store) == []


def test_precompute_of_an_import_that_was_replaced_is_refused(
    imported, tmp_path, monkeypatch, capsys
):
    from s2rtools.precompute import pipeline

    store = tmp_path / "s.s2r"
    shutil.copytree(imported, store)
    query = "SELECT iid, side, x + 0.1 AS x, y, heading FROM prediction WHERE run = 'vanilla'"
    file = sql(store, query, tmp_path / "moved.csv")
    words = ["run", "import", "exported", "--predictions", str(file), "--store", str(store)]
    compute = pipeline._compute_stages

    def replaced(*arguments: object) -> None:
        compute(*arguments)  # type: ignore[arg-type]
        if not (tmp_path / "done").exists():
            (tmp_path / "done").touch()
            assert main(words) == 0

    monkeypatch.setattr(pipeline, "_compute_stages", replaced)
    with s2rstore.open(store) as opened:
        before = opened.run("exported").key
    with pytest.raises(Exception, match="run 'exported': was imported again meanwhile"):
        precompute(store, SilentReporter(), ["exported"], PrecomputeOptions(KINDS))
    monkeypatch.undo()
    with s2rstore.open(store) as opened:
        assert opened.run("exported").key != before
        assert not any(record.kind == "umap" for record in opened.array_kinds("exported"))
    assert precompute(store, SilentReporter(), ["exported"], PrecomputeOptions(KINDS))
    assert verify(store) == []
