"""Loaded by Dask workers of tests: units take longer, or wait for a file.

`S2R_TEST_UNIT_SECONDS` is the time that a unit takes in addition. In the folder `S2R_TEST_GATE`,
where it is set, each job leaves a file when it begins a unit, and units wait for the file `open`.
"""

import os
import time
from pathlib import Path
from typing import Any

from s2rtools.precompute.unit_computer import UnitComputer
from s2rtools.precompute.work_units import FORWARD, WorkUnit

_SECONDS = float(os.environ.get("S2R_TEST_UNIT_SECONDS", "0"))
_GATE = os.environ.get("S2R_TEST_GATE")


def dask_setup(worker: Any) -> None:
    """Called by Dask when the worker starts."""
    compute = UnitComputer.__call__

    def slow_compute(self: UnitComputer, unit: WorkUnit) -> Any:
        if unit.stage.name == FORWARD:
            time.sleep(_SECONDS)
            if _GATE:
                (Path(_GATE) / f"begun-{os.environ['SLURM_JOB_ID']}").touch()
                while not (Path(_GATE) / "open").exists():
                    time.sleep(0.02)
        return compute(self, unit)

    UnitComputer.__call__ = slow_compute  # type: ignore[method-assign]
