"""Stores of small pairs with a briefly trained model."""

from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from s2rtools.datasets.importers import IMPORTERS
from s2rtools.datasets.scan import ScanOptions
from s2rtools.datasets.writing.build import build
from s2rtools.training.train_into_store import TrainingRequest, train_into_store
from tests.support import pairs

N = 10


def build_small(path: Path, n: int = N, size: int = 32, steps: int = 1) -> None:
    """Write a store of `n` pairs of `size` x `size` pixels; its run `vanilla` is not computed."""
    data = path.with_name(f"{path.stem}-data")
    with TemporaryDirectory() as cache, pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", cache)
        header = pairs.sim2realviz(data, n=n)
        scan = IMPORTERS["sim2realviz"](data, ScanOptions(header=header, frame=(size, size)))
        build(scan, path, "s2r ingest", False, lambda steps: None)
        request = TrainingRequest("vanilla", steps=steps)
        train_into_store(path, request, lambda *progress: None, "s2r train")
