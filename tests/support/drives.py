"""Drives of a robot and its simulator, as logs in a store."""

from pathlib import Path

import numpy as np

RADII = {"narrow": 1.0, "wide": 2.0}
"""Metres of the curve of each drive."""


def add_drives(store: Path) -> None:
    """Drives of 3 s at 1 rad/s; the simulator begins .25 s later and drives a wider curve."""
    for name, radius in RADII.items():
        folder = store / "drives" / name
        folder.mkdir(parents=True)
        for log, start, step, r in (("real", 5.0, 0.1, radius), ("sim", 5.25, 0.25, 1.2 * radius)):
            times = np.arange(start, 8.05, step)
            turns = times - 5.0
            rows = np.stack([times, r * np.sin(turns), r * (1 - np.cos(turns)), turns], axis=1)
            np.savetxt(
                folder / f"{log}.csv", rows, "%.6f", ",", header="time,x,y,heading", comments=""
            )
