"""The stage in which one pass serves predictions, occlusion and the other heatmaps."""

import multiprocessing
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from bench.measured_stores import QUIET, frames_store, lively
from s2rstore.errors import RequestError
from s2rstore.index.transaction import edit
from s2rstore.records import SIDES
from s2rtools.precompute import pipeline
from s2rtools.precompute.executors import local_executors
from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
from s2rtools.precompute.run_registration import insert_run

KINDS = ("activation", "feature_distance", "occlusion")
BACKENDS = ("torch", "winograd")
INSTANCES, PIXELS = 2, 48


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs by two backends of a network of local operations; the real images are darker."""
    path = frames_store(
        tmp_path_factory.mktemp("winograd") / "s.s2r", INSTANCES, PIXELS, lively("posest")
    )
    darker = [{"name": "brightness", "value": 0.7}]
    with edit(path) as draft:
        for name in BACKENDS:
            insert_run(draft, name, "m", ("sim", "real"), {"sim": [], "real": darker})
    for name in BACKENDS:
        precompute(path, QUIET, [name], PrecomputeOptions(KINDS, workers=1, backend=name))
    return path


@pytest.mark.parametrize(
    ("kind", "tolerance"),
    [("prediction", 1e-5), ("embedding", 2e-3), *((kind, 5e-3) for kind in KINDS)],
)
def test_arrays_equal_those_of_torch(store, kind, tolerance):
    with s2rstore.open(store) as opened:
        records = [each for each in opened.array_kinds("torch") if each.kind == kind]
        assert records
        for each in records:
            exact, found = (
                np.asarray(opened.array(run, kind, each.side, each.mode)[1][:], np.float64)
                for run in BACKENDS
            )
            assert exact.std() > 0
            np.testing.assert_allclose(found, exact, rtol=0, atol=tolerance * exact.std())


def test_the_sides_differ_and_the_provenance_names_the_backend(store):
    with s2rstore.open(store) as opened:
        sim, real = (
            opened.heatmaps("winograd", "occlusion", side, 0, INSTANCES, "rgb") for side in SIDES
        )
        assert np.abs(sim - real).max() > 0.1 * sim.std()
        for name in BACKENDS:
            found = opened.provenance_object(f"run:{name}", "backend")
            assert found["predictions"]["name"] == name


def test_workers_end_with_a_failed_request(store, monkeypatch):
    """Workers are started before the backends are chosen."""
    started = []

    def refuse(*arguments: object, **named: object) -> None:
        started.extend(multiprocessing.active_children())
        raise RequestError("no backend suits")

    monkeypatch.setattr(local_executors, "available_processors", lambda: 2)
    monkeypatch.setattr(local_executors, "default_workers", lambda instances: 2)
    monkeypatch.setattr(pipeline, "run_backends", refuse)
    with pytest.raises(RequestError, match="no backend suits"):
        precompute(store, QUIET, ["r"], PrecomputeOptions(KINDS))
    assert started
    assert not any(process.is_alive() for process in started)
