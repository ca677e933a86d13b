"""A run whose model executes code does not stop the others."""

from pathlib import Path

import pytest
import torch

import s2rstore
from s2rstore.errors import RequestError
from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
from s2rtui.cli import main
from tests.support.copies import copy_store
from tests.support.predictions import make, write_csv
from tests.support.silent_reporter import SilentReporter


class Network(torch.nn.Module):
    """Returns the same pose for every image of 8 x 8."""

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return x.flatten(1)[:, :4] * 0 + 1


@pytest.fixture
def store(tiny_store: Path, tmp_path: Path) -> Path:
    """Its runs are `vanilla`..., the first `strange` with an archive, and `theirs`, imported."""
    path, file = copy_store(tiny_store, tmp_path / "s.s2r"), tmp_path / "net.pt"
    torch.jit.trace(Network(), torch.zeros(1, 4, 8, 8)).save(str(file))
    (tmp_path / "net.toml").write_text('size = [8, 8]\nconvention = "cos_sin,map"\n')
    command = ["model", "add", "archive", str(file), "--arch", "torchscript", "--trust",
               "--input", str(tmp_path / "net.toml"), "--store", str(path)]  # fmt: skip
    assert main(command) == 0
    return path


def test_other_runs_are_computed_and_the_untrusted_one_is_told(store, tmp_path, s2r):
    added = s2r("run", "add", "strange", "--model", "archive", "--store", store).printed
    assert f"next: `s2r precompute {store} --trust`, which executes the code" in added
    predictions = write_csv(tmp_path / "p.csv", make(store))
    command = ["run", "import", "theirs", "--predictions", str(predictions), "--store", str(store)]
    assert main(command) == 0
    options = PrecomputeOptions(("pixel_difference",))
    with pytest.raises(RequestError, match=r"not computed: strange; .* add --trust"):
        precompute(store, SilentReporter(), ["strange", "theirs"], options)
    with s2rstore.open(store) as opened:
        assert opened.runs["strange"].key is None
        assert "pixel_difference" in {record.kind for record in opened.array_kinds("theirs")}
    rows = {row.split(",")[0]: row for row in s2r("runs", store, "--format", "csv").lines}
    assert "s2r precompute --trust (its model executes code)" in rows["strange"]
