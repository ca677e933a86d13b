"""Loaded by Dask workers of tests: units wait for a file.

In the folder `S2R_TEST_GATE` each job leaves a file when it begins a unit, and units wait for the
file `open`.
"""

import os
import time
from pathlib import Path
from typing import Any

from s2rtools.precompute.unit_computer import UnitComputer
from s2rtools.precompute.work_units import FORWARD, WorkUnit

_GATE = Path(os.environ["S2R_TEST_GATE"])


def dask_setup(worker: Any) -> None:
    """Called by Dask when the worker starts."""
    compute = UnitComputer.__call__

    def waiting_compute(self: UnitComputer, unit: WorkUnit) -> Any:
        if unit.stage.name == FORWARD:
            (_GATE / f"begun-{os.environ['SLURM_JOB_ID']}").touch()
            while not (_GATE / "open").exists():
                time.sleep(0.02)
        return compute(self, unit)

    UnitComputer.__call__ = waiting_compute  # type: ignore[method-assign]
