"""Small worlds with one factor and with none."""

from pathlib import Path

import pytest

from s2rstore.index.transaction import edit
from s2rtools.datasets.importers import IMPORTERS
from s2rtools.datasets.scan import ScanOptions
from s2rtools.datasets.writing.build import build
from s2rtools.models import build_network
from s2rtools.models.model_registration import pack_weights, register_model
from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
from s2rtools.precompute.run_registration import insert_run
from s2rtools.synthetic_world.factors import parse_factors
from tests.conftest import BuildOnce
from tests.support.silent_reporter import SilentReporter

PIXELS = 32


def world(path: Path, factors: str) -> None:
    """A small world with a computed run `r` of an untrained network."""
    import torch

    recipe = {"seed": 2, "count": 56, "survey": 0, "factors": parse_factors(factors)}
    scan = IMPORTERS["world"](Path(), ScanOptions(frame=(PIXELS, PIXELS), world=recipe))
    build(scan, path, "test", False, lambda steps: None)
    torch.manual_seed(0)
    network = build_network("resposenet")
    with edit(path) as draft:
        register_model(path, draft, "m", pack_weights(network), network.convention)
        insert_run(draft, "r", "m", ("sim", "real"))
    precompute(path, SilentReporter(), ["r"], PrecomputeOptions((), workers=1))


@pytest.fixture(scope="session")
def camera_world(build_once: BuildOnce) -> Path:
    return build_once("camera-world.s2r", lambda path: world(path, "camera"))


@pytest.fixture(scope="session")
def null_world(build_once: BuildOnce) -> Path:
    return build_once("null-world.s2r", lambda path: world(path, "none"))
