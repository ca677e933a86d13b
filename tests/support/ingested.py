"""Build a small store with `s2r ingest`'s functions: floor plan, drives and model weights."""

from pathlib import Path

import numpy as np

from s2rstore.index.transaction import edit
from s2rtools.datasets.importers import IMPORTERS
from s2rtools.datasets.scan import ScanOptions
from s2rtools.datasets.writing.build import build
from s2rtools.models.conventions import OutputConvention
from s2rtools.models.input_contract import InputContract
from s2rtools.models.model_registration import Weights, register_model
from tests.support import pairs

LOGS = ("real", "sim", "untuned", "commands")


def build_ingested_store(path: Path, n: int = 4) -> None:
    """Write the store at `path`; its data set lies beside it."""
    data = path.with_name(f"{path.stem}-data")
    header = pairs.sim2realviz(data, n=n)
    scan = IMPORTERS["sim2realviz"](data, ScanOptions(header=header, frame=(16, 16)))
    scan.floor_plan = np.random.default_rng(0).integers(0, 255, (40, 60, 3)).astype(np.uint8)
    scan.drives = _write_drives
    build(scan, path, "s2r ingest", False, lambda steps: None)
    content = bytes(range(256)) * 4
    weights = Weights(
        "resposenet", "a" * 64, content, ".safetensors", InputContract(size=(16, 16)), 4
    )
    with edit(path) as draft:
        register_model(path, draft, "m", weights, OutputConvention("cos_sin"))


def _write_drives(folder: Path) -> None:
    for name in ("one", "two"):
        (folder / name).mkdir(parents=True)
        for log in LOGS:
            (folder / name / f"{log}.csv").write_text("time,x,y,heading\n0,0,0,0\n1,1,0,0\n")
