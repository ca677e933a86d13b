"""True and predicted trajectories in the format of the TUM RGB-D benchmark, which evo reads."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import SIDES
from s2rtui.export.other_programs.content import ExportContent, Floats


def write(content: ExportContent, path: Path) -> None:
    """Write `TRAJECTORY-truth.txt`, `-sim.txt` and `-real.txt`: time, position and quaternion.

    The frame is that of the map. Instances without a prediction have no line in its file; `evo_ape`
    matches the others by their times.
    """
    truth = content.store.instances
    poses = {"truth": np.stack([truth.x, truth.y, truth.heading], axis=1)}
    poses |= {side: content.predicted(side) for side in SIDES}
    for name, iids in content.trajectories():
        for which, every in poses.items():
            kept = iids[np.isfinite(every[iids]).all(axis=1)]
            if kept.size:
                lines = _lines(content.times[kept], every[kept])
                (path / f"{name}-{which}.txt").write_text(lines, encoding="utf-8")


def _lines(times: Floats, poses: NDArray[np.float64]) -> str:
    lines = [
        f"{time:.6f} {x:.9g} {y:.9g} 0 0 0 {math.sin(h / 2):.9g} {math.cos(h / 2):.9g}\n"
        for time, (x, y, h) in zip(times.tolist(), poses.tolist(), strict=True)
    ]
    return "".join(lines)
