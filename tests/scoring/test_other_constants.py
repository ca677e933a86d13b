"""A store of a world whose camera and sensors differ from the default ones."""

from pathlib import Path

import numpy as np

import s2rstore
from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
from s2rtools.scoring.counterfactual_errors import CounterfactualErrors, open_runs
from s2rtools.scoring.ground_truth import GroundTruth
from s2rtools.scoring.report import ScoreSettings, score
from s2rtools.training import pretrained
from s2rtui.cli import main
from tests.support.silent_reporter import SilentReporter


def test_counterfactuals_use_the_constants_of_the_store(tmp_path):
    """Rendered again with all factors, the errors are the stored ones; the world is found again."""
    path = tmp_path / "other.s2r"
    constants = "exposure.vignette=0.5,depth.farthest=4,sensor.noise=9,camera.height=-0.05"
    factors = "lights,exposure,sensor,depth,camera"
    arguments = ["ingest", "world", "--instances", "2", "--size", "64", "--factors", factors]
    assert main([*arguments, "--constants", constants, "--store", str(path)]) == 0
    pretrained.add_pretrained_models(path)
    precompute(path, SilentReporter(), ["vanilla"], PrecomputeOptions(()))
    with s2rstore.open(path) as store:
        truth = GroundTruth(store)
        errors = CounterfactualErrors(truth, open_runs(store, ["vanilla"]))
        iids = np.arange(len(store.instances))
        found = errors.of_instances(iids, {"none": {}, "all": errors.active})
        for label, side in (("none", "sim"), ("all", "real")):
            stored = store.run_columns("vanilla").side(side).error
            assert np.allclose(found[label]["vanilla"], stored, atol=1e-4)
        assert store.frames("real", 0, 4)["depth"].max() < 4800
    assert_scored_without_objects(path)


def assert_scored_without_objects(path: Path) -> None:
    """Where no object was changed there are no pairs, and the objects have no share."""
    settings = ScoreSettings(("vanilla",), instances=2, harm=True, views=4)
    harm = score(path, settings, SilentReporter())["harm"]
    assert {(row["n"], row["auroc"]) for row in harm["kinds"]} == {(0, None)}
    assert harm["repairs"] == []
    means = {row["group"]: row["mean"] for row in harm["shares"]}
    assert means["objects"] == 0 != means["lighting"]


def test_unknown_constants_are_refused(tmp_path, s2r):
    arguments = ["ingest", "world", "--constants", "depth.range=3"]
    s2r(*arguments, "--store", tmp_path / "no.s2r").assert_refused("depth.farthest")
