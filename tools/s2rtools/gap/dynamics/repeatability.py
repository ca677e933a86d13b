"""Drives of the same commands: what reality differs by from itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from s2rtools.gap.axis_result import GapSettings
from s2rtools.gap.delay import time_delay
from s2rtools.gap.dynamics.windows import WindowPlan, windows
from s2rtools.motion_logs.motion_log import Commands, Drive, Floats

_TIME_TOLERANCE = 1e-3
_QUICK = 20


def same_commands(a: Commands, b: Commands) -> bool:
    """Whether both say the same at the same times after their first."""
    if a.time.size != b.time.size or a.channels.keys() != b.channels.keys():
        return False
    apart = (a.time - a.time[0]) - (b.time - b.time[0])
    return bool(np.abs(apart).max() <= _TIME_TOLERANCE) and all(
        np.allclose(a.channels[name], b.channels[name], atol=1e-9) for name in a.channels
    )


def partners(drives: Sequence[Drive]) -> list[list[int]]:
    """For each drive the others that were given the same commands."""
    return [
        [
            j
            for j, other in enumerate(drives)
            if j != i
            and drive.commands is not None
            and other.commands is not None
            and other.real.sha256 != drive.real.sha256
            and same_commands(drive.commands, other.commands)
        ]
        for i, drive in enumerate(drives)
    ]


def squares(
    drive: Drive,
    others: Sequence[Drive],
    plan: WindowPlan,
    settings: GapSettings,
    furthest: float = 1.0,
) -> Floats:
    """Half the mean square (H, K), m^2, between the windows of a drive and of each other.

    Real against real carries reality's variation twice, real against simulated once.
    """
    assert drive.commands is not None
    found = []
    for other in others:
        assert other.commands is not None
        shift = float(drive.commands.time[0] - other.commands.time[0])
        moved = replace(other.real, time=other.real.time + shift)
        quick = replace(settings, replicates=_QUICK)
        late = time_delay.delay(drive.real, moved, quick, plan.rate, furthest).seconds
        found.append(windows(drive.real, time_delay.without(moved, late), plan).end ** 2)
    stacked = np.stack(found)
    known = np.isfinite(stacked)
    count = known.sum(axis=0)
    return np.where(count > 0, np.nansum(stacked, axis=0) / np.maximum(2 * count, 1), np.nan)
