"""Loaded by Dask workers of tests: units take longer, and one of them ends its worker."""

from __future__ import annotations

import os
import signal
import time
from typing import Any

from s2rtools.precompute.unit_computer import UnitComputer
from s2rtools.precompute.work_units import FORWARD, WorkUnit

_SECONDS = float(os.environ.get("S2R_TEST_UNIT_SECONDS", "0"))
_FATAL = int(os.environ.get("S2R_TEST_FATAL_UNIT", "-1"))


def dask_setup(worker: Any) -> None:
    """Called by Dask when the worker starts."""
    compute = UnitComputer._compute

    def slow_compute(self: UnitComputer, unit: WorkUnit) -> Any:
        if unit.stage.name == FORWARD:
            time.sleep(_SECONDS)
            if unit.number == _FATAL:
                os.kill(os.getpid(), signal.SIGKILL)
        return compute(self, unit)

    UnitComputer._compute = slow_compute  # type: ignore[method-assign]
