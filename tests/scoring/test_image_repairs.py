"""Repairing images in the order of a heatmap."""

from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
from s2rtools.scoring.image_repairs import SHARES, score_image_repairs
from tests.support.copies import copy_store
from tests.support.silent_reporter import SilentReporter


@pytest.fixture(scope="module")
def with_harm(world_with_all_factors: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = copy_store(world_with_all_factors, tmp_path_factory.mktemp("harm") / "all.s2r")
    options = PrecomputeOptions(("pixel_difference", "harm", "harm_fine"))
    precompute(path, SilentReporter(), ["vanilla"], options)
    return path


def test_repairs_by_harm_lower_the_error_more_than_at_random(with_harm):
    with s2rstore.open(with_harm) as store:
        rows = score_image_repairs(store, ["vanilla"], 12)
    by_kind = {(row.kind, row.mode, row.share): row for row in rows}
    assert len(by_kind) == len(rows) == 5 * len(SHARES)
    for kind in ("harm", "harm_fine"):
        gains = [by_kind[kind, "position", share].gain.value for share in SHARES]
        assert gains[1] > 0
        assert by_kind[kind, "position", 0.1].over_random.value > 0
    for share in SHARES:
        assert by_kind["random", None, share].over_random.value == 0
    assert {row.n for row in rows} == {12}


def test_the_published_shares_sum_to_the_gap(with_harm):
    with s2rstore.open(with_harm) as store:
        columns = store.run_columns("vanilla")
        names = ("lighting", "depth", "objects", "sensor", "camera")
        total = sum(getattr(columns.real, f"share_{name}") for name in names)
        assert np.abs(total - columns.gap).max() < 1e-3


def test_repairs_are_printed(with_harm, s2r):
    command = ["score", str(with_harm), "--image-repairs", "--run", "vanilla", "--views", "4"]
    assert "harm_fine" in s2r(*command).printed
    rows = s2r(*command, "--json").json
    assert {row["n"] for row in rows} == {4}


def test_without_calibrated_rigs_the_reason_is_told(world_with_all_factors, s2r):
    s2r("score", world_with_all_factors, "--image-repairs", "--views", "3").assert_refused(
        "not calibrated"
    )


@pytest.mark.parametrize("views", ["1", "-3", "100001"])
def test_numbers_of_views_out_of_range_are_refused(world_with_all_factors, s2r, views):
    words = ["score", str(world_with_all_factors), "--image-repairs", "--views", views]
    s2r(*words).assert_refused(f"--views {views}: 2 .. 100000")
