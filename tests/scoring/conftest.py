"""A small default world that the tests of scores share."""

from pathlib import Path

import pytest

from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
from s2rtools.training import pretrained
from s2rtui.cli import main
from tests.conftest import BuildOnce
from tests.support.silent_reporter import SilentReporter


@pytest.fixture(scope="session")
def world_with_all_factors(build_once: BuildOnce) -> Path:
    """Six instances of each trajectory, two runs with one heatmap kind; no test modifies it."""
    return build_once("all-factors.s2r", _build)


def _build(path: Path) -> None:
    assert main(["ingest", "world", "--instances", "6", "--size", "64", "--store", str(path)]) == 0
    pretrained.add_pretrained_models(path)
    precompute(
        path, SilentReporter(), ["vanilla", "finetune"], PrecomputeOptions(("pixel_difference",))
    )
