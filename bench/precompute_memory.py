"""Memory of a precompute above that of the loaded process, for small and large stores."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from bench.budget import BudgetRow
from bench.measured_stores import Small, frames_store

_CODE = """
import json, re, sys
from pathlib import Path
import sklearn.decomposition, torch, umap, zarr
import numpy as np
from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
from s2rtools.precompute.tasks.umap_projection import ProjectionSettings, joint_umap
rng = np.random.default_rng(0)
for n in (60, 2400):  # the second size compiles the neighbour search and transform
    warm = rng.random((n, 50), dtype=np.float32)
    joint_umap((warm, warm + 1), np.ones(n, bool), ProjectionSettings(fit_instances=4200))
def status(name):
    text = Path("/proc/self/status").read_text()
    return int(re.search(name + r":\\s+(\\d+)", text)[1]) / 1024
class Quiet:
    def begin(self, what, total): pass
    def advance(self, steps): pass
    def say(self, line): pass
torch.set_num_threads(2)
torch.nn.functional.conv2d(torch.rand(8, 4, 64, 64), torch.rand(24, 4, 5, 5))
Path("/proc/self/clear_refs").write_text("5")
before = status("VmRSS")
precompute(Path(sys.argv[1]), Quiet(), [], PrecomputeOptions((), trust=True))
print(json.dumps(status("VmHWM") - before))
"""


def figures(sizes: tuple[int, ...]) -> Iterator[BudgetRow]:
    """Compute predictions, embeddings, PCA and UMAP of small frames with a small network."""
    for n in sizes:
        folder = Path(tempfile.mkdtemp())
        try:
            path = frames_store(folder / "s.s2r", n, 16, Small().eval())
            command = [sys.executable, "-c", _CODE, str(path)]
            done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
            grown = float(json.loads(done.stdout.splitlines()[-1]))
        finally:
            shutil.rmtree(folder)
        budget = 200 + 100 * n / 1e6
        yield BudgetRow(f"memory of precompute, {n} instances", grown, "MB", budget)
